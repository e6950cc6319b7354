/* SPDX-License-Identifier: Apache-2.0 */
/* A picture of a scene with its shadows, band by band; see study_picture.h. */
#include "study/study_picture.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "tool/threads.h"
#include "study/shading.h"
#include "study/study_math.h"
#include "tool/clock.h"
#include "tool/progress.h"

#define BAND_SAMPLES ((size_t)1 << 19) /* samples of a band: about 50 MB */
#define BAND_TRACED  ((size_t)1 << 16) /* samples of a traced band: the progress line moves often */
#define QUERY_BLOCK  16384             /* points in a request: less than a daemon's usual limit */
#define TRACE_BLOCK  512
#define FIXED_ONE    4294967296.0

/* Sums over receivers that face the light. Visibilities are integers in units of 2^-32: the order
 * of the sum does not matter. */
struct differences {
    uint64_t facing, undefined, over_half, over_half_defined;
    uint64_t lighter, darker, defined;
    uint64_t judged, false_shadow, false_light;
};

struct frame {
    const struct umbt_picture_request *request;
    struct umbt_picture_result *result;
    struct umbt_gbuffer buffer;
    uint32_t height; /* height of the picture */
    float *answers;  /* [capacity] of the asset */
    float *truths;   /* [capacity] of the rays */
    struct umbu_progress progress;
    pthread_mutex_t mutex; /* guards result->stats, sum and picture_sum while blocks run */
    uint64_t picture_sum;  /* sum of |asset - traced| over 8-bit channels */
    struct differences sum;
};

static enum umb_status block_query(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct frame *frame = user;
    struct umb_query_stats stats = {0};
    const enum umb_status status = umbt_shadow_source_answer(
        frame->request->source, frame->buffer.positions, frame->buffer.normals, first, count,
        frame->answers, &stats, error);
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
        umbt_widen(&frame->buffer.normals[3 * i], normal);
        frame->truths[i] =
            umbt_truth_visibility(frame->request->truth, &frame->buffer.positions[3 * i], normal);
    }
    return UMB_OK;
}

/* Cosine between a receiver's normal and the direction to the light. */
static double receiver_cosine(const struct frame *frame, size_t slot, const double normal[3])
{
    const struct umbt_picture_request *request = frame->request;
    double towards[3];
    (void)umbt_towards_light(request->lamp, request->setup->to_light,
                             &frame->buffer.positions[3 * slot], towards);
    return umb__dot(normal, towards);
}

/* Returns the largest error of a truth's share. An edge through s x s rays can put up to s rays on
 * the wrong side. Kinds without a window of rays are exact. */
static double truth_error(const struct umbt_truth *truth)
{
    return truth->kind == UMBT_TRUTH_AREA || truth->kind == UMBT_TRUTH_DISC
               ? 1.0 / (double)truth->samples
               : 0.0;
}

/* Judges a receiver whose window is defined. */
static void judge(const struct umbt_truth *truth, double answer, double traced,
                  struct differences *sum)
{
    const double error = truth_error(truth);
    sum->false_shadow += answer < 0.5 && traced > 0.5 + error;
    sum->false_light += answer > 0.5 && traced < 0.5 - error;
}

/* Sums the differences of a run of receivers. */
static enum umb_status block_compare(void *user, size_t first, size_t count,
                                     struct umb_error *error)
{
    struct frame *frame = user;
    const struct umbt_picture_request *request = frame->request;
    const int both = request->source != NULL && request->truth != NULL;
    struct differences sum = {0};
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        double normal[3];
        umbt_widen(&frame->buffer.normals[3 * i], normal);
        const double facing = receiver_cosine(frame, i, normal);
        if (!(facing > 0.0)) {
            continue;
        }
        const int judged = facing > UMBT_JUDGED_FACING;
        sum.facing++;
        sum.judged += (uint64_t)judged;
        const double difference = (double)frame->answers[i] - (double)frame->truths[i];
        if (!both || difference == 0.0) {
            continue;
        }
        const uint64_t fixed = (uint64_t)(fabs(difference) * FIXED_ONE);
        sum.lighter += difference > 0.0 ? fixed : 0;
        sum.darker += difference < 0.0 ? fixed : 0;
        sum.over_half += fabs(difference) > 0.5;
        if (umbt_truth_is_undefined(request->truth, &frame->buffer.positions[3 * i], normal)) {
            sum.undefined++;
        } else {
            sum.defined += fixed;
            sum.over_half_defined += fabs(difference) > 0.5;
            if (judged) {
                judge(request->truth, (double)frame->answers[i], (double)frame->truths[i], &sum);
            }
        }
    }
    pthread_mutex_lock(&frame->mutex);
    frame->sum.facing += sum.facing;
    frame->sum.undefined += sum.undefined;
    frame->sum.over_half += sum.over_half;
    frame->sum.over_half_defined += sum.over_half_defined;
    frame->sum.lighter += sum.lighter;
    frame->sum.darker += sum.darker;
    frame->sum.defined += sum.defined;
    frame->sum.judged += sum.judged;
    frame->sum.false_shadow += sum.false_shadow;
    frame->sum.false_light += sum.false_light;
    pthread_mutex_unlock(&frame->mutex);
    return UMB_OK;
}

