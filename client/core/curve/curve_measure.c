/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See curve_measure.h. A point is placed as a query places it. A second look-up at full resolution,
 * up to half a voxel to the side, estimates the error of its answer: an answer cannot depend on
 * where in a voxel the true boundary runs. The second look-up is half a texel farther off the
 * surface, so that the sideways move does not lead into the surface itself.
 */
#include "curve/curve_measure.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "curve/octree_window.h"
#include "format/asset_parts.h"
#include "query/perspective.h"

/* A setting to be measured. */
struct setting {
    struct umb__query query;  /* as asked */
    struct umb__query fine;   /* Second look-up: the same window, at full resolution */
    struct umb__query beside; /* Places the second look-up: with the bias of one texel more */
    struct umb__curve_record sums;
};

/* Mixes a counter into bits (splitmix64, Steele et al. 2014). */
static uint64_t mix(uint64_t counter)
{
    uint64_t bits = (counter + 1) * UINT64_C(0x9e3779b97f4a7c15);
    bits = (bits ^ bits >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    bits = (bits ^ bits >> 27) * UINT64_C(0x94d049bb133111eb);
    return bits ^ bits >> 31;
}

/* Finds the frustum and the voxel of a point's look-up; false if its normal faces away. */
static bool place(const struct umb__query *q, const struct umb_points *points, size_t i,
                  double voxel[3], uint32_t *frustum)
{
    if (q->face_count > 0) {
        struct umb__sighting sighting;
        umb__perspective_map(q, points, i, &sighting);
        memcpy(voxel, sighting.voxel, sizeof sighting.voxel);
        *frustum = q->first_face + sighting.face;
        return !sighting.facing_away;
    }
    double p[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        p[axis] = points->origin[axis] - q->origin[axis] + umb__coordinate(points, i, axis);
    }
    *frustum = q->frustum;
    if (!umb__move(q, points, i, p)) {
        return false;
    }
    umb__to_voxel(q, p, voxel);
    return true;
}

/* Answers a look-up; space beyond the frustum is lit and reads nothing. */
static uint32_t look_up(const struct umb__query *q, const struct umb__content *content,
                        const struct umb__octree *octree, uint32_t frustum, const double voxel[3],
                        struct umb__octree_window *read)
{
    struct umb__query sized = *q;
    struct umb_query_stats ignored = {0};
    sized.log2_size = content->frusta[frustum].log2_size;
    const struct umb__window window = umb__window_at(&sized, voxel, &ignored);
    *read = (struct umb__octree_window){.octree = octree,
                                        .root = frustum,
                                        .level = q->level,
                                        .x0 = window.x0,
                                        .x1 = window.x1,
                                        .y0 = window.y0,
                                        .y1 = window.y1,
                                        .z = window.z};
    if (window.all_lit) {
        read->lines = 1;
        return q->level > 0 ? 2 : (uint32_t)(q->taps * q->taps);
    }
    return window.outside + umb__octree_window_count(read);
}

/* Adds point i to a setting's sums. */
static void add_point(struct setting *s, const struct umb__content *content,
                      const struct umb__octree *octree, const struct umb_points *points, size_t i)
{
    const struct umb__query *q = &s->query;
    struct umb__octree_window read;
    double voxel[3], aside[3];
    uint32_t frustum;
    if (!place(q, points, i, voxel, &frustum)) {
        return;
    }
    const uint64_t total = q->level > 0 ? 2 : (uint64_t)q->taps * (uint64_t)q->taps;
    const uint64_t lit = look_up(q, content, octree, frustum, voxel, &read);
    s->sums.points++;
    s->sums.nodes += read.nodes;
    s->sums.lines += read.lines;
    (void)place(&s->beside, points, i, aside, &frustum);
    const uint64_t bits = mix(i);
    aside[0] += (double)(bits >> 40) * 0x1p-24 - 0.5;
    aside[1] += (double)(bits & 0xffffffU) * 0x1p-24 - 0.5;
    uint64_t other = look_up(&s->fine, content, octree, frustum, aside, &read);
    other *= q->level > 0 ? 2 : 1; /* one tap against halves */
    const uint64_t difference = lit > other ? lit - other : other - lit;
    s->sums.squares += difference * difference * UMB__CURVE_SQUARE / (total * total);
}

static enum umb_status prepare(const struct umb_asset *bare, struct umb_query_settings settings,
                               struct setting *s, struct umb_error *error)
{
    struct umb_query query;
    memset(s, 0, sizeof *s);
    UMB__TRY(umb_query_prepare(bare, &settings, &query, error));
    memcpy(&s->query, query.opaque, sizeof s->query);
    settings.level = 0;
    enum umb_status status = umb_query_prepare(bare, &settings, &query, error);
    memcpy(&s->fine, query.opaque, sizeof s->fine);
    s->beside = s->fine;
    s->beside.taps++;
    s->sums = (struct umb__curve_record){
        .light = settings.light, .level = s->query.level, .taps = settings.taps};
    return status;
}

static enum umb_status list_settings(const struct umb_asset *bare, uint32_t light,
                                     struct setting *settings, uint32_t *count,
                                     struct umb_error *error)
{
    const struct umb_light_info *info = &bare->canonical.content.lights[light];
    const struct umb_frustum_info *frustum = &bare->canonical.content.frusta[info->first_frustum];
    const uint32_t highest =
        info->kind == UMB_LIGHT_DIRECTIONAL && bare->canonical.content.receiver_mask_cells == NULL
            ? umb_level_max(frustum->log2_size)
            : 0;
    enum umb_status status = UMB_OK;
    *count = 0;
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX && status == UMB_OK; taps += 2) {
        const struct umb_query_settings wanted = {.light = light, .taps = taps};
        status = prepare(bare, wanted, &settings[(*count)++], error);
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= highest && status == UMB_OK; level += 2) {
        const struct umb_query_settings wanted = {.light = light, .taps = 1, .level = level};
        status = prepare(bare, wanted, &settings[(*count)++], error);
    }
    return status;
}

