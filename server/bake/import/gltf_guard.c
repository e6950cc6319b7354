/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Checks of glTF that Assimp omits (gltf_guard.h).
 * Source: glTF 2.0 specification, sections 3.6.2.2 and 3.12.
 */
#include "bake/import/gltf_guard.h"

#include <stdlib.h>
#include <string.h>

#include "bake/import/json_scan.h"
#include "common/clean_text.h"

#define COMPONENT_FLOAT 5126
#define NO_TYPE         (-1)

/* The properties of an accessor that decide how Assimp reads positions through it. */
struct accessor {
    int32_t component;
    int is_vec3;
    int has_view; /* without a view, Assimp gives zeros, even if `sparse` holds values */
};

/* Checks the version, which selects Assimp's importer: only that of 2.x may be selected. */
static enum umb_status check_asset(struct umbb_cursor *json, int *has_version,
                                   struct umb_error *error)
{
    struct umbb_json_text key;
    if (!umbb_json_enter(json, '{')) {
        return UMB_OK;
    }
    while (umbb_json_member(json, &key)) {
        if (!umbb_json_is(key, "version") || !umbb_skip_blanks(json) || *json->at != '"') {
            umbb_json_skip(json);
            continue;
        }
        struct umbb_json_text version = umbb_json_string(json);
        *has_version = 1;
        if (!umbb_json_starts(version, "2.")) {
            char shown[16];
            umbs_text_clean(shown, sizeof(shown), version.at, version.length);
            return umb_fail(error, UMB_E_BAD_SCENE, "glTF version '%s' is not supported (2.x is)",
                            shown);
        }
    }
    return UMB_OK;
}

/* Extensions that do not change the shape of a scene, or that are read here. */
static int is_harmless(struct umbb_json_text name)
{
    return umbb_json_is(name, "KHR_lights_punctual") || umbb_json_starts(name, "KHR_materials_") ||
           umbb_json_starts(name, "KHR_texture_") || umbb_json_starts(name, "EXT_texture_") ||
           umbb_json_is(name, "KHR_xmp") || umbb_json_is(name, "KHR_xmp_json_ld") ||
           umbb_json_is(name, "EXT_mesh_gpu_instancing");
}

static enum umb_status check_extensions(struct umbb_cursor *json, struct umb_error *error)
{
    if (!umbb_json_enter(json, '[')) {
        return UMB_OK;
    }
    while (umbb_json_item(json)) {
        if (*json->at == '"') {
            struct umbb_json_text name = umbb_json_string(json);
            if (!is_harmless(name)) {
                char shown[80];
                umbs_text_clean(shown, sizeof(shown), name.at, name.length);
                return umb_fail(error, UMB_E_BAD_SCENE,
                                "it requires the glTF extension '%s', which is not supported",
                                shown);
            }
        }
        umbb_json_skip(json);
    }
    return UMB_OK;
}

static void read_accessor(struct umbb_cursor *json, struct accessor *accessor)
{
    struct umbb_json_text key;
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "componentType")) {
            accessor->component = (int32_t)(umbb_json_number(json, NO_TYPE) & 0xffff);
        } else if (umbb_json_is(key, "type") && umbb_skip_blanks(json) && *json->at == '"') {
            accessor->is_vec3 = umbb_json_is(umbb_json_string(json), "VEC3");
        } else {
            accessor->has_view |= umbb_json_is(key, "bufferView");
            umbb_json_skip(json);
        }
    }
}

/* Lists all accessors. Returns 0 if out of memory. */
static int read_accessors(struct umbb_cursor *json, struct umbs_array *accessors)
{
    if (!umbb_json_enter(json, '[')) {
        return 1;
    }
    while (umbb_json_item(json)) {
        struct accessor *accessor = umbs_array_reserve(accessors, 1, sizeof(*accessor));
        if (accessor == NULL) {
            return 0;
        }
        *accessor = (struct accessor){.component = NO_TYPE};
        accessors->count++;
        if (umbb_json_enter(json, '{')) {
            read_accessor(json, accessor);
        }
    }
    return 1;
}

/* Positions must be vectors of three floats, from a buffer. */
static enum umb_status check_position(const struct umbs_array *accessors, int64_t index,
                                      struct umb_error *error)
{
    if (index < 0 || (uint64_t)index >= accessors->count) {
        return UMB_OK; /* assimp reports it */
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
    struct umbb_json_text key;
    enum umb_status status = UMB_OK;
    if (!umbb_json_enter(json, '{')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "POSITION")) {
            status = check_position(accessors, umbb_json_number(json, -1), error);
        } else {
            umbb_json_skip(json);
        }
    }
    return status;
}

/* Walks arrays of objects: calls itself for `primitives`, then check_attributes. Two levels. */
static enum umb_status check_members(struct umbb_cursor *json, const char *const *path,
                                     const struct umbs_array *accessors, struct umb_error *error)
{
    struct umbb_json_text key;
    enum umb_status status = UMB_OK;
    if (*path == NULL) {
        return check_attributes(json, accessors, error);
    }
    if (!umbb_json_enter(json, '[')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_item(json)) {
        if (!umbb_json_enter(json, '{')) {
            continue;
        }
        while (status == UMB_OK && umbb_json_member(json, &key)) {
            if (umbb_json_is(key, *path)) {
                status = check_members(json, path + 1, accessors, error);
            } else {
                umbb_json_skip(json);
            }
        }
    }
    return status;
}

enum umb_status umbb_gltf_guard(struct umbb_import *job, enum umbb_kind kind,
                                struct umb_error *error)
{
    static const char *const path[] = {"primitives", "attributes", NULL};
    struct umbb_cursor json = umbb_gltf_json(job, kind);
    struct umbb_cursor meshes = {NULL, NULL};
    struct umbs_array accessors = {0};
    struct umbb_json_text key;
    enum umb_status status = UMB_OK;
    int has_version = 0;
    if (!umbb_json_enter(&json, '{')) {
        return umb_fail(error, UMB_E_BAD_SCENE, "the file has no JSON object");
    }
    while (status == UMB_OK && umbb_json_member(&json, &key)) {
        if (umbb_json_is(key, "asset")) {
            status = check_asset(&json, &has_version, error);
        } else if (umbb_json_is(key, "extensionsRequired")) {
            status = check_extensions(&json, error);
        } else if (umbb_json_is(key, "accessors")) {
            if (!read_accessors(&json, &accessors)) {
                status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
            }
        } else {
            if (umbb_json_is(key, "meshes")) {
                meshes = json; /* read once the accessors are known */
            }
            umbb_json_skip(&json);
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
