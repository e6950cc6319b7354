/* SPDX-License-Identifier: Apache-2.0 */
/* Wavefront MTL (mtl_reader.h). Source: Alias/Wavefront, "MTL material format", 1995. */
#define _GNU_SOURCE /* tdestroy */
#include "bake/import/mtl_reader.h"

#include <search.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"

/* A material's name, in a tree of <search.h>. */
struct name {
    const char *text; /* behind the struct, in the tree; not NUL-terminated */
    size_t length;
    uint32_t index;
};

static int compare_names(const void *a, const void *b)
{
    const struct name *x = a, *y = b;
    return x->length != y->length ? (x->length > y->length) - (x->length < y->length)
                                  : memcmp(x->text, y->text, x->length);
}

void umbb_material_table_finish(struct umbb_material_table *table)
{
    tdestroy(table->names, free);
    memset(table, 0, sizeof(*table));
}

enum umb_status umbb_material_get(struct umbb_material_table *table, const char *name,
                                  size_t length, uint32_t *index, struct umb_error *error)
{
    const struct name wanted = {.text = name, .length = length};
    struct name *const *found = tfind(&wanted, &table->names, compare_names);
    if (found != NULL) {
        *index = (*found)->index;
        return UMB_OK;
    }
    if (table->count >= UMBB_MATERIALS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "more than %u materials", UMBB_MATERIALS_MAX);
    }
    struct umbs_material material = umbs_material_opaque();
    umbs_text_clean(material.name, sizeof(material.name), name, length);
    UMB__TRY(umbs_scene_add_material(table->scene, &material, error));
    struct name *fresh = malloc(sizeof *fresh + length);
    if (fresh == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a material");
    }
    memcpy(fresh + 1, name, length);
    *fresh = (struct name){(const char *)(fresh + 1), length, table->count++};
    if (tsearch(fresh, &table->names, compare_names) == NULL) {
        free(fresh);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a material");
    }
    *index = fresh->index;
    return UMB_OK;
}

/* Properties of one material from its lines so far. */
struct current {
    uint32_t index;
    double dissolve; /* from d or Tr, 0..1 */
    int has_d;       /* 1: d was given; it overrides Tr, on whose meaning exporters disagree */
    int has_map;
    struct umbb_cursor map; /* rest of the line of map_d */
};

/* Options of a map. An option of several words takes fewer where the next word is no number. */
static const struct {
    const char *name;
    int words;   /* largest number of words after the name */
    int changes; /* 1: the option moves, scales or replaces the image, which is not supported */
} map_options[] = {
    {"-blendu", 1, 0}, {"-blendv", 1, 0}, {"-boost", 1, 0}, {"-cc", 1, 0}, {"-texres", 1, 0},
    {"-type", 1, 0},   {"-clamp", 1, 0},  {"-bm", 1, 0},    {"-mm", 2, 1}, {"-imfchan", 1, 1},
    {"-o", 3, 1},      {"-s", 3, 1},      {"-t", 3, 1},
};

/* Sets a material's alpha. A line without a number is ignored; a number outside of 0 to 1 is
 * ignored with a warning. */
static void set_alpha(struct umbb_material_table *table, struct current *current,
                      struct umbb_cursor *line, int is_d)
{
    double value;
    struct umbb_cursor first = *line;
    const char *option;
    size_t length = umbb_take_token(&first, &option);
    if (umbb_is_word(option, length, "-halo")) {
        *line = first;
    }
    if (current->index == UMBS_NO_INDEX || (!is_d && current->has_d) ||
        !umbb_take_double(line, &value)) {
        return;
    }
    if (!(value >= 0.0) || !(value <= 1.0)) {
        const struct umbs_material *materials = table->scene->materials.data;
        umbs_scene_warn(table->scene, "material '%s': %s of %g is not in 0 to 1 and is left out",
                        materials[current->index].name, is_d ? "d" : "Tr", value);
        return;
    }
    current->dissolve = is_d ? value : 1.0 - value;
    current->has_d = is_d;
}

