/* SPDX-License-Identifier: Apache-2.0 */
/* Scene buffers in files: checks of their owners, and content that is refused. */
#define _DEFAULT_SOURCE /* chown, mkdtemp */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "scene/scene_builder.h"
#include "scene/scene_file.h"

#define WHAT "--scene-buffer"

struct fixture {
    char folder[64], file[96], link[96];
    struct umb_error error;
    int asked; /* calls of shut_in */
    enum umb_status answer;
};

struct bytes {
    unsigned char data[4096];
    size_t size;
};

static enum umb_status append_bytes(void *user, const void *data, size_t count)
{
    struct bytes *bytes = user;
    assert_true(count <= sizeof bytes->data - bytes->size);
    memcpy(bytes->data + bytes->size, data, count);
    bytes->size += count;
    return UMB_OK;
}

/* A scene of one triangle. */
static void build(struct bytes *bytes)
{
    static const uint32_t corners[3] = {0, 1, 2};
    const struct umb_sink sink = {append_bytes, bytes};
    struct umbs_scene_builder builder;
    bytes->size = 0;
    umbs_scene_builder_init(&builder, UMBS_FORMAT_OBJ, 1, 0);
    for (int i = 0; i < 3; i++) {
        const double position[3] = {i == 1, i == 2, 0};
        assert_int_equal(umbs_scene_add_vertex(&builder, position, NULL, NULL), UMB_OK);
    }
    assert_int_equal(umbs_scene_add_triangle(&builder, corners, NULL), UMB_OK);
    assert_int_equal(umbs_scene_end_mesh(&builder, 0, 3, 1, UMBS_NO_INDEX, NULL), UMB_OK);
    assert_int_equal(umbs_scene_add_instance(&builder, 0, NULL, NULL), UMB_OK);
    assert_int_equal(umbs_scene_builder_write(&builder, &sink, NULL), UMB_OK);
    umbs_scene_builder_finish(&builder);
}

static int setup(void **state)
{
    static struct fixture f;
    static struct bytes bytes;
    f = (struct fixture){.answer = UMB_OK};
    snprintf(f.folder, sizeof f.folder, "/tmp/umbrage-scene-file-XXXXXX");
    assert_non_null(mkdtemp(f.folder));
    snprintf(f.file, sizeof f.file, "%s/scene", f.folder);
    snprintf(f.link, sizeof f.link, "%s/link", f.folder);
    build(&bytes);
    const struct umbs_scene scene = {.map = bytes.data, .map_bytes = bytes.size};
    assert_int_equal(umbs_scene_save(&scene, f.file, &f.error), UMB_OK);
    *state = &f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    (void)unlink(f->link);
    (void)unlink(f->file);
    return rmdir(f->folder);
}

static enum umb_status shut_in(void *user, const struct umbs_importer *importer,
                               struct umb_error *error)
{
    struct fixture *f = user;
    assert_null(importer);
    f->asked++;
    return f->answer == UMB_OK ? UMB_OK : umb_fail(error, f->answer, "no sandbox");
}

static enum umb_status load(struct fixture *f, const char *path, uint64_t max_triangles)
{
    const struct umbs_import_options options = {
        .max_triangles = max_triangles, .shut_in = shut_in, .user = f};
    struct umbs_scene *scene;
    const enum umb_status status = umbs_scene_load(WHAT, path, &options, &scene, &f->error);
    assert_int_equal(scene != NULL, status == UMB_OK);
    if (status == UMB_OK) {
        assert_int_equal(scene->view.world_triangle_count, 1);
    }
    umbs_scene_destroy(scene);
    return status;
}

static void what_was_saved_is_ones_own_and_loads(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    assert_int_equal(stat(f->file, &facts), 0);
    assert_int_equal(facts.st_mode & 07777, 0600);
    assert_int_equal(load(f, f->file, 0), UMB_OK);
    assert_int_equal(f->asked, 1);
    char here[256];
    assert_non_null(getcwd(here, sizeof here));
    assert_int_equal(chdir(f->folder), 0);
    assert_int_equal(load(f, "scene", 0), UMB_OK);
    assert_int_equal(chdir(here), 0);
}

/* The message must name the field, the file, the fault and the reason. */
static void assert_not_proven(struct fixture *f, const char *at_fault, const char *why)
{
    char words[160];
    snprintf(words, sizeof words, "'%s' %s", at_fault, why);
    f->asked = 0;
    assert_int_equal(load(f, f->file, 0), UMB_E_PERMISSION);
    assert_int_equal(f->asked, 0); /* nothing was read */
    assert_non_null(strstr(f->error.message, WHAT));
    assert_non_null(strstr(f->error.message, words));
}

static void what_others_can_write_is_refused(void **state)
{
    static const mode_t modes[] = {0620, 0602, 0666};
    struct fixture *f = *state;
    for (int i = 0; i < 3; i++) {
        assert_int_equal(chmod(f->file, modes[i]), 0);
        assert_not_proven(f, f->file, "has mode 06");
        assert_non_null(strstr(f->error.message, "chmod go-w"));
        assert_int_equal(chmod(f->file, 0644), 0);
        assert_int_equal(load(f, f->file, 0), UMB_OK);
        assert_int_equal(chmod(f->folder, 0700 | modes[i]), 0);
        assert_not_proven(f, f->folder, "has mode 07");
        assert_int_equal(chmod(f->folder, 01777), 0); /* sticky: a file's name can still be taken */
        assert_not_proven(f, f->folder, "has mode 1777");
        assert_int_equal(chmod(f->folder, 0755), 0);
        assert_int_equal(load(f, f->file, 0), UMB_OK);
    }
}

