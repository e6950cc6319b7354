/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Materials of glTF, as far as they change shadows (gltf.h).
 * Source: glTF 2.0, sections 3.8 and 3.9; KHR_texture_transform, KHR_materials_transmission,
 * KHR_materials_pbrSpecularGlossiness.
 */
#include "bake/import/gltf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"

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

/* KHR_texture_transform: scale, then rotate, then move. In: info: a textureInfo. */
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

/* Gets the texture of an image: bytes of a view, a data URI, or a file. */
static enum umb_status get_texture(struct umbb_gltf_scene *scene, const json_t *json,
                                   struct umbb_image *image, uint32_t *texture,
                                   struct umb_error *error)
{
    const json_t *uri = json_object_get(json, "uri");
    const char *name = json_string_value(uri);
    struct umbb_gltf_view view;
    char *decoded = NULL;
    if (name == NULL) {
        UMB__TRY(umbb_gltf_view(&scene->file, umbb_gltf_index(json, "bufferView"), &view, error));
        image->bytes = view.bytes;
        image->size = view.size;
    } else {
        UMB__TRY(umbb_gltf_data_uri(name, json_string_length(uri), &decoded, &image->size, error));
        image->bytes = decoded;
        if (decoded == NULL) {
            image->name = name;
            image->name_length = json_string_length(uri);
        }
    }
    const enum umb_status status = umbb_texture_get(&scene->textures, image, texture, error);
    free(decoded);
    return status;
}

/* Gives a material the alpha of its texture. In: info: a textureInfo, or NULL. */
static enum umb_status read_texture(struct umbb_gltf_scene *scene, const json_t *info,
                                    struct umbs_material *material,
                                    struct umbb_gltf_mapping *mapping, struct umb_error *error)
{
    const json_t *texture, *json, *sampler = NULL;
    char number[32];
    if (info == NULL) {
        return UMB_OK;
    }
    UMB__TRY(
        umbb_gltf_item(&scene->file, "textures", umbb_gltf_index(info, "index"), &texture, error));
    const int64_t source = umbb_gltf_index(texture, "source");
    if (source == UMBB_GLTF_NONE) {
        umbs_scene_warn(&scene->file.job->scene,
                        "material '%s': its texture has no PNG or JPEG image and is left out",
                        material->name);
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_item(&scene->file, "images", source, &json, error));
    const int64_t sampler_number = umbb_gltf_index(texture, "sampler");
    if (sampler_number != UMBB_GLTF_NONE) {
        UMB__TRY(umbb_gltf_item(&scene->file, "samplers", sampler_number, &sampler, error));
    }
    struct umbb_image image = {
        .name = number,
        .name_length = (size_t)snprintf(number, sizeof number, "images[%lld]", (long long)source),
        .wrap_s = wrap_of(sampler, "wrapS"),
        .wrap_t = wrap_of(sampler, "wrapT"),
        .nearest = umbb_gltf_index(sampler, "magFilter") == GL_NEAREST};
    read_mapping(info, mapping);
    return get_texture(scene, json, &image, &material->texture, error);
}

static double clamp_unit(double value)
{
    return value > 0.0 ? (value < 1.0 ? value : 1.0) : 0.0;
}

static void read_alpha(struct umbs_scene_builder *builder, const json_t *json,
                       struct umbs_material *material)
{
    const char *mode = json_string_value(json_object_get(json, "alphaMode"));
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

static enum umb_status read_material(struct umbb_gltf_scene *scene, const json_t *json,
                                     struct umbb_gltf_mapping *mapping, struct umb_error *error)
{
    struct umbs_scene_builder *builder = &scene->file.job->scene;
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
        UMB__TRY(read_texture(scene,
                              info != NULL ? info : json_object_get(metallic, "baseColorTexture"),
                              &material, mapping, error));
    }
    return umbs_scene_add_material(builder, &material, error);
}

enum umb_status umbb_gltf_get_material(struct umbb_gltf_scene *scene, int64_t number,
                                       const struct umbb_gltf_material **material,
                                       struct umb_error *error)
{
    const json_t *json;
    UMB__TRY(umbb_gltf_item(&scene->file, "materials", number, &json, error));
    struct umbb_gltf_material *found = &scene->materials[number];
    if (!found->is_read) {
        UMB__TRY(read_material(scene, json, &found->mapping, error));
        found->number = (uint32_t)scene->file.job->scene.materials.count - 1;
        found->is_read = 1;
    }
    *material = found;
    return UMB_OK;
}
