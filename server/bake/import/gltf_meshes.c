/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Meshes of glTF, and the properties of their materials that change shadows (gltf.h).
 * Source: glTF 2.0, sections 3.7.2, 3.8 and 3.9; KHR_texture_transform,
 * KHR_materials_transmission, KHR_materials_pbrSpecularGlossiness.
 */
#include "bake/import/gltf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"

/* Limit of texture coordinates: products with sides stay finite in double and float. */
#define COORDINATE_MAX 1e30

/* Values of samplers (OpenGL's). */
enum {
    GL_NEAREST = 9728,
    GL_CLAMP_TO_EDGE = 33071,
    GL_MIRRORED_REPEAT = 33648,
};

static uint32_t wrap_of(const json_t *sampler, const char *key)
{
    const int64_t wrap = umbb_gltf_index(sampler, key);
    return wrap == GL_CLAMP_TO_EDGE     ? UMBS_WRAP_CLAMP
           : wrap == GL_MIRRORED_REPEAT ? UMBS_WRAP_MIRROR
                                        : UMBS_WRAP_REPEAT;
}

/* Reads KHR_texture_transform, which scales, then rotates, then moves. In: info: a textureInfo. */
static void read_mapping(const json_t *info, struct umbb_gltf_mapping *mapping)
{
    const json_t *transform = umbb_gltf_extension(info, "KHR_texture_transform");
    const int64_t set = umbb_gltf_index(info, "texCoord");
    const int64_t other_set = umbb_gltf_index(transform, "texCoord");
    double move[2] = {0.0, 0.0}, scale[2] = {1.0, 1.0};
    mapping->set = other_set >= 0 && other_set != UMBB_GLTF_BAD ? other_set : set < 0 ? 0 : set;
    if (transform == NULL) {
        return;
    }
    (void)umbb_gltf_numbers(transform, "offset", 2, move);
    (void)umbb_gltf_numbers(transform, "scale", 2, scale);
    const double angle = umbb_gltf_number(transform, "rotation", 0.0);
    const double c = cos(angle), s = sin(angle);
    const double matrix[2][3] = {{c * scale[0], s * scale[1], move[0]},
                                 {-s * scale[0], c * scale[1], move[1]}};
    memcpy(mapping->matrix, matrix, sizeof matrix);
    mapping->moves = 1;
}

/* Gets the texture of an image, whose bytes are in a view, a data URI or a file. image: names the
 * image; its bytes are set here. Textures that are known already are searched first, because a data
 * URI takes long to decode. */
static enum umb_status get_texture(struct umbb_gltf *gltf, const json_t *json,
                                   struct umbb_image *image, uint32_t *texture,
                                   struct umb_error *error)
{
    const struct umbb_cursor uri = umbb_gltf_uri(json);
    struct umbb_gltf_view view;
    char *decoded = NULL;
    if (umbb_texture_find(&gltf->textures, image, texture)) {
        return UMB_OK;
    }
    if (uri.at == NULL) {
        UMB__TRY(umbb_gltf_view(gltf, umbb_gltf_index(json, "bufferView"), &view, error));
        image->bytes = view.bytes;
        image->size = view.size;
    } else {
        UMB__TRY(umbb_gltf_data_uri(uri, &decoded, &image->size, error));
        image->bytes = decoded;
        if (decoded == NULL) {
            image->is_embedded = 0;
            image->name = uri.at;
            image->name_length = umbb_length(uri);
        }
    }
    const enum umb_status status = umbb_texture_get(&gltf->textures, image, texture, error);
    free(decoded);
    return status;
}

