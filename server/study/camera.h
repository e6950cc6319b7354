/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_CAMERA_H
#define UMBRAGE_SERVER_STUDY_CAMERA_H
/*
 * Pinhole cameras: the camera of --camera, or a fitted view without it.
 *
 * The default view is a three-quarter view from 35 degrees above the horizon. Its compass direction
 * is 80 degrees to one side of the sun's: the side from which the scene fills more of the picture,
 * clockwise if both are equal. The light then comes from the side: shadows lie across the picture,
 * one face of a box is lit and one is not. The vertical field of view is 35 degrees. The eye moves
 * along and across the view until all geometry just fits, with 4 % to spare.
 *
 * Compass: azimuth in degrees clockwise from north (+y in z-up scenes, -z in y-up ones), elevation
 * above the horizon, as for suns. All positions in metres, world space.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/geom.h"
#include "umbrage/status.h"

/* A camera as --camera states it; zeroed means the default view. */
struct umbt_camera_request {
    bool has_eye, has_target, has_azimuth, has_elevation;
    double eye[3], target[3];
    double azimuth_deg;   /* compass direction of the fitted camera, seen from the scene */
    double elevation_deg; /* -90..90 */
    double fov_deg;       /* vertical, 1..150; 0 = 35 */
};

struct umbt_camera {
    double eye[3];
    double right[3], up[3], forward[3]; /* orthonormal */
    double tan_x, tan_y;                /* tangents of half the fields of view */
};

/* Converts a camera to the struct of the libraries, which has a range from near_m to far_m. */
struct umb_camera umbt_camera_view(const struct umbt_camera *camera, double near_m, double far_m);

/* Vertical field of view, degrees. */
double umbt_camera_fov_deg(const struct umbt_camera *camera);

/* The geometry a camera is fitted to. */
struct umbt_camera_subject {
    const double (*points)[3]; /* [count], borrowed */
    size_t count;              /* number of points, at least 1 */
    struct umb_box box;        /* bounds of the points */
    int z_up;
    double to_light[3]; /* unit, from the scene to the sun */
};

/*
 * Parses `eye=X,Y,Z[,target=X,Y,Z][,fov=DEG]` or `[az=DEG][,el=DEG][,fov=DEG]`.
 *
 * Fails: E_ARGUMENT (unknown key, key twice, a number missing or out of range, eye mixed with az
 *        or el, eye at the target).
 */
UMB_CHECKED enum umb_status umbt_camera_parse(const char *text, struct umbt_camera_request *request,
                                              struct umb_error *error);

/*
 * Makes a camera for a picture of width x height pixels.
 *
 * Fails: E_ARGUMENT (eye without target lies at the centre of the box).
 * Cost:  one pass over the points, none if the request gives an eye.
 */
UMB_CHECKED enum umb_status umbt_camera_make(const struct umbt_camera_request *request,
                                             const struct umbt_camera_subject *subject,
                                             uint32_t width, uint32_t height,
                                             struct umbt_camera *camera, struct umb_error *error);

/* Computes the unit direction through a point of the picture: u, v in 0..1 from left and top. */
void umbt_camera_ray(const struct umbt_camera *camera, double u, double v, double direction[3]);

/* Returns a position's distance from the eye along the view. */
double umbt_camera_depth(const struct umbt_camera *camera, const double position[3]);

/* Unit vector of a compass direction, from the scene outwards. */
void umbt_compass_vector(double azimuth_deg, double elevation_deg, int z_up, double out[3]);

/* Returns a direction's azimuth in degrees, 0..360; `otherwise` within 1 degree of vertical. */
double umbt_compass_azimuth(const double direction[3], int z_up, double otherwise);

#endif
