/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What Assimp overlooks in glTF (gltf_guard.h). The little JSON scanner here only finds members and
 * passes over values; every step takes at least one byte, nothing recurses, so it ends on anything.
 * Sources: RFC 8259; glTF 2.0 specification, sections 3.6.2.2 and 3.12.
 */
#include "bake/import/gltf_guard.h"

#include <stdlib.h>
#include <string.h>

#include "bake/import/text_number.h"
#include "common/scene_text.h"

#define COMPONENT_FLOAT 5126
#define NO_TYPE         (-1)

/* What of an accessor decides how Assimp reads positions through it. */
struct accessor {
    int32_t component;
    int is_vec3;
    int has_view; /* without one, Assimp gives zeros, also where `sparse` says otherwise */
};

/* A text inside the JSON, without its quotes, escapes as written. */
struct text {
    const char *at;
    size_t length;
};

static int is_text(struct text text, const char *word)
{
    return text.length == strlen(word) && memcmp(text.at, word, text.length) == 0;
}

/* Passes over a string; the cursor is at its opening quote. */
static struct text take_string(struct umbb_cursor *json)
{
    struct text text = {++json->at, 0};
    while (json->at < json->end && *json->at != '"') {
        json->at += *json->at == '\\' && json->end - json->at > 1 ? 2 : 1;
    }
    text.length = (size_t)(json->at - text.at);
    json->at += json->at < json->end;
    return text;
}

/* Passes over one value of any kind: up to the next ',' or closing bracket of this level. */
static void skip_value(struct umbb_cursor *json)
{
    size_t depth = 0;
    while (json->at < json->end) {
        char c = *json->at;
        if (c == '"') {
            (void)take_string(json);
            continue;
        }
        if (depth == 0 && (c == ',' || c == '}' || c == ']')) {
            return;
        }
        depth += c == '{' || c == '[';
        depth -= c == '}' || c == ']';
        json->at++;
    }
}

/* Enters an object or array; otherwise passes over the value and returns 0. */
static int enter(struct umbb_cursor *json, char bracket)
{
    if (umbb_skip_blanks(json) && *json->at == bracket) {
        json->at++;
        return 1;
    }
    skip_value(json);
    return 0;
}

/* Moves to the next item of the array; 0 at its end. */
static int next_item(struct umbb_cursor *json)
{
    while (umbb_skip_blanks(json)) {
        if (*json->at != ',') {
            int more = *json->at != ']' && *json->at != '}';
            json->at += !more;
            return more;
        }
        json->at++;
    }
    return 0;
}

/* Moves to the value of the object's next member; 0 at its end. */
static int next_member(struct umbb_cursor *json, struct text *key)
{
    while (next_item(json)) {
        if (*json->at == '"') {
            *key = take_string(json);
            if (umbb_skip_blanks(json) && *json->at == ':') {
                json->at++;
                return 1;
            }
        } else {
            json->at++; /* no JSON: look for something that is */
        }
    }
    return 0;
}

static int64_t take_number(struct umbb_cursor *json, int64_t otherwise)
{
    int64_t number = otherwise;
    (void)umbb_skip_blanks(json);
    if (!umbb_take_integer(json, &number)) {
        number = otherwise;
    }
    skip_value(json); /* what is left of it */
    return number;
}

static int starts_with(struct text text, const char *prefix)
{
    size_t length = strlen(prefix);
    return text.length >= length && memcmp(text.at, prefix, length) == 0;
}

/* The version decides which of Assimp's importers reads the file: only that of 2.x is wanted. */
static enum umb_status check_asset(struct umbb_cursor *json, int *has_version,
                                   struct umb_error *error)
{
    struct text key;
    if (!enter(json, '{')) {
        return UMB_OK;
    }
    while (next_member(json, &key)) {
        if (!is_text(key, "version") || !umbb_skip_blanks(json) || *json->at != '"') {
            skip_value(json);
            continue;
        }
        struct text version = take_string(json);
        *has_version = 1;
        if (!starts_with(version, "2.")) {
            char shown[16];
            umbs_text_clean(shown, sizeof(shown), version.at, version.length);
            return umb_fail(error, UMB_E_BAD_SCENE, "glTF version '%s' is not supported (2.x is)",
                            shown);
        }
    }
    return UMB_OK;
}

/* Extensions that change nothing about the shape of a scene, or that Assimp knows. */
static int is_harmless(struct text name)
{
    return is_text(name, "KHR_lights_punctual") || starts_with(name, "KHR_materials_") ||
           starts_with(name, "KHR_texture_") || starts_with(name, "EXT_texture_") ||
           is_text(name, "KHR_xmp") || is_text(name, "KHR_xmp_json_ld");
}

static enum umb_status check_extensions(struct umbb_cursor *json, struct umb_error *error)
{
    if (!enter(json, '[')) {
        return UMB_OK;
    }
    while (next_item(json)) {
        if (*json->at == '"') {
            struct text name = take_string(json);
            if (!is_harmless(name)) {
                char shown[80];
                umbs_text_clean(shown, sizeof(shown), name.at, name.length);
                return umb_fail(error, UMB_E_BAD_SCENE,
                                "it requires the glTF extension '%s', which is not supported",
                                shown);
            }
        }
        skip_value(json);
    }
    return UMB_OK;
}

