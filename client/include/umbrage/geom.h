/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_GEOM_H
#define UMBRAGE_GEOM_H
/*
 * The few geometric types that cross an interface.
 *
 * World space is the scene's own coordinates (metres unless the scene says otherwise), right
 * handed. Voxel space is one frustum's: x and y across the light, z along it, one unit a voxel,
 * integer voxel i covers [i, i+1). Doubles everywhere: a national-grid coordinate of 1e7 m keeps
 * 2e-9 m, far below any voxel.
 */

#ifdef __cplusplus
extern "C" {
#endif

struct umb_box {
    double min[3]; /* metres, world space */
    double max[3];
};

#ifdef __cplusplus
}
#endif
#endif
