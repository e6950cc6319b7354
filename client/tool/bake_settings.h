/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_BAKE_SETTINGS_H
#define UMBRAGE_TOOL_BAKE_SETTINGS_H
/*
 * The options of umbrage-bake that decide the content of the asset. A bake job may have these and
 * no others: threads, memory and tiles belong to the machine that bakes, and no job names files.
 *
 * umbrage-bake adds the kind and the destination of each value to these rows; `umbrage submit` and
 * the daemon use the rows as they are.
 */
#include "tool/options.h"
#include "umbrage/jobs.h"

#define UMBU_BAKE_RESOLUTION                                                                       \
    "resolution", "N", "voxels a side, a power of two, 64 to 262144", .otherwise = "16384"
#define UMBU_BAKE_MAX_ERROR                                                                        \
    "max-error", "M",                                                                              \
        "instead of --resolution: the smallest that keeps one tap within M metres of true shadow " \
        "boundaries; says what that will cost before it starts"
#define UMBU_BAKE_SUN                                                                              \
    "sun", "AZ,EL",                                                                                \
        "sun from azimuth AZ (degrees clockwise from north: +y in z-up scenes, -z in y-up ones) "  \
        "and elevation EL (degrees above the horizon)"
#define UMBU_BAKE_SUN_PATH                                                                         \
    "sun-path", "LAT,LON,YYYY-MM-DD,MINUTES",                                                      \
        "the suns of that day, one every so many minutes of mean solar time from midnight on, "    \
        "while above the horizon (degrees north and east)"
#define UMBU_BAKE_POINT "point", "X,Y,Z", "a light that shines all around from there"
#define UMBU_BAKE_SPOT                                                                             \
    "spot", "X,Y,Z,DX,DY,DZ,DEGREES",                                                              \
        "a light at X,Y,Z that shines along DX,DY,DZ within so many degrees of it, at most 90"
#define UMBU_BAKE_AREA                                                                             \
    "area", "X,Y,Z,DX,DY,DZ,SIZE",                                                                 \
        "a flat light around X,Y,Z that shines to the side DX,DY,DZ: a disc with SIZE its "        \
        "diameter, or a rectangle with SIZE WIDTH,HEIGHT or WIDTH,HEIGHT,AX,AY,AZ (metres; the "   \
        "width lies along AX,AY,AZ, or level)"
#define UMBU_BAKE_LIGHT                                                                            \
    "light", "NAME",                                                                               \
        "the file's light of that name. --sun, --sun-path, --point, --spot, --area and --light "   \
        "may be "                                                                                  \
        "repeated and mixed: all lights share one asset. Without them: the file's lights, else "   \
        "--sun 135,45"
#define UMBU_BAKE_LIGHT_SIZE                                                                       \
    "light-size", "SIZE",                                                                          \
        "how large the lights are, recorded in the asset: as 0.53deg (what suns have without it) " \
        "for directional ones, as 0.25m for spot and point lights"
#define UMBU_BAKE_UP                                                                               \
    "up", "y|z", "the up axis",                                                                    \
        .otherwise = "y for glTF; what an OBJ, PLY or STL file tells, else z and a warning"
#define UMBU_BAKE_CLOSED                                                                           \
    "closed", "auto|on|off|parts",                                                                 \
        "leave the inside of closed solids undefined: of those that are closed, if that makes "    \
        "the "                                                                                     \
        "asset smaller (auto) or in any case (parts), of everything on your word (on), never "     \
        "(off)",                                                                                   \
        .otherwise = "auto"
#define UMBU_BAKE_EFFECT                                                                           \
    "effect", "NAME=on|off",                                                                       \
        "overrule the plan: closed, front (first occluders of closed solids, for columns), "       \
        "penumbra (on: front as well; off: lights without an extent), cut-out (holes by the "      \
        "alpha of textures), transmittance (glass, hair: casters that take part of the light), "   \
        "blend-cut-out (BLEND materials that are clear or opaque nearly all over as cut-outs), "   \
        "static; mraa and voaa can only be off in this version"
#define UMBU_BAKE_STATIC                                                                           \
    "static", NULL,                                                                                \
        "nothing moves: only points on surfaces are asked for, and what lies elsewhere is left "   \
        "undefined, counted in every reply"
#define UMBU_BAKE_DEPTH                                                                            \
    "depth", "auto|embree|raster|plain",                                                           \
        "how depth is found; all give the same bits (auto: raster; plain: that without vector "    \
        "instructions)",                                                                           \
        .otherwise = "auto"
#define UMBU_BAKE_VERIFY                                                                           \
    "verify", "N", "compare N points with traced rays before publishing, 0 = off",                 \
        .otherwise = "1000000"

#define UMBU_BAKE_SETTING_COUNT 15
#define UMBU_BAKE_COLLECTED_MAX 512

/* Settings in the order in which they were given; several may have one name. */
struct umbu_bake_settings {
    struct umb_job_setting list[UMBU_BAKE_COLLECTED_MAX];
    size_t count;
};

/* Rows that collect names and values into a struct umbu_bake_settings. */
extern const struct umbu_option UMBU_BAKE_SETTINGS[UMBU_BAKE_SETTING_COUNT];

/* Checks that an asset was baked from a scene, by the hashes of both. Fails: E_BAD_SCENE. */
UMB_CHECKED enum umb_status
umbu_scene_match(const char *asset, const uint8_t asset_hash[UMB_ID_BYTES], const char *scene,
                 const uint8_t scene_hash[UMB_ID_BYTES], struct umb_error *error);

/* The row of a name, or NULL: no job may have it. */
const struct umbu_option *umbu_bake_setting(const char *name);

#endif
