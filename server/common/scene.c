/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What is done with a validated scene: destroy, hash, multiply the instances out (scene.h).
 * Everything here relies on umbs_scene_view and checks no index again.
 */
#include "common/scene.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "common/sha256.h"

/* First part of every scene hash; a change of what is hashed changes it. */
static const char hash_domain[16] = "umbrage scene 1";

void umbs_scene_destroy(struct umbs_scene *scene)
{
    if (scene == NULL) {
        return;
    }
    if (scene->map != NULL) {
        (void)munmap(scene->map, scene->map_bytes);
    }
    free(scene);
}

static void digest(const void *const *parts, const size_t *sizes, size_t count,
                   uint8_t out[UMB_ID_BYTES])
{
    umbs_sha256.digest(umbs_sha256.user, parts, sizes, count, out);
}

/* What of a material can change a shadow: not its name, nor values its mode makes idle. */
struct material_core {
    uint32_t alpha_mode, double_sided, texture;
    float alpha_cutoff, base_alpha;
};

/* Digest of all materials, in blocks that fit the stack: each is hashed with the digest before. */
static void hash_materials(const struct umbs_scene_view *view, uint8_t out[UMB_ID_BYTES])
{
    struct material_core block[256];
    memset(out, 0, UMB_ID_BYTES);
    for (uint32_t first = 0; first < view->material_count;) {
        uint32_t count = view->material_count - first;
        count = count < 256 ? count : 256;
        memset(block, 0, sizeof(block));
        for (uint32_t i = 0; i < count; i++) {
            const struct umbs_material *material = &view->materials[first + i];
            int opaque = material->alpha_mode == UMBS_ALPHA_OPAQUE;
            block[i].alpha_mode = material->alpha_mode;
            block[i].double_sided = material->double_sided;
            block[i].texture = opaque ? UMBS_NO_INDEX : material->texture;
            block[i].alpha_cutoff =
                material->alpha_mode == UMBS_ALPHA_MASK ? material->alpha_cutoff : 0.0F;
            block[i].base_alpha = opaque ? 1.0F : material->base_alpha;
        }
        const void *parts[2] = {out, block};
        size_t sizes[2] = {UMB_ID_BYTES, count * sizeof(block[0])};
        uint8_t next[UMB_ID_BYTES];
        digest(parts, sizes, 2, next);
        memcpy(out, next, UMB_ID_BYTES);
        first += count;
    }
}

/* The same over the textures' shapes; their names are names of files. */
static void hash_textures(const struct umbs_scene_view *view, uint8_t out[UMB_ID_BYTES])
{
    memset(out, 0, UMB_ID_BYTES);
    for (uint32_t i = 0; i < view->texture_count; i++) {
        const struct umbs_texture *texture = &view->textures[i];
        uint64_t shape[5] = {texture->width, texture->height, texture->offset, texture->wrap_s,
                             texture->wrap_t};
        const void *parts[2] = {out, shape};
        size_t sizes[2] = {UMB_ID_BYTES, sizeof(shape)};
        uint8_t next[UMB_ID_BYTES];
        digest(parts, sizes, 2, next);
        memcpy(out, next, UMB_ID_BYTES);
    }
}

void umbs_scene_hash(const struct umbs_scene_view *view, uint8_t hash[UMB_ID_BYTES])
{
    uint8_t materials[UMB_ID_BYTES];
    uint8_t textures[UMB_ID_BYTES];
    hash_materials(view, materials);
    hash_textures(view, textures);
    /* The uvs count only where a texture is read through them. */
    int has_uvs = view->uvs != NULL && view->texture_count > 0;
    uint64_t counts[] = {
        (uint64_t)view->z_up, view->mesh_count,    view->instance_count, view->material_count,
        view->light_count,    view->texture_count, view->vertex_count,   view->triangle_count,
        (uint64_t)has_uvs,    view->alpha_bytes,
    };
    const void *const parts[] = {
        hash_domain,  counts,          materials,       textures,    view->meshes, view->instances,
        view->lights, view->positions, view->triangles, view->alpha, view->uvs,
    };
    const size_t sizes[] = {
        sizeof(hash_domain),
        sizeof(counts),
        sizeof(materials),
        sizeof(textures),
        view->mesh_count * sizeof(struct umbs_mesh),
        view->instance_count * sizeof(struct umbs_instance),
        view->light_count * sizeof(struct umbs_light),
        view->vertex_count * 3 * sizeof(double),
        view->triangle_count * 3 * sizeof(uint32_t),
        (size_t)view->alpha_bytes,
        has_uvs ? view->vertex_count * 2 * sizeof(float) : 0,
    };
    digest(parts, sizes, has_uvs ? 11 : 10, hash);
}

static void transform_point(const double matrix[3][4], const double point[3], double out[3])
{
    for (int row = 0; row < 3; row++) {
        out[row] = matrix[row][0] * point[0] + matrix[row][1] * point[1] +
                   matrix[row][2] * point[2] + matrix[row][3];
    }
}

/* Whether a transform mirrors: such an instance's front faces are wound the other way (glTF 2.0,
 * section 3.7.4), so two corners change places to keep outward solids outward. */
static int is_mirror(const double m[3][4])
{
    double determinant = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                         m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    return determinant < 0.0;
}

static void flatten_instance(const struct umbs_scene_view *view,
                             const struct umbs_instance *instance, double (*corners)[3][3])
{
    const struct umbs_mesh *mesh = &view->meshes[instance->mesh];
    int mirror = is_mirror(instance->mesh_to_world);
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *triangle = view->triangles[mesh->first_triangle + i];
        for (int k = 0; k < 3; k++) {
            int to = mirror && k > 0 ? 3 - k : k;
            transform_point(instance->mesh_to_world,
                            view->positions[(size_t)mesh->first_vertex + triangle[k]],
                            corners[i][to]);
        }
    }
}

enum umb_status umbs_scene_flatten(const struct umbs_scene_view *view, double (**corners)[3][3],
                                   uint32_t **materials, size_t *count, struct umb_error *error)
{
    *corners = NULL;
    *count = 0;
    if (materials != NULL) {
        *materials = NULL;
    }
    size_t total = (size_t)view->world_triangle_count; /* at most 2^32: the products fit */
    double(*all)[3][3] = malloc(total * sizeof(*all));
    uint32_t *tags = materials != NULL ? malloc(total * sizeof(*tags)) : NULL;
    if (all == NULL || (materials != NULL && tags == NULL)) {
        free(all);
        free(tags);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu world triangles", total);
    }
    size_t at = 0;
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const struct umbs_mesh *mesh = &view->meshes[view->instances[i].mesh];
        flatten_instance(view, &view->instances[i], all + at);
        for (uint32_t k = 0; tags != NULL && k < mesh->triangle_count; k++) {
            tags[at + k] = mesh->material;
        }
        at += mesh->triangle_count;
    }
    *corners = all;
    if (materials != NULL) {
        *materials = tags;
    }
    *count = total;
    return UMB_OK;
}