/* Takes one option of a map off the cursor; returns 0 if there is none. */
static int take_option(struct umbb_cursor *line, uint32_t *wrap, int *changes)
{
    struct umbb_cursor at = *line;
    const char *word;
    const size_t length = umbb_take_token(&at, &word);
    for (size_t i = 0; i < sizeof map_options / sizeof map_options[0]; i++) {
        if (!umbb_is_word(word, length, map_options[i].name)) {
            continue;
        }
        *changes |= map_options[i].changes;
        for (int k = 0; k < map_options[i].words; k++) {
            struct umbb_cursor next = at;
            double number;
            const char *value;
            if (k > 0 && !umbb_take_double(&next, &number)) {
                break;
            }
            const size_t size = umbb_take_token(&at, &value);
            if (strcmp(map_options[i].name, "-clamp") == 0 && umbb_is_word(value, size, "on")) {
                *wrap = UMBS_WRAP_CLAMP;
            }
        }
        *line = at;
        return 1;
    }
    return 0;
}

/* Gives a material the texture of its map_d. */
static enum umb_status read_map(struct umbb_texture_table *textures, struct umbb_cursor line,
                                struct umbs_material *material, struct umb_error *error)
{
    uint32_t wrap = UMBS_WRAP_REPEAT;
    int changes = 0;
    while (umbb_skip_blanks(&line) && take_option(&line, &wrap, &changes)) {
    }
    const struct umbb_cursor name = umbb_trim(line);
    if (changes || name.at == name.end) {
        umbs_scene_warn(&textures->job->scene,
                        "material '%s': map_d with options that are not "
                        "read is left out",
                        material->name);
        return UMB_OK;
    }
    const struct umbb_image image = {.name = name.at,
                                     .name_length = (size_t)(name.end - name.at),
                                     .luminance = 1,
                                     .wrap_s = wrap,
                                     .wrap_t = wrap};
    return umbb_texture_get(textures, &image, &material->texture, error);
}

static enum umb_status store(struct umbb_material_table *table, struct umbb_texture_table *textures,
                             const struct current *current, struct umb_error *error)
{
    if (current->index == UMBS_NO_INDEX) {
        return UMB_OK;
    }
    struct umbs_material *materials = table->scene->materials.data;
    struct umbs_material *material = &materials[current->index];
    material->base_alpha = (float)current->dissolve;
    material->alpha_mode = current->dissolve < 1.0 ? UMBS_ALPHA_BLEND
                           : current->has_map      ? UMBS_ALPHA_MASK
                                                   : UMBS_ALPHA_OPAQUE;
    return current->has_map ? read_map(textures, current->map, material, error) : UMB_OK;
}

enum umb_status umbb_mtl_read(const struct umbb_file *file, struct umbb_material_table *table,
                              struct umbb_texture_table *textures, struct umb_error *error)
{
    struct umbb_cursor text = {file->bytes, file->bytes + file->size};
    struct umbb_cursor line;
    struct current current = {.index = UMBS_NO_INDEX, .dissolve = 1.0};
    while (umbb_take_line(&text, &line)) {
        const char *word;
        size_t length = umbb_take_token(&line, &word);
        if (umbb_is_word(word, length, "newmtl")) {
            struct umbb_cursor name = umbb_trim(line);
            UMB__TRY(store(table, textures, &current, error));
            current = (struct current){.dissolve = 1.0};
            UMB__TRY(umbb_material_get(table, name.at, (size_t)(name.end - name.at), &current.index,
                                       error));
        } else if (umbb_is_word(word, length, "d")) {
            set_alpha(table, &current, &line, 1);
        } else if (umbb_is_word(word, length, "Tr")) {
            set_alpha(table, &current, &line, 0);
        } else if (umbb_is_word(word, length, "map_d")) {
            current.has_map = 1;
            current.map = line;
        }
    }
    return store(table, textures, &current, error);
}
