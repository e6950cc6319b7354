/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_OPTIONS_BAKE_OPTIONS_H
#define UMBRAGE_SERVER_BAKE_OPTIONS_BAKE_OPTIONS_H
/*
 * The command line of umbrage-bake, checked.
 *
 * Every refusal names the option, the value and its limits. Only the command line is checked here,
 * not the scene's content.
 */
#include <stddef.h>
#include <stdint.h>
#include "bake/options/light_options.h"
#include "bake/sandbox/sandbox.h"
#include "tool/options.h"
#include "tool/threads.h"

enum umbb_closed_mode {
    UMBB_CLOSED_AUTO = 0,  /* parts that are closed, if that saves enough bytes */
    UMBB_CLOSED_ON = 1,    /* every part, on the caller's word */
    UMBB_CLOSED_OFF = 2,   /* none */
    UMBB_CLOSED_PARTS = 3, /* parts that are closed, whatever that saves */
};

enum umbb_depth_path {
    UMBB_DEPTH_AUTO = 0, /* the rasteriser */
    UMBB_DEPTH_EMBREE = 1,
    UMBB_DEPTH_RASTER = 2,
    UMBB_DEPTH_PLAIN = 3, /* the rasteriser without vector kernels, whatever the processor has */
};

enum umbb_up_axis {
    UMBB_UP_OF_SCENE = 0, /* y for glTF, else as found for the file (umbs_scene_view.z_up) */
    UMBB_UP_Y = 1,
    UMBB_UP_Z = 2,
};

/* Setting of half shadows (penumbras). */
enum umbb_penumbra_mode {
    UMBB_PENUMBRA_AUTO = 0, /* on if a light's extent calls for it and occluders are known */
    UMBB_PENUMBRA_ON,       /* on; the asset keeps first occluders (`front`) */
    UMBB_PENUMBRA_OFF,      /* the asset's lights get no extent: queries have no penumbras */
};

/* Tasks of the program. */
enum umbb_task {
    UMBB_TASK_BAKE = 0,
    UMBB_TASK_TILE = 1,   /* `tile`: results of tiles into a folder */
    UMBB_TASK_MERGE = 2,  /* `merge`: an asset from a folder of such results */
    UMBB_TASK_IMPORT = 3, /* `import`: the scene as a file for --scene-buffer */
};

#define UMBB_RESOLUTION_LOG2_MIN 6U
#define UMBB_RESOLUTION_LOG2_MAX 18U
#define UMBB_TILE_LOG2_MIN       6U
#define UMBB_THREADS_MAX         UMBU_THREADS_MAX
#define UMBB_VERIFY_POINTS_MAX   1000000000U

struct umbb_options {
    enum umbb_task task;
    const char *scene;    /* borrowed from argv */
    int scene_buffer;     /* 1: the scene is a file of task import (--scene-buffer) */
    const char *output;   /* a folder with task tile; NULL with plan */
    const char *cache;    /* folder of tile results to use and fill, or NULL */
    const char *from;     /* task merge: folder of the tile results */
    uint64_t cache_bytes; /* limit of the cache; with task tile only if given */
    int cache_size_given;
    int only_given; /* task tile: only tiles only_first .. only_last */
    uint64_t only_first, only_last;
    uint32_t resolution_log2;
    double max_error_m; /* above 0: chooses the resolution */
    struct umbb_light_requests lights;
    enum umbb_up_axis up;
    enum umbb_closed_mode closed;
    int occluder_depth;         /* effect `front`, if the closed rule applies */
    int occluder_depth_refused; /* effect `front` was switched off */
    int static_rule;            /* effect `static`: nothing moves */
    int opaque_cut_outs;        /* effect `cut-out` switched off */
    int opaque_translucents;    /* effect `transmittance` switched off */
    int sharp_cut_outs;         /* effect `blend-cut-out`: sharp BLEND materials are cut-outs */
    enum umbb_penumbra_mode penumbra;
    unsigned threads; /* 1.. */
    uint64_t memory_bytes;
    uint32_t tile_log2;
    enum umbb_depth_path depth;
    uint64_t verify_points; /* 0 = off */
    int progress_fd;        /* descriptor of a supervisor (bake_progress.h); -1 = none */
    enum umbb_sandbox_mode sandbox;
    int plan, json, quiet, help, version;
};

/*
 * Reads argv[1..]. argv[1] may name the task: import, tile, merge.
 *
 * Out:   options: complete; with help or version no other option is required.
 * Fails: E_ARGUMENT.
 */
UMB_CHECKED enum umb_status umbb_options_parse(int argc, char **argv, struct umbb_options *options,
                                               struct umb_error *error);

/* The table of options. */
extern const struct umbu_command umbb_command;

/*
 * --effect NAME=on|off overrules what the analysis decides.
 *
 * Only effects that a caller can decide are accepted. For an effect that follows from the lights or
 * the coordinates, the refusal names the place to change it. An effect that this version lacks may
 * be off, never on.
 */

/* Reads --effect NAME=on|off into a struct umbb_options. Fails: E_ARGUMENT. */
enum umb_status umbb_effect_set(const struct umbu_option *option, const char *value, void *options,
                                struct umb_error *error);

/* Completes the effects after all options are read: "penumbra=on" turns first occluders on, unless
 * they are switched off. Fails: E_ARGUMENT (effects that exclude each other). */
UMB_CHECKED enum umb_status umbb_effects_settle(struct umbb_options *options,
                                                struct umb_error *error);

#endif
