/* SPDX-License-Identifier: Apache-2.0 */
/* The growing scene (scene_builder.h). Invariant: uvs.count is 0 or positions.count. */
#include "scene/scene_builder.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"

#define WARNINGS_MAX 65536U

enum umb_status umbs_array_reserve(struct umbs_array *array, size_t more, size_t item_bytes,
                                   struct umb_error *error)
{
    const size_t most = SIZE_MAX / item_bytes, need = array->count + more;
    size_t capacity = array->capacity + array->capacity / 2;
    if (more <= array->capacity - array->count) {
        return UMB_OK;
    }
    capacity = capacity < need ? need : capacity;
    capacity = capacity < 16 ? 16 : capacity;
    capacity = capacity > most ? need : capacity;
    void *data = more > most - array->count ? NULL : realloc(array->data, capacity * item_bytes);
    if (data == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu items of %zu bytes", need,
                        item_bytes);
    }
    array->data = data;
    array->capacity = capacity;
    return UMB_OK;
}

/* Appends items to a section; their number stays within 32 bits. */
static enum umb_status append(struct umbs_scene_builder *builder, enum umbs_section section,
                              const void *items, size_t count, struct umb_error *error)
{
    struct umbs_array *array = &builder->sections[section];
    const size_t item_bytes = umbs_section_item_bytes(section);
    if (section != UMBS_SECTION_ALPHA && array->count + count > UINT32_MAX - 1U) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u items of one kind", UINT32_MAX - 1U);
    }
    UMB__TRY(umbs_array_reserve(array, count, item_bytes, error));
    if (count > 0) {
        memcpy((char *)array->data + array->count * item_bytes, items, count * item_bytes);
    }
    array->count += count;
    return UMB_OK;
}

void umbs_scene_builder_init(struct umbs_scene_builder *builder, enum umbs_format format, int z_up,
                             uint64_t max_triangles)
{
    memset(builder, 0, sizeof(*builder));
    builder->format = format;
    builder->z_up = z_up;
    builder->up_evidence = format == UMBS_FORMAT_GLTF ? UMBS_UP_FORMAT : UMBS_UP_NONE;
    builder->max_triangles = max_triangles > 0 && max_triangles < UMBS_WORLD_TRIANGLES_MAX
                                 ? max_triangles
                                 : UMBS_WORLD_TRIANGLES_MAX;
}

void umbs_scene_builder_finish(struct umbs_scene_builder *builder)
{
    for (int i = 0; i < UMBS_SECTION_COUNT; i++) {
        free(builder->sections[i].data);
    }
    memset(builder, 0, sizeof(*builder));
}

/* Gives every vertex added so far the texture coordinates 0 0. */
static enum umb_status start_uvs(struct umbs_scene_builder *builder, struct umb_error *error)
{
    size_t count = builder->positions.count;
    UMB__TRY(umbs_array_reserve(&builder->uvs, count, 2 * sizeof(float), error));
    memset(builder->uvs.data, 0, count * 2 * sizeof(float));
    builder->uvs.count = count;
    return UMB_OK;
}

enum umb_status umbs_scene_add_vertex(struct umbs_scene_builder *builder, const double position[3],
                                      const float *uv, struct umb_error *error)
{
    static const float zero[2] = {0.0F, 0.0F};
    if (uv != NULL && builder->uvs.count != builder->positions.count) {
        UMB__TRY(start_uvs(builder, error));
    }
    UMB__TRY(append(builder, UMBS_SECTION_POSITIONS, position, 1, error));
    if (uv == NULL && builder->uvs.count == 0) {
        return UMB_OK;
    }
    const enum umb_status status =
        append(builder, UMBS_SECTION_UVS, uv != NULL ? uv : zero, 1, error);
    builder->positions.count -= status != UMB_OK;
    return status;
}

/* Appends vertices without a normal, up to `count` in all. */
static enum umb_status fill_normals(struct umbs_scene_builder *builder, size_t count,
                                    struct umb_error *error)
{
    struct umbs_array *normals = &builder->normals;
    const size_t bytes = 3 * sizeof(float), more = count - normals->count;
    UMB__TRY(umbs_array_reserve(normals, more, bytes, error));
    memset((char *)normals->data + normals->count * bytes, 0, more * bytes);
    normals->count = count;
    return UMB_OK;
}

