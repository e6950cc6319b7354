/* SPDX-License-Identifier: Apache-2.0 */
/* See caster_bytes.h. Each caster of a tile is hashed once; a square's digest is made of the
 * digests of its casters. */
#include "bake/tiles/caster_bytes.h"

#include <stdlib.h>
#include <string.h>

#include "bake/depth/cut_out.h"
#include "base/bytes.h"
#include "common/sha256.h"

#define DIGEST ((size_t)16)

/* Writes everything that decides which texels a cut-out caster keeps. */
static void put_cut(const struct umbb_cuts *cuts, uint32_t number, uint8_t *bytes)
{
    const struct umbs_cut *cut = &cuts->table->cuts[number];
    const struct umbb_cut_plane *plane = &cuts->planes[number];
    const struct umbs_material *material = &cuts->table->materials[cut->material];
    umb__store_f64(bytes, plane->anchor[0]);
    umb__store_f64(bytes + 8, plane->anchor[1]);
    for (size_t i = 0; i < 9; i++) {
        umb__store_f64(bytes + 8 * (2 + i), plane->edge[i / 3][i % 3]);
    }
    for (size_t i = 0; i < 6; i++) {
        umb__store_f64(bytes + 8 * (11 + i), (double)cut->uv[i / 2][i % 2]);
    }
    umb__store_f64(bytes + 8 * 17, (double)material->alpha_cutoff);
    umb__store_f64(bytes + 8 * 18, (double)material->base_alpha);
    memcpy(bytes + 8 * 19, cuts->table->digests[material->texture], UMB_ID_BYTES);
}

size_t umbb_caster_bytes(const struct umbb_casters *casters, size_t number,
                         uint8_t bytes[UMBB_CASTER_BYTES_MAX])
{
    const uint32_t cut = umbb_cut_of(casters->cuts, number);
    for (size_t i = 0; i < 9; i++) {
        umb__store_f64(bytes + 8 * i, casters->corners[number][i / 3][i % 3]);
    }
    bytes[72] = umbb_caster_kind(casters, number);
    bytes[73] = casters->marks != NULL ? casters->marks[number] : 0;
    if (cut == UMBS_CUT_NONE) {
        return UMBB_CASTER_BYTES;
    }
    put_cut(casters->cuts, cut, bytes + UMBB_CASTER_BYTES);
    return UMBB_CASTER_BYTES_MAX;
}

/* Position of a caster in a tile's list, which is ascending and has it. */
static size_t position_of(const uint32_t *list, size_t count, uint32_t caster)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (list[middle] <= caster) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

/* Digests of all casters of a list, malloced; NULL if out of memory. */
static uint8_t (*digest_casters(const struct umbb_casters *casters, const uint32_t *list,
                                size_t count))[16]
{
    uint8_t(*digests)[DIGEST] = malloc((count + 1) * sizeof *digests);
    for (size_t i = 0; digests != NULL && i < count; i++) {
        uint8_t bytes[UMBB_CASTER_BYTES_MAX], digest[UMB_ID_BYTES];
        umbs_sha256_bytes(bytes, umbb_caster_bytes(casters, list[i], bytes), digest);
        memcpy(digests[i], digest, DIGEST);
    }
    return digests;
}

enum umb_status umbb_casters_of_squares(const struct umbb_depth *depth,
                                        const struct umbb_tile_place *place, uint32_t tile_log2,
                                        uint32_t square_log2, uint8_t (*digests)[16],
                                        struct umb_error *error)
{
    const struct umbb_casters *casters = depth->lists->casters;
    struct umbb_bins_input input = {
        .casters = casters,
        .borders = casters->marks != NULL,
        .x0 = place->x0,
        .y0 = place->y0,
        .cell_log2 = square_log2,
        .cells_x = 1U << (tile_log2 - square_log2),
        .max_bytes = SIZE_MAX,
    };
    struct umbb_bins bins = {0};
    input.list = umbb_tile_lists_of_tile(depth->lists, place->x0, place->y0, &input.count);
    uint8_t(*of_casters)[DIGEST] = digest_casters(casters, input.list, input.count);
    enum umb_status status =
        of_casters != NULL ? umbb_bins_fill(&bins, &input, error)
                           : umb_fail(error, UMB_E_NO_MEMORY, "proofs: memory of a tile refused");
    for (uint32_t i = 0; status == UMB_OK && i < input.cells_x * input.cells_x; i++) {
        size_t count;
        const uint32_t *list = umbb_bins_cell(&bins, (int32_t)(i % input.cells_x),
                                              (int32_t)(i / input.cells_x), &count);
        uint8_t digest[UMB_ID_BYTES];
        struct umbs_sha256_run run;
        umbs_sha256_begin(&run);
        for (size_t k = 0; k < count; k++) {
            umbs_sha256_add(&run, of_casters[position_of(input.list, input.count, list[k])],
                            DIGEST);
        }
        umbs_sha256_end(&run, digest);
        memcpy(digests[i], digest, DIGEST);
    }
    free(of_casters);
    umbb_bins_finish(&bins);
    return status;
}
