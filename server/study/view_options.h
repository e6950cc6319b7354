/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_VIEW_OPTIONS_H
#define UMBRAGE_SERVER_STUDY_VIEW_OPTIONS_H
/*
 * A scene, a sun and a camera from the command line, for the studies that need no asset.
 *
 *     --sun AZ,EL   --camera WHERE   --size WxH   --up y|z
 */
#include "study/camera.h"
#include "study/study_scene.h"
#include "tool/options.h"

struct umbt_view_options {
    double sun[3]; /* Azimuth and elevation in degrees, and 1 if they were given */
    struct umbt_camera_request camera;
    uint32_t size[2]; /* Pixels */
    unsigned up;      /* 0 by the scene's format, 1 y, 2 z */
};

/* Readers of --sun into double[3], of --camera into a struct umbt_camera_request. */
enum umb_status umbt_read_sun(const struct umbu_option *option, const char *text, void *field,
                              struct umb_error *error);
enum umb_status umbt_read_camera(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error);

/* Rows that several commands have. type: their settings. */
#define UMBT_CAMERA_ROW(type, field)                                                               \
    "camera", "WHERE",                                                                             \
        "eye=X,Y,Z[,target=X,Y,Z][,fov=DEG], or [az=DEG][,el=DEG][,fov=DEG]: fitted to the "       \
        "scene from a compass direction",                                                          \
        UMBU_READ(umbt_read_camera, "eye=X,Y,Z or az=DEG and more, with commas"),                  \
        UMBU_AT(type, field),                                                                      \
        .otherwise = "fitted, from 80 degrees beside the sun, 35 above the horizon, fov 35"
#define UMBT_UP_ROW(type, field)                                                                   \
    "up", "y|z", "the scene's up axis", UMBU_CHOICE("|y|z"), UMBU_AT(type, field),                 \
        .otherwise = "by its format"
#define UMBT_SIZE_ROW(type, field, side_max, pixels)                                               \
    "size", "WxH", "pixels of a view", UMBU_SIDES(side_max),                                       \
        .high = 67108864, UMBU_AT(type, field), .standard = (pixels)
#define UMBT_SUN_ROW(type, field)                                                                  \
    "sun", "AZ,EL", "degrees",                                                                     \
        UMBU_READ(umbt_read_sun, "AZIMUTH,ELEVATION with elevation above 0 to 90"),                \
        UMBU_AT(type, field), .otherwise = "the scene's first sun, else 135,45"
#define UMBT_THREADS_ROW(type)                                                                     \
    "threads", "N", "threads that work", UMBU_COUNT(1, 256), UMBU_AT(type, threads),               \
        .otherwise = "all processors"
/* The opened scene, sun and camera. */
struct umbt_view {
    struct umbt_scene scene;
    struct umbt_camera camera;
    double to_light[3]; /* unit */
    int z_up;
};

/*
 * Loads the scene, chooses the sun (given, else the scene's first directional
 * light, else 135,45) and makes the camera.
 *
 * Fails: as umbt_scene_init, umbt_camera_make.
 */
UMB_CHECKED enum umb_status umbt_view_open(const struct umbt_view_options *options,
                                           const char *scene, struct umbt_view *view,
                                           struct umb_error *error);
void umbt_view_close(struct umbt_view *view); /* a zeroed struct is allowed */

#endif