/* Extensions that a reader may pass over, at the price of things that cast shadows. */
static void warn_of_extensions(struct umbs_scene_builder *scene, struct umbb_cursor json)
{
    if (!enter(&json, '[')) {
        return;
    }
    while (next_item(&json)) {
        if (*json.at == '"') {
            struct text name = take_string(&json);
            if (is_text(name, "EXT_mesh_gpu_instancing")) {
                umbs_scene_warn(scene, "EXT_mesh_gpu_instancing is not read: of its instances only "
                                       "one is there");
            }
        }
        skip_value(&json);
    }
}

static void read_accessor(struct umbb_cursor *json, struct accessor *accessor)
{
    struct text key;
    while (next_member(json, &key)) {
        if (is_text(key, "componentType")) {
            accessor->component = (int32_t)(take_number(json, NO_TYPE) & 0xffff);
        } else if (is_text(key, "type") && umbb_skip_blanks(json) && *json->at == '"') {
            accessor->is_vec3 = is_text(take_string(json), "VEC3");
        } else {
            accessor->has_view |= is_text(key, "bufferView");
            skip_value(json);
        }
    }
}

/* Lists all accessors. Returns 0 without memory. */
static int read_accessors(struct umbb_cursor *json, struct umbs_array *accessors)
{
    if (!enter(json, '[')) {
        return 1;
    }
    while (next_item(json)) {
        struct accessor *accessor = umbs_array_reserve(accessors, 1, sizeof(*accessor));
        if (accessor == NULL) {
            return 0;
        }
        *accessor = (struct accessor){.component = NO_TYPE};
        accessors->count++;
        if (enter(json, '{')) {
            read_accessor(json, accessor);
        }
    }
    return 1;
}

/* Positions must be floats in threes, from a buffer. */
static enum umb_status check_position(const struct umbs_array *accessors, int64_t index,
                                      struct umb_error *error)
{
    if (index < 0 || (uint64_t)index >= accessors->count) {
        return UMB_OK; /* Assimp has a word for it */
    }
    const struct accessor *accessor = (const struct accessor *)accessors->data + index;
    if (accessor->component != COMPONENT_FLOAT) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "accessors[%lld].componentType of a POSITION is %d, must be %d (float)",
                        (long long)index, (int)accessor->component, COMPONENT_FLOAT);
    }
    if (!accessor->is_vec3) {
        return umb_fail(error, UMB_E_BAD_SCENE, "accessors[%lld].type of a POSITION must be VEC3",
                        (long long)index);
    }
    if (!accessor->has_view) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "accessors[%lld] of a POSITION has no bufferView, which is not supported",
                        (long long)index);
    }
    return UMB_OK;
}

static enum umb_status check_attributes(struct umbb_cursor *json,
                                        const struct umbs_array *accessors, struct umb_error *error)
{
    struct text key;
    enum umb_status status = UMB_OK;
    if (!enter(json, '{')) {
        return UMB_OK;
    }
    while (status == UMB_OK && next_member(json, &key)) {
        if (is_text(key, "POSITION")) {
            status = check_position(accessors, take_number(json, -1), error);
        } else {
            skip_value(json);
        }
    }
    return status;
}

/* Walks arrays of objects: calls itself for `primitives`, then check_attributes. Two levels. */
static enum umb_status check_members(struct umbb_cursor *json, const char *const *path,
                                     const struct umbs_array *accessors, struct umb_error *error)
{
    struct text key;
    enum umb_status status = UMB_OK;
    if (*path == NULL) {
        return check_attributes(json, accessors, error);
    }
    if (!enter(json, '[')) {
        return UMB_OK;
    }
    while (status == UMB_OK && next_item(json)) {
        if (!enter(json, '{')) {
            continue;
        }
        while (status == UMB_OK && next_member(json, &key)) {
            if (is_text(key, *path)) {
                status = check_members(json, path + 1, accessors, error);
            } else {
                skip_value(json);
            }
        }
    }
    return status;
}

/* Finds the JSON: the file, or the first chunk of a GLB. */
static struct umbb_cursor find_json(const struct umbb_import *job, enum umbb_kind kind)
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

enum umb_status umbb_gltf_guard(struct umbb_import *job, enum umbb_kind kind,
                                struct umb_error *error)
{
    static const char *const path[] = {"primitives", "attributes", NULL};
    struct umbb_cursor json = find_json(job, kind);
    struct umbb_cursor meshes = {NULL, NULL};
    struct umbs_array accessors = {0};
    struct text key;
    enum umb_status status = UMB_OK;
    int has_version = 0;
    if (!enter(&json, '{')) {
        return umb_fail(error, UMB_E_BAD_SCENE, "the file has no JSON object");
    }
    while (status == UMB_OK && next_member(&json, &key)) {
        if (is_text(key, "asset")) {
            status = check_asset(&json, &has_version, error);
        } else if (is_text(key, "extensionsRequired")) {
            status = check_extensions(&json, error);
        } else if (is_text(key, "accessors")) {
            if (!read_accessors(&json, &accessors)) {
                status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
            }
        } else {
            if (is_text(key, "meshes")) {
                meshes = json; /* read when the accessors are known */
            } else if (is_text(key, "extensionsUsed")) {
                warn_of_extensions(&job->scene, json);
            }
            skip_value(&json);
        }
    }
    if (status == UMB_OK && !has_version) {
        status = umb_fail(error, UMB_E_BAD_SCENE, "it has no asset.version, so it is no glTF");
    }
    if (status == UMB_OK && meshes.at != NULL) {
        status = check_members(&meshes, path, &accessors, error);
    }
    free(accessors.data);
    return status;
}
