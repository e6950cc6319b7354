/* SPDX-License-Identifier: Apache-2.0 */
/* Checks of submitted manifests, and their key. */
#include "jobs/bundle.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/try.h"
#include "scene/scene_file.h"
#include "common/sha256.h"
#include "tool/bake_settings.h"
#include "umbrage/version.h"

_Static_assert(UMBJ_HEAD_BYTES == UMBS_SCENE_FILE_MAGIC_BYTES, "the head is the magic");

/* Endings of files that the importer reads; it also checks the content. */
static const char *const scene_endings[] = {".gltf", ".glb", ".obj", ".ply", ".stl"};

static int is_component(const char *text, size_t length)
{
    return length > 0 && !(length == 1 && text[0] == '.') &&
           !(length == 2 && text[0] == '.' && text[1] == '.');
}

/* Number of components of a path that may be unpacked, or 0. */
static int path_depth(const char *path)
{
    int depth = 0;
    for (;;) {
        size_t length = strcspn(path, "/");
        if (!is_component(path, length)) {
            return 0;
        }
        depth++;
        if (path[length] == '\0') {
            return depth;
        }
        path += length + 1;
    }
}

static enum umb_status check_path(const char *what, const char *path, struct umb_error *error)
{
    const size_t length = strlen(path);
    if (length == 0 || length > UMBJ_PATH_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: has %zu bytes, must have 1 to %d", what, length,
                        UMBJ_PATH_MAX);
    }
    for (size_t i = 0; i < length; i++) {
        if ((unsigned char)path[i] < 0x20 || path[i] == 0x7f || path[i] == '\\') {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "%s: '%.80s' has a control character or a backslash", what, path);
        }
    }
    const int depth = path_depth(path);
    if (depth == 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: '%.80s' must be relative, without empty components, '.' and '..'",
                        what, path);
    }
    if (depth > UMBJ_PATH_DEPTH_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.80s' has %d components, the limit is %d",
                        what, path, depth, UMBJ_PATH_DEPTH_MAX);
    }
    return UMB_OK;
}

static int ends_in(const char *text, const char *ending)
{
    const size_t length = strlen(text), tail = strlen(ending);
    return length > tail && strcasecmp(text + length - tail, ending) == 0;
}