_Static_assert(UMB__CURVE_TAPS_COUNT + (UMB_LEVEL_MAX - UMB__GRID_LOG2_MAX + 1) / 2 <=
                   UMB_CURVE_ROWS_MAX,
               "rows of a light");

enum umb_status umb__curve_measure(const struct umb__content *content,
                                   const struct umb__octree *octree, uint32_t light,
                                   const struct umb_points *points,
                                   struct umb__curve_record records[UMB_CURVE_ROWS_MAX],
                                   uint32_t *count, struct umb_error *error)
{
    const struct umb_alloc *alloc = octree->alloc;
    struct umb_asset bare = {.canonical.content = *content}; /* The parts of an asset that preparing
                                                                a query reads */
    struct umb__top *tops = umb__alloc_zeroed(alloc, content->frustum_count, sizeof *tops);
    struct umb_frustum_info *frusta = umb__alloc(alloc, content->frustum_count, sizeof *frusta);
    struct setting *settings = umb__alloc_zeroed(alloc, UMB_CURVE_ROWS_MAX, sizeof *settings);
    static const uint32_t no_grid[1];
    static const struct umb__column no_columns[1];
    uint32_t rows = 0;
    enum umb_status status = UMB_OK;
    *count = 0;
    bare.view.tops = tops;
    bare.view.grid = no_grid;
    bare.view.columns = no_columns;
    bare.view.pieces = no_grid;
    bare.canonical.content.frusta = frusta;
    if (!tops || !settings || !frusta) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "accuracy curve: out of memory");
    } else if (light >= content->light_count) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "light: %u, the asset has %u", light,
                          content->light_count);
    } else {
        memcpy(frusta, content->frusta, content->frustum_count * sizeof *frusta);
        umb__content_derive(&bare.canonical.content); /* As every reader of the file does */
        status = list_settings(&bare, light, settings, &rows, error);
    }
    for (uint32_t row = 0; row < rows && status == UMB_OK; row++) {
        for (size_t i = 0; i < points->count; i++) {
            add_point(&settings[row], &bare.canonical.content, octree, points, i);
        }
        if (settings[row].sums.points > 0) {
            records[(*count)++] = settings[row].sums;
        }
    }
    umb__free(alloc, settings);
    umb__free(alloc, frusta);
    umb__free(alloc, tops);
    return status;
}
