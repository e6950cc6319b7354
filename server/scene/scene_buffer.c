/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Layout and validator of scene buffers (scene_buffer.h).
 *
 * Invariant: umbs_scene_view returns UMB_OK only if every pointer of the view is in the buffer with
 * as many items as its count says, every index is in range, every number is finite and inside its
 * documented range. Later code checks nothing again. The validator never writes to the buffer, and
 * each of its loops is bounded by a section that was proven to lie inside the buffer.
 */
#include "scene/scene_buffer.h"

#include <math.h>
#include <string.h>

#include "base/try.h"
#include "base/vec.h"
#include "common/clean_text.h"

_Static_assert(sizeof(struct umbs_scene_header) == 232, "header without padding");
_Static_assert(sizeof(struct umbs_mesh) == 24, "mesh without padding");
_Static_assert(sizeof(struct umbs_instance) == 104, "instance without padding");
_Static_assert(sizeof(struct umbs_material) == 104, "material without padding");
_Static_assert(sizeof(struct umbs_light) == 176, "light without padding");
_Static_assert(sizeof(struct umbs_light_extent) == 40, "extent without padding");
_Static_assert(sizeof(struct umbs_texture) == 96, "texture without padding");
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "hashes are over little-endian bytes");

/* A unit vector in doubles is off by a few 1e-16; one converted from floats by 1e-7. */
#define UNIT_TOLERANCE 1e-6
#define PI             3.14159265358979323846

struct section_kind {
    const char *name;
    size_t item_bytes;
    uint64_t limit; /* items */
};

static const struct section_kind section_kinds[UMBS_SECTION_COUNT] = {
    [UMBS_SECTION_MESHES] = {"mesh_count", sizeof(struct umbs_mesh), UINT32_MAX},
    [UMBS_SECTION_INSTANCES] = {"instance_count", sizeof(struct umbs_instance), UINT32_MAX},
    [UMBS_SECTION_MATERIALS] = {"material_count", sizeof(struct umbs_material), UINT32_MAX},
    [UMBS_SECTION_LIGHTS] = {"light_count", sizeof(struct umbs_light), UINT32_MAX},
    [UMBS_SECTION_TEXTURES] = {"texture_count", sizeof(struct umbs_texture), UINT32_MAX},
    [UMBS_SECTION_POSITIONS] = {"vertex_count", 3 * sizeof(double), UINT32_MAX},
    [UMBS_SECTION_UVS] = {"uv count", 2 * sizeof(float), UINT32_MAX},
    [UMBS_SECTION_NORMALS] = {"normal count", 3 * sizeof(float), UINT32_MAX},
    [UMBS_SECTION_TRIANGLES] = {"triangle_count", 3 * sizeof(uint32_t), UINT32_MAX},
    [UMBS_SECTION_ALPHA] = {"alpha_bytes", 1, 1ULL << 40},
    [UMBS_SECTION_WARNINGS] = {"warnings bytes", 1, 1ULL << 24},
    [UMBS_SECTION_EXTENTS] = {"extent count", sizeof(struct umbs_light_extent), UINT32_MAX},
};

size_t umbs_section_item_bytes(enum umbs_section section)
{
    return section_kinds[section].item_bytes;
}

const char *umbs_scene_layout(const uint64_t counts[UMBS_SECTION_COUNT],
                              uint64_t offsets[UMBS_SECTION_COUNT], uint64_t *total)
{
    uint64_t at = sizeof(struct umbs_scene_header);
    *total = 0;
    for (int i = 0; i < UMBS_SECTION_COUNT; i++) {
        if (counts[i] > section_kinds[i].limit) {
            return section_kinds[i].name;
        }
        offsets[i] = at;
        /* A section has at most 2^32 * 176 or 2^40 bytes, so the sum of eleven sections cannot
         * overflow. */
        at += (counts[i] * section_kinds[i].item_bytes + 7) & ~7ULL;
    }
    *total = at;
    return NULL;
}

static enum umb_status bad(struct umb_error *error, const char *field, uint64_t value,
                           const char *rule, uint64_t limit)
{
    return umb_fail(error, UMB_E_BAD_SCENE, "scene buffer: %s is %llu, %s %llu", field,
                    (unsigned long long)value, rule, (unsigned long long)limit);
}

