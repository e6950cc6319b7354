/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Properties of a scene for pictures, beyond its shape: normals of corners, in the order of the
 * flattened triangles, and whether the materials have colours.
 */
#include "study/study_scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

#define SAME_COLOR 0.02F /* greatest difference of colours that count as equal */

/* Cofactors of an instance's linear part: they turn normals as the transform turns planes. */
static void cofactors_of(const struct umbs_instance *instance, double out[3][3])
{
    const double(*m)[4] = instance->mesh_to_world;
    for (int row = 0; row < 3; row++) {
        umb__cross(m[(row + 1) % 3], m[(row + 2) % 3], out[row]);
    }
}

/* Sets the normals of world triangle `at`. Corners change places where flattening changes them, or
 * where the bake turns a part around. */
static void triangle_normals(struct umbt_scene *scene, const struct umbs_mesh *mesh,
                             const uint32_t triangle[3], const double cofactors[3][3], int swaps,
                             size_t at)
{
    const struct umbs_scene_view *view = &scene->scene->view;
    float(*out)[3] = scene->normals[at];
    double normal[3], facing = 0.0;
    umb__triangle_cross((const double(*)[3])scene->corners[at], normal);
    for (int k = 0; k < 3; k++) {
        const float *from = view->normals[(size_t)mesh->first_vertex + triangle[k]];
        double own[3], turned[3];
        umbt_widen(from, own);
        for (int row = 0; row < 3; row++) {
            turned[row] = umb__dot(cofactors[row], own);
        }
        if (!(umbt_normalize(turned) > 0.0)) {
            memset(out, 0, 3 * sizeof *out);
            return;
        }
        facing += umb__dot(turned, normal);
        for (int row = 0; row < 3; row++) {
            out[swaps && k > 0 ? 3 - k : k][row] = (float)turned[row];
        }
    }
    for (int i = 0; facing < 0.0 && i < 9; i++) {
        out[i / 3][i % 3] = -out[i / 3][i % 3];
    }
}

static enum umb_status normals_find(struct umbt_scene *scene, struct umb_error *error)
{
    const struct umbs_scene_view *view = &scene->scene->view;
    size_t at = 0;
    scene->normals = malloc(scene->count * sizeof *scene->normals);
    if (scene->normals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "normals of %zu triangles do not fit in memory",
                        scene->count);
    }
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const struct umbs_instance *instance = &view->instances[i];
        const struct umbs_mesh *mesh = &view->meshes[instance->mesh];
        const int mirrors = umbs_instance_mirrors(instance);
        double cofactors[3][3];
        cofactors_of(instance, cofactors);
        for (uint32_t t = 0; t < mesh->triangle_count; t++, at++) {
            triangle_normals(scene, mesh, view->triangles[mesh->first_triangle + t],
                             (const double(*)[3])cofactors,
                             mirrors != umbt_scene_is_turned(scene, at), at);
        }
    }
    return UMB_OK;
}

/* Returns 1 if two used materials differ in colour, or the only colour is not a grey. Materials
 * whose colour is in an image do not count. */
static int has_colors(const struct umbt_scene *scene)
{
    const struct umbs_scene_view *view = &scene->scene->view;
    const float *first = NULL;
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const uint32_t number = view->meshes[view->instances[i].mesh].material;
        const struct umbs_material *material =
            number != UMBS_NO_INDEX ? &view->materials[number] : NULL;
        const float *color = material != NULL && !material->has_image ? material->base_color : NULL;
        for (int k = 0; color != NULL && k < 3; k++) {
            const float *other = first != NULL ? first : color;
            if (fabsf(color[k] - color[(k + 1) % 3]) > SAME_COLOR ||
                fabsf(color[k] - other[k]) > SAME_COLOR) {
                return 1;
            }
        }
        first = color != NULL ? color : first;
    }
    return 0;
}

enum umb_status umbt_scene_look(struct umbt_scene *scene, struct umb_error *error)
{
    scene->has_colors = has_colors(scene);
    return scene->scene->view.normals != NULL ? normals_find(scene, error) : UMB_OK;
}
