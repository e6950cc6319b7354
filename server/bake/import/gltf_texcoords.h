/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_TEXCOORDS_H
/*
 * KHR_texture_transform may say which set of coordinates a texture takes, in the place of what the
 * texture says itself; Assimp 5.2.5 does not hand that over.
 */
#include "bake/import/import_job.h"

/*
 * Finds the sets that base colour textures are given so.
 *
 * Out:   sets: uint32_t[count], for each material of the file's order, or UMBS_NO_INDEX.
 * Trust: safe on hostile bytes; broken JSON gives whatever is found in it.
 * Cost:  one pass over the JSON.
 */
void umbb_gltf_texcoords(const struct umbb_import *job, enum umbb_kind kind, uint32_t *sets,
                         size_t count);

#endif
