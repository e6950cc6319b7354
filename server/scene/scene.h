/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_H
#define UMBRAGE_SERVER_SCENE_SCENE_H
/*
 * The scene as the importer delivers it: flat arrays of doubles, materials, lights and instances,
 * in one contiguous validated buffer.
 *
 * Life: umbs_scene_import starts the importer in its own process, which parses the file and writes
 * a scene buffer into a sealed memfd. The calling process maps the memfd and checks every count,
 * index and number before any use (umbs_scene_view). Nothing that parses foreign bytes runs in the
 * caller.
 *
 *     struct umbs_scene *scene;
 *     umbs_scene_import(path, &options, &scene, &error);
 *     ... scene->view ...
 *     umbs_scene_destroy(scene);
 *
 * Spaces: mesh space -> world by the instance's transform. World is right handed, metres.
 * Threads: an imported scene is immutable.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/asset.h"

enum umbs_format {
    UMBS_FORMAT_GLTF = 0, /* .gltf and .glb, y up */
    UMBS_FORMAT_OBJ = 1,  /* these three leave the up axis open */
    UMBS_FORMAT_PLY = 2,
    UMBS_FORMAT_STL = 3,
};

/* Evidence by which a scene's up axis was found. */
enum umbs_up_evidence {
    UMBS_UP_NONE = 0, /* nothing: z is taken */
    UMBS_UP_FORMAT,   /* the format: glTF */
    UMBS_UP_COMMENT,  /* a comment that names the axis */
    UMBS_UP_PROGRAM,  /* a comment that names a program or data of one axis */
    UMBS_UP_MAP,      /* coordinates of a map */
    UMBS_UP_GROUND,   /* a surface that shows one side along the axis */
    UMBS_UP_FLATS,    /* the largest flat faces */
    UMBS_UP_EXTENT,   /* a small extent along the axis */
    UMBS_UP_BASE,     /* a base on zero */
    UMBS_UP_OPENING,  /* a body with an open underside */
    UMBS_UP_EVIDENCE_COUNT
};

enum umbs_alpha_mode {
    UMBS_ALPHA_OPAQUE = 0,
    UMBS_ALPHA_MASK = 1,
    UMBS_ALPHA_BLEND = 2,
};

#define UMBS_NO_INDEX 0xffffffffU

struct umbs_material {
    char name[UMB_NAME_SIZE];
    uint32_t alpha_mode;   /* enum umbs_alpha_mode */
    uint32_t double_sided; /* 0 or 1 */
    float alpha_cutoff;    /* 0..1, for MASK */
    float base_alpha;      /* 0..1, factor on the texture's alpha */
    uint32_t texture;      /* index of the alpha texture or UMBS_NO_INDEX */
    float transmission;    /* 0..1, share of the light that passes through the surface */
    /* For pictures only, never hashed: linear red, green and blue, 0..1; and 1 if an image, which
     * is not read, gives the colour. */
    float base_color[3];
    uint32_t has_image;
};

struct umbs_mesh {
    uint32_t first_vertex, vertex_count;
    uint32_t first_triangle, triangle_count;
    uint32_t material; /* index or UMBS_NO_INDEX */
    uint32_t reserved;
};

struct umbs_instance {
    double mesh_to_world[3][4]; /* row major affine; finite */
    uint32_t mesh;
    uint32_t reserved;
};

struct umbs_light {
    char name[UMB_NAME_SIZE];
    uint32_t kind; /* enum umb_light_kind */
    uint32_t reserved;
    double direction[3];           /* unit vector along the light's travel, world */
    double position[3];            /* metres, world */
    double inner_cone, outer_cone; /* radians, spot */
    double range;                  /* metres, 0 = unlimited */
    double intensity;              /* lux (directional) or candela */
    double color[3];
};

/* Extent of a light, beside its struct umbs_light. */
struct umbs_light_extent {
    uint32_t is_given; /* 1: the file gives the light's extent; 0: the rest is 0 */
    uint32_t reserved;
    double extent;  /* Extent as in struct umb_light_info: radians (directional) or metres */
    double side[3]; /* Side as in struct umb_light_info */
};

enum umbs_wrap {
    UMBS_WRAP_REPEAT = 0,
    UMBS_WRAP_CLAMP = 1,
    UMBS_WRAP_MIRROR = 2,
};

/* Decoded alpha channel: uint8[height][width] from byte `offset` of the alpha pool on. The row at v
 * = 0 comes first; image files have it last. */
struct umbs_texture {
    char name[UMB_NAME_SIZE];
    uint32_t width, height;
    uint64_t offset;
    uint32_t wrap_s, wrap_t; /* enum umbs_wrap, along u and v */
    uint32_t nearest;        /* 1: the nearest texel counts; 0: bilinear */
    uint32_t reserved;
};

/* A view of a validated buffer: its arrays are borrowed. */
struct umbs_scene_view {
    enum umbs_format format;
    int z_up; /* 1 if +z is up in world space, else +y */
    enum umbs_up_evidence up_evidence;
    uint32_t mesh_count, instance_count, material_count, light_count, texture_count;
    uint32_t vertex_count, triangle_count; /* stored numbers: instances not multiplied */
    const struct umbs_mesh *meshes;
    const struct umbs_instance *instances;
    const struct umbs_material *materials;
    const struct umbs_light *lights;
    const struct umbs_light_extent *extents; /* [light_count]; NULL: the file gives none */
    const struct umbs_texture *textures;
    const double (*positions)[3];   /* [vertex_count], mesh space */
    const float (*uvs)[2];          /* [vertex_count] or NULL; u right, v up over the image */
    const float (*normals)[3];      /* [vertex_count] unit, 0 0 0 = none; NULL unless `look` */
    const uint32_t (*triangles)[3]; /* [triangle_count], vertex numbers within the mesh */
    const uint8_t *alpha;           /* alpha pool */
    uint64_t alpha_bytes;
    uint64_t world_triangle_count; /* instances multiplied */
    /* Number of faces that the importer could not use: not finite, bad index, < 3 corners. */
    uint32_t dropped_faces;
    const char *warnings; /* lines, may be empty */
};

