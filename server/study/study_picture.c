/* SPDX-License-Identifier: Apache-2.0 */
/* A picture of a scene with its shadows, band by band; see study_picture.h. */
#include "study/study_picture.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"
#include "study/surface.h"
#include "tool/clock.h"
#include "tool/progress.h"

#define BAND_SAMPLES ((size_t)1 << 19) /* samples of a band: about 50 MB */
#define BAND_TRACED  ((size_t)1 << 16) /* samples of a traced band: the progress line moves often */
#define QUERY_BLOCK  16384             /* points in a request: less than a daemon's usual limit */
#define TRACE_BLOCK  512
#define FIXED_ONE    4294967296.0
#define INTERVALS    256 /* most intervals of a view ray in fog; a ray with more is halved */

/* Sums over receivers that face the light. Sums of |asset - traced| are integers in units of 2^-32,
 * so their order does not matter. */
enum {
    FACING, /* numbers of receivers */
    UNDEFINED,
    OVER_HALF,
    OVER_HALF_DEFINED,
    JUDGED,
    FALSE_SHADOW,
    FALSE_LIGHT,
    LIGHTER, /* sums of |asset - traced| */
    DARKER,
    DEFINED,
    SUMS
};

/* Light that a receiver has got from all lights so far. */
struct received {
    float asset[3], traced[3];
    float difference; /* of the visibilities, asset - traced */
};

struct frame {
    const struct umbt_picture_request *request;
    struct umbt_pictures *pictures;
    struct umbt_picture_result *result;
    struct umbt_gbuffer buffer;
    const struct umbt_picture_light *light; /* the light of the stage that runs */
    size_t room;                            /* size of the next arrays */
    float *answers;                         /* of the asset, for one light */
    float *truths;                          /* of the rays, for one light */
    struct received *received;
    struct umbu_progress progress;
    pthread_mutex_t mutex; /* guards result->stats and the sums while blocks run */
    uint64_t picture_sum;  /* sum of |asset - traced| over 8-bit channels */
    uint64_t sums[SUMS];
};

/* ---- fog ---- */

enum umb_status umbt_fog_make(const struct umb_asset *asset, uint32_t light, double density,
                              struct umbt_fog *fog, struct umb_error *error)
{
    fog->density = density;
    UMB__TRY(umb_volume_prepare(asset, light, &fog->volume, error));
    /* A lamp's falloff is not known, but would dominate the fog: only parallel light is allowed. */
    return umb_volume_check_parallel(&fog->volume, error);
}

/* The lit integral over the part [from, to] of a ray. */
static double lit_between(const struct umbt_fog *fog, const double eye[3], const double way[3],
                          double from, double to)
{
    const double depth = fog->density * umb__length(way);
    struct umb_interval intervals[INTERVALS];
    struct umb_segment_answer answer;
    struct umb_segment_answers answers = {
        .segments = &answer, .intervals = intervals, .interval_max = INTERVALS};
    double ends[6], sum = 0.0;
    for (int k = 0; k < 3; k++) {
        ends[k] = way[k] * from;
        ends[3 + k] = way[k] * to;
    }
    struct umb_segments segments = {.ends = ends, .format = UMB_POINT_F64, .count = 1};
    memcpy(segments.origin, eye, sizeof segments.origin);
    umb_volume_segments(&fog->volume, &segments, 0, 1, &answers);
    if (answer.interval_count > INTERVALS) {
        /* Halving ends: a piece as long as a voxel crosses few voxels. */
        const double middle = 0.5 * (from + to);
        return lit_between(fog, eye, way, from, middle) + lit_between(fog, eye, way, middle, to);
    }
    for (uint64_t i = 0; i < answer.interval_count; i++) {
        const double begin = from + (to - from) * intervals[i].begin;
        const double end = from + (to - from) * intervals[i].end;
        sum += exp(-depth * begin) - exp(-depth * end);
    }
    return sum;
}

void umbt_fog_look(const struct umbt_fog *fog, const double eye[3], const double end[3],
                   double *through, double *lit)
{
    double way[3];
    umb__subtract(end, eye, way);
    *through = exp(-fog->density * umb__length(way));
    *lit = lit_between(fog, eye, way, 0.0, 1.0);
}

