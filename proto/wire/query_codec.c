/* SPDX-License-Identifier: Apache-2.0 */
/*
 * QueryRequest and QueryReply. Points, normals and answers stay in the message. The encoder and the
 * decoder apply the same checks, so a client reports an error before it sends, in the server's
 * words.
 */
#include "wire/messages.h"

#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <string.h>
#include "base/query_settings.h"
#include "base/try.h"
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/codec.h"

#define PICTURE_BYTES_MAX 512 /* Most bytes of a picture without depths: four times its fields */

/* On the wire 0 is the usual answer, U8. */
static const int FORMATS[] = {UMB_ANSWER_U8, UMB_ANSWER_F32, UMB_ANSWER_BIT};

UMBW_TABLE(PICTURE, umbrage__v1__picture, "picture.", sizeof(struct umb_picture),
           {1, UMBW_AT(umb_picture, camera.eye)}, {2, UMBW_AT(umb_picture, camera.forward)},
           {3, UMBW_AT(umb_picture, camera.up)}, {4, UMBW_AT(umb_picture, camera.fov_y)},
           {5, UMBW_AT(umb_picture, width)}, {6, UMBW_AT(umb_picture, height)});

#define FIELD(member) UMBW_AT(umbw_query_request, member)
#define RECORDS(member, record)                                                                    \
    FIELD(member.at), UMBW_COUNT(umbw_query_request, member.count), .stride = sizeof(record)

/* Fields of the message that are no query settings, and settings that the message stores in another
 * form than the struct. The core checks the range of pixel_rad, which is an angle. */
UMBW_ROWS(OTHER_ROWS, {1, FIELD(asset), .flags = UMBW_CHECKED},
          {6, FIELD(settings.format), .flags = UMBW_CHECKED | UMBW_FILLED, .values = FORMATS},
          {7, FIELD(points.origin), .flags = UMBW_FINITE | UMBW_SPARSE}, {8, FIELD(want_stats)},
          {9, UMBW_COUNT(umbw_query_request, target_count)}, {11, RECORDS(normals, char)},
          {12, RECORDS(f32, float[3])}, {13, RECORDS(f64, double[3])}, {14, RECORDS(depth, float)},
          {21, FIELD(dial.max_error_m)}, {22, FIELD(dial.max_visibility)},
          {23, FIELD(dial.budget_ns)},
          {24, FIELD(picture), UMBW_COUNT(umbw_query_request, has_picture), .table = &PICTURE,
           .most = PICTURE_BYTES_MAX},
          {25, FIELD(pack)}, {26, FIELD(base_mark)}, {32, RECORDS(footprints, char)},
          {34, FIELD(settings.eye), UMBW_COUNT(umbw_query_request, eye_count)},
          {35, FIELD(settings.pixel_rad)});

static struct umbw_row request_rows[UMBW_ROWS_MAX]; /* Made by make_rows */
UMBW_TABLE_OF(REQUEST, umbrage__v1__query_request, "", sizeof(struct umbw_query_request),
              request_rows);

/* Makes the row of a field that has a setting's name. */
static struct umbw_row setting_row(const ProtobufCFieldDescriptor *field)
{
    static const struct {
        size_t size;
        uint32_t flags;
    } KINDS[] = {
        [UMB__SETTING_COUNT] = {sizeof(uint32_t), 0},
        [UMB__SETTING_ODD] = {sizeof(uint32_t), 0},
        [UMB__SETTING_CHOICE] = {sizeof(uint32_t), UMBW_CHECKED},
        [UMB__SETTING_FLAG] = {sizeof(int), 0},
        [UMB__SETTING_NUMBER] = {sizeof(double), 0},
        [UMB__SETTING_NUMBERS] = {3 * sizeof(double), UMBW_FINITE | UMBW_SPARSE},
    };
    for (size_t i = 0; i < umb__setting_count; i++) {
        const struct umb__setting *setting = &umb__settings[i];
        if (strcmp(setting->name, field->name) == 0) {
            return (struct umbw_row){
                .number = field->id,
                .flags = KINDS[setting->kind].flags,
                .offset = offsetof(struct umbw_query_request, settings) + setting->at,
                .size = KINDS[setting->kind].size,
                .most = setting->kind == UMB__SETTING_NUMBER ? setting->most : 0};
        }
    }
    return (struct umbw_row){.flags = UMBW_SENT}; /* no such row: a test compares with the table */
}

static void make_rows(void)
{
    const ProtobufCMessageDescriptor *message = REQUEST.descriptor;
    const size_t other_count = sizeof OTHER_ROWS / sizeof OTHER_ROWS[0];
    for (unsigned i = 0; i < message->n_fields && i < UMBW_ROWS_MAX; i++) {
        size_t other = 0;
        while (other < other_count && OTHER_ROWS[other].number != message->fields[i].id) {
            other++;
        }
        request_rows[i] =
            other < other_count ? OTHER_ROWS[other] : setting_row(&message->fields[i]);
    }
}

