/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_CUT_PLANES_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_CUT_PLANES_H
/* Cut-out casters of a frustum. */
#include "bake/analysis/analysis.h"
#include "bake/depth/cut_out.h"

/* Bytes of an analysis's cut-out casters, edge functions included. */
uint64_t umbb_cut_bytes(const struct umbb_analysis *analysis);

/*
 * Prepares the cut-out casters of an analysis for frustum `number`. The corners must be in world
 * space.
 *
 * Out:   cuts: borrows from the analysis, valid until the next call for it.
 */
void umbb_cut_planes_make(struct umbb_analysis *analysis, uint32_t number, struct umbb_cuts *cuts);

/* Prepares the translucent triangles, for any frustum; the corners may be in any space. */
void umbb_cut_planes_translucent(struct umbb_analysis *analysis,
                                 const struct umb_frustum_info *frustum, struct umbb_cuts *cuts);

#endif
