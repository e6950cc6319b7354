/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_CONTENT_H
#define UMBRAGE_CORE_FORMAT_CONTENT_H
/*
 * The content of an asset besides its voxels: lights, frusta, origin, plan, settings. The writer
 * takes a content, and the reader returns one. Both encodings carry the content as the same
 * canonical block of bytes, which is part of the identity (docs/reference/umb-format.md, "Canonical
 * block").
 */
#include <stdbool.h>
#include "format/octree.h"
#include "umbrage/file.h"
#include "umbrage/workers.h"

/* One row of an accuracy curve (umbrage/curve.h), as sums over the points that the bake queried. */
struct umb__curve_record {
    uint32_t light;
    uint32_t level, taps; /* Setting of the row; level is 0 or taps is 1 */
    uint32_t points;      /* Number of points queried, 1 to UMB__CURVE_POINTS_MAX */
    uint64_t nodes;       /* Distinct mixed nodes above bricks in the points' windows */
    uint64_t lines;       /* Cache lines read, as docs/reference/umb-format.md counts them */
    uint64_t squares;     /* Sum of squared differences, in units of 1 / 2^20, each rounded down */
};

/* Error message for a light that is not there. Arguments: the light, and the asset's last one. */
#define UMB__NO_LIGHT "light: %u, the asset's lights are 0 to %u"

#define UMB__CURVE_POINTS_MAX (1U << 20) /* Points of one row */
#define UMB__CURVE_SQUARE     (1U << 20) /* Units of `squares` for a difference of 1 */

struct umb__content {
    uint32_t light_count;
    uint32_t frustum_count;
    struct umb_light_info *lights;   /* [light_count] */
    struct umb_frustum_info *frusta; /* [frustum_count]; voxel_step is derived, not stored */
    double origin[3];                /* Scene origin, metres, world space */
    struct umb_box bounds;           /* Box around the casters, metres, world space */
    uint8_t scene_hash[UMB_ID_BYTES];
    uint64_t bytes_2014; /* Bytes of these voxels in the encoding of Sintorn et al. 2014; 0: not
                            computed */
    char *plan;          /* Bake plan: NUL-terminated UTF-8, one line an effect */
    char *settings;      /* Bake settings: NUL-terminated key=value lines */
    char *notes;         /* Notes, outside the identity; or NULL */
    struct umb__curve_record *curve; /* [curve_count] ascending by light, level, taps; or NULL */
    uint32_t curve_count;
    uint32_t *occluder_depth; /* [occluder_depth_words] format/occluder_depth.h, or NULL */
    uint64_t occluder_depth_words;
    uint8_t *transmittance; /* [transmittance_bytes] format/transmittance.h, or NULL */
    uint64_t transmittance_bytes;
    uint64_t *receiver_mask_cells; /* [frustum_count][UMB__RECEIVER_MASK_WORDS] Receiver masks,
                                      format/receiver_mask.h; NULL: not the static rule */
};

/* Returns 1 if the rays of a frustum start in one point (spot, point), 0 if they are parallel. */
static inline int umb__is_perspective(const struct umb_frustum_info *frustum)
{
    const double *w = frustum->world_to_voxel[3];
    return w[0] != 0.0 || w[1] != 0.0 || w[2] != 0.0;
}

/* The linear part of a perspective frustum that umb__content_check has accepted. */
struct umb__perspective {
    double axis[3];       /* World vector that changes W by 1, and X and Y not at all */
    double scale, offset; /* Coefficients of W = scale Z + offset, where Z is the depth in voxels.
                             scale is above 0, and so is W at the far side */
    double step[3][3];    /* Content of voxel_step of struct umb_frustum_info */
};

/* Computes the linear part of a perspective frustum. Returns 0 if the frustum cannot be inverted,
 * its depth does not follow W, or its far side is not ahead of the light; else 1. */
int umb__perspective_derive(const struct umb_frustum_info *frustum,
                            struct umb__perspective *perspective);

/*
 * Computes the length that a content's canonical block will have, from the content's counts and
 * texts alone.
 */
UMB_CHECKED enum umb_status umb__content_head_bytes(const struct umb__content *content,
                                                    uint64_t *bytes, struct umb_error *error);

/*
 * Writes a packed asset (.umb) of a canonical octree.
 *
 * In:    content, octree: borrowed, only read. sink: gets the file's bytes in order.
 * Out:   id: the identity, SHA-256(canonical block, page hashes); unchanged on failure.
 * Fails: E_ARGUMENT (content that a reader would refuse; the field is named: counts, levels,
 *        children or masks that contradict each other, a text too long or not UTF-8), E_NO_MEMORY,
 *        or what the sink returns. After a failure the sink may have got part of the file.
 * Cost:  time linear in the octree, memory about the packed size and 8 bytes a node.
 * Guaranteed: equal content and octree (up to numbering) give equal bytes, except for the notes.
 */
UMB_CHECKED enum umb_status umb__pack_write(const struct umb__content *content,
                                            const struct umb__octree *octree,
                                            const struct umb_sha256 *sha256,
                                            const struct umb_sink *sink, uint8_t id[UMB_ID_BYTES],
                                            struct umb_error *error);

struct umb__pack_kept;
struct umb__pack_cuts;
struct umb__kept_page;

/* Arguments of umb__pack_run. */
struct umb__pack_job {
    const struct umb__content *content;
    const struct umb__octree *octree; /* With workers, its allocator must be thread-safe */
    const struct umb_sha256 *sha256;  /* Hash; with workers, called from several threads */
    const struct umb_sink *sink;
    const struct umb_workers *workers; /* Helper threads; NULL: the calling thread does
                                          everything */
    /* Called every few pages, on any of the threads; nonzero ends the call with E_CANCELLED. May be
     * NULL. */
    int (*cancelled)(void);
    const struct umb__pack_kept
        *kept; /* Cuts and pages of nodes that are known (pack_kept.h); NULL:
                                          none. The bytes are the same */
    /* Called with all pages when the file is written; may be NULL. */
    void (*made)(void *user, const struct umb__pack_cuts *cuts, const struct umb__kept_page *pages,
                 uint32_t page_count);
    void *made_user;
    uint32_t page_bytes; /* Most estimated bytes of a page; 0: what the format page says. Readers
                            take any */
};

/* Does what umb__pack_write does, with helpers that encode and compress pages. The bytes are the
 * same for any number of helpers. */
UMB_CHECKED enum umb_status umb__pack_run(const struct umb__pack_job *job, uint8_t id[UMB_ID_BYTES],
                                          struct umb_error *error);

/*
 * Writes the mapped form (.umbm) of an open asset.
 *
 * Fails: E_NO_MEMORY, or what the sink returns.
 * Cost:  one pass of the sink and of XXH3 over the file; allocates its head.
 */
UMB_CHECKED enum umb_status umb__mapped_write(const struct umb_asset *asset,
                                              const struct umb_sink *sink, struct umb_error *error);

/*
 * Exports the octree and content of an open asset of either encoding.
 *
 * Out:   octree: canonical (merged, uniform nodes dissolved); its numbering is unspecified. Finish
 *        with umb__octree_finish. content: arrays and strings borrowed from the asset. Both are
 *        zeroed on failure.
 * Fails: E_NO_MEMORY, E_LIMIT (2^32 nodes in one level).
 * Threads: any number may export one asset at once, if its allocator allows.
 * Cost:  linear in the nodes and the grids' cells.
 */
UMB_CHECKED enum umb_status umb__asset_export(const struct umb_asset *asset,
                                              struct umb__octree *octree,
                                              struct umb__content *content,
                                              struct umb_error *error);

#endif
