/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_DAG_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_DAG_H
/*
 * A baked asset as rows of the study of techniques, on the same points of the same view. One tap is
 * compared with one ray, and the view's filter, in voxels, with rays over its box.
 */
#include "study/technique_view.h"

#define UMBT_DAG_ROWS 2U

/* The truths of the rows. */
extern const enum umbt_technique_truth umbt_dag_truths[UMBT_DAG_ROWS];

/*
 * Opens an asset for a view.
 *
 * Fails: as umb_asset_open_file; E_ARGUMENT (its first light is not the view's sun).
 */
UMB_CHECKED enum umb_status umbt_dag_open(const struct umbt_technique_view *view, const char *path,
                                          struct umb_asset **asset, struct umb_error *error);

/* umbt_technique_run for row `row` of an asset; of result->info only `bytes` is set. */
UMB_CHECKED enum umb_status umbt_dag_run(const struct umbt_technique_view *view,
                                         const struct umb_asset *asset, uint32_t row, float *values,
                                         struct umbt_technique_result *result,
                                         struct umb_error *error);

#endif
