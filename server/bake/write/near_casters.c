/* SPDX-License-Identifier: Apache-2.0 */
/* See near_casters.h. Squares that lie close together share a box; a triangle counts if its own box
 * across the light meets one. */
#include "bake/write/near_casters.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"

enum {
    BOXES_MAX = 8,
    GATHER = 512, /* texels: squares as close to a box enlarge it */
    SLACK = 4,    /* texels beside a box; the band reaches one texel, float rays less than that */
};

struct box {
    double low[2], high[2]; /* texels */
};

struct search {
    const struct umbb_check *check;
    struct umb_frustum_info frustum;
    double origin[3];
    struct box boxes[BOXES_MAX];
    size_t box_count;
    uint8_t *is_near; /* [check->count] */
};

/* 1 if two boxes come as close as this many texels. */
static int are_close(const struct box *a, const struct box *b, double reach)
{
    for (int k = 0; k < 2; k++) {
        if (a->low[k] > b->high[k] + reach || b->low[k] > a->high[k] + reach) {
            return 0;
        }
    }
    return 1;
}

static void box_add(struct box *box, const struct box *other)
{
    for (int k = 0; k < 2; k++) {
        box->low[k] = fmin(box->low[k], other->low[k]);
        box->high[k] = fmax(box->high[k], other->high[k]);
    }
}

/* Gathers the squares in boxes. Returns 0 if there are too many. */
static int gather(struct search *search, const struct umbr_square *squares, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const double x = squares[i].x, y = squares[i].y;
        const struct box one = {{x, y}, {x + UMBR_SQUARE, y + UMBR_SQUARE}};
        size_t b = 0;
        while (b < search->box_count && !are_close(&search->boxes[b], &one, GATHER)) {
            b++;
        }
        if (b == BOXES_MAX) {
            return 0;
        }
        if (b == search->box_count) {
            search->boxes[search->box_count++] = one;
        }
        box_add(&search->boxes[b], &one);
    }
    return 1;
}

/* Marks a caster if it is near. */
static void mark(void *user, size_t number)
{
    struct search *search = user;
    const double(*corners)[3] = search->check->corners[number];
    struct box box = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
    for (int c = 0; c < 3; c++) {
        for (int k = 0; k < 2; k++) {
            const double *row = search->frustum.world_to_voxel[k];
            double at = row[3];
            for (int axis = 0; axis < 3; axis++) {
                at += row[axis] * (corners[c][axis] - search->origin[axis]);
            }
            box.low[k] = fmin(box.low[k], at);
            box.high[k] = fmax(box.high[k], at);
        }
    }
    for (size_t b = 0; b < search->box_count; b++) {
        search->is_near[number] |= (uint8_t)are_close(&box, &search->boxes[b], SLACK);
    }
}

/* Copies the marked casters. */
static enum umb_status copy(const struct search *search, struct umbb_near_casters *near,
                            struct umb_error *error)
{
    const struct umbb_check *check = search->check;
    size_t count = 0;
    for (size_t i = 0; i < check->count; i++) {
        count += search->is_near[i];
    }
    double(*corners)[3][3] = near->memory[0] = malloc((count + 1) * sizeof *corners);
    uint8_t *closed = near->memory[1] = malloc(count + 1);
    uint32_t *of = near->memory[2] = malloc((count + 1) * sizeof *of);
    if (corners == NULL || closed == NULL || of == NULL) {
        umbb_near_casters_finish(near);
        return umb_fail(error, UMB_E_NO_MEMORY, "self-check: memory for %zu casters refused",
                        count);
    }
    near->count = 0;
    for (size_t i = 0; i < check->count; i++) {
        if (search->is_near[i]) {
            memcpy(corners[near->count], check->corners[i], sizeof corners[0]);
            closed[near->count] = check->closed != NULL ? check->closed[i] : 0;
            of[near->count] = check->cuts->of != NULL ? check->cuts->of[i] : 0;
            near->count++;
        }
    }
    near->corners = (const double(*)[3][3])corners;
    near->closed = check->closed != NULL ? closed : NULL;
    near->cuts = *check->cuts;
    near->cuts.of = check->cuts->of != NULL ? of : NULL;
    return UMB_OK;
}

enum umb_status umbb_near_casters_find(const struct umb_asset *asset, uint32_t light,
                                       const struct umbb_check *check,
                                       const struct umbr_square *squares, size_t count,
                                       struct umbb_near_casters *near, int *found,
                                       struct umb_error *error)
{
    struct search search = {.check = check};
    struct umb_light_info info;
    struct umb_asset_info about;
    *near = (struct umbb_near_casters){.count = 0};
    *found = 0;
    UMB__TRY(umb_asset_get_light(asset, light, &info));
    if (info.kind != UMB_LIGHT_DIRECTIONAL || !gather(&search, squares, count)) {
        return UMB_OK;
    }
    UMB__TRY(umb_asset_get_frustum(asset, info.first_frustum, &search.frustum));
    umb_asset_get_info(asset, &about);
    memcpy(search.origin, about.origin, sizeof search.origin);
    search.is_near = calloc(check->count + 1, 1);
    if (search.is_near == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "self-check: memory for %zu casters refused",
                        check->count);
    }
    enum umb_status status =
        umbu_range_each(check->threads, check->count, 1 << 14, mark, &search, error);
    if (status == UMB_OK) {
        status = copy(&search, near, error);
    }
    free(search.is_near);
    *found = status == UMB_OK;
    return status;
}

void umbb_near_casters_finish(struct umbb_near_casters *near)
{
    for (size_t i = 0; i < sizeof near->memory / sizeof near->memory[0]; i++) {
        free(near->memory[i]);
    }
    *near = (struct umbb_near_casters){.count = 0};
}