static enum umb_status bad_item(struct umb_error *error, const char *what, size_t index,
                                const char *rule)
{
    return umb_fail(error, UMB_E_BAD_SCENE, "scene buffer: %s %zu: %s", what, index, rule);
}

static int in_range(double value, double low, double high)
{
    return value >= low && value <= high; /* false for NaN */
}

static int is_coordinate(double value)
{
    return in_range(value, -UMBS_COORDINATE_MAX, UMBS_COORDINATE_MAX);
}

/* Returns whether a name is clean and NUL to its end, so that equal names are equal bytes. */
static int is_name(const char name[UMB_NAME_SIZE])
{
    const char *end = memchr(name, '\0', UMB_NAME_SIZE);
    if (end == NULL || !umbs_text_is_clean(name, (size_t)(end - name), 0)) {
        return 0;
    }
    for (const char *at = end; at < name + UMB_NAME_SIZE; at++) {
        if (*at != '\0') {
            return 0;
        }
    }
    return 1;
}

static enum umb_status check_header(const struct umbs_scene_header *header, size_t size,
                                    struct umb_error *error)
{
    if (memcmp(header->magic, UMBS_SCENE_MAGIC, sizeof(header->magic)) != 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene buffer: magic is wrong");
    }
    if (header->total_bytes != size) {
        return bad(error, "total_bytes", header->total_bytes, "the buffer has", size);
    }
    if (header->format > UMBS_FORMAT_STL) {
        return bad(error, "format", header->format, "limit", UMBS_FORMAT_STL);
    }
    if (header->z_up > 1) {
        return bad(error, "z_up", header->z_up, "limit", 1);
    }
    if (header->up_evidence >= UMBS_UP_EVIDENCE_COUNT) {
        return bad(error, "up_evidence", header->up_evidence, "limit", UMBS_UP_EVIDENCE_COUNT - 1);
    }
    uint64_t offsets[UMBS_SECTION_COUNT];
    uint64_t total;
    const char *field = umbs_scene_layout(header->counts, offsets, &total);
    if (field != NULL) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene buffer: %s is over its limit", field);
    }
    for (int i = 0; i < UMBS_SECTION_COUNT; i++) {
        if (header->offsets[i] != offsets[i]) {
            return umb_fail(error, UMB_E_BAD_SCENE,
                            "scene buffer: offset of section %d is %llu, must be %llu", i,
                            (unsigned long long)header->offsets[i], (unsigned long long)offsets[i]);
        }
    }
    if (total != size) {
        return bad(error, "bytes that the counts ask for", total, "the buffer has", size);
    }
    uint64_t uvs = header->counts[UMBS_SECTION_UVS];
    if (uvs != 0 && uvs != header->counts[UMBS_SECTION_POSITIONS]) {
        return bad(error, "uv count", uvs, "must be 0 or", header->counts[UMBS_SECTION_POSITIONS]);
    }
    const uint64_t normals = header->counts[UMBS_SECTION_NORMALS];
    if (normals != 0 && normals != header->counts[UMBS_SECTION_POSITIONS]) {
        return bad(error, "normal count", normals, "must be 0 or",
                   header->counts[UMBS_SECTION_POSITIONS]);
    }
    const uint64_t extents = header->counts[UMBS_SECTION_EXTENTS];
    if (extents != 0 && extents != header->counts[UMBS_SECTION_LIGHTS]) {
        return bad(error, "extent count", extents, "must be 0 or",
                   header->counts[UMBS_SECTION_LIGHTS]);
    }
    return UMB_OK;
}