/* Gives a material the alpha of its texture. In: info: a textureInfo, or NULL. */
static enum umb_status read_texture(struct umbb_gltf *gltf, const json_t *info,
                                    struct umbs_material *material,
                                    struct umbb_gltf_mapping *mapping, struct umb_error *error)
{
    const json_t *texture, *json, *sampler = NULL;
    char number[32];
    if (info == NULL) {
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_item(gltf, "textures", umbb_gltf_index(info, "index"), &texture, error));
    const int64_t source = umbb_gltf_index(texture, "source");
    if (source == UMBB_GLTF_NONE) {
        umbs_scene_warn(&gltf->job->scene,
                        "material '%s': its texture has no PNG or JPEG image and is left out",
                        material->name);
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_item(gltf, "images", source, &json, error));
    const int64_t sampler_number = umbb_gltf_index(texture, "sampler");
    if (sampler_number != UMBB_GLTF_NONE) {
        UMB__TRY(umbb_gltf_item(gltf, "samplers", sampler_number, &sampler, error));
    }
    struct umbb_image image = {
        .name = number,
        .is_embedded = 1,
        .name_length = (size_t)snprintf(number, sizeof number, "images[%lld]", (long long)source),
        .wrap_s = wrap_of(sampler, "wrapS"),
        .wrap_t = wrap_of(sampler, "wrapT"),
        .nearest = umbb_gltf_index(sampler, "magFilter") == GL_NEAREST};
    read_mapping(info, mapping);
    return get_texture(gltf, json, &image, &material->texture, error);
}

static double clamp_unit(double value)
{
    return value > 0.0 ? (value < 1.0 ? value : 1.0) : 0.0;
}

static void read_alpha(struct umbs_scene_builder *builder, const json_t *json,
                       struct umbs_material *material)
{
    const char *mode = umbb_gltf_text(json, "alphaMode");
    const double cutoff = umbb_gltf_number(json, "alphaCutoff", 0.5);
    material->alpha_mode = mode != NULL && strcmp(mode, "MASK") == 0    ? UMBS_ALPHA_MASK
                           : mode != NULL && strcmp(mode, "BLEND") == 0 ? UMBS_ALPHA_BLEND
                                                                        : UMBS_ALPHA_OPAQUE;
    if (cutoff > 1.0 && material->alpha_mode == UMBS_ALPHA_MASK) {
        umbs_scene_warn(builder, "material '%s': alphaCutoff %g is taken as 1", material->name,
                        cutoff);
    }
    material->alpha_cutoff = (float)clamp_unit(cutoff);
}

static enum umb_status read_material(struct umbb_gltf *gltf, const json_t *json,
                                     struct umbb_gltf_mapping *mapping, struct umb_error *error)
{
    struct umbs_scene_builder *builder = &gltf->job->scene;
    struct umbs_material material = umbs_material_opaque();
    const json_t *name = json_object_get(json, "name");
    const json_t *metallic = json_object_get(json, "pbrMetallicRoughness");
    const json_t *specular = umbb_gltf_extension(json, "KHR_materials_pbrSpecularGlossiness");
    const json_t *transmission = umbb_gltf_extension(json, "KHR_materials_transmission");
    const json_t *info = json_object_get(specular, "diffuseTexture");
    double color[4] = {1.0, 1.0, 1.0, 1.0};
    umbs_text_clean(material.name, sizeof material.name,
                    name != NULL ? json_string_value(name) : "", json_string_length(name));
    read_alpha(builder, json, &material);
    material.double_sided = json_is_true(json_object_get(json, "doubleSided"));
    if (!umbb_gltf_numbers(specular, "diffuseFactor", 4, color)) {
        (void)umbb_gltf_numbers(metallic, "baseColorFactor", 4, color);
    }
    material.base_alpha = (float)clamp_unit(color[3]);
    for (int k = 0; k < 3; k++) {
        material.base_color[k] = (float)clamp_unit(color[k]);
    }
    material.has_image = info != NULL || json_object_get(metallic, "baseColorTexture") != NULL;
    material.transmission =
        (float)clamp_unit(umbb_gltf_number(transmission, "transmissionFactor", 0.0));
    if (material.transmission > 0.0F &&
        json_object_get(transmission, "transmissionTexture") != NULL) {
        umbs_scene_warn(builder,
                        "material '%s': the texture of its transmission is not read; the factor "
                        "counts all over",
                        material.name);
    }
    if (material.alpha_mode != UMBS_ALPHA_OPAQUE) {
        UMB__TRY(read_texture(gltf,
                              info != NULL ? info : json_object_get(metallic, "baseColorTexture"),
                              &material, mapping, error));
    }
    return umbs_scene_add_material(builder, &material, error);
}

