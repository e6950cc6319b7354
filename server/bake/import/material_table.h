/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_MATERIAL_TABLE_H
#define UMBRAGE_SERVER_BAKE_IMPORT_MATERIAL_TABLE_H
/* Materials of a scene found by their full name, as OBJ and MTL refer to them. */
#include "scene/scene_builder.h"

#define UMBB_MATERIALS_MAX 65536U

struct umbb_material_table {
    struct umbs_scene_builder *scene; /* borrowed; receives the materials */
    struct umbs_array names;          /* struct name, one a material, in the scene's order */
    uint32_t *slots;                  /* open addressing: index + 1, 0 = free */
};

void umbb_material_table_init(struct umbb_material_table *table, struct umbs_scene_builder *scene);
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

#endif
