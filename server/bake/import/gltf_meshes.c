/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes of glTF (gltf.h). Source: glTF 2.0, section 3.7.2. */
#include "bake/import/gltf.h"

#include <math.h>
#include <stdio.h>

#include "base/try.h"

/* Limit of texture coordinates: products with sides stay finite in double and float. */
#define COORDINATE_MAX 1e30

enum {
    MODE_TRIANGLES = 4,
    MODE_STRIP = 5,
    MODE_FAN = 6,
};

static int is_coordinate(double value)
{
    return fabs(value) <= COORDINATE_MAX; /* false for NaN */
}

/* Texture coordinates of a vertex, v counting up; 0 0 if they are not finite. */
static void get_uv(const struct umbb_gltf_accessor *accessor,
                   const struct umbb_gltf_mapping *mapping, uint32_t vertex, float uv[2])
{
    double numbers[2];
    umbb_gltf_get(accessor, vertex, numbers);
    double u = numbers[0], v = numbers[1];
    if (mapping->moves && is_coordinate(u) && is_coordinate(v)) {
        const double *a = mapping->matrix[0], *b = mapping->matrix[1];
        u = a[0] * numbers[0] + a[1] * numbers[1] + a[2];
        v = b[0] * numbers[0] + b[1] * numbers[1] + b[2];
    }
    const int good = is_coordinate(u) && is_coordinate(v);
    uv[0] = good ? (float)u : 0.0F;
    uv[1] = good ? (float)(1.0 - v) : 0.0F;
}

/* One primitive. */
struct primitive {
    struct umbb_gltf_accessor positions, indices, uvs;
    int has_indices, has_uvs;
    uint32_t material; /* of the builder, or UMBS_NO_INDEX */
    const struct umbb_gltf_mapping *mapping;
    int64_t mode;
};

/* Chooses the material. A mesh that lacks the coordinates of its material's texture gets none and
 * is opaque. */
static enum umb_status choose_material(struct umbb_gltf_scene *scene, const json_t *json,
                                       struct primitive *p, struct umb_error *error)
{
    static const struct umbb_gltf_use use = {"TEXCOORD",
                                             "VEC2 of floats or unsigned integers of 8 or 16 bits",
                                             2, UMBB_GLTF_FLOAT | UMBB_GLTF_UNSIGNED};
    const struct umbs_array *materials = &scene->file.job->scene.materials;
    const struct umbb_gltf_material *material;
    const int64_t number = umbb_gltf_index(json, "material");
    char key[32];
    p->material = UMBS_NO_INDEX;
    if (number == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_get_material(scene, number, &material, error));
    p->material = material->number;
    p->mapping = &material->mapping;
    if (((const struct umbs_material *)materials->data)[material->number].texture ==
        UMBS_NO_INDEX) {
        return UMB_OK;
    }
    (void)snprintf(key, sizeof key, "TEXCOORD_%lld", (long long)p->mapping->set);
    const int64_t accessor = umbb_gltf_index(json_object_get(json, "attributes"), key);
    if (accessor != UMBB_GLTF_NONE) {
        UMB__TRY(umbb_gltf_accessor(&scene->file, accessor, &use, &p->uvs, error));
        p->has_uvs = p->uvs.count == p->positions.count;
    }
    if (!p->has_uvs) {
        scene->bare++;
        p->material = UMBS_NO_INDEX;
    }
    return UMB_OK;
}