/* Finds a material, and reads it at its first use. */
static enum umb_status get_material(struct umbb_gltf *gltf, int64_t number,
                                    const struct umbb_gltf_material **material,
                                    struct umb_error *error)
{
    const json_t *json;
    UMB__TRY(umbb_gltf_item(gltf, "materials", number, &json, error));
    struct umbb_gltf_material *found = &gltf->materials[number];
    if (!found->is_read) {
        UMB__TRY(read_material(gltf, json, &found->mapping, error));
        found->number = (uint32_t)gltf->job->scene.materials.count - 1;
        found->is_read = 1;
    }
    *material = found;
    return UMB_OK;
}

enum {
    MODE_TRIANGLES = 4,
    MODE_STRIP = 5,
    MODE_FAN = 6,
};

static int is_coordinate(double value)
{
    return fabs(value) <= COORDINATE_MAX; /* false for NaN */
}

/* Gets the texture coordinates of a vertex, with v growing upwards; 0 0 if they are not finite. */
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
    struct umbb_gltf_accessor positions, indices, uvs, normals; /* count 0: there are none */
    uint32_t material; /* of the builder, or UMBS_NO_INDEX */
    const struct umbb_gltf_mapping *mapping;
    int64_t mode;
};

/* Chooses the material. A mesh that lacks the coordinates of its material's texture gets none and
 * is opaque. */
