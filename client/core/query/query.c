/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing, checking and running queries; see umbrage/query.h. */
#include "umbrage/query.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "format/asset_parts.h"
#include "query/effect_switches.h"
#include "query/footprint.h"
#include "query/receiver_mask_stage.h"
#include "query/perspective.h"
#include "query/query_parts.h"
#include "query/transmittance_stage.h"
#include "umbrage/curve.h"

static umb__kernel_fn choose_kernel(void)
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("popcnt") &&
        __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2")) {
        const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                          __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd");
        return wide ? umb__run_wide : umb__kernel_avx2;
    }
#endif
    return umb__kernel_base;
}

static umb__kernel_fn choose_coarse_kernel(void)
{
    return choose_kernel() == umb__kernel_base ? umb__kernel_coarse : umb__kernel_coarse_avx2;
}

static double length3(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static enum umb_status check_settings(const struct umb_asset *asset,
                                      const struct umb_query_settings *settings,
                                      struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    uint32_t lights = asset->canonical.content.light_count;
    if (settings->light >= lights) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, the asset has %u", settings->light,
                        lights);
    }
    if (settings->taps > UMB_TAPS_MAX || (settings->taps % 2 == 0 && settings->taps != 0)) {
        return umb_fail(error, UMB_E_ARGUMENT, "taps: %u, must be odd and at most %d",
                        settings->taps, UMB_TAPS_MAX);
    }
    if ((unsigned)settings->bias_mode > UMB_BIAS_NONE) {
        return umb_fail(error, UMB_E_ARGUMENT, "bias_mode: %d, unknown", (int)settings->bias_mode);
    }
    if ((unsigned)settings->format > UMB_ANSWER_BIT) {
        return umb_fail(error, UMB_E_ARGUMENT, "format: %d, unknown", (int)settings->format);
    }
    if (!(settings->bias >= 0 && settings->bias <= UMB_BIAS_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "bias: %g, must be 0 to %g", settings->bias,
                        UMB_BIAS_MAX);
    }
    if ((unsigned)settings->filter > UMB_FILTER_FOOTPRINT) {
        return umb_fail(error, UMB_E_ARGUMENT, "filter: %d, unknown", (int)settings->filter);
    }
    if (settings->filter == UMB_FILTER_FOOTPRINT) {
        return UMB_OK; /* Any light; taps may be given beside a footprint */
    }
    if (settings->footprint_m != 0 && settings->taps != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "footprint_m: %g beside %u taps; give one of both",
                        settings->footprint_m, settings->taps);
    }
    if (asset->canonical.content.lights[settings->light].kind != UMB_LIGHT_DIRECTIONAL &&
        (settings->filter != UMB_FILTER_BOX || settings->footprint_m != 0)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "%s: light %u is not directional; it takes the box filter and taps",
                        settings->filter != UMB_FILTER_BOX ? "filter" : "footprint_m",
                        settings->light);
    }
    return UMB_OK;
}

/* Returns the angular diameter that penumbras use, in radians. */
static double extent_of(const struct umb_asset *asset, const struct umb_query_settings *settings)
{
    return settings->light_extent > 0 ? settings->light_extent
                                      : asset->canonical.content.lights[settings->light].extent;
}

/* Checks penumbras: the light has an extent, and first occluders are known. */
static enum umb_status check_penumbra(const struct umb_asset *asset,
                                      const struct umb_query_settings *settings,
                                      struct umb_error *error)
{
    const struct umb__content *content = &asset->canonical.content;
    const struct umb_light_info *light = &content->lights[settings->light];
    if (!(settings->light_extent >= 0 && settings->light_extent <= UMB_EXTENT_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "light_extent: %g rad, must be 0 to %g",
                        settings->light_extent, UMB_EXTENT_MAX);
    }
    if (settings->filter != UMB_FILTER_PENUMBRA) {
        return settings->light_extent == 0
                   ? UMB_OK
                   : umb_fail(error, UMB_E_ARGUMENT,
                              "light_extent: %g rad belongs to the penumbra filter",
                              settings->light_extent);
    }
    const double extent = extent_of(asset, settings);
    if (!(extent > 0 && extent <= UMB_EXTENT_MAX)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter: penumbra: light %u is %g rad across, must be above 0 and at most "
                        "%g; give its extent",
                        settings->light, extent, UMB_EXTENT_MAX);
    }
    if (content->frusta[light->first_frustum].closed && content->occluder_depth == NULL) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter: penumbra: light %u was baked under the closed rule, which leaves "
                        "out the depth of first occluders; bake with --effect front=on, or "
                        "--closed off",
                        settings->light);
    }
    return UMB_OK;
}

