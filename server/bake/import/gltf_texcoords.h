/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
/*
 * Sets of texture coordinates that KHR_texture_transform selects, overriding the texture's own set.
 * Assimp 5.2.5 does not give that, nor the file's number of a material: it numbers materials in the
 * order in which meshes use them. So materials are matched by their names.
 */
#include "bake/import/import_job.h"

/* Coordinate sets of base colour textures by the names of materials. The caller frees
 * materials.data. */
struct umbb_gltf_sets {
    struct umbs_array materials; /* in order of their names, each once; empty if none has a set */
    int has_escapes; /* 1: a material whose name has escapes was left out; it may have a set */
};

#define UMBB_SET_UNSAID  UMBS_NO_INDEX        /* the texture's own set applies */
#define UMBB_SET_UNKNOWN (UMBS_NO_INDEX - 1U) /* materials of that name have different sets */

/*
 * Finds the sets of base colour textures that the extension selects.
 *
 * Out:   sets: zero it before.
 * Fails: E_NO_MEMORY.
 * Trust: safe on hostile bytes; broken JSON gives any members that are found in it.
 * Cost:  one pass over the JSON; the names are sorted.
 */
enum umb_status umbb_gltf_sets_find(const struct umbb_import *job, enum umbb_kind kind,
                                    struct umbb_gltf_sets *sets, struct umb_error *error);

/* The set of a material by its name, or one of the constants above. */
uint32_t umbb_gltf_set_of(const struct umbb_gltf_sets *sets, const char *name, size_t length);

#endif
