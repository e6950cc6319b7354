/* SPDX-License-Identifier: Apache-2.0 */
/*
 * PLY in doubles: text, and binary of either byte order; all scalar types; polygons of any number
 * of corners; other elements and properties are skipped.
 *
 * Elements are read in the order of the file; faces that stand before the vertices are skipped
 * first and read afterwards. Counts are compared with the rest of the bytes before any allocation
 * for them, and each item takes at least one byte, so no loop outlives the file.
 * Source: G. Turk, The PLY Polygon File Format, 1994.
 */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "bake/import/face_builder.h"
#include "bake/import/import_job.h"
#include "base/try.h"

#define ELEMENTS_MAX   16
#define PROPERTIES_MAX 128
#define WORDS_MAX      8 /* the longest statement of a header has 5 words */
#define COUNT(array)   (sizeof(array) / sizeof((array)[0]))

enum encoding {
    ASCII = 0,
    LITTLE_ENDIAN_BINARY,
    BIG_ENDIAN_BINARY,
};

/* Type of a property. */
struct type {
    const char *old_name, *name;
    struct umbb_scalar scalar;
};

static const struct type types[] = {
    {"char", "int8", {'i', 1}},     {"uchar", "uint8", {'u', 1}},    {"short", "int16", {'i', 2}},
    {"ushort", "uint16", {'u', 2}}, {"int", "int32", {'i', 4}},      {"uint", "uint32", {'u', 4}},
    {"float", "float32", {'f', 4}}, {"double", "float64", {'f', 8}},
};

/* Meaning of a property. */
enum role {
    OTHER = 0,
    X, /* coordinates of a vertex, then its texture coordinates */
    Y,
    Z,
    U,
    V,
    NX, /* components of its normal */
    NY,
    NZ,
    CORNERS, /* list of a face: numbers of its vertices */
};

static const struct {
    const char *element, *name;
    enum role role;
} meanings[] = {
    {"vertex", "x", X},
    {"vertex", "y", Y},
    {"vertex", "z", Z},
    {"vertex", "u", U},
    {"vertex", "v", V},
    {"vertex", "s", U},
    {"vertex", "t", V},
    {"vertex", "texture_u", U},
    {"vertex", "texture_v", V},
    {"vertex", "nx", NX},
    {"vertex", "ny", NY},
    {"vertex", "nz", NZ},
    {"face", "vertex_indices", CORNERS},
    {"face", "vertex_index", CORNERS},
};

struct property {
    const struct type *type, *count_type; /* count_type: of a list's count; NULL: no list */
    enum role role;
};

struct element {
    char name[16]; /* cut after 15 bytes */
    uint64_t count;
    uint32_t property_count;
    struct property properties[PROPERTIES_MAX];
};

struct ply {
    struct umbb_import *job;
    enum encoding encoding;
    uint32_t element_count;
    struct element elements[ELEMENTS_MAX];
    const struct element *vertex, *face; /* the first element of that name */
    struct umbb_cursor data;             /* rest of the file behind the header */
    struct umbb_faces faces;
    int has_uvs;
};

/* Words of a line of the header. */
struct words {
    uint32_t count;
    struct umbb_cursor text[WORDS_MAX];
};

static void split(struct umbb_cursor line, struct words *words)
{
    *words = (struct words){0};
    while (words->count < WORDS_MAX && umbb_take_token(&line, &words->text[words->count])) {
        words->count++;
    }
}

static int is_word(const struct words *words, uint32_t index, const char *word)
{
    return index < words->count && umbb_is_word(words->text[index], word);
}

/* The type that a word names, or NULL. */
static const struct type *find_type(const struct words *words, uint32_t index)
{
    for (size_t i = 0; i < COUNT(types); i++) {
        if (is_word(words, index, types[i].old_name) || is_word(words, index, types[i].name)) {
            return &types[i];
        }
    }
    return NULL;
}

static int has_role(const struct element *element, enum role role)
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        if (element->properties[i].role == role) {
            return 1;
        }
    }
    return 0;
}

/* Returns the role of a property. If an element has several properties with one role, the first
 * gets it and the others are OTHER. */
static enum role find_role(const struct element *element, const struct words *words, uint32_t index,
                           int is_list)
{
    for (size_t i = 0; i < COUNT(meanings); i++) {
        if (strcmp(element->name, meanings[i].element) == 0 &&
            is_word(words, index, meanings[i].name) && is_list == (meanings[i].role == CORNERS)) {
            return has_role(element, meanings[i].role) ? OTHER : meanings[i].role;
        }
    }
    return OTHER;
}

static const char *add_property(struct ply *ply, const struct words *words)
{
    if (ply->element_count == 0) {
        return "property before any element";
    }
    struct element *element = &ply->elements[ply->element_count - 1];
    if (element->property_count >= PROPERTIES_MAX) {
        return "more than 128 properties in an element";
    }
    const int is_list = is_word(words, 1, "list");
    const uint32_t name = is_list ? 4 : 2;
    if (words->count <= name) {
        return "property without a name";
    }
    struct property property = {.type = find_type(words, name - 1),
                                .count_type = is_list ? find_type(words, 2) : NULL,
                                .role = find_role(element, words, name, is_list)};
    if (property.type == NULL || (is_list && property.count_type == NULL)) {
        return "property of an unknown type";
    }
    if (is_list && property.count_type->scalar.kind == 'f') {
        return "list whose count is no integer";
    }
    element->properties[element->property_count++] = property;
    return NULL;
}

