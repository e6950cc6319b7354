/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_H
/*
 * One glTF or GLB file: its JSON, parsed once by Jansson, and the bytes that the JSON names.
 *
 *     umbb_gltf_open(&gltf, job, &error);
 *     umbb_gltf_accessor(&gltf, number, &use, &accessor, &error);
 *     umbb_gltf_get(&accessor, i, numbers)             i below accessor.count
 *     umbb_gltf_close(&gltf);                          also closes accessors
 *
 * gltf_reader.c walks the nodes, gltf_meshes.c reads meshes and materials. Any member of the JSON
 * may be missing or of a wrong type. Jansson's getters return NULL or 0 for such a member, so
 * callers need no checks of types. Source: Khronos glTF 2.0 specification, sections 3.6 and 4.4.
 * Trust: all functions are safe on hostile files.
 */
#include <jansson.h>

#include "bake/import/face_builder.h"
#include "bake/import/texture_table.h"

struct umbb_gltf_buffer {
    const char *bytes; /* NULL: not opened yet */
    size_t size;
    struct umbb_file file;
    char *decoded; /* content of a data URI */
};

/* Mapping of a mesh's texture coordinates to those of the image. */
struct umbb_gltf_mapping {
    int64_t set;         /* n of TEXCOORD_n */
    int moves;           /* 0: the matrix is the identity */
    double matrix[2][3]; /* KHR_texture_transform; v counts down, as in the file */
};

struct umbb_gltf_material {
    int is_read;
    uint32_t number; /* material of the builder */
    struct umbb_gltf_mapping mapping;
};

struct umbb_gltf_mesh {
    int is_read;
    uint32_t first, count; /* meshes of the builder: primitives with triangles */
};

/* The file, and the state of reading its scene. The walk over the nodes reads meshes and materials
 * where a node first shows them; what no node shows is not read. Each array has one item for each
 * object of its kind in the file. */
struct umbb_gltf {
    struct umbb_import *job; /* borrowed */
    json_t *json;
    struct umbb_cursor chunk; /* binary chunk of a GLB, or empty */
    struct umbb_gltf_buffer *buffers;
    uint8_t *accessors; /* 1: the sparse indices ascend */
    struct umbb_gltf_material *materials;
    struct umbb_gltf_mesh *meshes;
    uint8_t *nodes; /* 1: visited */
    struct umbb_faces faces;
    struct umbb_texture_table textures;
    unsigned bare;    /* number of primitives without coordinates for their texture */
    unsigned skinned; /* number of nodes with a skin */
    unsigned morphed; /* number of primitives with morph targets */
};

/* Values for a reference that is missing, and for one that is not a whole number of 0 or more.
 * Neither is an index of any list. */
#define UMBB_GLTF_NONE INT64_C(-1)
#define UMBB_GLTF_BAD  (INT64_C(1) << 40)

/*
 * Parses the file's JSON.
 *
 * Out:   gltf: close it, also after a failure.
 * Fails: E_BAD_SCENE (not JSON, nested too deeply, a name twice in one object, another version than
 *        2.x, a required extension that is not supported), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_open(struct umbb_gltf *gltf, struct umbb_import *job,
                                           struct umb_error *error);
void umbb_gltf_close(struct umbb_gltf *gltf);

/* Returns a value, or the member `key` of an object, as an index. Value NULL: UMBB_GLTF_NONE. */
int64_t umbb_gltf_to_index(const json_t *value);
int64_t umbb_gltf_index(const json_t *object, const char *key);

/* The object's byteOffset, 0 if it has none. */
int64_t umbb_gltf_offset(const json_t *object);

/* The text at `key`, or NULL. */
const char *umbb_gltf_text(const json_t *object, const char *key);

/* The number at `key`, or `otherwise` if there is none. */
double umbb_gltf_number(const json_t *object, const char *key, double otherwise);

/* Reads the array at `key` if it has `count` numbers. Returns 0 and changes nothing otherwise. */
int umbb_gltf_numbers(const json_t *object, const char *key, size_t count, double *numbers);

/* The object's `uri`; at is NULL if there is none. */
struct umbb_cursor umbb_gltf_uri(const json_t *object);

/* The object of an extension by its name, or NULL. */
const json_t *umbb_gltf_extension(const json_t *object, const char *name);

/* Finds an object by its number in a list of the file ("nodes"). Fails: E_BAD_SCENE, naming the
 * list, and the number if it is one. */
