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
 * Two encodings of one content: packed (.umb, what is stored and sent) and mapped (.umbm, laid out
 * for queries, used in place). Every function takes either; a packed file is expanded in memory.
 *
 * Ownership: the asset owns its memory and maps; strings and arrays it hands out are borrowed and
 * live until umb_asset_close.
 * Threads: an open asset is immutable. Any number of threads may query it and read its
 * description at once; only umb_asset_close needs that nobody else still uses it.
 * Trust: open is safe on hostile bytes. It checks everything a query relies on, so that queries
 * have no failure path and never read outside the asset. It does not prove that the bytes are
 * those the identity names: that takes SHA-256, which `umbrage verify` and the daemon's store do.
 * Texts (plan, settings, notes, names) are UTF-8 without NUL, but may hold control characters.
 * Caveat: a mapped file (.umbm) that another process truncates or overwrites while it is open
 * breaks that promise; the store's files are never edited in place (docs/reference/operations.md).
 * A packed one is not looked at any more once it is open.
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
#define UMB_FRUSTA_MAX   24576 /* six a light */
#define UMB_NAME_SIZE    64    /* bytes of a light's name with its NUL */

struct umb_asset; /* opaque */

/* How much of a file is checked when it opens. */
enum umb_trust {
    UMB_TRUST_NOTHING = 0, /* default: checksums of everything, and the whole structure */
    /* For a file that passed a full check before and that nobody else can write to. Mapped: head,
     * canonical block, and the lengths of sections, grids and levels are checked; the numbers in
     * grids and nodes are not, so that queries of a file altered since may read anywhere. Packed:
     * only the checksums of the pages are left out; their structure is checked as ever. */
    UMB_TRUST_VALIDATED,
};

