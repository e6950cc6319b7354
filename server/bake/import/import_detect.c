/* SPDX-License-Identifier: Apache-2.0 */
/* Choice of a file's reader: extension and content must agree. */
#include "bake/import/import_job.h"

#include <string.h>
#include <strings.h>

#include "bake/import/text_number.h"
#include "scene/scene_file.h"

#define TEXT_PROBE_BYTES 4096

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

static const char *stl_fault(const struct umbb_file *file)
{
    return umbb_stl_is_binary(file) || (starts_with(file, "solid") && is_text(file))
               ? NULL
               : "is neither text STL nor binary STL whose size fits its count of facets";
}

enum umb_status umbb_import_detect(const char *name, const struct umbb_file *file,
                                   const struct umbb_format **format, struct umb_error *error)
{
    static const struct umbb_format known[] = {
        {".gltf", UMBS_FORMAT_GLTF, gltf_fault, umbb_gltf_read},
        {".glb", UMBS_FORMAT_GLTF, glb_fault, umbb_gltf_read},
        {".obj", UMBS_FORMAT_OBJ, obj_fault, umbb_obj_read},
        {".ply", UMBS_FORMAT_PLY, ply_fault, umbb_ply_read},
        {".stl", UMBS_FORMAT_STL, stl_fault, umbb_stl_read},
    };
    const char *extension = strrchr(name, '.');
    if (starts_with(file, UMBS_SCENE_FILE_MAGIC)) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "the file is a scene buffer of umbrage-bake import (UMBSCF1), not a scene; "
                        "if it is your own, give it by --scene-buffer");
    }
    for (size_t i = 0; extension != NULL && i < sizeof(known) / sizeof(known[0]); i++) {
        if (strcasecmp(extension, known[i].extension) == 0) {
            const char *fault = file->size == 0 ? "is empty" : known[i].fault(file);
            *format = &known[i];
            return fault == NULL ? UMB_OK : umb_fail(error, UMB_E_BAD_SCENE, "the file %s", fault);
        }
    }
    return umb_fail(error, UMB_E_BAD_SCENE,
                    "format '%.16s' is not supported (.gltf .glb .obj .ply .stl)",
                    extension != NULL ? extension : "without extension");
}