enum umb_status umbs_scene_set_normal(struct umbs_scene_builder *builder, const double normal[3],
                                      struct umb_error *error)
{
    const double length = hypot(hypot(normal[0], normal[1]), normal[2]);
    const size_t count = builder->positions.count;
    if (!(length > 0.0) || !isfinite(length) || count == 0) {
        return UMB_OK;
    }
    UMB__TRY(fill_normals(builder, count, error));
    float *last = (float *)builder->normals.data + 3 * (count - 1);
    for (int k = 0; k < 3; k++) {
        last[k] = (float)fmax(-1.0, fmin(1.0, normal[k] / length));
    }
    return UMB_OK;
}

enum umb_status umbs_scene_add_triangle(struct umbs_scene_builder *builder,
                                        const uint32_t corners[3], struct umb_error *error)
{
    if (builder->triangles.count >= builder->max_triangles) {
        return umb_fail(error, UMB_E_LIMIT, "more than %llu triangles",
                        (unsigned long long)builder->max_triangles);
    }
    return append(builder, UMBS_SECTION_TRIANGLES, corners, 1, error);
}

enum umb_status umbs_scene_end_mesh(struct umbs_scene_builder *builder, uint32_t first_vertex,
                                    uint32_t vertex_count, uint32_t triangle_count,
                                    uint32_t material, struct umb_error *error)
{
    struct umbs_mesh mesh = {
        .first_vertex = first_vertex,
        .vertex_count = vertex_count,
        .triangle_count = triangle_count,
        .material = material,
    };
    if (builder->meshes.count > 0) {
        const struct umbs_mesh *meshes = builder->meshes.data;
        const struct umbs_mesh *last = &meshes[builder->meshes.count - 1];
        mesh.first_triangle = last->first_triangle + last->triangle_count;
    }
    return append(builder, UMBS_SECTION_MESHES, &mesh, 1, error);
}

enum umb_status umbs_scene_add_instance(struct umbs_scene_builder *builder, uint32_t mesh,
                                        const double (*transform)[4], struct umb_error *error)
{
    struct umbs_instance instance = {.mesh = mesh};
    for (int row = 0; row < 3; row++) {
        for (int column = 0; column < 4; column++) {
            instance.mesh_to_world[row][column] =
                transform != NULL ? transform[row][column] : (row == column ? 1.0 : 0.0);
        }
    }
    const struct umbs_mesh *meshes = builder->meshes.data;
    uint64_t world = builder->world_triangles + meshes[mesh].triangle_count;
    if (world > builder->max_triangles) {
        return umb_fail(error, UMB_E_LIMIT, "%llu triangles with instances, limit %llu",
                        (unsigned long long)world, (unsigned long long)builder->max_triangles);
    }
    UMB__TRY(append(builder, UMBS_SECTION_INSTANCES, &instance, 1, error));
    builder->world_triangles = world;
    return UMB_OK;
}

struct umbs_material umbs_material_opaque(void)
{
    struct umbs_material material = {
        .alpha_mode = UMBS_ALPHA_OPAQUE,
        .alpha_cutoff = 0.5F,
        .base_alpha = 1.0F,
        .texture = UMBS_NO_INDEX,
        .base_color = {1.0F, 1.0F, 1.0F},
    };
    return material;
}

enum umb_status umbs_scene_add_material(struct umbs_scene_builder *builder,
                                        const struct umbs_material *material,
                                        struct umb_error *error)
{
    return append(builder, UMBS_SECTION_MATERIALS, material, 1, error);
}

enum umb_status umbs_scene_add_light(struct umbs_scene_builder *builder,
                                     const struct umbs_light *light,
                                     const struct umbs_light_extent *extent,
                                     struct umb_error *error)
{
    static const struct umbs_light_extent none = {0};
    UMB__TRY(append(builder, UMBS_SECTION_EXTENTS, extent != NULL ? extent : &none, 1, error));
    const enum umb_status status = append(builder, UMBS_SECTION_LIGHTS, light, 1, error);
    builder->extents.count -= status != UMB_OK;
    return status;
}

/* Returns the number of extents to write: none if the file gives none, so that the scene's hash is
 * that of its lights alone. */
