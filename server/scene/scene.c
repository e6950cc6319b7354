/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Operations on a validated scene (scene.h): destroying it and multiplying its instances out. The
 * hash is in scene_hash.c. Everything here relies on umbs_scene_view and checks no index again.
 */
#include "scene/scene.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

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

static void transform_point(const double matrix[3][4], const double point[3], double out[3])
{
    for (int row = 0; row < 3; row++) {
        out[row] = matrix[row][0] * point[0] + matrix[row][1] * point[1] +
                   matrix[row][2] * point[2] + matrix[row][3];
    }
}

int umbs_instance_mirrors(const struct umbs_instance *instance)
{
    const double(*m)[4] = instance->mesh_to_world;
    double determinant = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                         m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    return determinant < 0.0;
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
