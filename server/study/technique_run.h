/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_RUN_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_RUN_H
/*
 * The rows of `umbrage-study techniques`: techniques with their settings, and a baked asset. Each
 * row answers the points of the same view.
 */
#include "study/technique_view.h"
#include "umbrage/cascades.h"

struct umbt_technique_row {
    const char *name; /* "vsm-sat" */
    enum umbt_technique_truth truth;
    struct umb_map_settings
        settings;                 /* Settings; with access BASE the filter's width is the blur */
    struct umb_map_filter filter; /* Filter; the view sets width, light_size and biases */
    /* Number of slices of the view with a map each, of half the view's texels a side: four slices
     * take the bytes of one map. 0: one map for all points. */
    uint32_t cascades;
    enum umb_cascade_fit fit; /* Fit of the slices; not LISPSM with truth BOX */
};

/* All rows, in the order of the table (technique_rows.c). */
extern const struct umbt_technique_row umbt_technique_rows[];
extern const size_t umbt_technique_row_count;

/* Builds, queries and compares one row. values: float[receivers], out. */
UMB_CHECKED enum umb_status umbt_technique_run(const struct umbt_technique_view *view,
                                               const struct umbt_technique_row *row, float *values,
                                               struct umbt_technique_result *result,
                                               struct umb_error *error);

#define UMBT_DAG_ROWS 2U

/* Truths of an asset's rows: one tap against one ray; the view's filter, in voxels, against rays
 * over its box. */
extern const enum umbt_technique_truth umbt_dag_truths[UMBT_DAG_ROWS];

/*
 * Opens an asset for a view.
 *
 * Fails: the errors of umb_asset_open_file; E_ARGUMENT (its first light is not the view's sun).
 */
UMB_CHECKED enum umb_status umbt_dag_open(const struct umbt_technique_view *view, const char *path,
                                          struct umb_asset **asset, struct umb_error *error);

/* Queries and compares row `row` of an asset. In result->info only `bytes` is set. */
UMB_CHECKED enum umb_status umbt_dag_run(const struct umbt_technique_view *view,
                                         const struct umb_asset *asset, uint32_t row, float *values,
                                         struct umbt_technique_result *result,
                                         struct umb_error *error);

#endif