/* Checks footprints: one source of them, and in range. */
static enum umb_status check_footprint(const struct umb_query_settings *settings,
                                       struct umb_error *error)
{
    const double pixel = settings->pixel_rad, side = settings->footprint_m;
    if (settings->filter != UMB_FILTER_FOOTPRINT) {
        return pixel == 0 ? UMB_OK
                          : umb_fail(error, UMB_E_ARGUMENT,
                                     "pixel_rad: %g belongs to the footprint filter", pixel);
    }
    if (!(pixel >= 0 && pixel <= 1)) {
        return umb_fail(error, UMB_E_ARGUMENT, "pixel_rad: %g, must be 0 to 1", pixel);
    }
    if (!(side >= 0 && side <= UMB_FOOTPRINT_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "footprint_m: %g, must be 0 to %g", side,
                        UMB_FOOTPRINT_MAX);
    }
    if (pixel > 0 && side > 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "footprint_m: %g beside pixels of %g rad; give one of both", side, pixel);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        const double eye = settings->eye[axis];
        if (!isfinite(eye)) {
            return umb_fail(error, UMB_E_ARGUMENT, "eye.%c: %g, must be finite", "xyz"[axis], eye);
        }
    }
    return UMB_OK;
}

/* Checks coarse look-ups: one tap of parallel light, and a level that every layout of the file
 * has. */
static enum umb_status check_level(const struct umb_asset *asset,
                                   const struct umb_query_settings *settings,
                                   struct umb_error *error)
{
    const struct umb__content *content = &asset->canonical.content;
    const struct umb_light_info *light = &content->lights[settings->light];
    const uint32_t highest = umb_level_max(content->frusta[light->first_frustum].log2_size);
    if (settings->level == 0) {
        return UMB_OK;
    }
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "level: light %u is not directional; it takes level 0", settings->light);
    }
    if (settings->level % 2 == 0 || settings->level < UMB_LEVEL_BRICK ||
        settings->level > highest) {
        return umb_fail(error, UMB_E_ARGUMENT, "level: %u, must be 0 or odd and %d to %u",
                        settings->level, UMB_LEVEL_BRICK, highest);
    }
    if (settings->taps > 1 || settings->footprint_m != 0 || settings->filter != UMB_FILTER_BOX) {
        return umb_fail(error, UMB_E_ARGUMENT, "level: %u beside %s; coarse look-ups take one tap",
                        settings->level,
                        settings->taps > 1           ? "taps"
                        : settings->footprint_m != 0 ? "footprint_m"
                                                     : "filter");
    }
    return UMB_OK;
}

/* Refuses filters that read around the window. Under the static rule only the voxels of windows of
 * points on surfaces are defined. */
static enum umb_status check_static(const struct umb_asset *asset,
                                    const struct umb_query_settings *settings,
                                    struct umb_error *error)
{
    const int is_window = settings->filter == UMB_FILTER_BOX || settings->filter == UMB_FILTER_TENT;
    if (asset->canonical.content.receiver_mask_cells == NULL ||
        (is_window && settings->level == 0)) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_UNSUPPORTED,
                    "%s: the asset was baked under the static rule, which leaves out what lies "
                    "off the surfaces; it takes level 0 and the box or the tent filter",
                    is_window ? "level" : "filter");
}

