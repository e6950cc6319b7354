/* SPDX-License-Identifier: Apache-2.0 */
/* See gltf_texcoords.h. Source: KHR_texture_transform. */
#include "bake/import/gltf_texcoords.h"

#include <stdlib.h>
#include <string.h>

#include "bake/import/json_scan.h"
#include "scene/scene_builder.h"

struct umbb_cursor umbb_gltf_json(const struct umbb_import *job, enum umbb_kind kind)
{
    const struct umbb_file *file = &job->file;
    struct umbb_cursor json = {file->bytes, file->bytes + file->size};
    if (kind == UMBB_KIND_GLB) {
        json.end = json.at;
        if (file->size >= 20 && memcmp(file->bytes + 16, "JSON", 4) == 0) {
            size_t length = umbb_load_u32(file->bytes + 12);
            json.at += 20;
            json.end = json.at + (length < file->size - 20 ? length : file->size - 20);
        }
    } else if (file->size >= 3 && memcmp(file->bytes, "\xef\xbb\xbf", 3) == 0) {
        json.at += 3;
    }
    return json;
}

/* The integer at the end of a path of members, the last one if there are several; it calls itself
 * once for each member of the path. */
static int64_t number_at(struct umbb_cursor *json, const char *const *path, int64_t otherwise)
{
    struct umbb_json_text key;
    int64_t found = otherwise;
    if (*path == NULL) {
        return umbb_json_number(json, otherwise);
    }
    if (!umbb_json_enter(json, '{')) {
        return otherwise;
    }
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, *path)) {
            found = number_at(json, path + 1, found);
        } else {
            umbb_json_skip(json);
        }
    }
    return found;
}

/* A material's name in the file and its set of coordinates. */
struct named_set {
    struct umbb_json_text name;
    uint32_t set;
};

static struct named_set read_material(struct umbb_cursor *json)
{
    static const char *const path[] = {"baseColorTexture", "extensions", "KHR_texture_transform",
                                       "texCoord", NULL};
    struct named_set material = {.name = {"", 0}, .set = UMBB_SET_UNSAID};
    struct umbb_json_text key;
    if (!umbb_json_enter(json, '{')) {
        return material;
    }
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "pbrMetallicRoughness")) {
            const int64_t set = number_at(json, path, -1);
            material.set = set >= 0 && set < UMBB_SET_UNKNOWN ? (uint32_t)set : UMBB_SET_UNSAID;
        } else if (umbb_json_is(key, "name") && umbb_skip_blanks(json) && *json->at == '"') {
            material.name = umbb_json_string(json);
        } else {
            umbb_json_skip(json);
        }
    }
    return material;
}

static int compare(const void *a, const void *b)
{
    const struct umbb_json_text *x = &((const struct named_set *)a)->name;
    const struct umbb_json_text *y = &((const struct named_set *)b)->name;
    return x->length != y->length ? (x->length > y->length) - (x->length < y->length)
                                  : memcmp(x->at, y->at, x->length);
}

/* Sorts the names and keeps each once. */
static void sort(struct umbs_array *materials)
{
    struct named_set *all = materials->data;
    size_t kept = 0;
    qsort(all, materials->count, sizeof *all, compare);
    for (size_t i = 0; i < materials->count; i++) {
        if (kept == 0 || compare(&all[kept - 1], &all[i]) != 0) {
            all[kept++] = all[i];
        } else if (all[kept - 1].set != all[i].set) {
            all[kept - 1].set = UMBB_SET_UNKNOWN;
        }
    }
    materials->count = kept;
}

static enum umb_status read_materials(struct umbb_cursor *json, struct umbb_gltf_sets *sets,
                                      int *said, struct umb_error *error)
{
    while (umbb_json_item(json)) {
        const struct named_set material = read_material(json);
        const int has_set = material.set != UMBB_SET_UNSAID;
        *said |= has_set;
        if (memchr(material.name.at, '\\', material.name.length) != NULL) {
            sets->has_escapes |= has_set;
            continue;
        }
        struct named_set *room = umbs_array_reserve(&sets->materials, 1, sizeof *room);
        if (room == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for materials");
        }
        *room = material;
        sets->materials.count++;
    }
    return UMB_OK;
}

enum umb_status umbb_gltf_sets_find(const struct umbb_import *job, enum umbb_kind kind,
                                    struct umbb_gltf_sets *sets, struct umb_error *error)
{
    struct umbb_cursor json = umbb_gltf_json(job, kind);
    struct umbb_json_text key;
    enum umb_status status = UMB_OK;
    int said = 0;
    if ((kind != UMBB_KIND_GLTF && kind != UMBB_KIND_GLB) || !umbb_json_enter(&json, '{')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_member(&json, &key)) {
        if (!umbb_json_is(key, "materials")) {
            umbb_json_skip(&json);
        } else if (umbb_json_enter(&json, '[')) {
            status = read_materials(&json, sets, &said, error);
        }
    }
    sets->materials.count = said ? sets->materials.count : 0;
    if (sets->materials.count > 0) {
        sort(&sets->materials);
    }
    return status;
}

uint32_t umbb_gltf_set_of(const struct umbb_gltf_sets *sets, const char *name, size_t length)
{
    const struct named_set wanted = {.name = {name, length}, .set = UMBB_SET_UNSAID};
    const struct named_set *found = NULL;
    if (sets->materials.count > 0) {
        found =
            bsearch(&wanted, sets->materials.data, sets->materials.count, sizeof wanted, compare);
    }
    if (found == NULL) {
        return sets->has_escapes ? UMBB_SET_UNKNOWN : UMBB_SET_UNSAID;
    }
    return found->set;
}