/* Sets pointers and counts; the header was checked before. */
static void fill_view(const unsigned char *bytes, const struct umbs_scene_header *header,
                      struct umbs_scene_view *view)
{
    const uint64_t *counts = header->counts;
    const uint64_t *offsets = header->offsets;
    view->format = (enum umbs_format)header->format;
    view->z_up = (int)header->z_up;
    view->up_evidence = (enum umbs_up_evidence)header->up_evidence;
    view->mesh_count = (uint32_t)counts[UMBS_SECTION_MESHES];
    view->instance_count = (uint32_t)counts[UMBS_SECTION_INSTANCES];
    view->material_count = (uint32_t)counts[UMBS_SECTION_MATERIALS];
    view->light_count = (uint32_t)counts[UMBS_SECTION_LIGHTS];
    view->texture_count = (uint32_t)counts[UMBS_SECTION_TEXTURES];
    view->vertex_count = (uint32_t)counts[UMBS_SECTION_POSITIONS];
    view->triangle_count = (uint32_t)counts[UMBS_SECTION_TRIANGLES];
    view->meshes = (const void *)(bytes + offsets[UMBS_SECTION_MESHES]);
    view->instances = (const void *)(bytes + offsets[UMBS_SECTION_INSTANCES]);
    view->materials = (const void *)(bytes + offsets[UMBS_SECTION_MATERIALS]);
    view->lights = (const void *)(bytes + offsets[UMBS_SECTION_LIGHTS]);
    view->extents = counts[UMBS_SECTION_EXTENTS] > 0
                        ? (const void *)(bytes + offsets[UMBS_SECTION_EXTENTS])
                        : NULL;
    view->textures = (const void *)(bytes + offsets[UMBS_SECTION_TEXTURES]);
    view->positions = (const void *)(bytes + offsets[UMBS_SECTION_POSITIONS]);
    view->uvs =
        counts[UMBS_SECTION_UVS] > 0 ? (const void *)(bytes + offsets[UMBS_SECTION_UVS]) : NULL;
    view->normals = counts[UMBS_SECTION_NORMALS] > 0
                        ? (const void *)(bytes + offsets[UMBS_SECTION_NORMALS])
                        : NULL;
    view->triangles = (const void *)(bytes + offsets[UMBS_SECTION_TRIANGLES]);
    view->alpha = bytes + offsets[UMBS_SECTION_ALPHA];
    view->alpha_bytes = counts[UMBS_SECTION_ALPHA];
    view->world_triangle_count = header->world_triangle_count;
    view->dropped_faces = header->dropped_faces;
    view->warnings = (const char *)(bytes + offsets[UMBS_SECTION_WARNINGS]);
}

static enum umb_status check_vertices(const struct umbs_scene_view *view, struct umb_error *error)
{
    for (size_t i = 0; i < view->vertex_count; i++) {
        const double *position = view->positions[i];
        if (!is_coordinate(position[0]) || !is_coordinate(position[1]) ||
            !is_coordinate(position[2])) {
            return umb_fail(error, UMB_E_BAD_SCENE,
                            "scene buffer: position %zu is %g %g %g, limit %g", i, position[0],
                            position[1], position[2], UMBS_COORDINATE_MAX);
        }
    }
    for (size_t i = 0; view->uvs != NULL && i < view->vertex_count; i++) {
        if (!isfinite(view->uvs[i][0]) || !isfinite(view->uvs[i][1])) {
            return bad_item(error, "uv", i, "is not finite");
        }
    }
    for (size_t i = 0; view->normals != NULL && i < (size_t)3 * view->vertex_count; i++) {
        if (!in_range((double)view->normals[i / 3][i % 3], -1.0, 1.0)) {
            return bad_item(error, "normal", i / 3, "is not in -1..1");
        }
    }
    return UMB_OK;
}

static enum umb_status check_mesh(const struct umbs_scene_view *view, size_t index,
                                  uint64_t first_triangle, struct umb_error *error)
{
    const struct umbs_mesh *mesh = &view->meshes[index];
    if ((uint64_t)mesh->first_vertex + mesh->vertex_count > view->vertex_count) {
        return bad_item(error, "mesh", index, "vertices beyond vertex_count");
    }
    if (mesh->first_triangle != first_triangle) {
        return bad_item(error, "mesh", index, "first_triangle does not follow the mesh before");
    }
    if (first_triangle + mesh->triangle_count > view->triangle_count) {
        return bad_item(error, "mesh", index, "triangles beyond triangle_count");
    }
    if (mesh->material != UMBS_NO_INDEX && mesh->material >= view->material_count) {
        return bad_item(error, "mesh", index, "material beyond material_count");
    }
    if (mesh->reserved != 0) {
        return bad_item(error, "mesh", index, "reserved is not 0");
    }
    for (size_t i = first_triangle; i < first_triangle + mesh->triangle_count; i++) {
        const uint32_t *triangle = view->triangles[i];
        if (triangle[0] >= mesh->vertex_count || triangle[1] >= mesh->vertex_count ||
            triangle[2] >= mesh->vertex_count) {
            return bad_item(error, "triangle", i, "vertex beyond its mesh's vertex_count");
        }
    }
    return UMB_OK;
}