/* Adds the vertices and the triangles. */
static enum umb_status add_triangles(struct umbb_faces *faces, const struct primitive *p,
                                     struct umb_error *error)
{
    const uint64_t first = faces->scene->positions.count;
    const uint32_t corners = p->has_indices ? p->indices.count : p->positions.count;
    const uint32_t count = p->mode == MODE_TRIANGLES ? corners / 3 : corners < 3 ? 0 : corners - 2;
    for (uint32_t i = 0; i < p->positions.count; i++) {
        double position[3];
        float uv[2];
        umbb_gltf_get(&p->positions, i, position);
        if (p->has_uvs) {
            get_uv(&p->uvs, p->mapping, i, uv);
        }
        UMB__TRY(umbs_scene_add_vertex(faces->scene, position, p->has_uvs ? uv : NULL, error));
    }
    for (uint32_t i = 0; i < count; i++) {
        /* Every second triangle of a strip is wound the other way. */
        const uint32_t odd = p->mode == MODE_STRIP ? i & 1 : 0;
        const uint32_t strip[3] = {i + odd, i + 1 - odd, i + 2}, fan[3] = {0, i + 1, i + 2};
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t corner = p->mode == MODE_TRIANGLES ? 3 * i + k
                                    : p->mode == MODE_FAN     ? fan[k]
                                                              : strip[k];
            double vertex = (double)corner;
            if (p->has_indices) {
                umbb_gltf_get(&p->indices, corner, &vertex);
            }
            UMB__TRY(umbb_face_corner(faces,
                                      vertex < (double)p->positions.count ? first + (uint64_t)vertex
                                                                          : UMBB_BAD_CORNER,
                                      error));
        }
        UMB__TRY(umbb_face_end(faces, error));
    }
    return UMB_OK;
}

/* Reads a primitive; without POSITION it has no shape. */
static enum umb_status add_primitive(struct umbb_gltf_scene *scene, const json_t *json,
                                     struct umb_error *error)
{
    static const struct umbb_gltf_use position_use = {"POSITION", "VEC3 of floats", 3,
                                                      UMBB_GLTF_FLOAT};
    static const struct umbb_gltf_use index_use = {"indices", "SCALAR of unsigned integers", 1,
                                                   UMBB_GLTF_UNSIGNED | UMBB_GLTF_UINT32};
    struct umbs_scene_builder *builder = &scene->file.job->scene;
    const int64_t position = umbb_gltf_index(json_object_get(json, "attributes"), "POSITION");
    const int64_t indices = umbb_gltf_index(json, "indices");
    const int64_t mode = umbb_gltf_index(json, "mode");
    struct primitive p = {.mode = mode != UMBB_GLTF_NONE ? mode : MODE_TRIANGLES};
    if (p.mode > MODE_FAN) {
        return umb_fail(error, UMB_E_BAD_SCENE, "mode %lld of a primitive is not in 0 to %d",
                        (long long)p.mode, MODE_FAN);
    }
    if (p.mode < MODE_TRIANGLES || position == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_accessor(&scene->file, position, &position_use, &p.positions, error));
    if (indices != UMBB_GLTF_NONE) {
        p.has_indices = 1;
        UMB__TRY(umbb_gltf_accessor(&scene->file, indices, &index_use, &p.indices, error));
    }
    UMB__TRY(choose_material(scene, json, &p, error));
    scene->morphed += json_array_size(json_object_get(json, "targets")) > 0;
    const size_t first = builder->triangles.count;
    UMB__TRY(add_triangles(&scene->faces, &p, error));
    const uint32_t count = (uint32_t)(builder->triangles.count - first);
    return count == 0 ? UMB_OK
                      : umbs_scene_end_mesh(builder, 0, (uint32_t)builder->positions.count, count,
                                            p.material, error);
}

enum umb_status umbb_gltf_get_mesh(struct umbb_gltf_scene *scene, int64_t number,
                                   const struct umbb_gltf_mesh **mesh, struct umb_error *error)
{
    const json_t *json;
    UMB__TRY(umbb_gltf_item(&scene->file, "meshes", number, &json, error));
    struct umbb_gltf_mesh *found = &scene->meshes[number];
    const struct umbs_array *made = &scene->file.job->scene.meshes;
    const json_t *primitives = json_object_get(json, "primitives");
    if (!found->is_read) {
        found->is_read = 1;
        found->first = (uint32_t)made->count;
        for (size_t i = 0; i < json_array_size(primitives); i++) {
            UMB__TRY(add_primitive(scene, json_array_get(primitives, i), error));
        }
        found->count = (uint32_t)made->count - found->first;
    }
    *mesh = found;
    return UMB_OK;
}