static const char *add_element(struct ply *ply, const struct words *words)
{
    if (ply->element_count >= ELEMENTS_MAX) {
        return "more than 16 elements";
    }
    struct element *element = &ply->elements[ply->element_count];
    struct umbb_cursor number = words->text[2];
    int64_t count;
    if (words->count < 3 || !umbb_take_integer(&number, &count) || number.at != number.end ||
        count < 0) {
        return "element without a name and a count";
    }
    size_t length = umbb_length(words->text[1]);
    length = length < sizeof(element->name) ? length : sizeof(element->name) - 1;
    memcpy(element->name, words->text[1].at, length);
    element->count = (uint64_t)count;
    ply->element_count++;
    return NULL;
}

static const char *read_format(struct ply *ply, const struct words *words)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    for (size_t i = 0; i < COUNT(names) && is_word(words, 2, "1.0"); i++) {
        if (is_word(words, 1, names[i])) {
            ply->encoding = (enum encoding)i;
            return NULL;
        }
    }
    return "unknown format";
}

/* Reads the header, line by line. In: ply: data: the file. */
static enum umb_status read_header(struct ply *ply, struct umb_error *error)
{
    struct umbb_cursor line;
    struct words words;
    int has_format = 0;
    for (unsigned number = 1; umbb_take_line(&ply->data, &line); number++) {
        const char *fault = NULL;
        split(line, &words);
        if (number == 1) {
            fault = is_word(&words, 0, "ply") ? NULL : "'ply' is missing";
        } else if (is_word(&words, 0, "end_header")) {
            return has_format ? UMB_OK : UMBB_REFUSE(error, "header has no format line");
        } else if (is_word(&words, 0, "format")) {
            fault = read_format(ply, &words);
            has_format = 1;
        } else if (is_word(&words, 0, "element")) {
            fault = add_element(ply, &words);
        } else if (is_word(&words, 0, "property")) {
            fault = add_property(ply, &words);
        } else if (words.count > 0 && !is_word(&words, 0, "comment") &&
                   !is_word(&words, 0, "obj_info")) {
            fault = "unknown keyword";
        }
        if (fault != NULL) {
            return UMBB_REFUSE(error, "header line %u: %s", number, fault);
        }
    }
    return UMBB_REFUSE(error, "header has no end_header");
}

/* The first element called name, or NULL. */
static const struct element *find_element(const struct ply *ply, const char *name)
{
    for (uint32_t i = 0; i < ply->element_count; i++) {
        if (strcmp(ply->elements[i].name, name) == 0) {
            return &ply->elements[i];
        }
    }
    return NULL;
}

/* Takes one value; integers of 32 bits are exact in a double. Returns 0 at the end of the data. */
static int take_value(struct ply *ply, const struct type *type, double *value)
{
    if (ply->encoding == ASCII) {
        return umbb_take_double(&ply->data, value);
    }
    if (umbb_length(ply->data) < type->scalar.bytes) {
        return 0;
    }
    *value = umbb_load_number(ply->data.at, type->scalar, ply->encoding == BIG_ENDIAN_BINARY);
    ply->data.at += type->scalar.bytes;
    return 1;
}

/* Takes the count of a list. Returns 0 if it is missing or invalid. */
static int take_count(struct ply *ply, const struct property *property, uint64_t *count)
{
    double value;
    if (!take_value(ply, property->count_type, &value) || !(value >= 0.0) ||
        value > (double)UINT32_MAX || floor(value) < value) {
        return 0;
    }
    *count = (uint64_t)value;
    return 1;
}

/* Skips a list of one item. */
static int skip_list(struct ply *ply, const struct property *property)
{
    uint64_t count;
    double ignored;
    if (!take_count(ply, property, &count)) {
        return 0;
    }
    if (ply->encoding != ASCII) {
        uint64_t bytes = count * property->type->scalar.bytes; /* below 2^35 */
        if (bytes > umbb_length(ply->data)) {
            return 0;
        }
        ply->data.at += bytes;
        return 1;
    }
    for (uint64_t i = 0; i < count; i++) {
        if (!take_value(ply, property->type, &ignored)) {
            return 0;
        }
    }
    return 1;
}

static enum umb_status add_vertex(struct ply *ply, const double values[CORNERS],
                                  struct umb_error *error)
{
    float uv[2] = {(float)values[U], (float)values[V]};
    if (!isfinite(uv[0]) || !isfinite(uv[1])) {
        uv[0] = uv[1] = 0.0F;
    }
    UMB__TRY(umbs_scene_add_vertex(&ply->job->scene, &values[X], ply->has_uvs ? uv : NULL, error));
    return ply->job->look ? umbs_scene_set_normal(&ply->job->scene, &values[NX], error) : UMB_OK;
}