/* Returns the window width: taps, or the odd number of texels nearest to footprint_m. */
static enum umb_status choose_taps(const struct umb_query_settings *settings,
                                   const struct umb_frustum_info *frustum, int32_t *taps,
                                   struct umb_error *error)
{
    *taps = settings->taps ? (int32_t)settings->taps : 1;
    if (settings->footprint_m == 0 || settings->filter == UMB_FILTER_FOOTPRINT) {
        return UMB_OK;
    }
    double texel_m = (length3(frustum->voxel_step[0]) + length3(frustum->voxel_step[1])) / 2;
    double limit = (UMB_TAPS_MAX + 1) * texel_m;
    if (!(settings->footprint_m > 0 && settings->footprint_m <= limit)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "footprint_m: %g, must be above 0 and at most %g (%d texels of %g m)",
                        settings->footprint_m, limit, UMB_TAPS_MAX + 1, texel_m);
    }
    int32_t half = (int32_t)floor(settings->footprint_m / texel_m / 2);
    *taps = half < UMB_TAPS_MAX / 2 ? 2 * half + 1 : UMB_TAPS_MAX;
    return UMB_OK;
}

/* Computes the tangent of 0..1/2 as a continued fraction (Lambert 1761). It gives the same bits on
 * all machines, which libm does not promise. */
static double tangent(double x)
{
    double rest = 17;
    for (int odd = 15; odd > 0; odd -= 2) {
        rest = odd - x * x / rest;
    }
    return x / rest;
}

/* Sets up the fields of penumbras: the light, and its occluder depth map. */
static void set_penumbra(struct umb__query *q, const struct umb_asset *asset,
                         const struct umb_query_settings *settings)
{
    const struct umb__content *content = &asset->canonical.content;
    const double slope = tangent(extent_of(asset, settings) / 2);
    const double depth_m = length3(q->voxel_step[2]);
    for (unsigned axis = 0; axis < 2; axis++) {
        q->reach[axis] = slope * depth_m / length3(q->voxel_step[axis]);
    }
    if (content->frusta[q->frustum].closed) {
        q->occluder_depth = content->occluder_depth;
        q->occluder_depth_root = content->occluder_depth[q->frustum];
    }
}

/* Sets up spot and point lights: everything else depends on the point. */
static void set_faces(struct umb__query *q, const struct umb_asset *asset,
                      const struct umb_query_settings *settings)
{
    const struct umb__content *content = &asset->canonical.content;
    const struct umb_light_info *light = &content->lights[settings->light];
    q->grid = asset->view.grid;
    q->columns = asset->view.columns;
    q->pieces = asset->view.pieces;
    q->faces = &content->frusta[light->first_frustum];
    q->tops = &asset->view.tops[light->first_frustum];
    q->face_count = light->frustum_count;
    q->first_face = light->first_frustum;
    q->bias_m = settings->bias;
    q->bias_mode = settings->bias_mode;
    for (unsigned axis = 0; axis < 3; axis++) {
        q->position[axis] = light->position[axis] - content->origin[axis];
    }
}

/*
 * The automatic bias takes its length from voxel_step. For coarse look-ups that is twice a cell's
 * edges: s >= |n.ex| + |n.ey| + |n.ez| for cells e, so that the whole cell around the moved point
 * lies on the light's side of the surface's plane, wherever in it the point is.
 */
static void widen_steps(struct umb__query *q)
{
    for (unsigned axis = 0; axis < 3 && q->level > 0; axis++) {
        for (unsigned k = 0; k < 3; k++) {
            q->voxel_step[axis][k] *= umb__coarse_steps(q);
        }
    }
}

/* The normal (1,1,1)/sqrt(3) in voxels needs (2 taps + 1) / (2 sqrt(3)) voxels. */
static double bias_without_normal(const struct umb__query *q, int32_t taps)
{
    return UMB__BIAS_SLACK * (2.0 * taps + 1.0) / (2.0 * sqrt(3.0)) * length3(q->voxel_step[2]);
}

static void set_bias(struct umb__query *q, const struct umb_query_settings *settings)
{
    q->bias_mode = settings->bias_mode;
    switch (settings->bias_mode) {
    case UMB_BIAS_AUTO:
        q->transmittance_no_normal_m = bias_without_normal(q, q->transmittance_bias_taps);
        widen_steps(q);
        q->no_normal_m = bias_without_normal(q, q->taps);
        break;
    case UMB_BIAS_VOXELS:
        q->bias_m =
            settings->bias *
            (length3(q->voxel_step[0]) + length3(q->voxel_step[1]) + length3(q->voxel_step[2])) /
            3.0;
        q->no_normal_m = q->transmittance_no_normal_m = q->bias_m;
        break;
    case UMB_BIAS_METRES:
        q->bias_m = settings->bias;
        q->no_normal_m = q->transmittance_no_normal_m = q->bias_m;
        break;
    case UMB_BIAS_NONE:
        break;
    }
}

