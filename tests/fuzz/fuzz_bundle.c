/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Files that `umbrage submit` collects for an untrusted scene, and the importer's checks of glTF as
 * a whole. The first byte picks: .obj with a material library (split at a zero byte), .gltf, .glb,
 * or the checks. Whatever the scene names, only regular files beneath its folder are sent.
 */
#define _XOPEN_SOURCE 700 /* realpath, symlink */
#include <limits.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/cli_bundle.h"
#include "bake/import/gltf.h"
#include "fuzz.h"
#include "fuzz_folder.h"

static char scenes[300]; /* the scene's folder, absolute, without links */

static void path_of(char path[600], const char *name)
{
    (void)snprintf(path, 600, "%s/%s", scenes, name);
}

/* What lies beside the scene, and what must not be sent. */
static void make_folder(void)
{
    char path[600];
    if (scenes[0] != '\0') {
        return;
    }
    (void)snprintf(scenes, sizeof scenes, "%s/scene", fuzz_folder());
    FUZZ_DEMAND(mkdir(scenes, 0700) == 0);
    static const char *const folders[] = {"t", "t/u", "a b"};
    static const char *const files[] = {"a.bin", "b.png", "t/c.png", "t/u/d.bin", "a b/e.png"};
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++) {
        path_of(path, folders[i]);
        FUZZ_DEMAND(mkdir(path, 0700) == 0);
    }
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        path_of(path, files[i]);
        fuzz_write(path, files[i], 3);
    }
    path_of(path, "../secret");
    fuzz_write(path, "key", 3);
    path_of(path, "link");
    FUZZ_DEMAND(symlink("../secret", path) == 0);
    path_of(path, "out");
    FUZZ_DEMAND(symlink("..", path) == 0);
    path_of(path, "in");
    FUZZ_DEMAND(symlink("t", path) == 0);
}

static void check_bundle(const char *scene, const struct umbc_bundle *bundle)
{
    FUZZ_DEMAND(bundle->count >= 1 && bundle->count <= UMBC_BUNDLE_FILES_MAX);
    FUZZ_DEMAND(strcmp(bundle->files[0].source, scene) == 0);
    for (size_t i = 0; i < bundle->count; i++) {
        const char *name = bundle->files[i].path;
        struct stat facts;
        char *found = realpath(bundle->files[i].source, NULL);
        FUZZ_DEMAND(found != NULL && strncmp(found, scenes, strlen(scenes)) == 0);
        FUZZ_DEMAND(found[strlen(scenes)] == '/');
        FUZZ_DEMAND(stat(found, &facts) == 0 && S_ISREG(facts.st_mode));
        FUZZ_DEMAND(name[0] != '/' && name[0] != '\0' && strstr(name, "..") == NULL);
        for (size_t k = 0; k < i; k++) {
            FUZZ_DEMAND(strcmp(bundle->files[k].path, name) != 0);
        }
        free(found);
    }
}

static void gather(const char *name, const uint8_t *data, size_t size)
{
    char scene[600], library[600];
    struct umbc_bundle bundle;
    struct umb_error error = {0};
    const uint8_t *zero = strcmp(name, "s.obj") == 0 ? memchr(data, 0, size) : NULL;
    path_of(scene, name);
    path_of(library, "m.mtl");
    fuzz_write(scene, data, zero != NULL ? (size_t)(zero - data) : size);
    if (zero != NULL) {
        fuzz_write(library, zero + 1, size - (size_t)(zero - data) - 1);
    }
    if (umbc_bundle_gather(scene, 1, &bundle, &error) == UMB_OK) {
        check_bundle(scene, &bundle);
    } else {
        FUZZ_DEMAND(error.message[0] != '\0');
    }
    umbc_bundle_finish(&bundle);
    (void)unlink(library);
}

/* The chunk of JSON of a GLB, with right lengths. */
static void gather_glb(const uint8_t *data, size_t size)
{
    uint8_t *file = calloc(1, size + 20);
    FUZZ_DEMAND(file != NULL);
    memcpy(file, "glTF\2\0\0\0", 8);
    const uint32_t whole = (uint32_t)size + 20, json = (uint32_t)size;
    memcpy(file + 8, &whole, 4);
    memcpy(file + 12, &json, 4);
    memcpy(file + 16, "JSON", 4);
    memcpy(file + 20, data, size);
    gather("s.glb", file, size + 20);
    free(file);
}

static void open_gltf(const uint8_t *data, size_t size)
{
    struct umb_error error = {0};
    struct umbb_import job = {.file = {.bytes = (const char *)data, .size = size}};
    struct umbb_gltf gltf;
    const enum umb_status status = umbb_gltf_open(&gltf, &job, &error);
    umbb_gltf_close(&gltf);
    FUZZ_DEMAND(status == UMB_OK || error.message[0] != '\0');
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0 || size > 32768) {
        return 0;
    }
    make_folder();
    uint8_t *exact = malloc(size);
    FUZZ_DEMAND(exact != NULL);
    memcpy(exact, data + 1, size - 1);
    switch (data[0] % 4) {
    case 0:
        gather("s.obj", exact, size - 1);
        break;
    case 1:
        gather("s.gltf", exact, size - 1);
        break;
    case 2:
        gather_glb(exact, size - 1);
        break;
    default:
        open_gltf(exact, size - 1);
    }
    free(exact);
    return 0;
}
