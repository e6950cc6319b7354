/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ASSET_H
#define UMBRAGE_ASSET_H
/*
 * Assets: the immutable shadow data of one scene and its lights.
 *
 *     struct umb_asset *asset;
 *     struct umb_error error;
 *     if (umb_asset_open_file("city.umb", NULL, &asset, &error) != UMB_OK) {
 *         fprintf(stderr, "%s\n", error.message);
 *         return error.status;
 *     }
 *     // ... umb_query_prepare(asset, ...) and umb_query_run(...), see umbrage/query.h
 *     umb_asset_close(asset);
 *
 * An asset has two encodings of the same content: packed (.umb, for storing and sending) and mapped
 * (.umbm, laid out for queries and used in place). Every function takes either; a packed file is
 * expanded in memory.
 *
 * Ownership: the asset owns its memory and file mappings. Strings and arrays that it returns are
 * borrowed until umb_asset_close.
 * Threads: an open asset is immutable. Any number of threads may query it and read its
 * description at once. umb_asset_close must run after the last use.
 * Trust: open is safe on hostile bytes. It checks everything a query relies on, so that queries
 * cannot fail and never read outside the asset. It does not prove that the id belongs to the
 * content: umb_packed_prove and umb_asset_prove (umbrage/file.h) do, by SHA-256.
 * Texts (plan, settings, notes, names) are UTF-8 without NUL, but may hold control characters.
 * Caveat: a mapped file (.umbm) must not be truncated or overwritten while it is open, or queries
 * may read outside it; the store's files are never edited in place (docs/reference/operations.md).
 * A packed file is read only while it opens.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"
#include "umbrage/geom.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_ID_BYTES     32    /* SHA-256 */
#define UMB_ID_TEXT_SIZE 65    /* lower-case hexadecimal and a NUL */
#define UMB_LEVEL_BRICK  3     /* an 8x8x8 brick is the node of level 3 */
#define UMB_LEVEL_MIN    6     /* smallest frustum: 64 voxels a side */
#define UMB_LEVEL_MAX    20    /* largest: 1048576 voxels a side */
#define UMB_LIGHTS_MAX   4096  /* lights in one asset */
#define UMB_FRUSTA_MAX   24576 /* frusta in one asset: six a light */
#define UMB_NAME_SIZE    64    /* bytes of a light's name with its NUL */

struct umb_asset; /* opaque */

/* How much of a file is checked when it opens. */
enum umb_trust {
    UMB_TRUST_NOTHING = 0, /* Default: all checksums and the whole structure are checked */
    /* For a file that has passed a full check and that no other user can write to. Mapped files:
     * checks the head, the canonical block, and the lengths of sections, grids and levels, but not
     * the numbers in grids and nodes; queries of a file that was changed since may read any memory.
     * Packed files: checks all but the checksums of the pages. */
    UMB_TRUST_VALIDATED,
};

struct umb_open_options {
    enum umb_trust trust;
    /* Most bytes that a packed file may need while it expands: pages, octree, grids, nodes and
     * bricks together. A file that needs more is refused. Not counted: up to two copies of its
     * head, and up to twelve times its `transmittance_bytes`. 0 = 64 GiB. */
    uint64_t max_memory_bytes;
    const struct umb_alloc *alloc; /* NULL = malloc; must outlive the asset */
    uint64_t reserved[4];          /* Zero: room for later versions (umbrage/version.h) */
};

enum umb_encoding {
    UMB_ENCODING_PACKED = 0, /* .umb */
    UMB_ENCODING_MAPPED = 1, /* .umbm */
};

enum umb_light_kind {
    UMB_LIGHT_DIRECTIONAL = 0,
    UMB_LIGHT_SPOT = 1,
    UMB_LIGHT_POINT = 2,
    /* Area lights: flat, and shine to the side that `direction` looks to. Shadows without a filter
     * are those of a light at the middle. */
    UMB_LIGHT_RECTANGLE = 3,
    UMB_LIGHT_DISC = 4,
};

#define UMB_LIGHT_KINDS   5   /* Number of values of enum umb_light_kind in this version */
#define UMB_LAMP_SIZE_MAX 1e6 /* Largest extent of a lamp that has penumbras, metres */

/* Returns the name of a kind as a static string: "directional", "spot", "point", "rectangle",
 * "disc"; "unknown" for any other number. */
UMB_API const char *umb_light_kind_name(enum umb_light_kind kind);

/* Description of one light. World space, metres, radians. */
struct umb_light_info {
    char name[UMB_NAME_SIZE]; /* Name: UTF-8, may be empty, NUL-terminated */
    enum umb_light_kind kind;
    double direction[3]; /* Unit vector in which the light travels (point light: 0). It is
                            perpendicular to the plane of an area light */
    double position[3];  /* Position, metres, scene origin included; of area lights their middle
                            (not directional) */
    /* Size of the light; 0: none. Directional: angular diameter, radians. Spot, point: diameter of
     * a sphere, metres. Disc: diameter, metres. Rectangle: length of the side across `side`,
     * metres. */
    double extent;
    uint32_t first_frustum; /* Index of the light's first frustum; its others follow */
    uint32_t frustum_count; /* Number of the light's frusta: 1 if directional, else up to 6 */
    double side[3];         /* Rectangle: vector of one side, metres, across `direction`; else 0 */
    uint64_t reserved[1];   /* Zero: room for later versions (umbrage/version.h) */
};

