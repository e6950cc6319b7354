/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_SETUP_H
#define UMBRAGE_SERVER_STUDY_SETUP_H
/*
 * A scene, a sun and a camera: what every picture of the study begins with. The commands that need
 * no asset take all three from the command line.
 */
#include "study/camera.h"
#include "study/study_scene.h"
#include "tool/options.h"

/* A scene under parallel light, seen by a camera. */
struct umbt_setup {
    const struct umbt_scene *scene; /* borrowed */
    struct umbt_camera camera;
    double to_light[3]; /* unit */
    int z_up;
};

/* Options of the commands that look at a scene without an asset. */
struct umbt_setup_options {
    const char *scene, *output; /* Names of the scene file and of the picture, or NULL */
    double sun[3];              /* Azimuth and elevation in degrees, and 1 if they were given */
    struct umbt_camera_request camera;
    uint32_t size[2]; /* Pixels */
    unsigned up;      /* 0 by the scene's format, 1 y, 2 z */
    uint64_t threads;
    int json, quiet;
};

/* Readers of --sun into double[3], of --camera into a struct umbt_camera_request. */
enum umb_status umbt_read_sun(const struct umbu_option *option, const char *text, void *field,
                              struct umb_error *error);
enum umb_status umbt_read_camera(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error);

/* Rows that several commands have. type: their settings. */
#define UMBT_SCENE_ROW(type, field)                                                                \
    "SCENE", NULL, "the scene file", UMBU_TEXT, UMBU_AT(type, field), .needed = true
#define UMBT_CAMERA_ROW(type, field)                                                               \
    "camera", "WHERE",                                                                             \
        "position of the camera: eye=X,Y,Z[,target=X,Y,Z][,fov=DEG] in metres, or "                \
        "[az=DEG][,el=DEG][,fov=DEG], a compass direction from which the scene fills the picture", \
        UMBU_READ(umbt_read_camera, "eye=X,Y,Z or az=DEG and more, with commas"),                  \
        UMBU_AT(type, field), .otherwise = "80 degrees beside the sun, el=35, fov=35"
#define UMBT_UP_ROW(type, field)                                                                   \
    "up", "y|z", "the scene's up axis", UMBU_CHOICE("|y|z"), UMBU_AT(type, field),                 \
        .otherwise = "by its format"
#define UMBT_SIZE_ROW(type, field, side_max, pixels)                                               \
    "size", "WxH", "width and height of the view in pixels", UMBU_SIDES(side_max),                 \
        .high = 67108864, UMBU_AT(type, field), .standard = (pixels)
#define UMBT_THREADS_ROW(type)                                                                     \
    "threads", "N", "number of working threads", UMBU_COUNT(1, 256), UMBU_AT(type, threads),       \
        .otherwise = "all processors"
#define UMBT_SEED_ROW(type)                                                                        \
    "seed", "N", "seed of the random points; the same seed gives the same points",                 \
        UMBU_COUNT(0, UINT64_MAX), UMBU_AT(type, seed), .standard = "1"

/* Section of option rows, for commands whose settings have a struct umbt_setup_options `field`. */
#define UMBT_SETUP_COUNT 6
extern const struct umbu_option UMBT_SETUP_OPTIONS[UMBT_SETUP_COUNT];
#define UMBT_SETUP(type, field)                                                                    \
    {                                                                                              \
        "the view", UMBT_SETUP_OPTIONS, UMBT_SETUP_COUNT, offsetof(type, field)                    \
    }

/*
 * Finds the direction to a scene's first directional light, as the file has it. Without such a
 * light: azimuth 135, elevation 45, as the bake chooses. Returns 1 if the light is the file's.
 */
int umbt_scene_sun(const struct umbt_scene *scene, int z_up, double to_light[3]);

/* What a camera is fitted to: all corners of a scene. */
struct umbt_camera_subject umbt_subject(const struct umbt_scene *scene, const double to_light[3],
                                        int z_up);

/* Makes the camera of a setup whose other fields are set. size: width and height in pixels. Fails:
 * the errors of umbt_camera_make. */
UMB_CHECKED enum umb_status umbt_setup_camera(struct umbt_setup *setup,
                                              const struct umbt_camera_request *request,
                                              const uint32_t size[2], struct umb_error *error);

/*
 * Loads the scene, chooses the sun (given, else umbt_scene_sun) and makes the camera.
 *
 * Out:   scene: finish with umbt_scene_finish, also after a failure. setup borrows it.
 * Fails: the errors of umbt_scene_init and umbt_camera_make.
 */
UMB_CHECKED enum umb_status umbt_setup_open(const struct umbt_setup_options *options,
                                            struct umbt_scene *scene, struct umbt_setup *setup,
                                            struct umb_error *error);

#endif
