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
 * Stability: stable; umbrage/version.h says what that means.
 */

#ifdef __cplusplus
extern "C" {
#endif

struct umb_box {
    double min[3]; /* metres, world space */
    double max[3];
};

/*
 * A camera: where its eye is, where it looks, and the shape of its picture. World space, metres,
 * radians. Functions name the fields that they do not read.
 */
struct umb_camera {
    double eye[3];     /* Position, finite */
    double forward[3]; /* Direction of view, of any length above 0 */
    double up[3];      /* Upward direction, of any length above 0, 1e-9 rad or more off forward */
    double fov_y;      /* Angle of the picture's height, above 0 and below pi */
    double aspect;     /* Width of the picture divided by its height, above 0 */
    double near_m, far_m; /* Distances between which the camera sees */
};

#ifdef __cplusplus
}
#endif
#endif