static struct umbt_rgb receiver_shade(const struct frame *frame, uint32_t slot, float visibility)
{
    const struct umbt_picture_request *request = frame->request;
    double normal[3];
    umbt_widen(&frame->buffer.normals[3 * (size_t)slot], normal);
    const uint32_t key =
        umbt_scene_surface_key(request->setup->scene, frame->buffer.triangles[slot]);
    return umbt_shade(umbt_surface_color(key), (double)visibility,
                      receiver_cosine(frame, slot, normal), normal[request->setup->z_up ? 2 : 1]);
}

/* The direction through a pixel's centre. */
static void pixel_direction(const struct frame *frame, size_t pixel, double direction[3])
{
    const uint32_t width = frame->buffer.width;
    const double row = (double)(frame->buffer.first_row + pixel / width);
    umbt_camera_ray(&frame->request->setup->camera, ((double)(pixel % width) + 0.5) / (double)width,
                    (row + 0.5) / (double)frame->height, direction);
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
        memcpy(end, &frame->buffer.positions[3 * (size_t)slot], sizeof end);
    } else {
        pixel_direction(frame, pixel, direction);
        umbt_along(request->setup->camera.eye, request->setup->scene->diagonal_m, direction, end);
    }
    umbt_fog_look(request->fog, request->setup->camera.eye, end, &through, &lit);
    return umbt_fog_shade(color, through, lit);
}

/* The pixel's colour with one set of answers, 8-bit sRGB. */
static void pixel_shade(const struct frame *frame, size_t pixel, const float *visibility,
                        struct umbt_rgb sky, uint8_t out[3])
{
    const uint32_t per_pixel = frame->buffer.aa * frame->buffer.aa;
    double sum[3] = {0.0, 0.0, 0.0};
    for (uint32_t k = 0; k < per_pixel; k++) {
        const uint32_t slot = frame->buffer.slots[pixel * per_pixel + k];
        const struct umbt_rgb clear =
            slot == UMBT_SKY ? sky : receiver_shade(frame, slot, visibility[slot]);
        const struct umbt_rgb color = fog_shade(frame, pixel, slot, clear);
        for (int c = 0; c < 3; c++) {
            sum[c] += umbt_shoulder(color.c[c]);
        }
    }
    for (int c = 0; c < 3; c++) {
        out[c] = umbt_srgb8(sum[c] / (double)per_pixel);
    }
}

/* Colours the differences over a pale grey picture: red where the asset is lighter, blue where
 * darker. */
