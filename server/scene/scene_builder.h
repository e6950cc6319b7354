/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_BUILDER_H
#define UMBRAGE_SERVER_SCENE_SCENE_BUILDER_H
/*
 * A growing scene that ends as a scene buffer: the importer's side of scene_buffer.h.
 *
 *     umbs_scene_builder_init(&builder, UMBS_FORMAT_PLY, 1, 0);
 *     umbs_scene_add_vertex(...) ...; umbs_scene_add_triangle(...) ...; umbs_scene_end_mesh(...);
 *     umbs_scene_add_instance(...);
 *     umbs_scene_builder_write(&builder, &sink, &error);
 *     umbs_scene_builder_finish(&builder);
 *
 * Ownership: the builder owns its arrays; everything passed in is copied. The arrays may be read
 * and changed in place, their counts only through the functions.
 * Failure: E_NO_MEMORY and E_LIMIT leave the builder as it was.
 * Threads: one thread.
 */
#include <string.h>
#include "base/try.h"
#include "format/content.h"
#include "scene/scene_buffer.h"

/* A growable array of items of one size. */
struct umbs_array {
    void *data;
    size_t count;
    size_t capacity;
};

struct umbs_scene_builder {
    enum umbs_format format;
    int z_up;
    uint32_t up_evidence;   /* enum umbs_up_evidence */
    uint64_t max_triangles; /* limit, instances multiplied */
    union {
        struct {                         /* in the order of enum umbs_section */
            struct umbs_array meshes;    /* struct umbs_mesh */
            struct umbs_array instances; /* struct umbs_instance */
            struct umbs_array materials; /* struct umbs_material */
            struct umbs_array lights;    /* struct umbs_light */
            struct umbs_array textures;  /* struct umbs_texture */
            struct umbs_array positions; /* double[3] */
            struct umbs_array uvs;       /* float[2]: none, or as many as positions */
            struct umbs_array triangles; /* uint32_t[3] */
            struct umbs_array alpha;     /* uint8_t */
            struct umbs_array normals;   /* float[3], at most as many as positions */
            struct umbs_array warnings;  /* char, without a NUL */
            struct umbs_array extents;   /* struct umbs_light_extent, as many as lights */
        };
        struct umbs_array sections[UMBS_SECTION_COUNT];
    };
    uint64_t world_triangles; /* number of triangles of all instances so far */
    uint32_t dropped_faces;   /* number of faces that could not be used */
};

/* Makes room for `more` items behind the last. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbs_array_reserve(struct umbs_array *array, size_t more,
                                               size_t item_bytes, struct umb_error *error);

/* Appends an item. Fails: E_NO_MEMORY. */
static inline enum umb_status umbs_array_add(struct umbs_array *array, const void *item,
                                             size_t item_bytes, struct umb_error *error)
{
    if (array->count == array->capacity) {
        UMB__TRY(umbs_array_reserve(array, 1, item_bytes, error));
    }
    memcpy((char *)array->data + array->count++ * item_bytes, item, item_bytes);
    return UMB_OK;
}

/* Starts an empty scene. max_triangles: 0 = the hard limit. Needs umbs_scene_builder_finish. */
void umbs_scene_builder_init(struct umbs_scene_builder *builder, enum umbs_format format, int z_up,
                             uint64_t max_triangles);
void umbs_scene_builder_finish(struct umbs_scene_builder *builder);

/*
 * Appends one vertex. uv: texture coordinates, float[2], or NULL. If any vertex has them, vertices
 * without them get 0 0.
 *
 * Fails: E_NO_MEMORY, E_LIMIT (2^32 - 1 vertices).
 */
UMB_CHECKED enum umb_status umbs_scene_add_vertex(struct umbs_scene_builder *builder,
                                                  const double position[3], const float *uv,
                                                  struct umb_error *error);

/* Gives the last vertex a normal of any length; one that is 0 or not finite counts as none. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbs_scene_set_normal(struct umbs_scene_builder *builder,
                                                  const double normal[3], struct umb_error *error);

/* Appends a triangle to the mesh that the next umbs_scene_end_mesh makes. Fails: E_NO_MEMORY,
 * E_LIMIT. */
UMB_CHECKED enum umb_status umbs_scene_add_triangle(struct umbs_scene_builder *builder,
                                                    const uint32_t corners[3],
                                                    struct umb_error *error);

/*
 * Makes a mesh of the `triangle_count` triangles behind the last mesh.
 *
 * In: first_vertex, vertex_count: range of vertices to which the corners of the mesh refer.
 */
UMB_CHECKED enum umb_status umbs_scene_end_mesh(struct umbs_scene_builder *builder,
                                                uint32_t first_vertex, uint32_t vertex_count,
                                                uint32_t triangle_count, uint32_t material,
                                                struct umb_error *error);

/* Places a mesh. transform: NULL = identity. Fails: E_LIMIT over max_triangles. */
UMB_CHECKED enum umb_status umbs_scene_add_instance(struct umbs_scene_builder *builder,
                                                    uint32_t mesh, const double (*transform)[4],
                                                    struct umb_error *error);

/* An opaque white material: cut-off 0.5, one sided, no texture, no name. */
struct umbs_material umbs_material_opaque(void);

UMB_CHECKED enum umb_status umbs_scene_add_material(struct umbs_scene_builder *builder,
                                                    const struct umbs_material *material,
                                                    struct umb_error *error);
/* extent: NULL = the file gives none. */
UMB_CHECKED enum umb_status umbs_scene_add_light(struct umbs_scene_builder *builder,
                                                 const struct umbs_light *light,
                                                 const struct umbs_light_extent *extent,
                                                 struct umb_error *error);

/* Appends an alpha texture and its pixels, uint8[height][width]; texture->offset is set here. */
UMB_CHECKED enum umb_status umbs_scene_add_texture(struct umbs_scene_builder *builder,
                                                   const struct umbs_texture *texture,
                                                   const uint8_t *pixels, struct umb_error *error);

/* Appends one line to the warnings, made clean. Lines beyond 64 KiB in total are left out. */
void umbs_scene_warn(struct umbs_scene_builder *builder, const char *format, ...) UMB_PRINTF(2, 3);

/*
 * Writes the scene buffer. Vertices that are not finite or too large become 0 0 0 (no triangle may
 * use one: the readers drop such faces).
 *
 * Fails: what the sink returns; E_LIMIT if a count is over its limit.
 * Cost:  no copy of the arrays.
 */
UMB_CHECKED enum umb_status umbs_scene_builder_write(struct umbs_scene_builder *builder,
                                                     const struct umb_sink *sink,
                                                     struct umb_error *error);

#endif
