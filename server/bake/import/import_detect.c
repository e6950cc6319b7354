/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Choice of a file's reader. Extension and content must agree. If an extension is wrong, Assimp
 * tries all its dozens of importers on the content, and most of those cannot be trusted.
 */
#include "bake/import/import_job.h"

#include <string.h>
#include <strings.h>

#include "bake/import/text_number.h"
#include "scene/scene_file.h"

#define TEXT_PROBE_BYTES 4096
#define STL_HEADER_BYTES 84
#define STL_FACET_BYTES  50

static int starts_with(const struct umbb_file *file, const char *magic)
{
    size_t length = strlen(magic);
    return file->size >= length && memcmp(file->bytes, magic, length) == 0;
}

static int is_text(const struct umbb_file *file)
{
    size_t probe = file->size < TEXT_PROBE_BYTES ? file->size : TEXT_PROBE_BYTES;
    return memchr(file->bytes, '\0', probe) == NULL;
}

/* The first byte that is not a blank or part of a byte order mark, or 0. */
static char first_char(const struct umbb_file *file)
{
    size_t at = starts_with(file, "\xef\xbb\xbf") ? 3 : 0;
    while (at < file->size && (file->bytes[at] == ' ' || file->bytes[at] == '\t' ||
                               file->bytes[at] == '\r' || file->bytes[at] == '\n')) {
        at++;
    }
    return at < file->size ? file->bytes[at] : '\0';
}

static const char *gltf_fault(const struct umbb_file *file)
{
    return first_char(file) == '{' ? NULL : "is not JSON";
}

static const char *glb_fault(const struct umbb_file *file)
{
    if (!starts_with(file, "glTF") || file->size < 12) {
        return "has no GLB header";
    }
    if (umbb_load_u32(file->bytes + 4) != 2) {
        return "is GLB of another version than 2";
    }
    return umbb_load_u32(file->bytes + 8) <= file->size ? NULL : "ends before the length it states";
}

static const char *obj_fault(const struct umbb_file *file)
{
    if (!is_text(file) || starts_with(file, "glTF") || starts_with(file, "ply\n") ||
        starts_with(file, "ply\r") || first_char(file) == '{' || first_char(file) == '<') {
        return "is not OBJ text";
    }
    return NULL;
}

static const char *ply_fault(const struct umbb_file *file)
{
    return starts_with(file, "ply\n") || starts_with(file, "ply\r\n") ? NULL
                                                                      : "does not begin with 'ply'";
}

static int is_binary_stl(const struct umbb_file *file)
{
    return file->size >= STL_HEADER_BYTES &&
           (file->size - STL_HEADER_BYTES) / STL_FACET_BYTES == umbb_load_u32(file->bytes + 80) &&
           (file->size - STL_HEADER_BYTES) % STL_FACET_BYTES == 0;
}

/* Also reports an empty file, because Assimp has no clear message for it. */
static const char *stl_fault(const struct umbb_file *file)
{
    if (is_binary_stl(file)) {
        return file->size > STL_HEADER_BYTES ? NULL : "has no triangles (binary STL of 0 facets)";
    }
    if (!starts_with(file, "solid") || !is_text(file)) {
        return "is neither text STL nor binary STL whose size fits its count of facets";
    }
    const char *at = file->bytes;
    const char *end = file->bytes + file->size;
    while ((at = memchr(at, 'v', (size_t)(end - at))) != NULL) {
        if (end - at >= 6 && memcmp(at, "vertex", 6) == 0) {
            return NULL;
        }
        at++;
    }
    return "has no triangles (text STL without a facet)";
}

enum umb_status umbb_import_detect(const char *name, const struct umbb_file *file,
                                   enum umbb_kind *kind, struct umb_error *error)
{
    static const struct {
        const char *extension;
        enum umbb_kind kind;
        const char *(*fault)(const struct umbb_file *file);
    } known[] = {
        {".gltf", UMBB_KIND_GLTF, gltf_fault}, {".glb", UMBB_KIND_GLB, glb_fault},
        {".obj", UMBB_KIND_OBJ, obj_fault},    {".ply", UMBB_KIND_PLY, ply_fault},
        {".stl", UMBB_KIND_STL, stl_fault},
    };
    const char *extension = strrchr(name, '.');
    if (starts_with(file, UMBS_SCENE_FILE_MAGIC)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "the file is a scene buffer of umbrage-bake import (UMBSCF1), not a scene; "
                        "if it is your own, give it by --scene-buffer");
    }
    for (size_t i = 0; extension != NULL && i < sizeof(known) / sizeof(known[0]); i++) {
        if (strcasecmp(extension, known[i].extension) != 0) {
            continue;
        }
        if (file->size == 0) {
            return umb_fail(error, UMB_E_BAD_SCENE, "the file is empty");
        }
        const char *fault = known[i].fault(file);
        if (fault != NULL) {
            return umb_fail(error, UMB_E_BAD_SCENE, "the file %s", fault);
        }
        *kind = known[i].kind;
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_BAD_SCENE,
                    "format '%.16s' is not supported (.gltf .glb .obj .ply .stl)",
                    extension != NULL ? extension : "without extension");
}