static size_t extent_count(const struct umbs_scene_builder *builder)
{
    const struct umbs_light_extent *extents = builder->extents.data;
    size_t given = 0;
    for (size_t i = 0; i < builder->extents.count; i++) {
        given += extents[i].is_given;
    }
    return given > 0 ? builder->extents.count : 0;
}

enum umb_status umbs_scene_add_texture(struct umbs_scene_builder *builder,
                                       const struct umbs_texture *texture, const uint8_t *pixels,
                                       struct umb_error *error)
{
    struct umbs_texture copy = *texture;
    copy.offset = builder->alpha.count;
    UMB__TRY(append(builder, UMBS_SECTION_TEXTURES, &copy, 1, error));
    enum umb_status status =
        append(builder, UMBS_SECTION_ALPHA, pixels, (size_t)copy.width * copy.height, error);
    builder->textures.count -= status != UMB_OK;
    return status;
}

void umbs_scene_warn(struct umbs_scene_builder *builder, const char *format, ...)
{
    char line[512];
    char clean[512];
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(line, sizeof(line), format, arguments);
    va_end(arguments);
    if (length < 0) {
        return;
    }
    umbs_text_clean(clean, sizeof(clean) - 1, line, sizeof(line));
    size_t used = strlen(clean);
    clean[used++] = '\n';
    struct umbs_array *warnings = &builder->warnings; /* a warning that does not fit is dropped */
    if (warnings->count + used <= WARNINGS_MAX &&
        umbs_array_reserve(warnings, used, 1, NULL) == UMB_OK) {
        memcpy((char *)warnings->data + warnings->count, clean, used);
        warnings->count += used;
    }
}

/* Clears positions that are not finite or too large. No triangle uses them, but the buffer promises
 * finite positions. */
static void clear_unusable_positions(struct umbs_array *positions)
{
    double *position = positions->data;
    for (size_t i = 0; i < positions->count; i++, position += 3) {
        for (int k = 0; k < 3; k++) {
            if (!(fabs(position[k]) <= UMBS_COORDINATE_MAX)) {
                position[0] = position[1] = position[2] = 0.0;
            }
        }
    }
}

static enum umb_status write_section(const struct umb_sink *sink, const void *data, uint64_t bytes)
{
    static const char zeros[8] = {0};
    enum umb_status status = UMB_OK;
    if (bytes > 0) {
        status = sink->write(sink->user, data, (size_t)bytes);
    }
    if (status == UMB_OK && bytes % 8 != 0) {
        status = sink->write(sink->user, zeros, (size_t)(8 - bytes % 8));
    }
    return status;
}

enum umb_status umbs_scene_builder_write(struct umbs_scene_builder *builder,
                                         const struct umb_sink *sink, struct umb_error *error)
{
    struct umbs_scene_header header = {
        .format = (uint32_t)builder->format,
        .z_up = builder->z_up != 0,
        .up_evidence = builder->up_evidence,
        .dropped_faces = builder->dropped_faces,
        .world_triangle_count = builder->world_triangles,
    };
    UMB__TRY(umbs_array_reserve(&builder->warnings, 1, 1, error));
    ((char *)builder->warnings.data)[builder->warnings.count] = '\0';
    clear_unusable_positions(&builder->positions);
    if (builder->normals.count > 0) {
        UMB__TRY(fill_normals(builder, builder->positions.count, error));
    }
    memcpy(header.magic, UMBS_SCENE_MAGIC, sizeof(header.magic));
    for (int i = 0; i < UMBS_SECTION_COUNT; i++) {
        header.counts[i] = builder->sections[i].count + (i == UMBS_SECTION_WARNINGS);
    }
    header.counts[UMBS_SECTION_EXTENTS] = extent_count(builder);
    const char *field = umbs_scene_layout(header.counts, header.offsets, &header.total_bytes);
    if (field != NULL) {
        return umb_fail(error, UMB_E_LIMIT, "%s is over its limit", field);
    }
    enum umb_status status = write_section(sink, &header, sizeof(header));
    for (int i = 0; status == UMB_OK && i < UMBS_SECTION_COUNT; i++) {
        status = write_section(sink, builder->sections[i].data,
                               header.counts[i] * umbs_section_item_bytes((enum umbs_section)i));
    }
    return status != UMB_OK ? umb_fail(error, status, "cannot write the scene buffer") : UMB_OK;
}