static void what_another_user_owns_is_refused(void **state)
{
    struct fixture *f = *state;
    if (geteuid() != 0) {
        skip();
    }
    assert_int_equal(chown(f->file, 12345, 0), 0);
    assert_not_proven(f, f->file, "belongs to uid 12345");
    assert_int_equal(chown(f->file, 0, 0), 0);
    assert_int_equal(chown(f->folder, 12345, 0), 0);
    assert_not_proven(f, f->folder, "belongs to uid 12345");
    assert_int_equal(chown(f->folder, 0, 0), 0);
    assert_int_equal(load(f, f->file, 0), UMB_OK);
}

/* Another user could replace one of the folders above by a folder of its own. */
static void a_folder_above_that_others_can_write_is_refused(void **state)
{
    struct fixture *f = *state;
    char below[96], file[128];
    snprintf(below, sizeof below, "%s/below", f->folder);
    snprintf(file, sizeof file, "%s/scene", below);
    assert_int_equal(mkdir(below, 0700), 0);
    assert_int_equal(rename(f->file, file), 0);
    assert_int_equal(load(f, file, 0), UMB_OK);
    assert_int_equal(chmod(f->folder, 0770), 0);
    assert_int_equal(load(f, file, 0), UMB_E_PERMISSION);
    assert_non_null(strstr(f->error.message, "has mode 0770"));
    assert_int_equal(chmod(f->folder, 01777), 0); /* sticky: theirs cannot replace ours */
    assert_int_equal(load(f, file, 0), UMB_OK);
    assert_int_equal(chmod(f->folder, 0700), 0);
    assert_int_equal(rename(file, f->file), 0);
    assert_int_equal(rmdir(below), 0);
}

/* Another user could have linked the file into a folder where it is forgotten. */
static void a_file_of_two_names_is_refused(void **state)
{
    struct fixture *f = *state;
    assert_int_equal(link(f->file, f->link), 0);
    assert_int_equal(load(f, f->file, 0), UMB_E_PERMISSION);
    assert_non_null(strstr(f->error.message, "2 hard links"));
    assert_int_equal(unlink(f->link), 0);
    assert_int_equal(load(f, f->file, 0), UMB_OK);
}

static void only_regular_files_are_opened(void **state)
{
    struct fixture *f = *state;
    assert_int_equal(symlink(f->file, f->link), 0);
    assert_int_equal(load(f, f->link, 0), UMB_E_NO_INPUT);
    assert_non_null(strstr(f->error.message, "symbolic link"));
    assert_int_equal(unlink(f->link), 0);
    assert_int_equal(mkfifo(f->link, 0600), 0);
    assert_int_equal(load(f, f->link, 0), UMB_E_NO_INPUT);
    assert_int_equal(load(f, f->folder, 0), UMB_E_PERMISSION); /* of /tmp: anyone can write there */
    assert_int_equal(unlink(f->file), 0);
    assert_int_equal(load(f, f->file, 0), UMB_E_NO_INPUT);
    assert_int_equal(f->asked, 0);
}

static void bytes_are_read_after_shutting_in_and_checked(void **state)
{
    struct fixture *f = *state;
    f->answer = UMB_E_UNAVAILABLE;
    assert_int_equal(load(f, f->file, 0), UMB_E_UNAVAILABLE);
    assert_string_equal(f->error.message, "no sandbox");
    f->answer = UMB_OK;
    const int fd = open(f->file, O_RDWR);
    struct stat facts;
    assert_true(fd >= 0);
    assert_int_equal(fstat(fd, &facts), 0);
    for (off_t at = 0; at < facts.st_size; at += 7) {
        unsigned char byte;
        assert_int_equal(pread(fd, &byte, 1, at), 1);
        byte ^= 0x20;
        assert_int_equal(pwrite(fd, &byte, 1, at), 1);
        assert_int_equal(load(f, f->file, 0), UMB_E_BAD_SCENE);
        byte ^= 0x20;
        assert_int_equal(pwrite(fd, &byte, 1, at), 1);
    }
    assert_int_equal(load(f, f->file, 0), UMB_OK);
    for (off_t size = facts.st_size - 1; size >= 0; size -= 13) {
        assert_int_equal(ftruncate(fd, size), 0);
        assert_int_equal(load(f, f->file, 0), UMB_E_BAD_SCENE);
    }
    (void)close(fd);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_was_saved_is_ones_own_and_loads, setup, teardown),
        cmocka_unit_test_setup_teardown(what_others_can_write_is_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(what_another_user_owns_is_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(a_folder_above_that_others_can_write_is_refused, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(a_file_of_two_names_is_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(only_regular_files_are_opened, setup, teardown),
        cmocka_unit_test_setup_teardown(bytes_are_read_after_shutting_in_and_checked, setup,
                                        teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
