/* SPDX-License-Identifier: Apache-2.0 */
/* Materials by name (material_table.h): FNV-1a (Fowler, Noll, Vo) with linear probing, never more
 * than half full, so a probe always ends. */
#include "bake/import/material_table.h"

#include <stdlib.h>
#include <string.h>

#include "common/clean_text.h"

#define SLOT_COUNT (2U * UMBB_MATERIALS_MAX)

struct name {
    char *text; /* owned, not NUL-terminated */
    size_t length;
};

void umbb_material_table_init(struct umbb_material_table *table, struct umbs_scene_builder *scene)
{
    memset(table, 0, sizeof(*table));
    table->scene = scene;
}

void umbb_material_table_finish(struct umbb_material_table *table)
{
    struct name *names = table->names.data;
    for (size_t i = 0; i < table->names.count; i++) {
        free(names[i].text);
    }
    free(names);
    free(table->slots);
    memset(table, 0, sizeof(*table));
}

static uint32_t hash_name(const char *name, size_t length)
{
    uint32_t hash = 2166136261U;
    for (size_t i = 0; i < length; i++) {
        hash = (hash ^ (unsigned char)name[i]) * 16777619U;
    }
    return hash;
}

static enum umb_status add_material(struct umbb_material_table *table, const char *name,
                                    size_t length, struct umb_error *error)
{
    if (table->names.count >= UMBB_MATERIALS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u materials", UMBB_MATERIALS_MAX);
    }
    struct name *room = umbs_array_reserve(&table->names, 1, sizeof(*room));
    char *copy = malloc(length + 1);
    if (room == NULL || copy == NULL) {
        free(copy);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a material");
    }
    struct umbs_material material = umbs_material_opaque();
    umbs_text_clean(material.name, sizeof(material.name), name, length);
    enum umb_status status = umbs_scene_add_material(table->scene, &material, error);
    if (status != UMB_OK) {
        free(copy);
        return status;
    }
    if (length > 0) {
        memcpy(copy, name, length);
    }
    room->text = copy;
    room->length = length;
    table->names.count++;
    return UMB_OK;
}

enum umb_status umbb_material_get(struct umbb_material_table *table, const char *name,
                                  size_t length, uint32_t *index, struct umb_error *error)
{
    *index = UMBS_NO_INDEX;
    if (table->slots == NULL) {
        table->slots = calloc(SLOT_COUNT, sizeof(*table->slots));
        if (table->slots == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for materials");
        }
    }
    uint32_t slot = hash_name(name, length) % SLOT_COUNT;
    for (; table->slots[slot] != 0; slot = (slot + 1) % SLOT_COUNT) {
        const struct name *names = table->names.data;
        const struct name *known = &names[table->slots[slot] - 1];
        if (known->length == length && memcmp(known->text, name, length) == 0) {
            *index = table->slots[slot] - 1;
            return UMB_OK;
        }
    }
    enum umb_status status = add_material(table, name, length, error);
    if (status == UMB_OK) {
        table->slots[slot] = (uint32_t)table->names.count;
        *index = table->slots[slot] - 1;
    }
    return status;
}
