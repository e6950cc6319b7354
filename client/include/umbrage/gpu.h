/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_GPU_H
#define UMBRAGE_GPU_H
/*
 * Gives a GPU the voxels of an asset, and the transform that takes positions to them. The shaders
 * of share/umbrage/gpu read both (docs/guide/gpu.md).
 *
 *     struct umb_gpu_layout layout;
 *     struct umb_gpu_view view = {.light = 0, .bias_mode = UMB_BIAS_AUTO};
 *     struct umb_gpu_placement placement;
 *     struct umb_gpu_precision precision;
 *     if (umb_gpu_layout_make(asset, 0, &layout, &error)) {
 *         return error.status;
 *     }
 *     uint32_t *entries = malloc((size_t)layout.entries * UMB_GPU_ENTRY_BYTES);
 *     if (entries == NULL) {
 *         return UMB_E_NO_MEMORY;
 *     }
 *     umb_gpu_write(asset, NULL, &layout, 0, layout.entries, entries);
 *     // ... copy `entries` to a buffer or texture of the GPU
 *     free(entries);
 *     if (umb_gpu_place(asset, &view, &placement, &precision, &error)) {
 *         return error.status;
 *     }
 *     // ... copy `placement` to a uniform buffer
 *
 * The array has entries of four 32-bit words: a head, two entries for each frustum, the grids, the
 * wide nodes, the bricks and the occluder depth. For a partial asset (umbrage/partial.h)
 * umb_gpu_changes lists the entries that new pages changed, so a new page costs only its own bytes.
 * Nodes and bricks keep their places. A new layout, and a copy of the whole array, is needed only
 * if they outgrow their room.
 *
 * Threads: functions of one asset or partial asset, one at a time.
 * Stability: experimental: may change in a minor version.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_partial; /* See umbrage/partial.h */

#define UMB_GPU_ENTRY_BYTES 16

/* Where the parts of an asset stand in the array, in entries. */
struct umb_gpu_layout {
    uint32_t entries;                 /* Length of the array */
    uint32_t node_first, node_room;   /* Wide nodes, and room for more of them */
    uint32_t brick_first, brick_room; /* Bricks, and room for more of them */
    uint32_t pad;                     /* Zero */
    uint64_t reserved[2];             /* Zero: room for later versions (umbrage/version.h) */
};

/* A range of entries. */
struct umb_gpu_range {
    uint32_t first, count;
};

/* The space of the shader's positions, and the bias of its look-ups. */
struct umb_gpu_view {
    uint32_t light;   /* Index of the light */
    uint32_t face;    /* Face of a light that is not directional: below its frustum_count */
    int has_to_world; /* 1: positions are in the space that to_world takes to the world */
    enum umb_bias_mode bias_mode; /* As in struct umb_query_settings */
    double bias;                  /* As there */
    /* World position of the shader's position 0, 0, 0; used if has_to_world is 0. The shader's
     * floats are finest near it. */
    double origin[3];
    /* A move and a rotation: 4x4, column major, such as that of a camera to the world */
    double to_world[16];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Numbers from which the shader computes voxels: struct UmbragePlacement of the shaders, byte for
 * byte. The shaders' source describes the members. */
struct umb_gpu_placement {
    int32_t row_x[4], row_y[4], row_z[4], row_w[4];
    uint32_t low[4];
    int32_t info[4];
    float step_x[4], step_y[4], step_z[4], light[4], lamp[4], axis[4];
};

/*
 * How precisely the shader places positions. A position whose voxel coordinates, with the bias of
 * its look-up, are farther than these bounds from a whole number gets the voxel that umb_query_run
 * computes from the same position in doubles. The bounds are those of windows; of coarse look-ups,
 * whose bias is longer, they are 2^level times as large. Under a light that is not directional the
 * bounds hold at the far side of the face; nearer to the light they grow as voxels there shrink.
 */
struct umb_gpu_precision {
    double range_m;       /* Positions with a coordinate beyond this distance from 0, bias included,
                       count as lit */
    double across;        /* Bound of x and y, in voxels */
    double depth;         /* Bound of z, in voxels */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Lays out an asset: a whole one, or the lower asset of a partial one (umb_partial_lower).
 *
 * In:    spare: entries to reserve for nodes and bricks of later pages; 0 for whole assets.
 * Fails: E_TOO_LARGE (more than 2^28 entries).
 */
UMB_API UMB_CHECKED enum umb_status umb_gpu_layout_make(const struct umb_asset *asset,
                                                        uint32_t spare,
                                                        struct umb_gpu_layout *layout,
                                                        struct umb_error *error);

/* Returns 1 if the nodes and bricks of an asset fit the rooms of a layout, else 0. */
UMB_API int umb_gpu_layout_fits(const struct umb_asset *asset, const struct umb_gpu_layout *layout);

/*
 * Writes entries first .. first + count - 1 of the array.
 *
 * In:    partial: the partial asset whose lower asset `asset` is; its missing cubes are marked.
 *        NULL: a whole asset. layout: one that fits. first, count: within it.
 * Out:   entries: uint32_t[4 * count].
 */
UMB_API void umb_gpu_write(const struct umb_asset *asset, const struct umb_partial *partial,
                           const struct umb_gpu_layout *layout, uint32_t first, uint32_t count,
                           uint32_t *entries);

/*
 * Lists the entries that builds of a partial asset changed since they were listed last. The first
 * call lists the whole array. Call it after umb_partial_build, until it returns 0; a new layout
 * needs the whole array instead, and umb_gpu_forget_changes.
 *
 * In:    room: length of ranges, at least 1.
 * Returns the number of ranges listed.
 * Cost:  a bit of memory for each 64 bytes of nodes and bricks, from the first call on.
 */
UMB_API size_t umb_gpu_changes(struct umb_partial *partial, const struct umb_gpu_layout *layout,
                               struct umb_gpu_range *ranges, size_t room);

/* Forgets the changes so far: the whole array is copied. */
UMB_API void umb_gpu_forget_changes(struct umb_partial *partial);

/*
 * Computes the transform from the shader's positions to the voxels of a directional light, or of
 * one face of another light.
 *
 * Fails: E_NOT_FOUND (no such light), E_ARGUMENT (view; the field is named).
 */
UMB_API UMB_CHECKED enum umb_status umb_gpu_place(const struct umb_asset *asset,
                                                  const struct umb_gpu_view *view,
                                                  struct umb_gpu_placement *placement,
                                                  struct umb_gpu_precision *precision,
                                                  struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