static void pixel_difference(const struct frame *frame, size_t pixel, const uint8_t traced[3],
                             uint8_t out[3])
{
    const uint32_t per_pixel = frame->buffer.aa * frame->buffer.aa;
    double difference = 0.0;
    for (uint32_t k = 0; k < per_pixel; k++) {
        const uint32_t slot = frame->buffer.slots[pixel * per_pixel + k];
        if (slot != UMBT_SKY) {
            difference += (double)frame->answers[slot] - (double)frame->truths[slot];
        }
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
    const uint32_t width = frame->buffer.width;
    const size_t row = frame->buffer.first_row + pixel / width;
    const size_t at = 3 * (row * width + pixel % width);
    if (request->asset != NULL) {
        memcpy(&request->asset->pixels[at], asset, 3);
    }
    if (request->traced != NULL) {
        memcpy(&request->traced->pixels[at], traced, 3);
    }
    if (request->difference != NULL) {
        pixel_difference(frame, pixel, traced, &request->difference->pixels[at]);
    }
}

/* The sky in the direction of a pixel's centre. */
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
        if (request->source != NULL) {
            pixel_shade(frame, pixel, frame->answers, sky, asset);
        }
        if (request->truth != NULL) {
            pixel_shade(frame, pixel, frame->truths, sky, traced);
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

/* Runs one stage and adds its wall time. */
static enum umb_status stage_run(struct frame *frame, size_t count, size_t block, umbu_block_fn fn,
                                 double *seconds, struct umb_error *error)
{
    const double start = umbu_clock_s();
    const enum umb_status status =
        umbu_range_run(frame->request->threads, count, block, fn, frame, error);
    *seconds += umbu_clock_s() - start;
    return status;
}

static enum umb_status band_render(struct frame *frame, uint32_t first_row, uint32_t row_count,
                                   struct umb_error *error)
{
    const struct umbt_picture_request *request = frame->request;
    struct umbt_picture_result *result = frame->result;
    double shade_s = 0.0;
    const double start = umbu_clock_s();
    UMB__TRY(umbt_gbuffer_fill(&frame->buffer, request->setup->scene, &request->setup->camera,
                               frame->height, first_row, row_count, request->threads, error));
    result->gbuffer_s += umbu_clock_s() - start;
    const size_t receivers = frame->buffer.receiver_count;
    if (request->source != NULL) {
        UMB__TRY(stage_run(frame, receivers, QUERY_BLOCK, block_query, &result->query_s, error));
    }
    if (request->truth != NULL) {
        UMB__TRY(stage_run(frame, receivers, TRACE_BLOCK, block_trace, &result->trace_s, error));
    }
    result->receivers += receivers;
    UMB__TRY(stage_run(frame, receivers, TRACE_BLOCK, block_compare, &result->compare_s, error));
    return stage_run(frame, (size_t)frame->buffer.width * row_count, 4096, block_shade, &shade_s,
                     error);
}

static void result_finish(struct frame *frame)
{
    struct umbt_picture_result *result = frame->result;
    const struct differences *sum = &frame->sum;
    const double facing = (double)sum->facing;
    result->facing = sum->facing;
    if (frame->request->source == NULL || frame->request->truth == NULL) {
        return;
    }
    if (result->facing > 0) {
        result->mean_lighter = (double)sum->lighter / (FIXED_ONE * facing);
        result->mean_darker = (double)sum->darker / (FIXED_ONE * facing);
        result->mean_difference = result->mean_lighter + result->mean_darker;
        result->over_half = (double)sum->over_half / facing;
        result->undefined = sum->undefined;
        result->mean_defined = (double)sum->defined / (FIXED_ONE * facing);
        result->over_half_defined = (double)sum->over_half_defined / facing;
    }
    result->judged = sum->judged;
    if (sum->judged > 0) {
        result->false_shadow = (double)sum->false_shadow / (double)sum->judged;
        result->false_light = (double)sum->false_light / (double)sum->judged;
    }
    result->picture_difference = (double)frame->picture_sum / (255.0 * 3.0 * (double)frame->height *
                                                               (double)frame->buffer.width);
}

static enum umb_status frame_init(struct frame *frame, uint32_t width, uint32_t rows,
                                  struct umb_error *error)
{
    UMB__TRY(umbt_gbuffer_init(&frame->buffer, width, frame->request->aa, rows, error));
    frame->answers = calloc(frame->buffer.capacity, sizeof *frame->answers);
    frame->truths = calloc(frame->buffer.capacity, sizeof *frame->truths);
    if (frame->answers == NULL || frame->truths == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu answers do not fit in memory",
                        frame->buffer.capacity);
    }
    return UMB_OK;
}

static void frame_finish(struct frame *frame)
{
    umbt_gbuffer_finish(&frame->buffer);
    free(frame->answers);
    free(frame->truths);
}

enum umb_status umbt_picture_render(const struct umbt_picture_request *request,
                                    struct umbt_picture_result *result, struct umb_error *error)
{
    const struct umbt_picture *shape = request->asset != NULL ? request->asset : request->traced;
    const uint32_t width = shape->width, height = shape->height;
    const size_t row_samples = (size_t)width * request->aa * request->aa;
    uint32_t rows = (uint32_t)((request->truth != NULL ? BAND_TRACED : BAND_SAMPLES) / row_samples);
    rows = rows < 1 ? 1 : rows > height ? height : rows;
    struct frame frame = {.request = request, .result = result, .height = height};
    memset(result, 0, sizeof *result);
    if (pthread_mutex_init(&frame.mutex, NULL) != 0) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a mutex could not be made");
    }
    enum umb_status status = frame_init(&frame, width, rows, error);
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
    frame_finish(&frame);
    pthread_mutex_destroy(&frame.mutex);
    return status;
}
