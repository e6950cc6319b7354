/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_MAPS_FIXTURE_H
#define UMBRAGE_TESTS_MAPS_FIXTURE_H
/*
 * Maps whose space is easy to think in: world x and y are texels, world z is depth in hundredths
 * (depth 0..1 is 0..100 metres), light from above along +z.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/maps.h"

static inline struct umb_map_frustum plain_frustum(uint32_t width, uint32_t height)
{
    struct umb_map_frustum frustum = {
        .width = width, .height = height, .depth_m = 100.0, .directional = 1};
    frustum.world_to_map[0][0] = 1.0;
    frustum.world_to_map[1][1] = 1.0;
    frustum.world_to_map[2][2] = 0.01;
    frustum.world_to_map[3][3] = 1.0;
    frustum.light[2] = -1.0;
    return frustum;
}

static inline struct umb_map *map_of(const struct umb_map_frustum *frustum, const float *depth,
                                     const struct umb_map_settings *settings)
{
    struct umb_map *map = NULL;
    struct umb_error error = {.message = ""};
    const struct umb_map_layer layer = {.depth = depth};
    if (umb_map_build(frustum, &layer, settings, NULL, &map, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return map;
}

static inline struct umb_map_query query_of(const struct umb_map *map,
                                            const struct umb_map_filter *filter)
{
    struct umb_map_query query;
    struct umb_error error = {.message = ""};
    if (umb_map_prepare(map, filter, &query, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    return query;
}

/* Answers points given as (texel x, texel y, depth 0..1), without normals. */
static inline void ask(const struct umb_map_query *query, const double (*at)[3], size_t count,
                       float *values)
{
    double(*world)[3] = malloc(count * sizeof *world);
    assert_non_null(world);
    for (size_t i = 0; i < count; i++) {
        world[i][0] = at[i][0];
        world[i][1] = at[i][1];
        world[i][2] = 100.0 * at[i][2];
    }
    const struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = count};
    umb_map_run(query, &points, 0, count, values);
    free(world);
}

static inline double ask_one(const struct umb_map_query *query, double x, double y, double depth)
{
    const double at[1][3] = {{x, y, depth}};
    float value = -1.0F;
    ask(query, at, 1, &value);
    return (double)value;
}

#endif
