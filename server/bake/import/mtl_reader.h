/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_MTL_READER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_MTL_READER_H
/* Materials of OBJ by their names, and the statements of Wavefront MTL that affect shadows: d, Tr,
 * map_d. */
#include "bake/import/import_files.h"
#include "bake/import/text_number.h"
#include "bake/import/texture_table.h"
#include "scene/scene_builder.h"

#define UMBB_MATERIALS_MAX 65536U

/* Materials by their full names. Zero it, but for `scene`, before its first use. */
struct umbb_material_table {
    struct umbs_scene_builder *scene; /* borrowed; receives the materials */
    void *names;                      /* tree */
    uint32_t count;
};

void umbb_material_table_finish(struct umbb_material_table *table);

/*
 * Finds the material called `name`, or adds an opaque one.
 *
 * Out:   index: in scene->materials.
 * Owns:  name is copied.
 * Fails: E_LIMIT (UMBB_MATERIALS_MAX), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_material_get(struct umbb_material_table *table, const char *name,
                                              size_t length, uint32_t *index,
                                              struct umb_error *error);

/*
 * Reads a material library.
 *
 * d (or 1 - Tr if there is no d) below 1 makes a material BLEND with that alpha. map_d makes it
 * MASK at 0.5, by the alpha of its PNG or else by its grey. Of map_d's options -clamp is supported;
 * a map that is moved, scaled or perturbed (-o, -s, -t, -mm, -imfchan) is left out with a warning.
 * All other statements are skipped.
 * Fails: E_LIMIT, E_NO_MEMORY. Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umbb_mtl_read(const struct umbb_file *file,
                                          struct umbb_material_table *table,
                                          struct umbb_texture_table *textures,
                                          struct umb_error *error);

#endif
