/* SPDX-License-Identifier: Apache-2.0 */
/* Numbers go into the hash little-endian, doubles as their bits. */
#include "bake/tiles/tile_folder.h"

#include "bake/analysis/plan.h"
#include "bake/depth/cut_out.h"
#include "base/bytes.h"
#include "common/sha256.h"
#include "umbrage/version.h"

static const char key_domain[16] = "umbrage tile", occluder_depth_domain[16] = "umbrage front";

static void add32(struct umbs_chain *chain, uint32_t value)
{
    uint8_t bytes[4];
    umb__store32(bytes, value);
    umbs_chain_add(chain, bytes, sizeof bytes);
}

static void add_double(struct umbs_chain *chain, double value)
{
    uint8_t bytes[8];
    umb__store_f64(bytes, value);
    umbs_chain_add(chain, bytes, sizeof bytes);
}

static void add_caster(struct umbs_chain *chain, const struct umbb_casters *casters, size_t number)
{
    uint8_t bytes[9 * 8 + 2];
    for (size_t i = 0; i < 9; i++) {
        umb__store_f64(bytes + 8 * i, casters->corners[number][i / 3][i % 3]);
    }
    bytes[72] = umbb_caster_kind(casters, number);
    bytes[73] = casters->marks != NULL ? casters->marks[number] : 0;
    umbs_chain_add(chain, bytes, sizeof bytes);
}

/* Adds everything that decides which texels a cut-out caster keeps. */
static void add_cut(struct umbs_chain *chain, const struct umbb_cuts *cuts, uint32_t number)
{
    const struct umbs_cut *cut = &cuts->table->cuts[number];
    const struct umbb_cut_plane *plane = &cuts->planes[number];
    const struct umbs_material *material = &cuts->table->materials[cut->material];
    uint8_t bytes[19 * 8];
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
    umbs_chain_add(chain, bytes, sizeof bytes);
    umbs_chain_add(chain, cuts->table->digests[material->texture], UMB_ID_BYTES);
}

void umbb_tile_key(const struct umbb_depth *depth, const struct umbb_tile_shape *shape,
                   const struct umbb_tile_place *place, uint8_t key[UMB_ID_BYTES])
{
    const struct umbb_casters *casters = depth->lists->casters;
    size_t count;
    const uint32_t *list = umbb_tile_lists_of_tile(depth->lists, place->x0, place->y0, &count);
    struct umbs_chain chain;
    umbs_chain_init(&chain);
    umbs_chain_add(&chain, shape->occluder_depth != NULL ? occluder_depth_domain : key_domain,
                   sizeof key_domain);
    umbs_chain_add(&chain, UMB_VERSION_TEXT, sizeof UMB_VERSION_TEXT);
    add32(&chain, UMBB_BAKE_VERSION);
    add32(&chain, (uint32_t)casters->size);
    add32(&chain, shape->tile_log2);
    add32(&chain, (uint32_t)place->x0);
    add32(&chain, (uint32_t)place->y0);
    add32(&chain, (uint32_t)casters->closed_rule);
    add32(&chain, casters->marks != NULL);
    add_double(&chain, casters->depth_scale);
    add_double(&chain, casters->depth_offset);
    for (size_t i = 0; i < count; i++) {
        const uint32_t cut = umbb_cut_of(casters->cuts, list[i]);
        add_caster(&chain, casters, list[i]);
        if (cut != UMBS_CUT_NONE) {
            add_cut(&chain, casters->cuts, cut);
        }
    }
    umbs_chain_end(&chain, key);
}