static const struct umbw_table *request_table(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    (void)pthread_once(&once, make_rows);
    return &REQUEST;
}

UMBW_TABLE(TARGET, umbrage__v1__target, "targets.", sizeof(struct umbw_query_target),
           {1, UMBW_AT(umbw_query_target, asset), .flags = UMBW_REQUIRED},
           {2, UMBW_AT(umbw_query_target, light)});

static bool is_dialled(const struct umb_dial *dial)
{
    return dial->max_error_m > 0 || dial->max_visibility > 0 || dial->budget_ns > 0;
}

/* Checks the limits of a dial (struct umb_dial: limits of error and time, by which the server
 * chooses taps and level). They must be finite, and the request must set no taps and no level
 * itself. */
static enum umb_status check_dial(const struct umbw_query_request *request, struct umb_error *error)
{
    const uint32_t taps = request->settings.taps, level = request->settings.level;
    const struct umb_dial *dial = &request->dial;
    const double wanted[3] = {dial->max_error_m, dial->max_visibility, dial->budget_ns};
    static const char *const names[3] = {"max_error_m", "max_visibility", "budget_ns"};
    for (int i = 0; i < 3; i++) {
        if (wanted[i] == 0) {
            continue;
        }
        if (!isfinite(wanted[i]) || wanted[i] < 0) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: %.9g, must be finite and not below 0",
                            names[i], wanted[i]);
        }
        if (taps != 0 || level != 0) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "%s: %.9g beside taps %lu and level %lu, which it chooses", names[i],
                            wanted[i], (unsigned long)taps, (unsigned long)level);
        }
    }
    if (dial->budget_ns > 0 && request->target_count > 1) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "budget_ns: %.9g beside %zu targets; it is of one light at a time",
                        dial->budget_ns, request->target_count);
    }
    return UMB_OK;
}

/* Checks the settings of footprints, which belong to one filter. */
static enum umb_status check_footprint(const struct umbw_query_request *request,
                                       struct umb_error *error)
{
    const struct umb_query_settings *settings = &request->settings;
    const char *given = request->footprints.count > 0 ? "footprints"
                        : settings->footprint_m != 0  ? "footprint_m"
                        : settings->pixel_rad != 0    ? "pixel_rad"
                                                      : NULL;
    const bool takes = umb_filter_get_info(settings->filter)->has_footprints;
    if (given != NULL && !takes) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: belongs to the filter 3 (FOOTPRINT), this is %d", given,
                        (int)settings->filter);
    }
    if (request->eye_count > 0 && settings->pixel_rad == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "eye: without pixel_rad; give the angle of a pixel");
    }
    if (takes && given == NULL && request->points.count > 0 && !request->has_picture) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "filter: 3 (FOOTPRINT) without one; give footprints, footprint_m, or eye "
                        "with pixel_rad");
    }
    return UMB_OK;
}

/* Checks a picture, whose depths are the request's points. */
static enum umb_status check_picture(const struct umbw_query_request *request,
                                     struct umb_error *error)
{
    const struct umb_picture *picture = &request->picture;
    const double *origin = request->points.origin;
    if (!request->has_picture) {
        return request->depth.count == 0
                   ? UMB_OK
                   : umb_fail(error, UMB_E_ARGUMENT, "depth: %zu bytes without a picture",
                              request->depth.count * sizeof(float));
    }
    UMB__TRY(umb_picture_check(picture, error));
    if ((uint64_t)picture->width * picture->height != request->points.count) {
        return umb_fail(error, UMB_E_ARGUMENT, "depth: %zu numbers for %u x %u pixels",
                        request->points.count, picture->width, picture->height);
    }
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "origin: beside a picture, which has an eye");
    }
    return UMB_OK;
}

/* Checks fields that depend on other fields, which the table cannot do. Sets the default of
 * taps. */
static enum umb_status check_request(struct umbw_query_request *request, struct umb_error *error)
{
    uint32_t *taps = &request->settings.taps;
    UMB__TRY(check_dial(request, error));
    if (*taps == 0 && !is_dialled(&request->dial)) {
        *taps = 1;
    }
    if (*taps != 0 && (*taps % 2 == 0 || *taps > UMB_TAPS_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "taps: %lu is not odd and within 1..%d",
                        (unsigned long)*taps, UMB_TAPS_MAX);
    }
    if (request->target_count == 0 && request->asset[0] == '\0') {
        return umb_fail(error, UMB_E_ARGUMENT, "asset: is empty, must be a name or an id");
    }
    UMB__TRY(check_footprint(request, error));
    return check_picture(request, error);
}

