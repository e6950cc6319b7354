/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sample points near shadow boundaries, see umbrage/sample.h.
 *
 * The cells that hold a boundary (boundary_draw.h) are counted, and each point gets one of them; a
 * second pass draws the points. Every point has random numbers of its own, made from the seed and
 * the point's number, and is checked against the look-up of queries.
 */
#include "umbrage/sample.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/reserved.h"
#include "base/try.h"
#include "format/receiver_mask.h"
#include "query/boundary_draw.h"
#include "query/perspective.h"
#include "query/stages.h"
#include "query/voxel_walk.h"

enum {
    TRIES = 4, /* Boundaries drawn for a point in one cell */
    CELLS = 4, /* Cells tried for a point, one after the other, before it is given up */
    CANCEL_POINTS = 1024,
};

/* Distance in voxels that points keep from the faces of their voxel, so that rounding to floats
 * leaves them inside. */
#define MARGIN (1.0 / 16)

/* A sample in progress. */
struct sampling {
    const struct umb_asset *asset;
    const struct umb_sample_settings *settings;
    struct umb__query query; /* Look-up of one tap without bias, of the whole light */
    /* The frustum at hand. */
    const struct umb_frustum_info *frustum;
    uint32_t frustum_number;
    struct umb__tree tree;
    uint32_t cells;  /* Number of cells with boundaries so far */
    uint32_t total;  /* Number of them in all frusta, once they are counted */
    uint32_t wanted; /* Number of points at boundaries; 0 while cells are counted */
    /* The next point at a boundary. */
    uint32_t next, cell; /* Its number, and that of its cell */
    uint32_t misses;     /* Number of cells where it was not found */
    struct umb__draws draws;
    uint32_t stride;   /* Step between the places of consecutive points in the sample; it has no
                          common divisor with their number */
    double *positions; /* [3 * settings->count]; NAN at first */
};

/* Returns the place of a point in the sample. Points of neighbouring cells have places far
 * apart. */
static double *place_of(const struct sampling *s, uint32_t point)
{
    return s->positions + 3 * (size_t)((uint64_t)point * s->stride % s->settings->count);
}

/* Returns false for a voxel that is undefined under the static rule, else true. */
static bool is_receiver(const struct sampling *s, const uint32_t voxel[3])
{
    const uint64_t *mask = s->asset->canonical.content.receiver_mask_cells;
    return mask == NULL ||
           umb__receiver_mask_has(mask + s->frustum_number * UMB__RECEIVER_MASK_WORDS,
                                  s->tree.log2_size, voxel);
}

/* Returns true if queries look a point up in this voxel, and the voxel is not undefined. */
static bool is_looked_up_in(const struct sampling *s, const double p[3], const uint32_t voxel[3])
{
    struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
    double found[3] = {0};
    uint32_t frustum;
    memcpy(points.origin, s->query.origin, sizeof points.origin);
    if (!umb__look_up_at(&s->query, &points, 0, found, &frustum) || frustum != s->frustum_number) {
        return false;
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        if (!(isfinite(p[axis]) && found[axis] >= voxel[axis] && found[axis] < voxel[axis] + 1.0)) {
            return false;
        }
    }
    return is_receiver(s, voxel);
}

/* Draws a point in one of the two voxels of a boundary. Returns false if a query of that point
 * would read another voxel. */
static bool draw_at(struct sampling *s, const struct umb__boundary *boundary, double p[3])
{
    const uint32_t *voxel = umb__draw(&s->draws) & 1 ? boundary->lit : boundary->shadowed;
    double place[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        place[axis] = voxel[axis] + MARGIN + (1 - 2 * MARGIN) * umb__draw_unit(&s->draws);
    }
    umb__voxel_to_world(s->frustum, place, p);
    return is_looked_up_in(s, p, voxel);
}

/* --- over all cells --- */

/* Draws the next point in a cell. If no boundary of the cell suits, returns false and leaves the
 * point NAN. */
