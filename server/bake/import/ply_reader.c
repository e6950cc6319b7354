/* SPDX-License-Identifier: Apache-2.0 */
/*
 * PLY in doubles: text, and binary of either byte order; all scalar types; polygons of any number
 * of corners; other elements and properties are skipped.
 *
 * Elements are read in the order of the file; faces that stand before the vertices are skipped
 * first and read afterwards. Counts are compared with the rest of the bytes before any allocation
 * for them, and each item takes at least one byte, so no loop outlives the file.
 */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "bake/import/face_builder.h"
#include "bake/import/import_job.h"
#include "bake/import/ply_header.h"
#include "bake/import/text_number.h"
#include "base/try.h"

struct ply {
    struct umbb_import *job;
    struct umbb_ply_header header;
    struct umbb_cursor data;
    struct umbb_faces faces;
    int has_uvs;
};

/* Loads a binary value of `bytes` bytes as an integer. */
static uint64_t load_bits(const char *at, size_t bytes, int big)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < bytes; i++) {
        uint64_t byte = (unsigned char)at[i];
        size_t place = big ? bytes - 1 - i : i;
        bits |= byte << (8 * place);
    }
    return bits;
}

static double bits_to_value(uint64_t bits, enum umbb_ply_type type)
{
    float single;
    double value;
    uint32_t low = (uint32_t)bits;
    switch (type) {
    case UMBB_PLY_INT8:
        return (double)(int8_t)bits;
    case UMBB_PLY_INT16:
        return (double)(int16_t)bits;
    case UMBB_PLY_INT32:
        return (double)(int32_t)bits;
    case UMBB_PLY_FLOAT32:
        memcpy(&single, &low, sizeof(single));
        return (double)single;
    case UMBB_PLY_FLOAT64:
        memcpy(&value, &bits, sizeof(value));
        return value;
    case UMBB_PLY_UINT8:
    case UMBB_PLY_UINT16:
    case UMBB_PLY_UINT32:
        break;
    }
    return (double)bits;
}

/* Takes one value; integers of 32 bits are exact in a double. Returns 0 at the end of the data. */
static int take_value(struct ply *ply, enum umbb_ply_type type, double *value)
{
    if (ply->header.encoding == UMBB_PLY_ASCII) {
        return umbb_take_double(&ply->data, value);
    }
    size_t bytes = umbb_ply_type_bytes(type);
    if ((size_t)(ply->data.end - ply->data.at) < bytes) {
        return 0;
    }
    uint64_t bits = load_bits(ply->data.at, bytes, ply->header.encoding == UMBB_PLY_BIG);
    ply->data.at += bytes;
    *value = bits_to_value(bits, type);
    return 1;
}