struct umbs_scene {
    struct umbs_scene_view view;
    void *map;
    size_t map_bytes;
};

/* Handles of the running importer. */
struct umbs_importer {
    int process; /* number of the importer's process and of its process group */
    int files;   /* caller's end of the socket of scene_broker.h */
};

#define UMBS_TRIANGLES_MAX 200000000ULL /* limit of a scene, instances multiplied */

struct umbs_import_options {
    uint64_t max_input_bytes;  /* limit of each file; 0 = 4 GiB */
    uint64_t max_memory_bytes; /* limit of the importer's address space; 0 = 8 GiB */
    uint64_t max_triangles;    /* limit, instances multiplied; 0 = 200 million */
    uint32_t max_files;        /* limit of look-ups of files that the scene names; 0 = 65536 */
    uint32_t timeout_s;        /* limit of CPU seconds and of wall seconds; 0 = 600 */
    int look; /* 1: reads what only pictures need, too: normals. The scene's hash is the same */
    const char *importer_path; /* program; NULL = umbrage-bake beside the running program */
    /* Hook, may be NULL: called once when every file is open and the importer runs, before a byte
     * of the scene or of the importer's answers is read. Here the caller drops its own rights.
     * importer: NULL where none runs (umbs_scene_load). If the hook fails, the import fails with
     * its status. */
    enum umb_status (*shut_in)(void *user, const struct umbs_importer *importer,
                               struct umb_error *error);
    void *user; /* first argument of shut_in */
};

/*
 * Imports a scene file in a separate, limited process.
 *
 * Out:   out: the scene, or NULL.
 * Owns:  the caller destroys it.
 * Fails: E_NO_INPUT (missing, a folder), E_BAD_SCENE (unknown format, unreadable, no triangles, not
 *        finite; also when the importer crashed), E_LIMIT (over memory, time, size or files),
 *        E_UNAVAILABLE (importer program missing).
 */
UMB_CHECKED enum umb_status umbs_scene_import(const char *path,
                                              const struct umbs_import_options *options,
                                              struct umbs_scene **out, struct umb_error *error);

/* Checks a scene buffer, of which nothing is trusted, and fills view. Fails: E_BAD_SCENE, naming
 * the field. */
UMB_CHECKED enum umb_status umbs_scene_view(const void *bytes, size_t size,
                                            struct umbs_scene_view *view, struct umb_error *error);

/* Checks the scene buffer in scene->map, and the limit of triangles, and sets scene->view.
 * In: name: name of the scene in messages. Fails: as umbs_scene_view; E_LIMIT. */
UMB_CHECKED enum umb_status umbs__scene_check(struct umbs_scene *scene, const char *name,
                                              const struct umbs_import_options *options,
                                              struct umb_error *error);

void umbs_scene_destroy(struct umbs_scene *scene);

/* Returns words that say how the up axis was found; they complete the sentence "y is up: ". */
const char *umbs_scene_up_reason(const struct umbs_scene_view *view);

/* Returns the sentence that a user must read if nothing in the file tells the up axis, without an
 * end of line; NULL if something does. */
const char *umbs_scene_up_warning(const struct umbs_scene_view *view);

/*
 * Hashes the scene's content, not the file: up axis, world triangles in the order of
 * umbs_scene_flatten, the materials' effects on light, lights. Vertex numbering, the division into
 * meshes and names of materials do not count; the order of triangles and of their corners does.
 *
 * Cost: SHA-256 of 72 bytes a world triangle (about 0.3 us); no allocation.
 */
void umbs_scene_hash(const struct umbs_scene_view *view, uint8_t hash[UMB_ID_BYTES]);

/*
 * Multiplies the instances out: world triangles in a fixed order (instances, then triangles).
 *
 * Out:   corners: double[count][3][3], world space; material: uint32[count] (may be NULL to skip).
 * Cost:  80 bytes a triangle; free() both.
 */
UMB_CHECKED enum umb_status umbs_scene_flatten(const struct umbs_scene_view *view,
                                               double (**corners)[3][3], uint32_t **materials,
                                               size_t *count, struct umb_error *error);

/*
 * Writes the world triangles first .. first + count - 1 of an instance. umbs_scene_flatten and the
 * scene's hash share this function, so their triangles are equal bit for bit.
 *
 * In:  first + count: at most the triangles of the instance's mesh.
 * Out: corners: double[count][3][3]; two corners have changed places if the transform mirrors.
 */
void umbs_scene_flatten_part(const struct umbs_scene_view *view,
                             const struct umbs_instance *instance, uint32_t first, uint32_t count,
                             double (*corners)[3][3]);

/* Returns 1 if an instance's transform mirrors. Front faces of such an instance are wound the other
 * way (glTF 2.0, section 3.7.4), so two corners change places to keep outward solids outward. */
int umbs_instance_mirrors(const struct umbs_instance *instance);

#endif