/* One light-space frustum. */
struct umb_frustum_info {
    uint32_t log2_size; /* Binary logarithm of the voxels a side: 1 << log2_size voxels */
    uint32_t light;     /* Index of the frustum's light */
    int closed;         /* 1: baked under the closed rule, undefined inside closed solids */
    /* Transform, row major: (X, Y, Z, W) = M * (world - origin, 1); voxel = (X / W, Y / W, Z), so
     * z is linear along the axis. Directional lights: W = 1. Spot and point lights: W is the
     * distance from the light along the frustum's axis, metres; points with W <= 0 are outside. */
    double world_to_voxel[4][4];
    /* Row i: world vector in metres of one voxel along voxel axis i. In a perspective frustum the
     * rows of x and y hold where W = 1 and grow with W; the row of z runs along the frustum's
     * axis. */
    double voxel_step[3][3];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Description of an asset. */
struct umb_asset_info {
    uint8_t id[UMB_ID_BYTES];
    enum umb_encoding encoding; /* Encoding of the file that the asset was opened from */
    uint64_t file_bytes;        /* Length of that file */
    uint64_t memory_bytes;      /* Bytes that queries read: the sum of the next six fields */
    uint64_t grid_bytes;
    uint64_t node_bytes;
    uint64_t brick_bytes;
    uint64_t occluder_depth_bytes; /* Bytes of the occluder depth map; 0: none */
    uint64_t transmittance_bytes;  /* Bytes of the transmittance of translucent casters; 0: none */
    uint64_t receiver_mask_bytes;  /* Bytes of the receiver mask; 0: not the static rule */
    uint32_t light_count;
    uint32_t frustum_count;
    uint64_t level_nodes[UMB_LEVEL_MAX + 1]; /* Unique nodes of each level; [3] are the bricks */
    uint64_t packed_bytes; /* Length of the packed file that was opened; 0 for a mapped one */
    uint64_t bytes_2014;   /* Bytes of the same voxels in the encoding of Sintorn et al. 2014; 0 if
                              the bake did not record it */
    double origin[3];      /* Scene origin that transforms start from, metres, world space */
    struct umb_box bounds; /* Box around the casters, metres, world space */
    uint8_t scene_hash[UMB_ID_BYTES]; /* SHA-256 of the scene's content */
    const char *plan;                 /* Bake plan, one line an effect, UTF-8; never NULL */
    const char *settings;             /* Bake settings, canonical key=value lines; never NULL */
    const char *notes;                /* Notes, key=value lines outside the id; never NULL */
    uint64_t reserved[8];             /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens an asset file, packed or mapped; its first bytes say which.
 *
 * In:    path: NUL-terminated. options: NULL for the defaults; copied, except the allocator.
 * Out:   out: the asset, or NULL on failure.
 * Owns:  the caller closes it with umb_asset_close.
 * Fails: E_NO_INPUT (missing, no regular file), E_PERMISSION, E_LIMIT (no descriptor left),
 *        E_FORMAT, E_VERSION (needs a newer reader), E_TRUNCATED, E_CORRUPT, E_TOO_LARGE (over
 *        max_memory_bytes), E_NO_MEMORY, E_IO. A failure leaves no memory or descriptor behind.
 * Threads: any number at once.
 * Trust: safe on hostile files with UMB_TRUST_NOTHING.
 * Cost:  mapped: one pass over the file (1 GB/s or more), or over its head with
 *        UMB_TRUST_VALIDATED. Packed: expands in memory. Blocks on the disk.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_open_file(const char *path,
                                                        const struct umb_open_options *options,
                                                        struct umb_asset **out,
                                                        struct umb_error *error);

/*
 * Opens an asset from memory.
 *
 * In:    bytes: uint8[size]; for a mapped asset 64-byte aligned.
 * Owns:  bytes are borrowed: of a mapped asset until umb_asset_close, and they must not change; of
 *        a packed one during the call.
 * Fails: as umb_asset_open_file, except for errors of files; E_ARGUMENT if a mapped asset is not
 *        aligned.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_open_bytes(const void *bytes, size_t size,
                                                         const struct umb_open_options *options,
                                                         struct umb_asset **out,
                                                         struct umb_error *error);

/* Closes an asset and frees all it owns. NULL is allowed. Threads: no other thread may use it. */
UMB_API void umb_asset_close(struct umb_asset *asset);

/* Fills info. Never fails. Owns: its texts are borrowed until umb_asset_close. Cost: O(1). */
UMB_API void umb_asset_get_info(const struct umb_asset *asset, struct umb_asset_info *info);

/* Fills info of light `index`. Fails: E_NOT_FOUND (no such light); info is then unchanged. */
UMB_API UMB_CHECKED enum umb_status
umb_asset_get_light(const struct umb_asset *asset, uint32_t index, struct umb_light_info *info);

/* Fills info of frustum `index`. Fails: E_NOT_FOUND (no such frustum); info is then unchanged. */
UMB_API UMB_CHECKED enum umb_status
umb_asset_get_frustum(const struct umb_asset *asset, uint32_t index, struct umb_frustum_info *info);

/* Fills in the edges of a voxel along x, y and z, metres. In a perspective frustum voxels grow with
 * the distance from the light; the edges are then those of the farthest voxels. */
UMB_API void umb_frustum_voxel_edges(const struct umb_frustum_info *frustum, double edges[3]);

/* Writes an id as 64 lower-case hexadecimal digits and a NUL. */
UMB_API void umb_id_to_text(const uint8_t id[UMB_ID_BYTES], char text[UMB_ID_TEXT_SIZE]);

/* Reads 64 hexadecimal digits of either case. Fails: E_ARGUMENT (any other text); id is then
 * unchanged. */
UMB_API UMB_CHECKED enum umb_status umb_id_from_text(const char *text, uint8_t id[UMB_ID_BYTES]);

#ifdef __cplusplus
}
#endif
#endif