/* Takes the count of a list. Returns 0 if it is missing or invalid. */
static int take_count(struct ply *ply, const struct umbb_ply_property *property, uint64_t *count)
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
static int skip_list(struct ply *ply, const struct umbb_ply_property *property)
{
    uint64_t count;
    double ignored;
    if (!take_count(ply, property, &count)) {
        return 0;
    }
    if (ply->header.encoding != UMBB_PLY_ASCII) {
        uint64_t bytes = count * umbb_ply_type_bytes(property->type); /* below 2^35 */
        if (bytes > (uint64_t)(ply->data.end - ply->data.at)) {
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

static enum umb_status add_vertex(struct ply *ply, const double values[UMBB_PLY_CORNERS],
                                  struct umb_error *error)
{
    float uv[2] = {(float)values[UMBB_PLY_U], (float)values[UMBB_PLY_V]};
    if (!isfinite(uv[0]) || !isfinite(uv[1])) {
        uv[0] = uv[1] = 0.0F;
    }
    return umbs_scene_add_vertex(&ply->job->scene, &values[UMBB_PLY_X], ply->has_uvs ? uv : NULL,
                                 error);
}

/* Reads the corners of a face. Out: good: 0 if the list cannot be read. */
static enum umb_status add_face(struct ply *ply, const struct umbb_ply_property *property,
                                int *good, struct umb_error *error)
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
static enum umb_status read_element(struct ply *ply, const struct umbb_ply_element *element,
                                    int is_used, struct umb_error *error)
{
    const int is_vertex = is_used && strcmp(element->name, "vertex") == 0;
    for (uint64_t i = 0; element->property_count > 0 && i < element->count; i++) {
        double values[UMBB_PLY_CORNERS + 1] = {0};
        for (uint32_t k = 0; k < element->property_count; k++) {
            const struct umbb_ply_property *property = &element->properties[k];
            int good = 1;
            if (is_used && property->role == UMBB_PLY_CORNERS) {
                UMB__TRY(add_face(ply, property, &good, error));
            } else {
                good = property->is_list ? skip_list(ply, property)
                                         : take_value(ply, property->type, &values[property->role]);
            }
            if (!good) {
                return umb_fail(error, UMB_E_BAD_SCENE,
                                "element '%s', item %" PRIu64 " of %" PRIu64
                                ": the file ends, or this is not a number",
                                element->name, i + 1, element->count);
            }
        }
        UMB__TRY(is_vertex ? add_vertex(ply, values, error) : UMB_OK);
    }
    return UMB_OK;
}

static int has_role(const struct umbb_ply_element *element, enum umbb_ply_role role)
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        if (element->properties[i].role == role) {
            return 1;
        }
    }
    return 0;
}

/* Refuses counts that the rest of the bytes cannot hold: at least one byte a value, more in
 * binary. */
static enum umb_status check_counts(const struct ply *ply, struct umb_error *error)
{
    uint64_t left = (uint64_t)(ply->data.end - ply->data.at);
    for (uint32_t i = 0; i < ply->header.element_count; i++) {
        const struct umbb_ply_element *element = &ply->header.elements[i];
        uint64_t least = 0;
        for (uint32_t k = 0; k < element->property_count; k++) {
            const struct umbb_ply_property *property = &element->properties[k];
            least += ply->header.encoding == UMBB_PLY_ASCII ? 1
                     : property->is_list ? umbb_ply_type_bytes(property->count_type)
                                         : umbb_ply_type_bytes(property->type);
        }
        if (least > 0 && element->count > left / least) {
            return umb_fail(error, UMB_E_BAD_SCENE,
                            "element '%s' has count %" PRIu64 ", but only %" PRIu64
                            " bytes are left",
                            element->name, element->count, left);
        }
        left -= least * element->count;
    }
    return UMB_OK;
}

static enum umb_status check_header(struct ply *ply, struct umb_error *error)
{
    const struct umbb_ply_element *vertex = umbb_ply_find(&ply->header, "vertex");
    const struct umbb_ply_element *face = umbb_ply_find(&ply->header, "face");
    if (vertex == NULL || vertex->count == 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "no vertices and no faces");
    }
    if (face == NULL || face->count == 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%" PRIu64 " vertices and no faces", vertex->count);
    }
    if (!has_role(vertex, UMBB_PLY_X) || !has_role(vertex, UMBB_PLY_Y) ||
        !has_role(vertex, UMBB_PLY_Z)) {
        return umb_fail(error, UMB_E_BAD_SCENE, "element 'vertex' has no x, y and z");
    }
    if (!has_role(face, UMBB_PLY_CORNERS)) {
        return umb_fail(error, UMB_E_BAD_SCENE, "element 'face' has no list vertex_indices");
    }
    ply->has_uvs = has_role(vertex, UMBB_PLY_U) && has_role(vertex, UMBB_PLY_V);
    return check_counts(ply, error);
}

/* Reads the elements in order; faces that come first are skipped until the vertices are known. */
static enum umb_status read_elements(struct ply *ply, struct umb_error *error)
{
    const struct umbb_ply_element *vertex = umbb_ply_find(&ply->header, "vertex");
    const struct umbb_ply_element *face = umbb_ply_find(&ply->header, "face");
    struct umbb_cursor faces = {NULL, NULL};
    for (const struct umbb_ply_element *at = ply->header.elements; at != vertex; at++) {
        faces = at == face ? ply->data : faces;
        UMB__TRY(read_element(ply, at, 0, error));
    }
    UMB__TRY(read_element(ply, vertex, 1, error));
    if (faces.at != NULL) {
        ply->data = faces;
    }
    for (const struct umbb_ply_element *at = vertex + 1; faces.at == NULL && at != face; at++) {
        UMB__TRY(read_element(ply, at, 0, error));
    }
    return read_element(ply, face, 1, error); /* the rest of the file is not needed */
}

enum umb_status umbb_ply_read(struct umbb_import *job, struct umb_error *error)
{
    struct ply ply = {.job = job};
    UMB__TRY(umbb_ply_header_read(job->file.bytes, job->file.size, &ply.header, error));
    ply.data.at = job->file.bytes + ply.header.bytes;
    ply.data.end = job->file.bytes + job->file.size;
    umbb_faces_init(&ply.faces, &job->scene);
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
