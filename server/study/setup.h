/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_SETUP_H
#define UMBRAGE_SERVER_STUDY_SETUP_H
/*
 * Shared parts of the sub-commands of umbrage-study: options, a scene, a sun and a camera, and the
 * way from the command line to the exit code.
 */
#include "study/camera.h"
#include "study/study_scene.h"
#include "tool/json.h"
#include "tool/options.h"

/* First field of every command's state. All but `code` and `scene` are options; no command has all
 * of them. */
struct umbt_common {
    const char *scene_path, *output; /* Names of the scene file and of the output, or NULL */
    double sun[3];                   /* Azimuth and elevation in degrees, and 1 if given */
    struct umbt_camera_request camera;
    uint32_t size[2]; /* Pixels */
    unsigned up;      /* 0 by the scene's format, 1 y, 2 z */
    unsigned threads;
    uint64_t seed;
    int force; /* 1: the asset may be of another scene */
    int json, quiet;
    int code;                /* Exit code of a command that succeeds */
    struct umbt_scene scene; /* Finished after the command */
};

/* A sub-command. It writes data to stdout and messages to stderr. */
struct umbt_command {
    const struct umbu_command *options;
    size_t bytes; /* Size of the state, which is zeroed before the options are read */
    enum umb_status (*run)(void *state, const struct umbu_parsed *parsed, struct umb_error *error);
    /* text prints the report of success, unless --quiet is given; json prints the members of the
     * JSON object. NULL: `run` prints them itself. */
    void (*text)(FILE *to, const void *state);
    void (*json)(struct umbu_json *json, const void *state);
    void (*finish)(void *state); /* After run, also if it failed */
};

extern const struct umbt_command umbt_render, umbt_verify, umbt_points, umbt_study_command,
    umbt_techniques, umbt_aliasing, umbt_deep;

/* Runs a command and returns the exit code of the process. argv[0]: the sub-command's name. */
int umbt_command_run(const struct umbt_command *command, int argc, char **argv);

/* A scene under parallel light, seen by a camera: what every picture begins with. */
struct umbt_setup {
    const struct umbt_scene *scene; /* borrowed */
    struct umbt_camera camera;
    double to_light[3]; /* unit */
    int z_up;
    int with_ground; /* 1: a fitted camera leaves room for shadows on a plane at the foot */
};

/* Rows that several commands have. */
#define UMBT_AT(field) UMBU_AT(struct umbt_common, field)
#define UMBT_SCENE_ROW                                                                             \
    "SCENE", NULL, "the scene file", UMBU_TEXT, UMBT_AT(scene_path), .needed = true
#define UMBT_CAMERA_ROW                                                                            \
    "camera", "WHERE",                                                                             \
        "position of the camera: eye=X,Y,Z[,target=X,Y,Z][,fov=DEG] in metres, or "                \
        "[az=DEG][,el=DEG][,fov=DEG], a compass direction from which the scene fills the picture", \
        UMBU_READ(umbt_read_camera, "eye=X,Y,Z or az=DEG and more, with commas"), UMBT_AT(camera), \
        .otherwise = "80 degrees beside the sun, el=35, fov=35"
#define UMBT_UP_ROW                                                                                \
    "up", "y|z", "the scene's up axis", UMBU_CHOICE("|y|z"), UMBT_AT(up),                          \
        .otherwise = "as for umbrage bake"
#define UMBT_SIZE_ROW(side_max, pixels)                                                            \
    "size", "WxH", "width and height of the view in pixels", UMBU_SIDES(side_max),                 \
        .high = 67108864, UMBT_AT(size), .standard = (pixels)
#define UMBT_THREADS_ROW                                                                           \
    "threads", "N", "number of working threads", UMBU_COUNT(1, 256), UMBT_AT(threads),             \
        .otherwise = "all processors"
#define UMBT_SEED_ROW                                                                              \
    "seed", "N", "seed of the random points; the same seed gives the same points",                 \
        UMBU_COUNT(0, UINT64_MAX), UMBT_AT(seed), .standard = "1"
#define UMBT_FORCE_ROW                                                                             \
    "force", NULL, "goes on even if the asset was baked from another scene", UMBU_FLAG,            \
        UMBT_AT(force)
#define UMBT_JSON_ROW         UMBU_JSON_ROW(struct umbt_common)
#define UMBT_QUIET_ROW(help_) UMBU_QUIET_ROW(struct umbt_common, help_)

/* Reader of --camera into a struct umbt_camera_request. */
enum umb_status umbt_read_camera(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error);

/* Section of option rows, for commands that look at a scene without an asset. */
#define UMBT_SETUP_COUNT 6
extern const struct umbu_option UMBT_SETUP_OPTIONS[UMBT_SETUP_COUNT];
#define UMBT_SETUP                                                                                 \
    {                                                                                              \
        "the view", UMBT_SETUP_OPTIONS, UMBT_SETUP_COUNT, 0                                        \
    }

/* Returns 1 if z is the up axis of the command's scene: by --up, else by the file. Warns if neither
 * tells it; call it once. */
int umbt_is_z_up(const struct umbt_common *common);

/* Checks that an asset was baked from the command's scene, by equal content hashes, unless --force
 * is given. Fails: E_BAD_SCENE, naming both hashes. */
UMB_CHECKED enum umb_status umbt_common_match(const struct umbt_common *common, const char *asset,
                                              const uint8_t asset_hash[UMB_ID_BYTES],
                                              struct umb_error *error);

/*
 * Finds the direction to a scene's first directional light, as the file has it. Without such a
 * light: azimuth 135, elevation 45, as the bake chooses. Returns 1 if the light is the file's.
 */
int umbt_scene_sun(const struct umbt_scene *scene, int z_up, double to_light[3]);

/* Returns the geometry that a camera is fitted to: all corners of a scene. */
struct umbt_camera_subject umbt_subject(const struct umbt_scene *scene, const double to_light[3],
                                        int z_up);

/* Makes the camera of a setup whose other fields are set; a camera without eye= shows what casts
 * (frame_casters.h). size: width and height in pixels. Fails: the errors of umbt_camera_make,
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_setup_camera(struct umbt_setup *setup,
                                              const struct umbt_camera_request *request,
                                              const uint32_t size[2], struct umb_error *error);

/*
 * Loads the scene, chooses the sun (given, else umbt_scene_sun) and makes the camera. setup borrows
 * the scene.
 *
 * Fails: the errors of umbt_scene_init and umbt_camera_make.
 */
UMB_CHECKED enum umb_status umbt_setup_open(struct umbt_common *common, struct umbt_setup *setup,
                                            struct umb_error *error);

#endif