static enum umb_status check_targets(const struct umbw_query_request *request,
                                     struct umb_error *error)
{
    if (request->target_count > UMBW_TARGETS_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "targets: %zu are over the limit of %d",
                        request->target_count, UMBW_TARGETS_MAX);
    }
    if (request->target_count > 0 && (request->asset[0] != '\0' || request->settings.light != 0)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "targets: %zu, beside asset or light; give either those or targets",
                        request->target_count);
    }
    return UMB_OK;
}

enum umb_status umbw_query_target_next(struct umbw_query_request *request,
                                       struct umbw_query_target *target, struct umb_error *error)
{
    struct umbw_item item = {0};
    while (item.number != 9) { /* targets */
        if (request->targets_at == request->targets_end) {
            return umb_fail(error, UMB_E_ARGUMENT, "targets: there are no more");
        }
        UMB__TRY(umbw_item_read(request->targets_at, &request->targets_at, request->targets_end,
                                &item, error));
    }
    return umbw_decode(&TARGET, item.payload, item.payload_size, target, error);
}

/* Checks the length of an array with one element for each point. Out: place: the array, or NULL. */
static enum umb_status take_beside(const char *name, const struct umbw_records *bytes, size_t each,
                                   const struct umb_points *points, const void **place,
                                   struct umb_error *error)
{
    *place = bytes->count > 0 ? bytes->at : NULL;
    return bytes->count == 0 || bytes->count == points->count * each
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "%s: length is %zu bytes, must be 0 or %zu for %zu points", name,
                          bytes->count, points->count * each, points->count);
}

/* Makes the points of a decoded request from one of the two point fields, or from a picture's
 * depths. */
static enum umb_status take_points(struct umbw_query_request *request, size_t max_points,
                                   struct umb_error *error)
{
    struct umb_points *points = &request->points;
    const size_t f32 = request->f32.count, f64 = request->f64.count;
    const bool picture = request->has_picture;
    if (f32 > 0 && f64 > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "points: %zu bytes, and points_f64: %zu bytes; give only one of them",
                        f32 * sizeof(float[3]), f64 * sizeof(double[3]));
    }
    if (picture && f32 + f64 > 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: beside points; give only one of them");
    }
    const struct umbw_records *field = picture   ? &request->depth
                                       : f64 > 0 ? &request->f64
                                                 : &request->f32;
    const char *name = picture ? "depth" : f64 > 0 ? "points_f64" : "points";
    points->count = field->count;
    if (points->count > max_points) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%s: %zu is over the limit of %zu points", name,
                        points->count, max_points);
    }
    if (request->target_count > 1 && points->count > max_points / request->target_count) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "%s: %zu for each of %zu targets is over the limit of %zu answers", name,
                        points->count, request->target_count, max_points);
    }
    points->positions = points->count > 0 ? field->at : NULL;
    points->format = f64 > 0 ? UMB_POINT_F64 : UMB_POINT_F32;
    request->picture.depth = request->depth.at;
    UMB__TRY(take_beside("normals", &request->normals, 3 * sizeof(float), points, &points->normals,
                         error));
    return take_beside("footprints", &request->footprints, sizeof(float), points,
                       &points->footprints, error);
}

/* Uses the areas of the picture's pixels as footprints if the request sets no footprint. */
static void look_through(const struct umb_picture *picture, struct umb_query_settings *settings)
{
    if (umb_filter_get_info(settings->filter)->has_footprints && settings->footprint_m == 0 &&
        settings->pixel_rad == 0) {
        memcpy(settings->eye, picture->camera.eye, sizeof settings->eye);
        settings->pixel_rad = fmin(2 * tan(picture->camera.fov_y / 2) / picture->height, 1);
    }
}

enum umb_status umbw_decode_query_request(const uint8_t *message, size_t size, size_t max_points,
                                          struct umbw_query_request *request,
                                          struct umb_error *error)
{
    UMB__TRY(umbw_decode(request_table(), message, size, request, error));
    request->targets_at = message;
    request->targets_end = size > 0 ? message + size : message;
    UMB__TRY(check_targets(request, error));
    UMB__TRY(take_points(request, max_points, error));
    UMB__TRY(check_request(request, error));
    if (request->has_picture) {
        look_through(&request->picture, &request->settings);
    }
    return UMB_OK;
}

