/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_MOMENT_ROWS_H
#define UMBRAGE_SERVER_STUDY_MOMENT_ROWS_H
/* The maps of moments that are compared with deep maps; each family rises in its parameter. */
#include <stddef.h>
#include "umbrage/maps.h"

struct umbt_moment_row {
    const char *name;
    struct umb_map_settings settings; /* without blur */
};

extern const struct umbt_moment_row umbt_moment_rows[];
extern const size_t umbt_moment_row_count;

/* Query of a row. */
struct umbt_moment_question {
    const struct umb_map_frustum *frustum;
    const struct umb_map_fragments *fragments;
    const struct umb_points *points;
    uint32_t taps;       /* width of the box blur of texels */
    double bias_m;       /* bias of the filter */
    const double *truth; /* [points->count] */
};

struct umbt_moment_result {
    struct umb_map_info info;
    double build_s, query_ns; /* CPU time of the whole build; of a point, the best of a few */
    double mean, lighter, darker, most; /* mean of |answer - truth|, its two parts, the largest */
};

/* Builds the map, queries it and compares. Out: values: float[points->count]. */
UMB_CHECKED enum umb_status umbt_moment_row_run(const struct umbt_moment_row *row,
                                                const struct umbt_moment_question *question,
                                                float *values, struct umbt_moment_result *result,
                                                struct umb_error *error);

#endif
