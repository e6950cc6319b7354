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

struct umbt_view_options {
    const char *sun, *camera, *size, *up; /* as given, or NULL */
    uint32_t width, height;               /* pixels; set to the defaults before parsing */
    uint32_t size_max;                    /* limit of each side */
};

/* The opened scene, sun and camera. */
struct umbt_view {
    struct umbt_scene scene;
    struct umbt_camera camera;
    double to_light[3]; /* unit */
    int z_up;
};

/*
 * Checks the options, loads the scene, chooses the sun (given, else the scene's first directional
 * light, else 135,45) and makes the camera.
 *
 * Fails: E_ARGUMENT naming the option; as umbt_scene_init, umbt_camera_make.
 */
UMB_CHECKED enum umb_status umbt_view_open(struct umbt_view_options *options, const char *scene,
                                           struct umbt_view *view, struct umb_error *error);
void umbt_view_close(struct umbt_view *view); /* a zeroed struct is allowed */

#endif
