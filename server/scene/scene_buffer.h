/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_BUFFER_H
#define UMBRAGE_SERVER_SCENE_SCENE_BUFFER_H
/*
 * The bytes of a scene buffer, which the importer's process hands to the process that started it.
 *
 * Both processes run the same build on the same machine, so numbers are in native (little-endian)
 * order and structs are those of scene.h. The buffer is no file format. The reader trusts nothing
 * in it: the importer parsed hostile bytes, which may have taken it over.
 *
 *     header, then the sections in the order of enum umbs_section, each starting at the next
 *     multiple of 8 after the one before, nothing between but padding; the buffer ends with the
 *     last section padded to a multiple of 8.
 *
 * The counts decide the layout, and the validator computes it again. So sections cannot overlap,
 * and no offset is trusted. The triangles of mesh i + 1 follow those of mesh i without a
 * gap (vertex ranges may overlap: all meshes of an OBJ share one), which keeps the check linear in
 * the size of the buffer.
 *
 * Clean names: NUL-terminated, UTF-8 without control characters, NULs to the end of the field.
 */
#include "scene/scene.h"

#define UMBS_SCENE_MAGIC "UMBSCN2\n"

/* Limits of every scene; options can only be stricter. Coordinates are in metres; matrix entries
 * have the same limit, so products stay finite in float. */
#define UMBS_COORDINATE_MAX      1e15
#define UMBS_WORLD_TRIANGLES_MAX 0xffffffffULL
#define UMBS_TEXTURE_SIDE_MAX    65536U

enum umbs_section {
    UMBS_SECTION_MESHES = 0,
    UMBS_SECTION_INSTANCES,
    UMBS_SECTION_MATERIALS,
    UMBS_SECTION_LIGHTS,
    UMBS_SECTION_TEXTURES,
    UMBS_SECTION_POSITIONS,
    UMBS_SECTION_UVS, /* vertex_count or none */
    UMBS_SECTION_TRIANGLES,
    UMBS_SECTION_ALPHA,
    UMBS_SECTION_NORMALS,  /* vertex_count or none */
    UMBS_SECTION_WARNINGS, /* with its NUL */
    UMBS_SECTION_EXTENTS,  /* light_count or none */
    UMBS_SECTION_COUNT
};

struct umbs_scene_header {
    char magic[8];
    uint64_t total_bytes;
    uint32_t format; /* enum umbs_format */
    uint32_t z_up;   /* 0 or 1 */
    uint32_t dropped_faces;
    uint32_t up_evidence; /* enum umbs_up_evidence */
    uint64_t world_triangle_count;
    uint64_t counts[UMBS_SECTION_COUNT];  /* items */
    uint64_t offsets[UMBS_SECTION_COUNT]; /* bytes from the start of the buffer */
};

/*
 * Computes the layout from the counts in the header.
 *
 * Out:   offsets: uint64[UMBS_SECTION_COUNT]. total: bytes of the whole buffer.
 * Fails: returns NULL on success, else the name of the section whose count is over its limit.
 * Trust: safe on hostile counts.
 */
const char *umbs_scene_layout(const uint64_t counts[UMBS_SECTION_COUNT],
                              uint64_t offsets[UMBS_SECTION_COUNT], uint64_t *total);

/* Bytes of one item of a section. */
size_t umbs_section_item_bytes(enum umbs_section section);

#endif
