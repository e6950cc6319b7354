/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_VERIFY_BOUNDS_H
#define UMBRAGE_SERVER_STUDY_VERIFY_BOUNDS_H
/*
 * Test of the bounds that an asset's accuracy curve states. Each point on the scene's surfaces is
 * answered by a query and by a ray. Where the two differ, another ray must find the other truth
 * within the bound. These rays start at places around the point and at the centres of the voxels of
 * the answer.
 *
 * A window that reaches into a closed solid is undefined; the bound promises nothing there.
 */
#include "study/setup.h"

struct umbt_bounds {
    const struct umbt_common *common;
    struct umb_asset *asset;
    uint32_t first_light, light_count; /* Range of lights to check */
    uint64_t points;                   /* Number of points for each row of a curve */
    uint64_t beyond; /* Out: answers that differ without a true boundary within the bound */
};

/*
 * Checks every row of the lights' curves, and prints each when it is done.
 *
 * Fails: E_NO_MEMORY, E_BAD_SCENE (no curve), and the errors of umb_query_prepare.
 * Cost:  about a ray a point and row, and a few hundred where answers differ.
 */
UMB_CHECKED enum umb_status umbt_bounds_verify(struct umbt_bounds *bounds, struct umb_error *error);

#endif
