/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
/*
 * KHR_texture_transform may say which set of coordinates a texture takes, in the place of what the
 * texture says itself; Assimp 5.2.5 does not hand that over. Nor does it say which of the file's
 * materials one of its own is: it numbers them as meshes meet them. Names tell.
 */
#include "bake/import/import_job.h"

/* The base colour textures' sets by the names of materials: the caller frees materials.data. */
struct umbb_gltf_sets {
    struct umbs_array materials; /* in order of their names, each once; empty if none has a set */
    int has_escapes;             /* a material left out may have a set: its name has escapes */
};

#define UMBB_SET_UNSAID  UMBS_NO_INDEX        /* the texture's own word holds */
#define UMBB_SET_UNKNOWN (UMBS_NO_INDEX - 1U) /* materials of that name have different ones */

/*
 * Finds the sets that base colour textures are given so.
 *
 * Out:   sets: to be zeroed before.
 * Fails: E_NO_MEMORY.
 * Trust: safe on hostile bytes; broken JSON gives whatever is found in it.
 * Cost:  one pass over the JSON; the names are sorted.
 */
enum umb_status umbb_gltf_sets_find(const struct umbb_import *job, enum umbb_kind kind,
                                    struct umbb_gltf_sets *sets, struct umb_error *error);

/* The set of a material of that name, or one of the above. */
uint32_t umbb_gltf_set_of(const struct umbb_gltf_sets *sets, const char *name, size_t length);

#endif