UMB_CHECKED enum umb_status umbb_gltf_item(const struct umbb_gltf *gltf, const char *list,
                                           int64_t number, const json_t **item,
                                           struct umb_error *error);

/*
 * Decodes a data URI (RFC 2397) of base64, up to the first character that is not base64.
 *
 * Out:   bytes: free it; NULL if the text is no such URI.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_data_uri(struct umbb_cursor uri, char **bytes, size_t *size,
                                               struct umb_error *error);

struct umbb_gltf_view {
    const char *bytes; /* borrowed */
    size_t size;
    int64_t stride; /* bytes from one element to the next; UMBB_GLTF_NONE: its size */
};

/* Finds the bytes of a buffer view, and opens its buffer. Fails: E_BAD_SCENE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_gltf_view(struct umbb_gltf *gltf, int64_t number,
                                           struct umbb_gltf_view *view, struct umb_error *error);

/* Kinds of components, as bits. */
enum {
    UMBB_GLTF_FLOAT = 1,
    UMBB_GLTF_SIGNED = 2,   /* 8 and 16 bits */
    UMBB_GLTF_UNSIGNED = 4, /* 8 and 16 bits */
    UMBB_GLTF_UINT32 = 8,
};

/* Kinds of accessors that an attribute allows. */
struct umbb_gltf_use {
    const char *name; /* name of the attribute */
    const char *must; /* words for messages: "VEC3 of floats" */
    uint32_t width;   /* numbers an element, 1..4 */
    unsigned kinds;   /* bits of components */
};

/* Run of elements in place. */
struct umbb_gltf_run {
    const char *bytes; /* NULL: all elements are 0 */
    size_t stride;
    struct umbb_scalar component;
};

struct umbb_gltf_accessor {
    struct umbb_gltf_run elements;
    uint32_t count, width;
    int is_normalized;
    uint32_t sparse_count;             /* number of replaced elements */
    struct umbb_gltf_run sparse_index; /* numbers of the replaced elements, ascending */
    struct umbb_gltf_run sparse_value; /* replacements, in the same order */
};

/*
 * Opens an accessor, and the file of its buffer if need be.
 *
 * Fails: E_BAD_SCENE naming the accessor (missing, of a type that its use does not allow, outside
 *        of its view's or buffer's bytes, without bufferView and sparse), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_accessor(struct umbb_gltf *gltf, int64_t number,
                                               const struct umbb_gltf_use *use,
                                               struct umbb_gltf_accessor *accessor,
                                               struct umb_error *error);

/* Reads an element: floats and integers unchanged, normalised integers as fractions.
 * Out: numbers: double[accessor->width]. */
void umbb_gltf_get(const struct umbb_gltf_accessor *accessor, uint32_t index, double *numbers);

/*
 * Finds a mesh, and reads it at its first use: a mesh of the builder for each primitive with
 * triangles. Points and lines cast no shadow.
 *
 * Fails: E_BAD_SCENE (no such mesh, accessors that cannot be read), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_gltf_get_mesh(struct umbb_gltf *gltf, int64_t number,
                                               const struct umbb_gltf_mesh **mesh,
                                               struct umb_error *error);

/*
 * Reads the extent of a light. KHR_lights_punctual knows lights without an extent only, so files
 * give it in the `extras` of the light's node, or else of the light itself:
 *
 *     umbrage_angle: radians        a directional light's angular diameter
 *     umbrage_diameter: metres      a spot or point light's diameter
 *     umbrage_shape: "rectangle"    with umbrage_width and umbrage_height, metres: a spot or point
 *                                   light becomes an area light that shines along the node's -z;
 *                                   the width lies along its x, the height along its y
 *     umbrage_shape: "disc"         with umbrage_diameter, metres: the same, round
 *
 * The node's scale does not change the light.
 *
 * In:    node, punctual: the light's node, and the light of KHR_lights_punctual. world: transform
 *        of the node. light: with name, kind and direction.
 * Out:   extent: zeroed if the file gives none. light->kind: changed by umbrage_shape.
 * Fails: E_BAD_SCENE, naming the light, the key, the value and its limits.
 */
UMB_CHECKED enum umb_status umbb_gltf_extent(const json_t *node, const json_t *punctual,
                                             const double (*world)[4], struct umbs_light *light,
                                             struct umbs_light_extent *extent,
                                             struct umb_error *error);

#endif
