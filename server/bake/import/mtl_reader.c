/* SPDX-License-Identifier: Apache-2.0 */
/* Wavefront MTL (mtl_reader.h). Source: Alias/Wavefront, "MTL material format", 1995. */
#include "bake/import/mtl_reader.h"

#include <string.h>

int umbb_take_line(struct umbb_cursor *text, struct umbb_cursor *line)
{
    if (text->at >= text->end) {
        return 0;
    }
    const char *newline = memchr(text->at, '\n', (size_t)(text->end - text->at));
    line->at = text->at;
    line->end = newline != NULL ? newline : text->end;
    text->at = newline != NULL ? newline + 1 : text->end;
    return 1;
}

struct umbb_cursor umbb_trim(struct umbb_cursor line)
{
    while (line.at < line.end && (*line.at == ' ' || *line.at == '\t')) {
        line.at++;
    }
    while (line.at < line.end &&
           (line.end[-1] == ' ' || line.end[-1] == '\t' || line.end[-1] == '\r')) {
        line.end--;
    }
    return line;
}

static int is_word(const char *token, size_t length, const char *word)
{
    return length == strlen(word) && memcmp(token, word, length) == 0;
}

/* What the lines of one material said so far. */
struct current {
    uint32_t index;
    double dissolve; /* from d or Tr, 0..1 */
    int has_d;       /* d beats Tr, which exporters disagree about */
    int has_map;
};

static void set_alpha(struct current *current, struct umbb_cursor *line, int is_d)
{
    double value;
    struct umbb_cursor first = *line;
    const char *option;
    size_t length = umbb_take_token(&first, &option);
    if (is_word(option, length, "-halo")) {
        *line = first;
    }
    if ((!is_d && current->has_d) || !umbb_take_double(line, &value) || !(value >= 0.0) ||
        !(value <= 1.0)) {
        return; /* not a number in 0..1: as if the line were not there */
    }
    current->dissolve = is_d ? value : 1.0 - value;
    current->has_d = is_d;
}

static void store(struct umbb_material_table *table, const struct current *current)
{
    if (current->index == UMBS_NO_INDEX) {
        return;
    }
    struct umbs_material *materials = table->scene->materials.data;
    struct umbs_material *material = &materials[current->index];
    material->base_alpha = (float)current->dissolve;
    material->alpha_mode = current->dissolve < 1.0 ? UMBS_ALPHA_BLEND
                           : current->has_map      ? UMBS_ALPHA_MASK
                                                   : UMBS_ALPHA_OPAQUE;
}

enum umb_status umbb_mtl_read(const struct umbb_file *file, struct umbb_material_table *table,
                              struct umb_error *error)
{
    struct umbb_cursor text = {file->bytes, file->bytes + file->size};
    struct umbb_cursor line;
    struct current current = {.index = UMBS_NO_INDEX, .dissolve = 1.0};
    while (umbb_take_line(&text, &line)) {
        const char *word;
        size_t length = umbb_take_token(&line, &word);
        if (is_word(word, length, "newmtl")) {
            store(table, &current);
            struct umbb_cursor name = umbb_trim(line);
            memset(&current, 0, sizeof(current));
            current.dissolve = 1.0;
            enum umb_status status = umbb_material_get(table, name.at, (size_t)(name.end - name.at),
                                                       &current.index, error);
            if (status != UMB_OK) {
                return status;
            }
        } else if (is_word(word, length, "d")) {
            set_alpha(&current, &line, 1);
        } else if (is_word(word, length, "Tr")) {
            set_alpha(&current, &line, 0);
        } else if (is_word(word, length, "map_d")) {
            current.has_map = 1;
        }
    }
    store(table, &current);
    return UMB_OK;
}