/* ---- stages ---- */

static enum umb_status block_query(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct frame *frame = user;
    struct umb_query_stats stats = {0};
    const struct umb_points points =
        umbt_points_at(frame->buffer.positions[first], frame->buffer.normals[first], count);
    const enum umb_status status = umbt_shadow_source_answer(frame->light->source, &points,
                                                             frame->answers + first, &stats, error);
    pthread_mutex_lock(&frame->mutex);
    umb_query_stats_add(&frame->result->stats, &stats);
    pthread_mutex_unlock(&frame->mutex);
    return status;
}

static enum umb_status block_trace(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct frame *frame = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3];
        umbt_widen(frame->buffer.normals[i], normal);
        frame->truths[i] =
            umbt_truth_visibility(frame->light->truth, frame->buffer.positions[i], normal);
    }
    return UMB_OK;
}

/* Returns the largest error of a truth's share. An edge through s x s rays can put up to s rays on
 * the wrong side. Kinds without a window of rays are exact. An asset ends the list of translucent
 * casters where less than 0.001 of the light is left. */
static double truth_error(const struct umbt_truth *truth)
{
    return (truth->kind == UMBT_TRUTH_AREA || truth->kind == UMBT_TRUTH_DISC ||
                    truth->kind == UMBT_TRUTH_FOOTPRINT
                ? 1.0 / (double)truth->samples
                : 0.0) +
           (truth->layers != NULL ? 0.001 : 0.0);
}

/* Adds the difference of receiver i, which faces the light. */
static void difference_add(const struct frame *frame, size_t i, const double normal[3], int judged,
                           uint64_t sums[SUMS])
{
    const struct umbt_truth *truth = frame->light->truth;
    const double answer = (double)frame->answers[i], traced = (double)frame->truths[i];
    const double difference = answer - traced;
    if (difference == 0.0) {
        return;
    }
    const uint64_t fixed = (uint64_t)(fabs(difference) * FIXED_ONE);
    const uint64_t over_half = fabs(difference) > 0.5;
    sums[difference > 0.0 ? LIGHTER : DARKER] += fixed;
    sums[OVER_HALF] += over_half;
    if (umbt_truth_is_undefined(truth, frame->buffer.positions[i], normal)) {
        sums[UNDEFINED]++;
        return;
    }
    sums[DEFINED] += fixed;
    sums[OVER_HALF_DEFINED] += over_half;
    sums[FALSE_SHADOW] += judged && answer < 0.5 && traced > 0.5 + truth_error(truth);
    sums[FALSE_LIGHT] += judged && answer > 0.5 && traced < 0.5 - truth_error(truth);
}

/* Adds what receiver i gets of the light. */
static void receiver_light(struct frame *frame, size_t i)
{
    const struct umbt_picture_light *light = frame->light;
    struct received *received = &frame->received[i];
    struct umbt_surface surface;
    double share;
    umbt_receiver_surface(frame->request->setup->scene, &frame->buffer, i, &surface);
    const double cosine =
        umbt_picture_light_at(light, frame->buffer.positions[i], surface.normal, &share);
    const float asset = light->source != NULL ? frame->answers[i] : 0.0F;
    const float traced = light->truth != NULL ? frame->truths[i] : 0.0F;
    for (int k = 0; k < 3; k++) {
        const double power = light->power[k] * share * fmax(cosine, 0.0);
        received->asset[k] += (float)(power * (double)asset);
        received->traced[k] += (float)(power * (double)traced);
    }
    received->difference += asset - traced;
}

static enum umb_status block_compare(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    struct frame *frame = user;
    const int both = frame->light->source != NULL && frame->light->truth != NULL;
    uint64_t sums[SUMS] = {0};
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3], share;
        umbt_widen(frame->buffer.normals[i], normal);
        const double facing =
            umbt_picture_light_at(frame->light, frame->buffer.positions[i], normal, &share);
        const int judged = facing > UMBT_JUDGED_FACING;
        sums[FACING] += facing > 0.0;
        sums[JUDGED] += (uint64_t)judged;
        if (both && facing > 0.0) {
            difference_add(frame, i, normal, judged, sums);
        }
        receiver_light(frame, i);
    }
    pthread_mutex_lock(&frame->mutex);
    for (int i = 0; i < SUMS; i++) {
        frame->sums[i] += sums[i];
    }
    pthread_mutex_unlock(&frame->mutex);
    return UMB_OK;
}