static enum umb_status check_meshes(const struct umbs_scene_view *view, struct umb_error *error)
{
    uint64_t triangles = 0;
    for (size_t i = 0; i < view->mesh_count; i++) {
        UMB__TRY(check_mesh(view, i, triangles, error));
        triangles += view->meshes[i].triangle_count;
    }
    if (triangles != view->triangle_count) {
        return bad(error, "triangle_count", view->triangle_count, "the meshes have", triangles);
    }
    return UMB_OK;
}

static enum umb_status check_instances(const struct umbs_scene_view *view, struct umb_error *error)
{
    uint64_t world = 0;
    for (size_t i = 0; i < view->instance_count; i++) {
        const struct umbs_instance *instance = &view->instances[i];
        const double *entry = &instance->mesh_to_world[0][0];
        for (int k = 0; k < 12; k++) {
            if (!is_coordinate(entry[k])) {
                return bad_item(error, "instance", i, "mesh_to_world is not finite or too large");
            }
        }
        if (instance->mesh >= view->mesh_count) {
            return bad_item(error, "instance", i, "mesh beyond mesh_count");
        }
        if (instance->reserved != 0) {
            return bad_item(error, "instance", i, "reserved is not 0");
        }
        world += view->meshes[instance->mesh].triangle_count; /* 2^32 terms below 2^32 each */
    }
    if (world != view->world_triangle_count) {
        return bad(error, "world_triangle_count", view->world_triangle_count, "the instances have",
                   world);
    }
    if (world == 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene buffer: world_triangle_count is 0");
    }
    if (world > UMBS_WORLD_TRIANGLES_MAX) {
        return bad(error, "world_triangle_count", world, "limit", UMBS_WORLD_TRIANGLES_MAX);
    }
    return UMB_OK;
}

static enum umb_status check_materials(const struct umbs_scene_view *view, struct umb_error *error)
{
    for (size_t i = 0; i < view->material_count; i++) {
        const struct umbs_material *material = &view->materials[i];
        const char *rule = NULL;
        if (!is_name(material->name)) {
            rule = "name is not clean text";
        } else if (material->alpha_mode > UMBS_ALPHA_BLEND) {
            rule = "alpha_mode is unknown";
        } else if (material->double_sided > 1) {
            rule = "double_sided is not 0 or 1";
        } else if (!in_range((double)material->alpha_cutoff, 0.0, 1.0)) {
            rule = "alpha_cutoff is not in 0..1";
        } else if (!in_range((double)material->base_alpha, 0.0, 1.0)) {
            rule = "base_alpha is not in 0..1";
        } else if (material->texture != UMBS_NO_INDEX && material->texture >= view->texture_count) {
            rule = "texture beyond texture_count";
        } else if (!in_range((double)material->transmission, 0.0, 1.0)) {
            rule = "transmission is not in 0..1";
        } else if (material->has_image > 1) {
            rule = "has_image is not 0 or 1";
        }
        for (int k = 0; k < 3; k++) {
            if (!in_range((double)material->base_color[k], 0.0, 1.0)) {
                rule = "base_color is not in 0..1";
            }
        }
        if (rule != NULL) {
            return bad_item(error, "material", i, rule);
        }
    }
    return UMB_OK;
}

static const char *light_fault(const struct umbs_light *light)
{
    const double length = umb__dot(light->direction, light->direction); /* squared */
    if (!is_name(light->name)) {
        return "name is not clean text";
    }
    if (light->kind >= UMB_LIGHT_KINDS) {
        return "kind is unknown";
    }
    if (light->reserved != 0) {
        return "reserved is not 0";
    }
    if (!in_range(length, 1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE)) {
        return "direction is not a unit vector";
    }
    for (int k = 0; k < 3; k++) {
        if (!is_coordinate(light->position[k])) {
            return "position is not finite or too large";
        }
        if (!in_range(light->color[k], 0.0, 1e30)) {
            return "color is negative or not finite";
        }
    }
    if (!in_range(light->inner_cone, 0.0, light->outer_cone) ||
        !in_range(light->outer_cone, 0.0, PI)) {
        return "cone is not 0 <= inner <= outer <= pi";
    }
    if (!in_range(light->range, 0.0, UMBS_COORDINATE_MAX)) {
        return "range is negative, not finite or too large";
    }
    if (!in_range(light->intensity, 0.0, 1e30)) {
        return "intensity is negative or not finite";
    }
    return NULL;
}

