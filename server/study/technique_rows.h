/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_ROWS_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_ROWS_H
/*
 * The techniques that the study compares: their settings, and the truth of each.
 */
#include "umbrage/cascades.h"

enum umbt_technique_truth {
    UMBT_BOX = 0,  /* rays over the filter's box; of cascades, of the box in a point's own slice */
    UMBT_POINT,    /* one ray */
    UMBT_PENUMBRA, /* rays to points of the light's disc */
    UMBT_TECHNIQUE_TRUTHS
};

struct umbt_technique_row {
    const char *name; /* "vsm-sat" */
    enum umbt_technique_truth truth;
    struct umb_map_settings settings; /* blur is set to the filter's width for BASE */
    struct umb_map_filter filter;     /* width, light_size and biases are set by the study */
    uint32_t cascades;                /* slices of the view with a map each; 0: one map for all */
    enum umb_cascade_fit fit;         /* BOX: not LISPSM */
};

/* All rows, in the order of the table. */
extern const struct umbt_technique_row umbt_technique_rows[];
extern const size_t umbt_technique_row_count;

#endif
