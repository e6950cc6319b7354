/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Operations on a validated scene (scene.h): destroying it, multiplying its instances out, and its
 * hash. Everything here relies on umbs_scene_view and checks no index again.
 *
 * The hash covers the world triangles in their order, the effects of their materials on light, and
 * the lights. Vertex numbering, the division into meshes and the transforms do not count. So one
 * scene written as OBJ and as PLY has one hash. Extents of lights count where the file gives any.
 */
#include "scene/scene.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "base/try.h"
#include "base/vec.h"
#include "common/sha256.h"

#define PART 64U /* triangles flattened at a time */

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

enum umb_status umbs__scene_check(struct umbs_scene *scene, const char *name,
                                  const struct umbs_import_options *options,
                                  struct umb_error *error)
{
    const uint64_t most = options->max_triangles > 0 ? options->max_triangles : UMBS_TRIANGLES_MAX;
    UMB__TRY(umbs_scene_view(scene->map, scene->map_bytes, &scene->view, error));
    return scene->view.world_triangle_count <= most
               ? UMB_OK
               : umb_fail(error, UMB_E_LIMIT, "%.200s: %llu triangles, limit %llu", name,
                          (unsigned long long)scene->view.world_triangle_count,
                          (unsigned long long)most);
}

int umbs_instance_mirrors(const struct umbs_instance *instance)
{
    const double(*m)[4] = instance->mesh_to_world;
    double normal[3];
    umb__cross(m[1], m[2], normal);
    return umb__dot(m[0], normal) < 0.0; /* the determinant */
}

void umbs_scene_flatten_part(const struct umbs_scene_view *view,
                             const struct umbs_instance *instance, uint32_t first, uint32_t count,
                             double (*corners)[3][3])
{
    const struct umbs_mesh *mesh = &view->meshes[instance->mesh];
    int mirror = umbs_instance_mirrors(instance);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *triangle = view->triangles[mesh->first_triangle + first + i];
        for (int k = 0; k < 3; k++) {
            const double *point = view->positions[(size_t)mesh->first_vertex + triangle[k]];
            double *out = corners[i][mirror && k > 0 ? 3 - k : k];
            for (int row = 0; row < 3; row++) {
                out[row] = umb__affine(instance->mesh_to_world[row], point);
            }
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
        umbs_scene_flatten_part(view, &view->instances[i], 0, mesh->triangle_count, all + at);
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

/* First input of every scene hash. This text changes whenever other data are hashed. */
static const char hash_domain[16] = "umbrage scene 2";

/* Properties of a material that change a shadow: without its name and without unused values. */
struct surface {
    uint32_t alpha_mode, texture;
    float alpha_cutoff, base_alpha;
    float transmission; /* hashed only if it is not 0 */
};

static struct surface surface_of(const struct umbs_scene_view *view, uint32_t material)
{
    struct surface surface = {UMBS_ALPHA_OPAQUE, UMBS_NO_INDEX, 0.0F, 1.0F, 0.0F};
    const struct umbs_material *from =
        material < view->material_count ? &view->materials[material] : NULL;
    if (from != NULL && from->alpha_mode != UMBS_ALPHA_OPAQUE) {
        surface.alpha_mode = from->alpha_mode;
        surface.texture = from->texture;
        surface.alpha_cutoff = from->alpha_mode == UMBS_ALPHA_MASK ? from->alpha_cutoff : 0.0F;
        surface.base_alpha = from->base_alpha;
    }
    if (from != NULL) {
        surface.transmission = from->transmission;
    }
    return surface;
}

static void hash_corners(const struct umbs_scene_view *view, uint8_t out[UMB_ID_BYTES])
{
    struct umbs_chain chain;
    double corners[PART][3][3];
    umbs_chain_init(&chain);
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const struct umbs_instance *instance = &view->instances[i];
        const uint32_t total = view->meshes[instance->mesh].triangle_count;
        for (uint32_t first = 0; first < total; first += PART) {
            const uint32_t left = total - first, count = left < PART ? left : PART;
            umbs_scene_flatten_part(view, instance, first, count, corners);
            for (size_t k = 0; k < (size_t)9 * count; k++) {
                corners[k / 9][k / 3 % 3][k % 3] += 0.0; /* -0 becomes 0 */
            }
            umbs_chain_add(&chain, corners, count * sizeof corners[0]);
        }
    }
    umbs_chain_end(&chain, out);
}

/* Hashes the surface wherever it changes along the triangles, and the texture coordinates of those
 * triangles whose material reads a texture. */
static void hash_surfaces(const struct umbs_scene_view *view, uint8_t out[UMB_ID_BYTES])
{
    struct umbs_chain chain;
    struct surface before = surface_of(view, UMBS_NO_INDEX);
    uint64_t number = 0;
    umbs_chain_init(&chain);
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const struct umbs_mesh *mesh = &view->meshes[view->instances[i].mesh];
        const struct surface surface = surface_of(view, mesh->material);
        if (mesh->triangle_count > 0 && memcmp(&surface, &before, sizeof surface) != 0) {
            umbs_chain_add(&chain, &number, sizeof number);
            umbs_chain_add(&chain, &surface, offsetof(struct surface, transmission));
            if (surface.transmission != 0.0F) {
                umbs_chain_add(&chain, &surface.transmission, sizeof surface.transmission);
            }
            before = surface;
        }
        number += mesh->triangle_count;
        if (surface.texture == UMBS_NO_INDEX || view->uvs == NULL) {
            continue;
        }
        for (size_t k = 0; k < (size_t)3 * mesh->triangle_count; k++) {
            const uint32_t vertex = view->triangles[mesh->first_triangle + k / 3][k % 3];
            umbs_chain_add(&chain, view->uvs[(size_t)mesh->first_vertex + vertex],
                           sizeof view->uvs[0]);
        }
    }
    umbs_chain_end(&chain, out);
}