static const char *extent_fault(const struct umbs_light_extent *extent,
                                const struct umbs_light *light)
{
    const double side = umb__length(extent->side);
    const double most = light->kind == UMB_LIGHT_DIRECTIONAL ? PI : UMB_LAMP_SIZE_MAX;
    if (extent->is_given > 1 || extent->reserved != 0) {
        return "is_given is not 0 or 1, or reserved is not 0";
    }
    if (!in_range(extent->extent, 0.0, extent->is_given ? most : 0.0)) {
        return "extent is negative, not finite or too large";
    }
    if (!in_range(side, 0.0, light->kind == UMB_LIGHT_RECTANGLE ? UMB_LAMP_SIZE_MAX : 0.0)) {
        return "side is not finite, too large, or not of a rectangle";
    }
    return fabs(umb__dot(extent->side, light->direction)) <= UNIT_TOLERANCE * side
               ? NULL
               : "side is not across the direction";
}

static enum umb_status check_lights(const struct umbs_scene_view *view, struct umb_error *error)
{
    for (size_t i = 0; i < view->light_count; i++) {
        const char *rule = light_fault(&view->lights[i]);
        if (rule == NULL && view->extents != NULL) {
            rule = extent_fault(&view->extents[i], &view->lights[i]);
        }
        if (rule != NULL) {
            return bad_item(error, "light", i, rule);
        }
    }
    return UMB_OK;
}

static enum umb_status check_textures(const struct umbs_scene_view *view, struct umb_error *error)
{
    for (size_t i = 0; i < view->texture_count; i++) {
        const struct umbs_texture *texture = &view->textures[i];
        const char *rule = NULL;
        uint64_t pixels = (uint64_t)texture->width * texture->height;
        if (!is_name(texture->name)) {
            rule = "name is not clean text";
        } else if (texture->width - 1U >= UMBS_TEXTURE_SIDE_MAX ||
                   texture->height - 1U >= UMBS_TEXTURE_SIDE_MAX) {
            rule = "width or height is not in 1..65536";
        } else if (texture->offset > view->alpha_bytes ||
                   pixels > view->alpha_bytes - texture->offset) {
            rule = "pixels beyond alpha_bytes";
        } else if (texture->wrap_s > UMBS_WRAP_MIRROR || texture->wrap_t > UMBS_WRAP_MIRROR) {
            rule = "wrap is unknown";
        } else if (texture->nearest > 1) {
            rule = "nearest is not 0 or 1";
        } else if (texture->reserved != 0) {
            rule = "reserved is not 0";
        }
        if (rule != NULL) {
            return bad_item(error, "texture", i, rule);
        }
    }
    return UMB_OK;
}

static enum umb_status check_warnings(const struct umbs_scene_view *view, uint64_t bytes,
                                      struct umb_error *error)
{
    if (bytes == 0 || view->warnings[bytes - 1] != '\0' ||
        !umbs_text_is_clean(view->warnings, (size_t)bytes - 1, 1)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "scene buffer: warnings are not clean NUL-terminated text");
    }
    return UMB_OK;
}

enum umb_status umbs_scene_view(const void *bytes, size_t size, struct umbs_scene_view *view,
                                struct umb_error *error)
{
    memset(view, 0, sizeof(*view));
    if (size < sizeof(struct umbs_scene_header) || (uintptr_t)bytes % 8 != 0) {
        return bad(error, "size", size, "must be 8-aligned and at least",
                   sizeof(struct umbs_scene_header));
    }
    const struct umbs_scene_header *header = bytes;
    struct umbs_scene_view found = {0};
    enum umb_status status = check_header(header, size, error);
    if (status == UMB_OK) {
        fill_view(bytes, header, &found);
        status = check_warnings(&found, header->counts[UMBS_SECTION_WARNINGS], error);
    }
    enum umb_status (*const checks[])(const struct umbs_scene_view *, struct umb_error *) = {
        check_textures, check_materials, check_lights,
        check_vertices, check_meshes,    check_instances,
    };
    for (size_t i = 0; status == UMB_OK && i < sizeof(checks) / sizeof(checks[0]); i++) {
        status = checks[i](&found, error);
    }
    if (status == UMB_OK) {
        *view = found;
    }
    return status;
}
