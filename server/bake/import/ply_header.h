/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_PLY_HEADER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_PLY_HEADER_H
/*
 * The header of a PLY file: its elements, and their properties.
 * Source: G. Turk, The PLY Polygon File Format, 1994.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBB_PLY_ELEMENTS_MAX   16
#define UMBB_PLY_PROPERTIES_MAX 128

enum umbb_ply_encoding {
    UMBB_PLY_ASCII = 0,
    UMBB_PLY_LITTLE,
    UMBB_PLY_BIG,
};

enum umbb_ply_type {
    UMBB_PLY_INT8 = 0,
    UMBB_PLY_UINT8,
    UMBB_PLY_INT16,
    UMBB_PLY_UINT16,
    UMBB_PLY_INT32,
    UMBB_PLY_UINT32,
    UMBB_PLY_FLOAT32,
    UMBB_PLY_FLOAT64,
};

/* Meaning of a property. */
enum umbb_ply_role {
    UMBB_PLY_OTHER = 0,
    UMBB_PLY_X, /* coordinates of a vertex, then its texture coordinates */
    UMBB_PLY_Y,
    UMBB_PLY_Z,
    UMBB_PLY_U,
    UMBB_PLY_V,
    UMBB_PLY_CORNERS, /* list of a face: numbers of its vertices */
};

struct umbb_ply_property {
    enum umbb_ply_type type;
    enum umbb_ply_type count_type; /* type of a list's count */
    int is_list;
    enum umbb_ply_role role;
};

struct umbb_ply_element {
    char name[16]; /* cut after 15 bytes */
    uint64_t count;
    uint32_t property_count;
    struct umbb_ply_property properties[UMBB_PLY_PROPERTIES_MAX];
};

struct umbb_ply_header {
    enum umbb_ply_encoding encoding;
    uint32_t element_count;
    struct umbb_ply_element elements[UMBB_PLY_ELEMENTS_MAX];
    size_t bytes; /* size of the header; the data follows it */
};

/* Reads the header. Fails: E_BAD_SCENE, naming the line. Trust: safe on hostile bytes. */
UMB_CHECKED enum umb_status umbb_ply_header_read(const char *bytes, size_t size,
                                                 struct umbb_ply_header *header,
                                                 struct umb_error *error);

/* Bytes of a value in the binary encodings. */
size_t umbb_ply_type_bytes(enum umbb_ply_type type);

/* The element called name, or NULL. */
const struct umbb_ply_element *umbb_ply_find(const struct umbb_ply_header *header,
                                             const char *name);

#endif