/* Hashes the textures' shapes. Their names are file names and do not count. */
static void hash_textures(const struct umbs_scene_view *view, uint8_t out[UMB_ID_BYTES])
{
    struct umbs_chain chain;
    umbs_chain_init(&chain);
    for (uint32_t i = 0; i < view->texture_count; i++) {
        const struct umbs_texture *texture = &view->textures[i];
        const uint64_t shape[6] = {texture->width,  texture->height, texture->offset,
                                   texture->wrap_s, texture->wrap_t, texture->nearest};
        umbs_chain_add(&chain, shape, sizeof shape);
    }
    umbs_chain_end(&chain, out);
}

void umbs_scene_hash(const struct umbs_scene_view *view, uint8_t hash[UMB_ID_BYTES])
{
    uint8_t corners[UMB_ID_BYTES], surfaces[UMB_ID_BYTES], textures[UMB_ID_BYTES];
    hash_corners(view, corners);
    hash_surfaces(view, surfaces);
    hash_textures(view, textures);
    const uint64_t counts[] = {(uint64_t)view->z_up, view->world_triangle_count, view->light_count,
                               view->texture_count, view->alpha_bytes};
    const void *const parts[] = {
        hash_domain, counts,
        corners,     surfaces,
        textures,    view->lights,
        view->alpha, view->extents != NULL ? (const void *)view->extents : ""};
    const size_t sizes[] = {
        sizeof hash_domain,
        sizeof counts,
        sizeof corners,
        sizeof surfaces,
        sizeof textures,
        view->light_count * sizeof(struct umbs_light),
        (size_t)view->alpha_bytes,
        view->extents != NULL ? view->light_count * sizeof(struct umbs_light_extent) : 0};
    umbs_sha256.digest(umbs_sha256.user, parts, sizes, sizeof parts / sizeof parts[0], hash);
}
