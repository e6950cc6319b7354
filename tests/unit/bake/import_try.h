/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_UNIT_BAKE_IMPORT_TRY_H
#define UMBRAGE_TESTS_UNIT_BAKE_IMPORT_TRY_H
/*
 * Imports for tests: complete imports through the import process; and a single reader in this
 * process, on a block of exactly the file's size, for sweeps under ASan. A test program that
 * includes this starts with
 *     if (is_import_child(argc, argv)) { return umbb_import_child(argc, argv); }
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bake/import/import_job.h"
#include "common/open_beneath.h"
#include "scene/scene.h"
#include "scene/scene_contract.h"
#include "tool/exit_code.h"

static char try_folder[256];

static inline int is_import_child(int argc, char **argv)
{
    return argc == UMBS_CHILD_ARG_COUNT && strcmp(argv[1], UMBS_CHILD_COMMAND) == 0;
}

static inline int make_try_folder(void **state)
{
    (void)state;
    const char *base = getenv("TMPDIR");
    (void)snprintf(try_folder, sizeof(try_folder), "%s/umbrage-test-XXXXXX",
                   base != NULL ? base : "/tmp");
    return mkdtemp(try_folder) != NULL ? 0 : -1;
}

static inline int remove_try_folder(void **state)
{
    (void)state;
    return rmdir(try_folder);
}

static inline const char *try_path(const char *name)
{
    static char path[512];
    (void)snprintf(path, sizeof(path), "%s/%s", try_folder, name);
    return path;
}

static inline void put_file(const char *name, const void *bytes, size_t size)
{
    FILE *file = fopen(try_path(name), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static inline void drop_file(const char *name)
{
    assert_int_equal(unlink(try_path(name)), 0);
}

static int try_look; /* 1: imports read what pictures need, too */

/* Writes a file, imports it through the process, and removes it. */
static inline enum umb_status try_bytes(const char *name, const void *bytes, size_t size,
                                        struct umbs_scene **scene, struct umb_error *error)
{
    const struct umbs_import_options options = {
        .importer_path = "/proc/self/exe", .timeout_s = 60, .look = try_look};
    memset(error, 0, sizeof(*error));
    put_file(name, bytes, size);
    enum umb_status status = umbs_scene_import(try_path(name), &options, scene, error);
    drop_file(name);
    return status;
}

/* Does the same with a text that must be imported. */
static inline struct umbs_scene *import_text(const char *name, const char *text)
{
    struct umbs_scene *scene;
    struct umb_error error;
    enum umb_status status = try_bytes(name, text, strlen(text), &scene, &error);
    if (status != UMB_OK) {
        print_error("%s: %s\n", name, error.message);
    }
    assert_int_equal(status, UMB_OK);
    return scene;
}

/* Imports a text for shapes alone and for pictures: the hashes must be equal, and the first must
 * have no normals. Returns the second. */
static inline struct umbs_scene *import_look(const char *name, const char *text)
{
    uint8_t hash[2][UMB_ID_BYTES];
    struct umbs_scene *scene = import_text(name, text);
    umbs_scene_hash(&scene->view, hash[0]);
    assert_null(scene->view.normals);
    umbs_scene_destroy(scene);
    try_look = 1;
    scene = import_text(name, text);
    try_look = 0;
    umbs_scene_hash(&scene->view, hash[1]);
    assert_memory_equal(hash[0], hash[1], sizeof hash[0]);
    return scene;
}

/* The normal at a corner of a triangle of the first mesh. */
static inline void expect_normal(const struct umbs_scene *scene, size_t triangle, int corner,
                                 double x, double y, double z)
{
    assert_non_null(scene->view.normals);
    const float *normal = scene->view.normals[scene->view.triangles[triangle][corner]];
    assert_true(fabs((double)normal[0] - x) < 1e-6 && fabs((double)normal[1] - y) < 1e-6 &&
                fabs((double)normal[2] - z) < 1e-6);
}

/* Does the same with a text that must be refused, with given words in the message. */
static inline void expect_refusal(const char *name, const char *text, const char *words)
{
    struct umbs_scene *scene;
    struct umb_error error;
    enum umb_status status = try_bytes(name, text, strlen(text), &scene, &error);
    if (status != UMB_E_BAD_SCENE || strstr(error.message, words) == NULL) {
        print_error("%s: %s '%s' lacks '%s'\n", name, umb_status_name(status), error.message,
                    words);
    }
    assert_int_equal(status, UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, words));
    assert_int_equal(umbu_exit_code(status), 65);
}

static inline void expect_corner(const struct umbs_scene *scene, size_t triangle, int corner,
                                 double x, double y, double z)
{
    double(*corners)[3][3];
    size_t count;
    assert_int_equal(umbs_scene_flatten(&scene->view, &corners, NULL, &count, NULL), UMB_OK);
    assert_in_range(triangle, 0, count - 1);
    const double *at = corners[triangle][corner];
    if (!(at[0] == x && at[1] == y && at[2] == z)) {
        print_error("triangle %zu corner %d is %.17g %.17g %.17g\n", triangle, corner, at[0], at[1],
                    at[2]);
        fail();
    }
    free(corners);
}

struct try_bytes {
    unsigned char *data;
    size_t size;
};

static inline enum umb_status try_append(void *user, const void *data, size_t count)
{
    struct try_bytes *bytes = user;
    unsigned char *grown = realloc(bytes->data, bytes->size + count);
    assert_non_null(grown);
    memcpy(grown + bytes->size, data, count);
    bytes->data = grown;
    bytes->size += count;
    return UMB_OK;
}

/* Runs one reader in this process. What the reader accepts must be a valid scene buffer. */
static inline enum umb_status read_here(enum umb_status (*reader)(struct umbb_import *,
                                                                  struct umb_error *),
                                        const void *bytes, size_t size)
{
    struct umb_error error = {0};
    char *block = malloc(size > 0 ? size : 1);
    assert_non_null(block);
    memcpy(block, bytes, size);
    struct umbb_import job = {.file = {.bytes = block, .size = size},
                              .folder = {AT_FDCWD, umbs_open_beneath},
                              .max_input_bytes = 1 << 20};
    umbs_scene_builder_init(&job.scene, UMBS_FORMAT_OBJ, 1, 100000);
    enum umb_status status = reader(&job, &error);
    if (status == UMB_OK) {
        struct try_bytes out = {0};
        struct umbs_scene_view view;
        const struct umb_sink sink = {try_append, &out};
        assert_int_equal(umbs_scene_builder_write(&job.scene, &sink, &error), UMB_OK);
        if (umbs_scene_view(out.data, out.size, &view, &error) != UMB_OK) {
            print_error("%s\n", error.message);
            fail();
        }
        free(out.data);
    } else {
        assert_true(error.message[0] != '\0');
    }
    umbs_scene_builder_finish(&job.scene);
    free(block);
    return status;
}

#endif