static bool draw_point(struct sampling *s, const struct umb__boundary_cell *cell)
{
    struct umb__boundary boundary;
    double p[3];
    for (int i = 0; i < TRIES && umb__boundary_draw(&s->tree, cell, &s->draws, &boundary); i++) {
        if (draw_at(s, &boundary, p)) {
            memcpy(place_of(s, s->next), p, sizeof p);
            return true;
        }
    }
    return false;
}

/* Draws a cell for the next point. The cells are divided into as many equal parts as there are
 * points, and each point gets a cell of its own part. */
static void begin_point(struct sampling *s)
{
    s->draws = umb__draws_of(s->settings->seed, s->next);
    s->misses = 0;
    const uint64_t part = (uint64_t)s->next * s->total + umb__draw_below(&s->draws, s->total);
    s->cell = (uint32_t)(part / s->wanted);
}

/* Returns true if a cell may hold points whose answers are defined. Under the static rule these are
 * only cells that contain a marked cell of the receiver mask. */
static bool has_receivers(const struct sampling *s, const struct umb__boundary_cell *cell)
{
    const uint64_t *mask = s->asset->canonical.content.receiver_mask_cells;
    const uint32_t side = 1U << umb__tree_cell_level(&s->tree);
    const uint32_t step = 1U << (s->tree.log2_size - UMB__RECEIVER_MASK_LOG2);
    for (uint32_t z = 0; mask != NULL && z < side; z += step) {
        for (uint32_t y = 0; y < side; y += step) {
            for (uint32_t x = 0; x < side; x += step) {
                const uint32_t voxel[3] = {cell->first[0] + x, cell->first[1] + y,
                                           cell->first[2] + z};
                if (is_receiver(s, voxel)) {
                    return true;
                }
            }
        }
    }
    return mask == NULL;
}

static bool is_cancelled(const struct sampling *s)
{
    return s->settings->cancelled != NULL && s->settings->cancelled(s->settings->cancel_user);
}

/* Draws the points that belong to a cell. If no boundary of the cell suits a point, the next cell
 * is tried. Returns false if the sample is cancelled. */
static bool draw_points(struct sampling *s, const struct umb__boundary_cell *cell)
{
    while (s->next < s->wanted && s->cell <= s->cells) {
        if (!draw_point(s, cell) && ++s->misses < CELLS) {
            if (s->cells + 1 < s->total) {
                return true;
            }
            continue; /* the last cell */
        }
        s->next++;
        if (s->next % CANCEL_POINTS == 0 && is_cancelled(s)) {
            return false;
        }
        begin_point(s);
    }
    return true;
}

/* Visits a layer of cells: counts those with boundaries, and draws the points that belong to them.
 * Returns false if the sample is cancelled. */
static bool visit_layer(struct sampling *s, uint32_t z)
{
    const uint32_t side = 1U << s->tree.grid_log2;
    for (uint32_t y = 0; y < side; y++) {
        for (uint32_t x = 0; x < side; x++) {
            struct umb__boundary_cell cell;
            if (!umb__boundary_cell_read(&s->tree, x, y, z, &cell) || !has_receivers(s, &cell)) {
                continue;
            }
            if (!draw_points(s, &cell)) {
                return false;
            }
            s->cells++;
        }
    }
    return !is_cancelled(s);
}

/* Visits all cells of a light. Returns false if the sample is cancelled. */
static bool visit_cells(struct sampling *s)
{
    const struct umb__content *content = &s->asset->canonical.content;
    const struct umb_light_info *light = &content->lights[s->settings->light];
    s->cells = 0;
    for (uint32_t i = 0; i < light->frustum_count; i++) {
        struct umb__query face = s->query;
        if (s->query.face_count > 0) {
            umb__perspective_face(&s->query, i, &face);
        }
        s->tree = umb__tree_of(&face);
        s->frustum_number = light->first_frustum + i;
        s->frustum = &content->frusta[s->frustum_number];
        for (uint32_t z = 0; z < 1U << s->tree.grid_log2; z++) {
            if (!visit_layer(s, z)) {
                return false;
            }
        }
    }
    return true;
}

/* --- the sample --- */

