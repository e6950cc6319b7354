/* SPDX-License-Identifier: Apache-2.0 */
/* Arithmetic on upper estimates; every number is in bytes. */
#include "bake/memory_plan.h"

#include "bake/analysis/analysis.h"
#include "bake/bake_transmittance.h"
#include "bake/build/tile_loop.h"
#include "format/layout.h"
#include "format/receiver_mask.h"
#include "umbrage/curve.h"

/* Bytes of code, stacks and buffers of the libraries. */
#define PROGRAM_BYTES ((uint64_t)16 << 20)
/* Bytes of a triangle during the bake. */
#define CORNER_BYTES 75U
/* Bytes of a triangle's second copy. */
#define COPY_BYTES 72U
/* Bytes of a triangle's projections. Few triangles are cut; the array grows by half at a time. */
#define PROJECTED_BYTES 160U
#define PROJECTED_MIN   ((uint64_t)1 << 20)
/* Bytes of a user primitive in Embree's hierarchy while it is built. */
#define EMBREE_BYTES 200U
/* Bytes of a triangle under the static rule: its survey flags, its place in a list, its kind. */
#define RULED_BYTES (1 + 4 + 1)
/* Bytes of a thread's layers. */
#define LAYER_BYTES ((uint64_t)3 * UMBB_BLOCK * UMBB_BLOCK * 4)
/* Bytes of a frustum's receiver mask. */
#define RECEIVER_MASK_BYTES ((uint64_t)UMB__RECEIVER_MASK_WORDS * 8)
/* Bytes of a tile beside its texels: column, runs, bounds, bins. */
#define GRID_CELL 80U
/* Bytes of the smallest octree worth starting with. */
#define OCTREE_MIN ((uint64_t)1 << 20)

#define OCCLUDER_DEPTH_MAX_BYTES ((uint64_t)48 << 20)
#define OCCLUDER_DEPTH_ENTRY     (UMB__ENTRY_HEAD + 8U) /* its head, and the padding after it */

/* Everything that depends on the tile size, except the octree. */
static uint64_t tile_bytes(const struct umbb_memory_input *input, uint32_t tile_log2)
{
    const uint64_t cells = (uint64_t)1 << (2 * (input->log2_size - tile_log2));
    const size_t drawn = umbb_bake_tile_bytes(input->log2_size, tile_log2, input->closed_rule);
    const uint64_t band = ((uint64_t)UMBB_STATIC_BAND << tile_log2) * 4; /* band of a thread */
    return (input->merging ? 0 : drawn) + cells * GRID_CELL +
           (input->ruled_frusta > 0 ? input->threads * band : 0);
}

/* Bytes of a triangle during the bake. */
static uint64_t baked_triangle(const struct umbb_memory_input *input)
{
    return CORNER_BYTES + (input->copies ? COPY_BYTES : 0) + (input->traced ? EMBREE_BYTES : 0) +
           (input->projected ? PROJECTED_BYTES : 0) + (input->ruled_frusta > 0 ? RULED_BYTES : 0);
}

/* Bytes that do not depend on the tile size. */
static uint64_t base_bytes(const struct umbb_memory_input *input)
{
    uint64_t triangle = baked_triangle(input);
    triangle = triangle > UMBB_TRIANGLE_BYTES ? triangle : UMBB_TRIANGLE_BYTES;
    return PROGRAM_BYTES + input->scene_bytes + triangle * input->triangles +
           input->threads * LAYER_BYTES + (input->projected ? PROJECTED_MIN : 0) +
           input->ruled_frusta * RECEIVER_MASK_BYTES;
}

/* Bytes of triangles at other moments that are free during the bake. */
static uint64_t spare_bytes(const struct umbb_memory_input *input)
{
    const uint64_t baked = baked_triangle(input);
    return baked < UMBB_TRIANGLE_BYTES ? (UMBB_TRIANGLE_BYTES - baked) * input->triangles : 0;
}

enum umb_status umbb_memory_divide(const struct umbb_memory_input *input,
                                   struct umbb_memory_plan *plan, struct umb_error *error)
{
    const uint64_t base = base_bytes(input);
    uint64_t least = UINT64_MAX; /* smallest requirement of the tried tile sizes */
    for (uint32_t log2 = input->tile_log2; log2 >= UMBB_TILE_LOG2_MIN; log2--) {
        const uint64_t fixed = base + tile_bytes(input, log2);
        least = fixed < least ? fixed : least;
        /* The octree gets at least as much as the tiles, and a minimum in any case. */
        const uint64_t wanted = fixed + (fixed - base) + OCTREE_MIN;
        if (wanted <= input->memory_bytes) {
            const uint64_t rest = input->memory_bytes - fixed;
            plan->tile_log2 = log2;
            plan->fixed_bytes = fixed;
            const uint64_t shared = rest + spare_bytes(input);
            plan->octree_max_bytes = rest > SIZE_MAX ? SIZE_MAX : (size_t)rest;
            plan->shared_max_bytes = shared > SIZE_MAX ? SIZE_MAX : (size_t)shared;
            plan->projected_max_bytes =
                (size_t)(PROJECTED_BYTES * (uint64_t)input->triangles + PROJECTED_MIN);
            plan->check_max_bytes = input->memory_bytes - base;
            return UMB_OK;
        }
    }
    return umb_fail(error, UMB_E_LIMIT,
                    "--memory: %llu MiB are not enough: %zu triangles at resolution %u need more "
                    "than %llu MiB",
                    (unsigned long long)(input->memory_bytes >> 20), input->triangles,
                    1U << input->log2_size,
                    (unsigned long long)((least + (least - base) + OCTREE_MIN) >> 20));
}

enum umb_status umbb_head_occluder_depth_bytes(const struct umb__content *content, int translucent,
                                               size_t *bytes, struct umb_error *error)
{
    struct umb__content whole = *content;
    struct umb_error cause = {0};
    uint64_t taken;
    whole.curve_count = content->light_count * UMB_CURVE_ROWS_MAX;
    whole.occluder_depth_words = 0;
    whole.transmittance_bytes = translucent ? UMBB_TRANSMITTANCE_BYTES_MAX : 0;
    *bytes = 0;
    const enum umb_status status = umb__content_head_bytes(&whole, &taken, &cause);
    if (status != UMB_OK || taken + OCCLUDER_DEPTH_ENTRY > UMB__CANONICAL_MAX) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%u lights with %u frusta are too many: %s",
                        content->light_count, content->frustum_count,
                        status != UMB_OK ? cause.message
                                         : "they leave no room in a head of 64 MiB");
    }
    const uint64_t left = UMB__CANONICAL_MAX - OCCLUDER_DEPTH_ENTRY - taken;
    *bytes = (size_t)(left < OCCLUDER_DEPTH_MAX_BYTES ? left : OCCLUDER_DEPTH_MAX_BYTES);
    return UMB_OK;
}