static enum umb_status choose_material(struct umbb_gltf *gltf, const json_t *json,
                                       struct primitive *p, struct umb_error *error)
{
    static const struct umbb_gltf_use use = {"TEXCOORD",
                                             "VEC2 of floats or unsigned integers of 8 or 16 bits",
                                             2, UMBB_GLTF_FLOAT | UMBB_GLTF_UNSIGNED};
    const struct umbs_array *materials = &gltf->job->scene.materials;
    const struct umbb_gltf_material *material;
    const int64_t number = umbb_gltf_index(json, "material");
    char key[32];
    p->material = UMBS_NO_INDEX;
    if (number == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    UMB__TRY(get_material(gltf, number, &material, error));
    p->material = material->number;
    p->mapping = &material->mapping;
    if (((const struct umbs_material *)materials->data)[material->number].texture ==
        UMBS_NO_INDEX) {
        return UMB_OK;
    }
    (void)snprintf(key, sizeof key, "TEXCOORD_%lld", (long long)p->mapping->set);
    const int64_t accessor = umbb_gltf_index(json_object_get(json, "attributes"), key);
    if (accessor != UMBB_GLTF_NONE) {
        UMB__TRY(umbb_gltf_accessor(gltf, accessor, &use, &p->uvs, error));
    }
    if (p->uvs.count != p->positions.count) {
        p->uvs.count = 0;
        gltf->bare++;
        p->material = UMBS_NO_INDEX;
    }
    return UMB_OK;
}

/* Finds the normals of a primitive. They are for pictures: those that cannot be read are left
 * out. */
static void find_normals(struct umbb_gltf *gltf, const json_t *json, struct primitive *p)
{
    static const struct umbb_gltf_use use = {"NORMAL", "VEC3 of floats or signed integers", 3,
                                             UMBB_GLTF_FLOAT | UMBB_GLTF_SIGNED};
    const int64_t number = umbb_gltf_index(json_object_get(json, "attributes"), "NORMAL");
    struct umb_error ignored;
    if (!gltf->job->look || number == UMBB_GLTF_NONE ||
        umbb_gltf_accessor(gltf, number, &use, &p->normals, &ignored) != UMB_OK ||
        p->normals.count != p->positions.count) {
        p->normals.count = 0;
    }
}

static enum umb_status add_normal(struct umbs_scene_builder *scene, const struct primitive *p,
                                  uint32_t vertex, struct umb_error *error)
{
    double normal[3];
    if (p->normals.count == 0) {
        return UMB_OK;
    }
    umbb_gltf_get(&p->normals, vertex, normal);
    return umbs_scene_set_normal(scene, normal, error);
}

/* Adds the vertices and the triangles. */
static enum umb_status add_triangles(struct umbb_faces *faces, const struct primitive *p,
                                     struct umb_error *error)
{
    const uint64_t first = faces->scene->positions.count;
    const uint32_t corners = p->indices.count > 0 ? p->indices.count : p->positions.count;
    const uint32_t count = p->mode == MODE_TRIANGLES ? corners / 3 : corners < 3 ? 0 : corners - 2;
    for (uint32_t i = 0; count > 0 && i < p->positions.count; i++) {
        double position[3];
        float uv[2];
        umbb_gltf_get(&p->positions, i, position);
        if (p->uvs.count > 0) {
            get_uv(&p->uvs, p->mapping, i, uv);
        }
        UMB__TRY(
            umbs_scene_add_vertex(faces->scene, position, p->uvs.count > 0 ? uv : NULL, error));
        UMB__TRY(add_normal(faces->scene, p, i, error));
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
            if (p->indices.count > 0) {
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
static enum umb_status add_primitive(struct umbb_gltf *gltf, const json_t *json,
                                     struct umb_error *error)
{
    static const struct umbb_gltf_use position_use = {"POSITION", "VEC3 of floats", 3,
                                                      UMBB_GLTF_FLOAT};
    static const struct umbb_gltf_use index_use = {"indices", "SCALAR of unsigned integers", 1,
                                                   UMBB_GLTF_UNSIGNED | UMBB_GLTF_UINT32};
    struct umbs_scene_builder *builder = &gltf->job->scene;
    const int64_t position = umbb_gltf_index(json_object_get(json, "attributes"), "POSITION");
    const int64_t indices = umbb_gltf_index(json, "indices");
    const int64_t mode = umbb_gltf_index(json, "mode");
    struct primitive p = {.mode = mode != UMBB_GLTF_NONE ? mode : MODE_TRIANGLES};
    if (p.mode == UMBB_GLTF_BAD) {
        return UMBB_REFUSE(error, "the mode of a primitive is not a whole number from 0 to %d",
                           MODE_FAN);
    }
    if (p.mode > MODE_FAN) {
        return UMBB_REFUSE(error, "mode %lld of a primitive is not in 0 to %d", (long long)p.mode,
                           MODE_FAN);
    }
    if (p.mode < MODE_TRIANGLES || position == UMBB_GLTF_NONE) {
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_accessor(gltf, position, &position_use, &p.positions, error));
    if (indices != UMBB_GLTF_NONE) {
        UMB__TRY(umbb_gltf_accessor(gltf, indices, &index_use, &p.indices, error));
        p.indices.is_normalized = 0; /* a fraction numbers no vertex */
    }
    UMB__TRY(choose_material(gltf, json, &p, error));
    find_normals(gltf, json, &p);
    gltf->morphed += json_array_size(json_object_get(json, "targets")) > 0;
    const size_t first = builder->triangles.count;
    UMB__TRY(add_triangles(&gltf->faces, &p, error));
    const uint32_t count = (uint32_t)(builder->triangles.count - first);
    return count == 0 ? UMB_OK
                      : umbs_scene_end_mesh(builder, 0, (uint32_t)builder->positions.count, count,
                                            p.material, error);
}

enum umb_status umbb_gltf_get_mesh(struct umbb_gltf *gltf, int64_t number,
                                   const struct umbb_gltf_mesh **mesh, struct umb_error *error)
{
    const json_t *json;
    UMB__TRY(umbb_gltf_item(gltf, "meshes", number, &json, error));
    struct umbb_gltf_mesh *found = &gltf->meshes[number];
    const struct umbs_array *made = &gltf->job->scene.meshes;
    const json_t *primitives = json_object_get(json, "primitives");
    if (!found->is_read) {
        found->is_read = 1;
        found->first = (uint32_t)made->count;
        for (size_t i = 0; i < json_array_size(primitives); i++) {
            UMB__TRY(add_primitive(gltf, json_array_get(primitives, i), error));
        }
        found->count = (uint32_t)made->count - found->first;
    }
    *mesh = found;
    return UMB_OK;
}