static enum umb_status check_scene_name(const char *path, struct umb_error *error)
{
    for (size_t i = 0; i < sizeof scene_endings / sizeof scene_endings[0]; i++) {
        if (ends_in(path, scene_endings[i])) {
            return UMB_OK;
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "scene: '%.80s' is not a .gltf, .glb, .obj, .ply or .stl file", path);
}

static int compare_files(const void *a, const void *b)
{
    const struct umbj_bundle_file *const *left = a, *const *right = b;
    return strcmp((*left)->path, (*right)->path);
}

/* Compares names without the case of ASCII letters (the locale is "C", because no program calls
 * setlocale): on a file system that folds case, both names would be one file. Other letters are
 * compared byte by byte. If a file system folds other letters too, the second file exists already
 * when it is created, and upload.c refuses it. */
static int compare_files_folded(const void *a, const void *b)
{
    const struct umbj_bundle_file *const *left = a, *const *right = b;
    const int order = strcasecmp((*left)->path, (*right)->path);
    return order != 0 ? order : strcmp((*left)->path, (*right)->path);
}

/* Pointers to the files, sorted by their paths; free() them. */
static const struct umbj_bundle_file **sort_files(const struct umbj_manifest *manifest,
                                                  int (*compare)(const void *, const void *))
{
    const struct umbj_bundle_file **sorted = calloc(manifest->file_count + 1, sizeof *sorted);
    for (size_t i = 0; sorted != NULL && i < manifest->file_count; i++) {
        sorted[i] = &manifest->files[i];
    }
    if (sorted != NULL) {
        qsort(sorted, manifest->file_count, sizeof *sorted, compare);
    }
    return sorted;
}

/* Returns 1 if two paths have first components that differ only by case. Such paths are neighbours
 * in the order without case. */
static int differ_by_case(const char *one, const char *other)
{
    int differ = 0, differ_here = 0;
    size_t i = 0;
    for (; one[i] != '\0' && tolower((unsigned char)one[i]) == tolower((unsigned char)other[i]);
         i++) {
        differ_here |= one[i] != other[i];
        differ = one[i] == '/' ? differ_here : differ;
    }
    return one[i] == '\0' && other[i] == '\0' ? differ_here : differ;
}

static enum umb_status check_twins(const struct umbj_manifest *manifest, struct umb_error *error)
{
    const struct umbj_bundle_file **sorted = sort_files(manifest, compare_files_folded);
    enum umb_status status = UMB_OK;
    if (sorted == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the manifest");
    }
    for (size_t i = 1; status == UMB_OK && i < manifest->file_count; i++) {
        const char *one = sorted[i - 1]->path, *other = sorted[i]->path;
        if (strcmp(one, other) == 0) {
            status = umb_fail(error, UMB_E_ARGUMENT, "files: '%.80s' is there twice", one);
        } else if (differ_by_case(one, other)) {
            status = umb_fail(error, UMB_E_ARGUMENT,
                              "files: '%.80s' and '%.80s' have a name that differs only by case, "
                              "which is one name on some file systems; rename one",
                              one, other);
        }
    }
    free(sorted);
    return status;
}

static enum umb_status check_files(const struct umbj_manifest *manifest, uint64_t max_bytes,
                                   uint64_t *bytes, struct umb_error *error)
{
    int has_scene = 0;
    *bytes = 0;
    if (manifest->file_count == 0 || manifest->file_count > UMBJ_FILES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "files: %zu are given, must be 1 to %d",
                        manifest->file_count, UMBJ_FILES_MAX);
    }
    for (size_t i = 0; i < manifest->file_count; i++) {
        const struct umbj_bundle_file *file = &manifest->files[i];
        char what[40];
        snprintf(what, sizeof what, "files[%zu].path", i);
        UMB__TRY(check_path(what, file->path, error));
        if (file->size > max_bytes - *bytes) {
            return umb_fail(error, UMB_E_TOO_LARGE,
                            "files: together over the limit of %llu bytes (--max-bundle)",
                            (unsigned long long)max_bytes);
        }
        *bytes += file->size;
        has_scene |= strcmp(file->path, manifest->scene) == 0;
    }
    if (!has_scene) {
        return umb_fail(error, UMB_E_ARGUMENT, "scene: '%.80s' is not one of the files",
                        manifest->scene);
    }
    UMB__TRY(check_scene_name(manifest->scene, error));
    return check_twins(manifest, error);
}

static enum umb_status check_setting(const struct umbj_setting *setting, struct umb_error *error)
{
    const struct umbu_option *row = umbu_bake_setting(setting->name);
    if (row == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings: '%.40s' is not a setting of a bake",
                        setting->name);
    }
    const size_t length = strlen(setting->value);
    if ((length > 0) != (row->value != NULL) || length > UMBJ_VALUE_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings: %s: '%.60s' must have %s", setting->name,
                        setting->value,
                        row->value != NULL ? "a value of 1 to 128 bytes" : "no value");
    }
    for (size_t at = 0; at < length; at++) {
        if (!isprint((unsigned char)setting->value[at])) {
            return umb_fail(error, UMB_E_ARGUMENT, "settings: %s: only printable ASCII is taken",
                            setting->name);
        }
    }
    return UMB_OK;
}

enum umb_status umbj_manifest_check(const struct umbj_manifest *manifest, uint64_t max_bytes,
                                    uint64_t *bytes, struct umb_error *error)
{
    UMB__TRY(check_files(manifest, max_bytes, bytes, error));
    if (manifest->setting_count > UMBJ_SETTINGS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings: %zu are given, the limit is %d",
                        manifest->setting_count, UMBJ_SETTINGS_MAX);
    }
    for (size_t i = 0; i < manifest->setting_count; i++) {
        UMB__TRY(check_setting(&manifest->settings[i], error));
    }
    if (manifest->priority < -UMBJ_PRIORITY_MAX || manifest->priority > UMBJ_PRIORITY_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "priority: %d is not in -%d..%d", manifest->priority,
                        UMBJ_PRIORITY_MAX, UMBJ_PRIORITY_MAX);
    }
    return UMB_OK;
}

enum umb_status umbj_bundle_check_head(size_t index, const char *path, const uint8_t *head,
                                       struct umb_error *error)
{
    return memcmp(head, UMBS_SCENE_FILE_MAGIC, UMBJ_HEAD_BYTES) != 0
               ? UMB_OK
               : umb_fail(
                     error, UMB_E_ARGUMENT,
                     "files[%zu]: '%.80s' begins with 'UMBSCF1': scene buffers of umbrage-bake "
                     "import are not taken; submit the scene that it was made of",
                     index, path);
}

