/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_SEAMS_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_SEAMS_H
/*
 * Seams between the cascades of a view: how far the answers of two layers lie apart at the points
 * where one takes over from the other, and the contrasts that bring them together
 * (umb_cascades_match). Half of the points find a contrast, the other half judge it.
 */
#include "study/techniques.h"

/*
 * Judges the seams of cascades, and with `match` finds the contrast of each layer after the first.
 *
 * In:    maps: [plan->count]. filter: of all layers, with contrast 1.
 * Out:   seams: [plan->count - 1].
 * Fails: E_NO_MEMORY; as umb_map_prepare.
 */
UMB_CHECKED enum umb_status
umbt_seams_run(const struct umbt_technique_view *view, const struct umb_cascade_plan *plan,
               struct umb_map *const maps[], const struct umb_map_filter *filter, int match,
               struct umbt_seam seams[UMB_CASCADES_MAX], struct umb_error *error);

#endif