static void pixel_direction(const struct frame *frame, size_t pixel, double direction[3])
{
    const uint32_t width = frame->buffer.width;
    const double row = (double)(frame->buffer.first_row + pixel / width);
    umbt_camera_ray(&frame->request->setup->camera, ((double)(pixel % width) + 0.5) / (double)width,
                    (row + 0.5) / (double)frame->request->size[1], direction);
}

/* Returns a colour seen through the fog, up to the receiver or through the whole scene. */
static struct umbt_rgb fog_shade(const struct frame *frame, size_t pixel, uint32_t slot,
                                 struct umbt_rgb color)
{
    const struct umbt_picture_request *request = frame->request;
    double end[3], direction[3], through, lit;
    if (request->fog == NULL) {
        return color;
    }
    if (slot != UMBT_SKY) {
        memcpy(end, frame->buffer.positions[slot], sizeof end);
    } else {
        pixel_direction(frame, pixel, direction);
        umbt_along(request->setup->camera.eye, request->setup->scene->diagonal_m, direction, end);
    }
    umbt_fog_look(request->fog, request->setup->camera.eye, end, &through, &lit);
    return umbt_fog_shade(color, through, lit);
}

/* The colour that a receiver, or the sky, sends to the eye. */
static struct umbt_rgb receiver_shade(const struct frame *frame, size_t pixel, uint32_t slot,
                                      int traced, struct umbt_rgb sky)
{
    const struct umbt_setup *setup = frame->request->setup;
    struct umbt_surface surface;
    double light[3];
    if (slot == UMBT_SKY) {
        return fog_shade(frame, pixel, slot, sky);
    }
    umbt_receiver_surface(setup->scene, &frame->buffer, slot, &surface);
    umbt_widen(traced ? frame->received[slot].traced : frame->received[slot].asset, light);
    struct umbt_rgb color =
        umbt_shade_light(surface.color, light, surface.normal[setup->z_up ? 2 : 1]);
    if (frame->buffer.triangles[slot] == UMBT_GROUND) {
        color = umbt_ground_fade(&frame->buffer.ground, setup->camera.eye,
                                 frame->buffer.positions[slot], color, sky);
    }
    return fog_shade(frame, pixel, slot, color);
}

/* Returns the colour of a sub-sample: its receivers over one another, up to the opaque one or the
 * sky. */
static struct umbt_rgb sample_shade(const struct frame *frame, size_t pixel, uint32_t slot,
                                    int traced, struct umbt_rgb sky)
{
    struct umbt_rgb sum = {{0.0, 0.0, 0.0}};
    double left = 1.0;
    for (;;) {
        const struct umbt_rgb color = receiver_shade(frame, pixel, slot, traced, sky);
        const double opacity = slot == UMBT_SKY ? 1.0 : umbt_gbuffer_opacity(&frame->buffer, slot);
        for (int c = 0; c < 3; c++) {
            sum.c[c] += left * opacity * color.c[c];
        }
        if (slot == UMBT_SKY || !(opacity < 1.0)) {
            return sum;
        }
        left *= 1.0 - opacity;
        slot = umbt_gbuffer_behind(&frame->buffer, slot);
    }
}

/* Returns 1 if a pixel may be part of a slow gradient, which is dithered against bands. Flat facets
 * under parallel light are not. */
static int is_gradient(const struct frame *frame, size_t pixel)
{
    const struct umbt_picture_request *request = frame->request;
    const uint32_t per_pixel = frame->buffer.aa * frame->buffer.aa;
    int found = request->fog != NULL || request->setup->scene->normals != NULL;
    for (uint32_t i = 0; i < request->light_count; i++) {
        found |= request->lights[i].lamp != NULL;
    }
    for (uint32_t k = 0; k < per_pixel && !found; k++) {
        const uint32_t slot = frame->buffer.slots[pixel * per_pixel + k];
        found = slot == UMBT_SKY || frame->buffer.triangles[slot] == UMBT_GROUND ||
                slot >= frame->buffer.first_layer;
    }
    return found;
}

