/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_GLTF_GUARD_H
#define UMBRAGE_SERVER_BAKE_IMPORT_GLTF_GUARD_H
/*
 * Refuses glTF that Assimp 5.2.5 would silently read wrongly. These are required extensions that it
 * does not know (quantised or compressed meshes become garbage), positions that are not vectors of
 * three floats from a buffer, and versions other than 2.x, which another importer of Assimp would
 * read.
 */
#include "bake/import/import_job.h"

/*
 * Checks the JSON of a glTF or GLB file.
 *
 * Fails: E_BAD_SCENE naming the extension or the accessor; E_NO_MEMORY.
 * Trust: safe on hostile bytes. Broken JSON may pass: Assimp reports it. Names written with escapes
 *        are not recognised; the worst result is a scene of wrong shape.
 * Cost:  one pass over the JSON, 12 bytes an accessor.
 */
UMB_CHECKED enum umb_status umbb_gltf_guard(struct umbb_import *job, enum umbb_kind kind,
                                            struct umb_error *error);

#endif