/* Draws the points of the sample that may lie anywhere in the box around the casters, from number
 * `first` on. */
static void draw_scattered(const struct sampling *s, uint32_t first)
{
    const struct umb__content *content = &s->asset->canonical.content;
    for (uint32_t i = first; i < s->settings->count; i++) {
        struct umb__draws draws = umb__draws_of(s->settings->seed, i);
        double p[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            const double share = umb__draw_unit(&draws);
            p[axis] = content->bounds.min[axis] * (1 - share) + content->bounds.max[axis] * share -
                      content->origin[axis];
        }
        if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2])) {
            memcpy(place_of(s, i), p, sizeof p);
        }
    }
}

/* Returns the step between the places of consecutive points in a sample of `count`: about 0.618 of
 * `count`, without a common divisor. */
static uint32_t stride_of(uint32_t count)
{
    for (uint32_t stride = (uint32_t)(0.618 * count) + 1;; stride++) {
        uint32_t a = stride, b = count;
        while (b > 0) {
            const uint32_t rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1) {
            return stride;
        }
    }
}

/* Moves the points that were found to the front; returns their number. */
static size_t close_up(double *positions, size_t count)
{
    size_t found = 0;
    for (size_t i = 0; i < count; i++) {
        if (!isnan(positions[3 * i])) {
            memmove(positions + 3 * found++, positions + 3 * i, 3 * sizeof *positions);
        }
    }
    return found;
}

static void explain(const struct sampling *s, struct umb_sample *sample)
{
    const uint32_t count = s->settings->count;
    if (s->total == 0 && s->wanted > 0) {
        (void)snprintf(sample->note, sizeof sample->note, "light %u has no shadow boundary%s",
                       s->settings->light,
                       s->asset->canonical.content.receiver_mask_cells != NULL
                           ? " in a cell that holds receivers"
                           : ": each of its frusta is all lit or all shadowed");
    } else if (sample->count < count) {
        (void)snprintf(sample->note, sizeof sample->note,
                       "%zu of %u points were not found: the boundaries drawn for them lie where "
                       "queries of light %u do not answer from their voxels",
                       count - sample->count, count, s->settings->light);
    }
}

static enum umb_status check(const struct umb_sample_settings *settings, struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    if (settings->count < 1 || settings->count > UMB_SAMPLE_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "count: %u, must be 1 to %u", settings->count,
                        UMB_SAMPLE_MAX);
    }
    return settings->scattered >= 0 && settings->scattered <= 1
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "scattered: %g, must be 0 to 1",
                          settings->scattered);
}

enum umb_status umb_asset_sample(const struct umb_asset *asset,
                                 const struct umb_sample_settings *settings, double *positions,
                                 struct umb_sample *sample, struct umb_error *error)
{
    const struct umb_query_settings look_up = {.light = settings->light,
                                               .bias_mode = UMB_BIAS_NONE};
    struct sampling s = {.asset = asset, .settings = settings, .positions = positions};
    struct umb_query query;
    memset(sample, 0, sizeof *sample);
    UMB__TRY(check(settings, error));
    UMB__TRY(umb_query_prepare(asset, &look_up, &query, error));
    memcpy(&s.query, query.opaque, sizeof s.query);
    for (size_t i = 0; i < 3 * (size_t)settings->count; i++) {
        positions[i] = NAN;
    }
    s.stride = stride_of(settings->count);
    bool done = visit_cells(&s);
    s.total = s.cells;
    s.wanted = settings->count - (uint32_t)(settings->scattered * settings->count);
    if (done && s.total > 0 && s.wanted > 0) {
        begin_point(&s);
        done = visit_cells(&s);
    }
    if (!done) {
        return umb_fail(error, UMB_E_CANCELLED, "sample: cancelled");
    }
    draw_scattered(&s, s.wanted);
    sample->count = close_up(positions, settings->count);
    memcpy(sample->origin, s.query.origin, sizeof sample->origin);
    memcpy(sample->asset_id, asset->id, sizeof sample->asset_id);
    explain(&s, sample);
    return UMB_OK;
}