/* The pixel's colour of the asset or of the rays, 8-bit sRGB. */
static void pixel_shade(const struct frame *frame, size_t pixel, int traced, struct umbt_rgb sky,
                        uint8_t out[3])
{
    const uint32_t per_pixel = frame->buffer.aa * frame->buffer.aa, width = frame->buffer.width;
    const uint32_t row = frame->buffer.first_row + (uint32_t)(pixel / width);
    const double threshold =
        is_gradient(frame, pixel) ? umbt_dither((uint32_t)(pixel % width), row) : 0.5;
    double sum[3] = {0.0, 0.0, 0.0};
    for (uint32_t k = 0; k < per_pixel; k++) {
        const uint32_t slot = frame->buffer.slots[pixel * per_pixel + k];
        const struct umbt_rgb color = sample_shade(frame, pixel, slot, traced, sky);
        for (int c = 0; c < 3; c++) {
            sum[c] += umbt_shoulder(color.c[c]);
        }
    }
    for (int c = 0; c < 3; c++) {
        out[c] = umbt_srgb8_dithered(sum[c] / (double)per_pixel, threshold);
    }
}

/* Returns the difference of the visibilities that a sub-sample shows, of all lights together. */
static double sample_difference(const struct frame *frame, uint32_t slot)
{
    double sum = 0.0, left = 1.0;
    while (slot != UMBT_SKY) {
        const double opacity = umbt_gbuffer_opacity(&frame->buffer, slot);
        sum += left * opacity * (double)frame->received[slot].difference;
        left *= 1.0 - opacity;
        slot = umbt_gbuffer_behind(&frame->buffer, slot);
    }
    return sum;
}

/* Colours the differences over a pale grey picture: red where the asset is lighter, blue where
 * darker. */
static void pixel_difference(const struct frame *frame, size_t pixel, const uint8_t traced[3],
                             uint8_t out[3])
{
    const uint32_t per_pixel = frame->buffer.aa * frame->buffer.aa;
    double difference = 0.0;
    for (uint32_t k = 0; k < per_pixel; k++) {
        difference += sample_difference(frame, frame->buffer.slots[pixel * per_pixel + k]);
    }
    difference =
        fmin(1.0, 2.0 * fabs(difference / (double)per_pixel)) * (difference < 0.0 ? -1.0 : 1.0);
    const double grey = 150.0 + 0.35 * ((double)traced[0] + traced[1] + traced[2]) / 3.0;
    const double fade = 1.0 - fabs(difference);
    out[0] = (uint8_t)(grey * fade + (difference > 0.0 ? 225.0 * difference : 0.0));
    out[1] = (uint8_t)(grey * fade);
    out[2] = (uint8_t)(grey * fade - (difference < 0.0 ? 235.0 * difference : 0.0));
}

static void pixel_finish(struct frame *frame, size_t pixel, uint8_t asset[3], uint8_t traced[3])
{
    const struct umbt_picture_request *request = frame->request;
    const size_t at = 3 * ((size_t)frame->buffer.first_row * frame->buffer.width + pixel);
    if (request->lights[0].source != NULL) {
        memcpy(&frame->pictures->asset.pixels[at], asset, 3);
    }
    if (request->lights[0].truth != NULL) {
        memcpy(&frame->pictures->traced.pixels[at], traced, 3);
    }
    if (request->difference) {
        pixel_difference(frame, pixel, traced, &frame->pictures->difference.pixels[at]);
    }
}

static struct umbt_rgb pixel_sky(const struct frame *frame, size_t pixel)
{
    double direction[3];
    pixel_direction(frame, pixel, direction);
    return umbt_sky(direction[frame->request->setup->z_up ? 2 : 1]);
}