/* Makes the fields of the message from the points. */
static enum umb_status put_points(struct umbw_query_request *request, struct umb_error *error)
{
    const struct umb_points *points = &request->points;
    const bool wide = points->format == UMB_POINT_F64;
    if (!wide && points->format != UMB_POINT_F32) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: format %d is unknown", (int)points->format);
    }
    if (points->count > UINT32_MAX / 24) { /* Most bytes of a point */
        return umb_fail(error, UMB_E_TOO_LARGE, "points: %zu is over the limit of %zu points",
                        points->count, (size_t)(UINT32_MAX / 24));
    }
    if (!request->has_picture && points->count > 0 && points->positions == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: no positions for %zu points",
                        points->count);
    }
    const size_t scalars = points->count * sizeof(float);
    const struct umbw_records none = {NULL, 0};
    request->f32 = request->f64 = request->depth = none;
    *(request->has_picture ? &request->depth
      : wide               ? &request->f64
                           : &request->f32) = (struct umbw_records){
        request->has_picture ? request->picture.depth : points->positions, points->count};
    request->normals =
        points->normals != NULL ? (struct umbw_records){points->normals, 3 * scalars} : none;
    request->footprints =
        points->footprints != NULL ? (struct umbw_records){points->footprints, scalars} : none;
    return UMB_OK;
}

enum umb_status umbw_encode_query_request(const struct umbw_query_request *request,
                                          struct umbw_buffer *buffer, struct umb_error *error)
{
    struct umbw_query_request copy = *request;
    const double *eye = copy.settings.eye;
    copy.target_count = 0;
    copy.eye_count =
        copy.settings.pixel_rad > 0 || eye[0] != 0 || eye[1] != 0 || eye[2] != 0 ? 3 : 0;
    UMB__TRY(put_points(&copy, error));
    UMB__TRY(check_request(&copy, error));
    return umbw_encode(request_table(), &copy, buffer, error);
}

#define REPLY(member) UMBW_AT(umbw_query_reply, member)

/* Most bytes of the stats, tags included: varints of 64 and 32 bits, doubles, and the tag and
 * length of the message. One of the 64-bit varints has a longer tag. */
#define STATS_MAX (8 * 11 + 12 + 2 * 6 + 5 * 9 + 3)

UMBW_TABLE(STATS, umbrage__v1__query_stats, "stats.", 0, {1, REPLY(stats.points)},
           {2, REPLY(stats.outside)}, {3, REPLY(stats.before)}, {4, REPLY(stats.behind)},
           {5, REPLY(stats.facing_away)}, {6, REPLY(stats.nodes)}, {7, REPLY(stats.bricks)},
           {8, REPLY(nanoseconds)}, {9, REPLY(voxel_m)}, {10, REPLY(level)}, {11, REPLY(taps)},
           {12, REPLY(bound_m)}, {13, REPLY(visibility_error)}, {14, REPLY(lines)},
           {15, REPLY(expected_ns)}, {16, REPLY(stats.undefined)});

UMBW_TABLE(REPLY_TABLE, umbrage__v1__query_reply, "", sizeof(struct umbw_query_reply),
           {1, REPLY(visibility), UMBW_COUNT(umbw_query_reply, visibility_bytes),
            .flags = UMBW_LAST},
           {2, REPLY(asset_id), UMBW_COUNT(umbw_query_reply, has_asset_id)},
           {3, UMBW_COUNT(umbw_query_reply, has_stats), .table = &STATS},
           {4, REPLY(asset_ids), UMBW_COUNT(umbw_query_reply, asset_id_count),
            .stride = UMB_ID_BYTES},
           {5, REPLY(packing), .flags = UMBW_CHECKED | UMBW_NEWER});

enum umb_status umbw_decode_query_reply(const uint8_t *message, size_t size,
                                        struct umbw_query_reply *reply, struct umb_error *error)
{
    UMB__TRY(umbw_decode(&REPLY_TABLE, message, size, reply, error));
    if (reply->asset_id_count > 0) {
        memcpy(reply->asset_id, reply->asset_ids, UMB_ID_BYTES);
    } else if (!reply->has_asset_id) {
        return umb_fail(error, UMB_E_ARGUMENT, "asset_id: length is 0 bytes, must be %d",
                        UMB_ID_BYTES);
    }
    return UMB_OK;
}

size_t umbw_query_reply_room(const struct umbw_query_reply *reply)
{
    const size_t ids = reply->asset_id_count > 0 ? reply->asset_id_count : 1;
    uint8_t length[10];
    size_t room = UMBW_PREFIX_BYTES + ids * (2 + UMB_ID_BYTES);
    room += reply->has_stats ? STATS_MAX : 0;
    room += reply->packing != UMBW_PACKING_PLAIN ? 2 : 0;
    return room + (reply->visibility_bytes > 0
                       ? 1 + umbw_varint_write(reply->visibility_bytes, length)
                       : 0);
}

size_t umbw_write_query_reply_head(const struct umbw_query_reply *reply, uint8_t *bytes)
{
    struct umbw_query_reply copy = *reply;
    copy.has_asset_id = copy.asset_id_count == 0;
    return umbw_write(&REPLY_TABLE, &copy, bytes);
}
