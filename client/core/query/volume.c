/* SPDX-License-Identifier: Apache-2.0 */
/* Preparing a light's voxels for segments, columns and boxes; see umbrage/volume.h. */
#include "umbrage/volume.h"

#include "format/asset_parts.h"
#include "query/volume_parts.h"

static int has_translucent(const struct umb_asset *asset, const struct umb_light_info *light)
{
    const struct umb__trans *trans = &asset->canonical.trans;
    for (uint32_t i = 0; trans->maps != NULL && i < light->frustum_count; i++) {
        if (trans->maps[light->first_frustum + i].level > 0) {
            return 1;
        }
    }
    return 0;
}

enum umb_status umb_volume_prepare(const struct umb_asset *asset, uint32_t light,
                                   struct umb_volume *volume, struct umb_error *error)
{
    const struct umb_content *content = &asset->canonical.content;
    memset(volume, 0, sizeof *volume);
    if (light >= content->light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, the asset has %u", light,
                        content->light_count);
    }
    if (content->lights[light].kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "light: %u is not directional", light);
    }
    uint32_t index = content->lights[light].first_frustum;
    const struct umb_frustum_info *frustum = &content->frusta[index];
    const struct umb__top *top = &asset->view.tops[index];
    struct umb__volume v = {
        .tree = {.grid = asset->view.grid + top->first_cell,
                 .nodes = asset->view.nodes,
                 .bricks = asset->view.bricks,
                 .log2_size = frustum->log2_size,
                 .grid_log2 = top->grid_log2},
        .light = light,
        .closed = frustum->closed,
        .translucent = has_translucent(asset, &content->lights[light]),
        .front = frustum->closed ? content->front : NULL,
        .front_root = content->front ? content->front[index] : 0,
    };
    memcpy(v.world_to_voxel, frustum->world_to_voxel, sizeof v.world_to_voxel);
    memcpy(v.voxel_step, frustum->voxel_step, sizeof v.voxel_step);
    memcpy(v.origin, content->origin, sizeof v.origin);
    memcpy(volume->opaque, &v, sizeof v);
    return UMB_OK;
}

int umb_volume_ignores_translucent(const struct umb_volume *volume)
{
    return umb__volume_of(volume).translucent;
}