/* Reads the corners of a face. Out: good: 0 if the list cannot be read. */
static enum umb_status add_face(struct ply *ply, const struct property *property, int *good,
                                struct umb_error *error)
{
    uint64_t count;
    *good = take_count(ply, property, &count);
    for (uint64_t i = 0; *good && i < count; i++) {
        double value;
        *good = take_value(ply, property->type, &value);
        int is_index = *good && value >= 0.0 && value < (double)UINT32_MAX && floor(value) >= value;
        UMB__TRY(
            umbb_face_corner(&ply->faces, is_index ? (uint64_t)value : UMBB_BAD_CORNER, error));
    }
    return *good ? umbb_face_end(&ply->faces, error) : UMB_OK;
}

/* Reads the items of an element, or skips them. */
static enum umb_status read_element(struct ply *ply, const struct element *element, int is_used,
                                    struct umb_error *error)
{
    const int is_vertex = is_used && element == ply->vertex;
    for (uint64_t i = 0; element->property_count > 0 && i < element->count; i++) {
        double values[CORNERS + 1] = {0};
        for (uint32_t k = 0; k < element->property_count; k++) {
            const struct property *property = &element->properties[k];
            int good = 1;
            if (is_used && property->role == CORNERS) {
                UMB__TRY(add_face(ply, property, &good, error));
            } else {
                good = property->count_type != NULL
                           ? skip_list(ply, property)
                           : take_value(ply, property->type, &values[property->role]);
            }
            if (!good) {
                return UMBB_REFUSE(error,
                                   "element '%s', item %" PRIu64 " of %" PRIu64
                                   ": the file ends, or this is not a number",
                                   element->name, i + 1, element->count);
            }
        }
        UMB__TRY(is_vertex ? add_vertex(ply, values, error) : UMB_OK);
    }
    return UMB_OK;
}

/* Refuses counts that the rest of the bytes cannot hold: at least one byte a value, more in
 * binary. */
static enum umb_status check_counts(const struct ply *ply, struct umb_error *error)
{
    uint64_t left = umbb_length(ply->data);
    for (uint32_t i = 0; i < ply->element_count; i++) {
        const struct element *element = &ply->elements[i];
        uint64_t least = 0;
        for (uint32_t k = 0; k < element->property_count; k++) {
            const struct property *property = &element->properties[k];
            least += ply->encoding == ASCII         ? 1
                     : property->count_type != NULL ? property->count_type->scalar.bytes
                                                    : property->type->scalar.bytes;
        }
        if (least > 0 && element->count > left / least) {
            return UMBB_REFUSE(
                error, "element '%s' has count %" PRIu64 ", but only %" PRIu64 " bytes are left",
                element->name, element->count, left);
        }
        left -= least * element->count;
    }
    return UMB_OK;
}

static enum umb_status check_header(struct ply *ply, struct umb_error *error)
{
    const struct element *vertex = ply->vertex = find_element(ply, "vertex");
    const struct element *face = ply->face = find_element(ply, "face");
    if (vertex == NULL || vertex->count == 0) {
        return UMBB_REFUSE(error, "no vertices and no faces");
    }
    if (face == NULL || face->count == 0) {
        return UMBB_REFUSE(error, "%" PRIu64 " vertices and no faces", vertex->count);
    }
    if (!has_role(vertex, X) || !has_role(vertex, Y) || !has_role(vertex, Z)) {
        return UMBB_REFUSE(error, "element 'vertex' has no x, y and z");
    }
    if (!has_role(face, CORNERS)) {
        return UMBB_REFUSE(error, "element 'face' has no list vertex_indices");
    }
    ply->has_uvs = has_role(vertex, U) && has_role(vertex, V);
    return check_counts(ply, error);
}

/* Reads the elements in order; faces that come first are skipped until the vertices are known. */
static enum umb_status read_elements(struct ply *ply, struct umb_error *error)
{
    const struct element *vertex = ply->vertex, *face = ply->face;
    struct umbb_cursor faces = {NULL, NULL};
    for (const struct element *at = ply->elements; at != vertex; at++) {
        faces = at == face ? ply->data : faces;
        UMB__TRY(read_element(ply, at, 0, error));
    }
    UMB__TRY(read_element(ply, vertex, 1, error));
    if (faces.at != NULL) {
        ply->data = faces;
    }
    for (const struct element *at = vertex + 1; faces.at == NULL && at != face; at++) {
        UMB__TRY(read_element(ply, at, 0, error));
    }
    return read_element(ply, face, 1, error); /* the rest of the file is not needed */
}

enum umb_status umbb_ply_read(struct umbb_import *job, struct umb_error *error)
{
    struct ply ply = {
        .job = job, .faces = {.scene = &job->scene}, .data = umbb_text_of(&job->file)};
    UMB__TRY(read_header(&ply, error));
    enum umb_status status = check_header(&ply, error);
    if (status == UMB_OK) {
        status = read_elements(&ply, error);
    }
    if (status == UMB_OK) {
        status = umbb_faces_end_scene(&ply.faces, error);
    }
    umbb_faces_finish(&ply.faces);
    return status;
}
