/* SPDX-License-Identifier: Apache-2.0 */
/* Prepares a light's voxels for segments, columns and boxes; see umbrage/volume.h. */
#include "umbrage/volume.h"

#include "base/try.h"
#include "query/stages.h"
#include "query/volume_parts.h"

/* Faces of a spot or point light. */
static enum umb_status set_faces(const struct umb_asset *asset, uint32_t index,
                                 struct umb__volume *v, struct umb_error *error)
{
    const struct umb__content *content = &asset->canonical.content;
    const struct umb_light_info *light = &content->lights[index];
    v->faces = &content->frusta[light->first_frustum];
    v->tops = &asset->view.tops[light->first_frustum];
    v->grid = asset->view.grid;
    v->face_count = light->frustum_count;
    for (unsigned axis = 0; axis < 3; axis++) {
        v->position[axis] = light->position[axis] - content->origin[axis];
    }
    for (uint32_t i = 0; i < v->face_count; i++) {
        double scale, offset;
        umb__face_depth(&v->faces[i], &scale, &offset);
        v->closed |= v->faces[i].closed;
        if (!(scale > 0) || !isfinite(scale) || !isfinite(offset) || i >= UMB__FACES_MAX) {
            return umb_fail(error, UMB_E_UNSUPPORTED,
                            "light: %u, depth does not grow with the distance in face %u", index,
                            i);
        }
    }
    return UMB_OK;
}

enum umb_status umb_volume_prepare(const struct umb_asset *asset, uint32_t light,
                                   struct umb_volume *volume, struct umb_error *error)
{
    const struct umb__content *content = &asset->canonical.content;
    memset(volume, 0, sizeof *volume);
    if (light >= content->light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, UMB__NO_LIGHT, light,
                        content->light_count - 1);
    }
    if (content->receiver_mask_cells != NULL) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "light: %u was baked under the static rule, which leaves out what lies off "
                        "the surfaces; only points can be asked for",
                        light);
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
        .translucent = umb__transmittance_texel(asset, &content->lights[light]) > 0,
        .occluder_depth = frustum->closed ? content->occluder_depth : NULL,
        .occluder_depth_roots = content->occluder_depth ? content->occluder_depth + index : NULL,
    };
    if (content->lights[light].kind != UMB_LIGHT_DIRECTIONAL) {
        UMB__TRY(set_faces(asset, light, &v, error));
    }
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

enum umb_status umb_volume_check_parallel(const struct umb_volume *volume, struct umb_error *error)
{
    const struct umb__volume v = umb__volume_of(volume);
    return v.face_count == 0 ? UMB_OK
                             : umb_fail(error, UMB_E_UNSUPPORTED,
                                        "light: %u is not directional; its voxels grow with the "
                                        "distance",
                                        v.light);
}