/* Chooses the stages of a batch, once for all points. */
static umb__kernel_fn choose_stages(const struct umb_query_settings *settings)
{
    if (settings->filter == UMB_FILTER_TENT) {
        return umb__kernel_tent;
    }
    if (UMB__HAS_PENUMBRA && settings->filter == UMB_FILTER_PENUMBRA) {
        return umb__kernel_penumbra;
    }
    return UMB__HAS_LEVELS && settings->level > 0 ? choose_coarse_kernel() : choose_kernel();
}

/* Sets up the fields of footprints: the eye and the frustum. */
static void set_footprint(struct umb__query *q, const struct umb_asset *asset,
                          const struct umb_query_settings *settings)
{
    q->run = umb__footprint_run;
    q->footprint_m = settings->footprint_m;
    q->pixel_rad = settings->pixel_rad;
    for (unsigned axis = 0; axis < 3; axis++) {
        q->eye[axis] = settings->eye[axis] - asset->canonical.content.origin[axis];
    }
    q->texel_m = (length3(q->voxel_step[0]) + length3(q->voxel_step[1])) / 2;
    q->sample_no_normal_m =
        settings->bias_mode == UMB_BIAS_AUTO ? bias_without_normal(q, 1) : q->no_normal_m;
}

enum umb_status umb_query_prepare(const struct umb_asset *asset,
                                  const struct umb_query_settings *settings,
                                  struct umb_query *query, struct umb_error *error)
{
    memset(query, 0, sizeof *query);
    enum umb_status status = check_settings(asset, settings, error);
    if (status == UMB_OK) {
        status = check_level(asset, settings, error);
    }
    if (status == UMB_OK) {
        status = check_penumbra(asset, settings, error);
    }
    if (status == UMB_OK) {
        status = check_static(asset, settings, error);
    }
    if (status == UMB_OK) {
        status = check_footprint(settings, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    const struct umb__content *content = &asset->canonical.content;
    const struct umb_light_info *light = &content->lights[settings->light];
    const struct umb_frustum_info *frustum = &content->frusta[light->first_frustum];
    const struct umb__top *top = &asset->view.tops[light->first_frustum];
    int32_t taps;
    UMB__TRY(choose_taps(settings, frustum, &taps, error));
    struct umb__query q = {
        .kernel = choose_stages(settings),
        .grid = asset->view.grid + top->first_cell,
        .columns = asset->view.columns + top->first_column,
        .pieces = asset->view.pieces + top->first_piece,
        .nodes = asset->view.nodes,
        .bricks = asset->view.bricks,
        .log2_size = frustum->log2_size,
        .grid_log2 = top->grid_log2,
        .column_level = top->column_level,
        .frustum = light->first_frustum,
        .taps = taps,
        .level = settings->level,
        .filter = settings->filter,
        .format = settings->format,
    };
    memcpy(q.world_to_voxel, frustum->world_to_voxel, sizeof q.world_to_voxel);
    memcpy(q.voxel_step, frustum->voxel_step, sizeof q.voxel_step);
    memcpy(q.direction, light->direction, sizeof q.direction);
    memcpy(q.origin, content->origin, sizeof q.origin);
    if (UMB__HAS_TRANSMITTANCE && !settings->opaque_only) {
        umb__transmittance_set(&q, asset, light);
    }
    if (!UMB__HAS_FACES || light->kind == UMB_LIGHT_DIRECTIONAL) {
        set_bias(&q, settings);
        if (UMB__HAS_PENUMBRA && settings->filter == UMB_FILTER_PENUMBRA) {
            set_penumbra(&q, asset, settings);
        }
    } else {
        set_faces(&q, asset, settings);
    }
    q.opaque_run = UMB__HAS_FACES && q.face_count > 0 ? umb__perspective_run : q.kernel;
    q.window_run =
        UMB__HAS_TRANSMITTANCE && q.trans != NULL ? umb__transmittance_run : q.opaque_run;
    q.run = q.window_run;
    if (UMB__HAS_STATIC && content->receiver_mask_cells != NULL) {
        umb__receiver_mask_set(&q, content);
    }
    if (UMB__HAS_FOOTPRINTS && settings->filter == UMB_FILTER_FOOTPRINT) {
        set_footprint(&q, asset, settings);
    }
    memcpy(query->opaque, &q, sizeof q);
    return UMB_OK;
}

uint32_t umb_query_taps(const struct umb_query *query)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    return (uint32_t)q.taps;
}

/*
 * Returns 1 if none of CHECK_WORDS numbers is infinite or NaN: adding one to the exponent's lowest
 * bit then never reaches the sign bit. It has no branch and a fixed length, so compilers vectorise
 * it.
 */
#define CHECK_WORDS 96 /* divides into whole points */

static int all_finite_f32(const uint8_t *bytes)
{
    uint32_t carry = 0;
    for (size_t i = 0; i < CHECK_WORDS; i++) {
        uint32_t bits;
        memcpy(&bits, bytes + i * sizeof bits, sizeof bits);
        carry |= (bits & 0x7f800000U) + 0x00800000U;
    }
    return carry >> 31 == 0;
}

static int all_finite_f64(const uint8_t *bytes)
{
    uint64_t carry = 0;
    for (size_t i = 0; i < CHECK_WORDS; i++) {
        uint64_t bits;
        memcpy(&bits, bytes + i * sizeof bits, sizeof bits);
        carry |= (bits & 0x7ff0000000000000U) + 0x0010000000000000U;
    }
    return carry >> 63 == 0;
}

/* Number of coordinates that are proven finite, in whole blocks. */
static size_t count_finite(const struct umb_points *points)
{
    const size_t block = CHECK_WORDS / 3;
    const int wide = points->format == UMB_POINT_F64;
    const size_t stride = CHECK_WORDS * (wide ? sizeof(double) : sizeof(float));
    const uint8_t *bytes = points->positions;
    size_t count = 0;
    while (points->count - count >= block &&
           (wide ? all_finite_f64(bytes) : all_finite_f32(bytes))) {
        bytes += stride;
        count += block;
    }
    return count;
}

enum umb_status umb_points_check(const struct umb_points *points, struct umb_error *error)
{
    if (UMB__UNKNOWN(points, "points", error)) {
        return UMB_E_ARGUMENT;
    }
    static const char axes[] = "xyz";
    for (unsigned axis = 0; axis < 3; axis++) {
        if (!isfinite(points->origin[axis])) {
            return umb_fail(error, UMB_E_ARGUMENT, "origin.%c: %g, must be finite", axes[axis],
                            points->origin[axis]);
        }
    }
    if (points->format != UMB_POINT_F32 && points->format != UMB_POINT_F64) {
        return umb_fail(error, UMB_E_ARGUMENT, "points: unknown format %d", (int)points->format);
    }
    for (size_t i = count_finite(points); i < points->count; i++) {
        for (unsigned axis = 0; axis < 3; axis++) {
            double value = umb__coordinate(points, i, axis);
            if (!isfinite(value)) {
                return umb_fail(error, UMB_E_ARGUMENT, "points[%zu].%c: %g, must be finite", i,
                                axes[axis], value);
            }
        }
    }
    for (size_t i = 0; points->footprints != NULL && i < points->count; i++) {
        float side;
        memcpy(&side, (const uint8_t *)points->footprints + i * sizeof side, sizeof side);
        if (!(side >= 0 && side <= FLT_MAX)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "footprints[%zu]: %g, must be finite and not below 0", i, (double)side);
        }
    }
    return UMB_OK;
}

void umb_query_run(const struct umb_query *query, const struct umb_points *points, size_t first,
                   size_t count, struct umb_answers *answers)
{
    struct umb__query q;
    memcpy(&q, query->opaque, sizeof q);
    q.run(&q, points, first, count, answers);
}

size_t umb_answer_bytes(enum umb_answer_format format, size_t count)
{
    switch (format) {
    case UMB_ANSWER_F32:
        return count * sizeof(float);
    case UMB_ANSWER_U8:
        return count;
    case UMB_ANSWER_BIT:
        return count / 8 + (count % 8 != 0);
    }
    return 0;
}
