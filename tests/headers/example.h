/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_EXAMPLE_H
#define UMBRAGE_TESTS_EXAMPLE_H
/*
 * What the functions around the examples of the installed headers share. Each runs in a folder that
 * has the asset city.umb, which a daemon serves too; the examples name its address. Arguments of a
 * program: the scene of that asset, and an address of the daemon that takes jobs.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "umbrage/asset.h"
#include "umbrage/query.h"

enum {
    POINTS = 1000,
    SIDE = 64 /* pixels and texels of pictures and maps */
};

#define EXPECT(condition)                                                                          \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition);                \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

static struct umb_error error;
static float positions[3 * POINTS];
static float values[POINTS];

/* Prints the error of an example that returned early. */
static inline int example_end(enum umb_status status)
{
    if (status != UMB_OK) {
        fprintf(stderr, "%s: %s\n", umb_status_name(status), error.message);
    }
    return status == UMB_OK ? 0 : 1;
}

static inline struct umb_asset *example_asset(void)
{
    struct umb_asset *asset = NULL;
    EXPECT(umb_asset_open_file("city.umb", NULL, &asset, &error) == UMB_OK);
    return asset;
}

static inline struct umb_box example_bounds(void)
{
    struct umb_asset *asset = example_asset();
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    umb_asset_close(asset);
    return info.bounds;
}

/* Makes points all over the asset's bounds, the same ones each time. */
static inline struct umb_points example_points(void)
{
    const struct umb_box box = example_bounds();
    uint32_t state = 1;
    for (int i = 0; i < 3 * POINTS; i++) {
        state = state * 1664525U + 1013904223U;
        positions[i] =
            (float)(box.min[i % 3] + (box.max[i % 3] - box.min[i % 3]) * (state >> 8) / 16777216.0);
    }
    return (struct umb_points){.positions = positions, .count = POINTS};
}

/* Returns the number of points whose answer is above one half. */
static inline int example_lit(void)
{
    int lit = 0;
    for (int i = 0; i < POINTS; i++) {
        lit += values[i] > 0.5F;
    }
    return lit;
}

/* Computes the answers of query.h's functions for the points, to compare with. */
static inline void example_answers(const struct umb_query_settings *settings, float *out)
{
    struct umb_asset *asset = example_asset();
    struct umb_points points = example_points();
    struct umb_query query;
    EXPECT(umb_query_prepare(asset, settings, &query, &error) == UMB_OK);
    struct umb_answers answers = {.values = out};
    umb_query_run(&query, &points, 0, points.count, &answers);
    umb_asset_close(asset);
}

#endif