/* Shades a run of pixels. The picture difference is summed in integers, so in any order. */
static enum umb_status block_shade(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct frame *frame = user;
    const struct umbt_picture_request *request = frame->request;
    (void)error;
    uint64_t sum = 0;
    for (size_t pixel = first; pixel < first + count; pixel++) {
        uint8_t asset[3] = {0, 0, 0}, traced[3] = {0, 0, 0};
        const struct umbt_rgb sky = pixel_sky(frame, pixel);
        if (request->lights[0].source != NULL) {
            pixel_shade(frame, pixel, 0, sky, asset);
        }
        if (request->lights[0].truth != NULL) {
            pixel_shade(frame, pixel, 1, sky, traced);
        }
        for (int c = 0; c < 3; c++) {
            sum += (uint64_t)abs((int)asset[c] - (int)traced[c]);
        }
        pixel_finish(frame, pixel, asset, traced);
    }
    pthread_mutex_lock(&frame->mutex);
    frame->picture_sum += sum;
    pthread_mutex_unlock(&frame->mutex);
    return UMB_OK;
}

static enum umb_status stage_run(struct frame *frame, size_t count, size_t block, umbu_block_fn fn,
                                 double *seconds, struct umb_error *error)
{
    const double start = umbu_clock_s();
    const enum umb_status status =
        umbu_range_run(frame->request->threads, count, block, fn, frame, error);
    *seconds += umbu_clock_s() - start;
    return status;
}

/* Makes the arrays of receivers as long as the band needs, and clears what they have received. */
static enum umb_status room_make(struct frame *frame, struct umb_error *error)
{
    const size_t receivers = frame->buffer.receiver_count;
    if (receivers > frame->room || frame->received == NULL) {
        free(frame->answers);
        free(frame->truths);
        free(frame->received);
        frame->room = receivers > frame->buffer.capacity ? receivers : frame->buffer.capacity;
        frame->answers = calloc(frame->room, sizeof *frame->answers);
        frame->truths = calloc(frame->room, sizeof *frame->truths);
        frame->received = calloc(frame->room, sizeof *frame->received);
        if (frame->answers == NULL || frame->truths == NULL || frame->received == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "%zu answers do not fit in memory",
                            frame->room);
        }
    }
    memset(frame->received, 0, receivers * sizeof *frame->received);
    return UMB_OK;
}

/* Asks for, traces and adds up one light. */
static enum umb_status light_render(struct frame *frame, struct umb_error *error)
{
    struct umbt_picture_result *result = frame->result;
    const size_t receivers = frame->buffer.receiver_count;
    if (frame->light->source != NULL) {
        UMB__TRY(stage_run(frame, receivers, QUERY_BLOCK, block_query, &result->query_s, error));
    }
    if (frame->light->truth != NULL) {
        UMB__TRY(stage_run(frame, receivers, TRACE_BLOCK, block_trace, &result->trace_s, error));
    }
    return stage_run(frame, receivers, TRACE_BLOCK, block_compare, &result->compare_s, error);
}

static enum umb_status band_render(struct frame *frame, uint32_t first_row, uint32_t row_count,
                                   struct umb_error *error)
{
    const struct umbt_picture_request *request = frame->request;
    struct umbt_picture_result *result = frame->result;
    double shade_s = 0.0;
    const double start = umbu_clock_s();
    UMB__TRY(umbt_gbuffer_fill(&frame->buffer, request->setup->scene, &request->setup->camera,
                               request->size[1], first_row, row_count, request->threads, error));
    UMB__TRY(room_make(frame, error));
    result->gbuffer_s += umbu_clock_s() - start;
    result->seen += frame->buffer.seen_count;
    result->receivers += frame->buffer.receiver_count;
    result->translucent += frame->buffer.receiver_count - frame->buffer.first_layer;
    for (uint32_t i = 0; i < request->light_count; i++) {
        frame->light = &request->lights[i];
        UMB__TRY(light_render(frame, error));
    }
    return stage_run(frame, (size_t)frame->buffer.width * row_count, 4096, block_shade, &shade_s,
                     error);
}