struct umb_open_options {
    enum umb_trust trust;
    /* Refuse a packed file that needs more while it expands: pages, octree, grids, nodes and bricks
     * together. On top come its head, twice at most, and up to twelve times what translucent
     * casters take of it (`transmittance_bytes`). 0 = 64 GiB. */
    uint64_t max_memory_bytes;
    const struct umb_alloc *alloc; /* NULL = malloc; must outlive the asset */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

enum umb_encoding {
    UMB_ENCODING_PACKED = 0, /* .umb */
    UMB_ENCODING_MAPPED = 1, /* .umbm */
};

enum umb_light_kind {
    UMB_LIGHT_DIRECTIONAL = 0,
    UMB_LIGHT_SPOT = 1,
    UMB_LIGHT_POINT = 2,
};

/* What one light of an asset is. World space, metres, radians. */
struct umb_light_info {
    char name[UMB_NAME_SIZE]; /* UTF-8, may be empty, NUL-terminated */
    enum umb_light_kind kind;
    double direction[3]; /* unit vector in which the light travels (directional, spot; point: 0) */
    double position[3];  /* metres (spot, point), scene origin included */
    double extent;       /* angular diameter in radians (directional) or size in metres; 0 = none */
    uint32_t first_frustum; /* its frusta are first_frustum .. first_frustum + frustum_count - 1 */
    uint32_t frustum_count; /* 1 for directional, up to 6 for spot and point */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* One light-space frustum. */
struct umb_frustum_info {
    uint32_t log2_size; /* voxels a side = 1 << log2_size */
    uint32_t light;     /* index of the light it belongs to */
    int closed;         /* baked under the closed rule: undefined inside closed solids */
    /* Row major; (X, Y, Z, W) = M * (world - origin, 1); voxel = (X / W, Y / W, Z): z is linear
     * along the axis. Directional lights: W = 1. Spot and point: W is the distance from the light
     * along the frustum's axis in metres; what has W <= 0 is not in the frustum. */
    double world_to_voxel[4][4];
    /* Row i: world vector of one voxel along voxel axis i, metres; of a perspective frustum x and y
     * where W = 1 (they grow with W), z along the frustum's axis. */
    double voxel_step[3][3];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* What an asset is, in one look. */
struct umb_asset_info {
    uint8_t id[UMB_ID_BYTES];
    enum umb_encoding encoding; /* of the file it was opened from */
    uint64_t file_bytes;        /* of that file */
    uint64_t memory_bytes;      /* that queries read: the sum of the next six */
    uint64_t grid_bytes;
    uint64_t node_bytes;
    uint64_t brick_bytes;
    uint64_t occluder_depth_bytes; /* of first occluders behind closed fronts, or 0 */
    uint64_t transmittance_bytes;  /* of translucent casters, or 0 */
    uint64_t receiver_mask_bytes;  /* of cells that hold receivers; 0: no static rule */
    uint32_t light_count;
    uint32_t frustum_count;
    uint64_t level_nodes[UMB_LEVEL_MAX + 1]; /* unique nodes of each level; [3] are the bricks */
    uint64_t
        packed_bytes;    /* of the packed file it was opened from; a mapped one does not know: 0 */
    uint64_t bytes_2014; /* of the same voxels in the 2014 encoding, 0 if the bake did not say */
    double origin[3];    /* metres, world space: the scene origin that transforms start from */
    struct umb_box bounds;            /* metres, world space, of the casters */
    uint8_t scene_hash[UMB_ID_BYTES]; /* SHA-256 of the scene's content */
    const char *plan;                 /* one line an effect, UTF-8 */
    const char *settings;             /* key=value lines of the bake, canonical */
    const char *notes; /* key=value lines outside the identity; the three are never NULL */
    uint64_t reserved[8]; /* Zero: room for later versions (umbrage/version.h) */
};

/*
 * Opens an asset file, packed or mapped, told apart by content.
 *
 * In:    path: NUL-terminated. options: NULL for the defaults; copied, but for the allocator.
 * Out:   out: the asset, or NULL on failure.
 * Owns:  the caller closes it with umb_asset_close.
 * Fails: E_NO_INPUT (missing, no regular file), E_PERMISSION, E_LIMIT (no descriptor left),
 *        E_FORMAT, E_VERSION (needs a newer reader), E_TRUNCATED, E_CORRUPT, E_TOO_LARGE (over
 *        max_memory_bytes), E_NO_MEMORY, E_IO. Nothing is left behind.
 * Threads: any number at once.
 * Trust: safe on hostile files with UMB_TRUST_NOTHING.
 * Cost:  mapped: one pass over the file (about 1 GB/s or more), with UMB_TRUST_VALIDATED over its
 *        head only; packed: expands in memory. Blocks on the disk.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_open_file(const char *path,
                                                        const struct umb_open_options *options,
                                                        struct umb_asset **out,
                                                        struct umb_error *error);

/*
 * Opens an asset from memory.
 *
 * In:    bytes: uint8[size]; for a mapped asset 64-byte aligned.
 * Owns:  mapped: bytes are borrowed, and must not change, until umb_asset_close; packed: during the
 *        call only.
 * Fails: as umb_asset_open_file but for its file; E_ARGUMENT if a mapped asset is not aligned.
 */
UMB_API UMB_CHECKED enum umb_status umb_asset_open_bytes(const void *bytes, size_t size,
                                                         const struct umb_open_options *options,
                                                         struct umb_asset **out,
                                                         struct umb_error *error);

/* Closes an asset and frees all it owns. NULL is allowed. Threads: nobody else may use it. */
UMB_API void umb_asset_close(struct umb_asset *asset);

/* Fills info. Never fails. Owns: its texts are the asset's. Threads: any. Cost: O(1). */
UMB_API void umb_asset_get_info(const struct umb_asset *asset, struct umb_asset_info *info);

/* Fills info of light `index`. Fails: E_NOT_FOUND beyond the last; info is left alone. */
UMB_API UMB_CHECKED enum umb_status
umb_asset_get_light(const struct umb_asset *asset, uint32_t index, struct umb_light_info *info);

/* Fills info of frustum `index`, likewise. */
UMB_API UMB_CHECKED enum umb_status
umb_asset_get_frustum(const struct umb_asset *asset, uint32_t index, struct umb_frustum_info *info);

/* Fills in the edges of a voxel, metres; of a perspective frustum those of its last voxels along z,
 * which are its largest. */
UMB_API void umb_frustum_voxel_edges(const struct umb_frustum_info *frustum, double edges[3]);

/* Writes an id as 64 lower-case hexadecimal digits and a NUL. */
UMB_API void umb_id_to_text(const uint8_t id[UMB_ID_BYTES], char text[UMB_ID_TEXT_SIZE]);

/* Reads 64 hexadecimal digits of either case. Fails: E_ARGUMENT (anything else); id is then left
 * alone. */
UMB_API UMB_CHECKED enum umb_status umb_id_from_text(const char *text, uint8_t id[UMB_ID_BYTES]);

#ifdef __cplusplus
}
#endif
#endif
