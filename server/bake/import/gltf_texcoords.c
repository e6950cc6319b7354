/* SPDX-License-Identifier: Apache-2.0 */
/* See gltf_texcoords.h. Source: KHR_texture_transform. */
#include "bake/import/gltf_texcoords.h"

#include "bake/import/json_scan.h"

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

/* The whole number at the end of a path of members, the last if there are several; calls itself
 * once a member of the path. */
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

void umbb_gltf_texcoords(const struct umbb_import *job, enum umbb_kind kind, uint32_t *sets,
                         size_t count)
{
    static const char *const path[] = {"pbrMetallicRoughness",  "baseColorTexture", "extensions",
                                       "KHR_texture_transform", "texCoord",         NULL};
    struct umbb_cursor json = umbb_gltf_json(job, kind);
    struct umbb_json_text key;
    for (size_t i = 0; i < count; i++) {
        sets[i] = UMBS_NO_INDEX;
    }
    if (!umbb_json_enter(&json, '{')) {
        return;
    }
    while (umbb_json_member(&json, &key)) {
        if (!umbb_json_is(key, "materials") || !umbb_json_enter(&json, '[')) {
            umbb_json_skip(&json);
            continue;
        }
        for (size_t i = 0; umbb_json_item(&json); i++) {
            const int64_t set = number_at(&json, path, -1);
            if (i < count && set >= 0 && set < (int64_t)UMBS_NO_INDEX) {
                sets[i] = (uint32_t)set;
            }
        }
    }
}