static void result_finish(struct frame *frame)
{
    struct umbt_picture_result *result = frame->result;
    const uint64_t *sums = frame->sums;
    const double facing = sums[FACING] > 0 ? (double)sums[FACING] : 1.0;
    const double judged = sums[JUDGED] > 0 ? (double)sums[JUDGED] : 1.0;
    result->facing = sums[FACING];
    if (frame->request->lights[0].source == NULL || frame->request->lights[0].truth == NULL) {
        return;
    }
    result->mean_lighter = (double)sums[LIGHTER] / (FIXED_ONE * facing);
    result->mean_darker = (double)sums[DARKER] / (FIXED_ONE * facing);
    result->mean_difference = result->mean_lighter + result->mean_darker;
    result->over_half = (double)sums[OVER_HALF] / facing;
    result->undefined = sums[UNDEFINED];
    result->mean_defined = (double)sums[DEFINED] / (FIXED_ONE * facing);
    result->over_half_defined = (double)sums[OVER_HALF_DEFINED] / facing;
    result->judged = sums[JUDGED];
    result->false_shadow = (double)sums[FALSE_SHADOW] / judged;
    result->false_light = (double)sums[FALSE_LIGHT] / judged;
    result->picture_difference =
        (double)frame->picture_sum /
        (255.0 * 3.0 * (double)frame->request->size[1] * (double)frame->request->size[0]);
}

static enum umb_status frame_init(struct frame *frame, uint32_t rows, struct umb_error *error)
{
    const struct umbt_picture_request *request = frame->request;
    const struct {
        int wanted;
        struct umbt_picture *picture;
    } pictures[] = {{request->lights[0].source != NULL, &frame->pictures->asset},
                    {request->lights[0].truth != NULL, &frame->pictures->traced},
                    {request->difference, &frame->pictures->difference}};
    for (size_t i = 0; i < sizeof pictures / sizeof pictures[0]; i++) {
        UMB__TRY(pictures[i].wanted ? umbt_picture_init(pictures[i].picture, request->size[0],
                                                        request->size[1], error)
                                    : UMB_OK);
    }
    const enum umb_status status =
        umbt_gbuffer_init(&frame->buffer, request->size[0], request->aa, rows, error);
    frame->buffer.ground = request->ground;
    return status;
}

/* Returns the number of rows of a band. A band that traces rays has fewer, and so has one with
 * translucent surfaces, of which a sub-sample may see many. */
static uint32_t band_rows(const struct umbt_picture_request *request, size_t row_samples)
{
    const int is_small =
        request->lights[0].truth != NULL || umbt_seen_layers(request->setup->scene) != NULL;
    const uint32_t rows = (uint32_t)((is_small ? BAND_TRACED : BAND_SAMPLES) / row_samples);
    return rows < 1 ? 1 : rows > request->size[1] ? request->size[1] : rows;
}

enum umb_status umbt_picture_render(const struct umbt_picture_request *request,
                                    struct umbt_pictures *pictures,
                                    struct umbt_picture_result *result, struct umb_error *error)
{
    const uint32_t height = request->size[1];
    const size_t row_samples = (size_t)request->size[0] * request->aa * request->aa;
    const uint32_t rows = band_rows(request, row_samples);
    struct frame frame = {.request = request, .pictures = pictures, .result = result};
    memset(result, 0, sizeof *result);
    if (pthread_mutex_init(&frame.mutex, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a mutex could not be made");
    }
    enum umb_status status = frame_init(&frame, rows, error);
    umbu_progress_begin(&frame.progress, "Msamples", request->quiet);
    for (uint32_t row = 0; row < height && status == UMB_OK; row += rows) {
        status = band_render(&frame, row, height - row < rows ? height - row : rows, error);
        result->samples += row_samples * frame.buffer.row_count;
        umbu_progress_show(&frame.progress, 1e-6 * (double)result->samples,
                           (double)result->samples / (double)(row_samples * height));
    }
    umbu_progress_end(&frame.progress);
    if (status == UMB_OK) {
        result_finish(&frame);
    }
    umbt_gbuffer_finish(&frame.buffer);
    free(frame.answers);
    free(frame.truths);
    free(frame.received);
    pthread_mutex_destroy(&frame.mutex);
    return status;
}

void umbt_pictures_finish(struct umbt_pictures *pictures)
{
    umbt_picture_finish(&pictures->asset);
    umbt_picture_finish(&pictures->traced);
    umbt_picture_finish(&pictures->difference);
}
