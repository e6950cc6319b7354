/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_CASCADES_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_CASCADES_H
/*
 * Rows of the study that split the view (PSSM): a map for each slice, of half the view's texels a
 * side, so that four slices take the bytes of one map. The camera's distances are those of its
 * points.
 */
#include "study/technique_view.h"

/* umbt_technique_run for a row with cascades. Its box is that of a point's own slice. */
UMB_CHECKED enum umb_status umbt_technique_cascades_run(const struct umbt_technique_view *view,
                                                        const struct umbt_technique_row *row,
                                                        float *values,
                                                        struct umbt_technique_result *result,
                                                        struct umb_error *error);

#endif