enum umb_status umbj_settings_text(const struct umbj_manifest *manifest,
                                   char text[UMBJ_SETTINGS_SIZE], struct umb_error *error)
{
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < manifest->setting_count; i++) {
        const struct umbj_setting *setting = &manifest->settings[i];
        const int count =
            snprintf(text + used, UMBJ_SETTINGS_SIZE - used, "--%s%s%s\n", setting->name,
                     setting->value[0] != '\0' ? "=" : "", setting->value);
        if (count < 0 || (size_t)count >= UMBJ_SETTINGS_SIZE - used) {
            return umb_fail(error, UMB_E_ARGUMENT, "settings: together over the limit of %d bytes",
                            UMBJ_SETTINGS_SIZE - 1);
        }
        used += (size_t)count;
    }
    return UMB_OK;
}

/* Returns the text whose hash is the key, malloc. No part of it contains control characters, so
 * parts cannot run together. */
static char *key_text(const struct umbj_manifest *manifest,
                      const struct umbj_bundle_file *const *sorted, const char *settings)
{
    const size_t size = 256 + strlen(settings) + (manifest->file_count + 1) * (UMBJ_PATH_MAX + 100);
    char *text = malloc(size), hash[UMB_ID_TEXT_SIZE];
    if (text == NULL) {
        return NULL;
    }
    size_t used = (size_t)snprintf(text, size, "umbrage bundle 1\nprogram %s\nscene %s\n%s",
                                   UMB_VERSION_TEXT, manifest->scene, settings);
    for (size_t i = 0; i < manifest->file_count; i++) {
        umb_id_to_text(sorted[i]->sha256, hash);
        used += (size_t)snprintf(text + used, size - used, "file %llu %s %s\n",
                                 (unsigned long long)sorted[i]->size, hash, sorted[i]->path);
    }
    return text;
}

enum umb_status umbj_manifest_key(const struct umbj_manifest *manifest,
                                  uint8_t key[UMBJ_HASH_BYTES], struct umb_error *error)
{
    char settings[UMBJ_SETTINGS_SIZE];
    UMB__TRY(umbj_settings_text(manifest, settings, error));
    const struct umbj_bundle_file **sorted = sort_files(manifest, compare_files);
    char *text = sorted != NULL ? key_text(manifest, sorted, settings) : NULL;
    free(sorted);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the manifest");
    }
    umbs_sha256_bytes(text, strlen(text), key);
    free(text);
    return UMB_OK;
}

enum umb_status umbj_manifest_prepare(const struct umbj_manifest *manifest, uint64_t max_bytes,
                                      struct umbj_prepared *prepared, struct umb_error *error)
{
    UMB__TRY(umbj_manifest_check(manifest, max_bytes, &prepared->bytes, error));
    UMB__TRY(umbj_manifest_key(manifest, prepared->key, error));
    return umbj_settings_text(manifest, prepared->settings, error);
}

/* Splits a line "--name=value", in place. */
static enum umb_status check_line(char *line, struct umb_error *error)
{
    if (strncmp(line, "--", 2) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings: '%.40s' is not --name or --name=value",
                        line);
    }
    char *equals = strchr(line, '=');
    if (equals != NULL) {
        *equals = '\0';
    }
    const struct umbj_setting setting = {line + 2, equals != NULL ? equals + 1 : ""};
    return check_setting(&setting, error);
}

enum umb_status umbj_settings_check(const char *text, struct umb_error *error)
{
    char copy[UMBJ_SETTINGS_SIZE];
    const size_t length = strlen(text);
    if (length >= sizeof copy || (length > 0 && text[length - 1] != '\n')) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "settings: %zu bytes must be below %d and end with a line's end", length,
                        UMBJ_SETTINGS_SIZE);
    }
    memcpy(copy, text, length + 1);
    for (char *line = copy, *next; *line != '\0'; line = next) {
        const size_t count = strcspn(line, "\n");
        line[count] = '\0';
        next = line + count + 1;
        UMB__TRY(check_line(line, error));
    }
    return UMB_OK;
}

enum umb_status umbj_scene_check(const char *scene, struct umb_error *error)
{
    UMB__TRY(check_path("scene", scene, error));
    return check_scene_name(scene, error);
}
