/* SPDX-License-Identifier: Apache-2.0 */
/* Numbers go into the hash little-endian, doubles as their bits. */
#include "bake/tiles/tile_folder.h"

#include "bake/analysis/plan.h"
#include "bake/tiles/caster_bytes.h"
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
        uint8_t bytes[UMBB_CASTER_BYTES_MAX];
        umbs_chain_add(&chain, bytes, umbb_caster_bytes(casters, list[i], bytes));
    }
    umbs_chain_end(&chain, key);
}
