/* SPDX-License-Identifier: Apache-2.0 */
/* Manifests and uploads from strangers: what is accepted, what is refused, and what is left
 * behind. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/upload.h"

#define CONTENT "v 0 0 0\n"

struct fixture {
    char folder[64];
    int fd;
    struct umb_error error;
    struct umbj_bundle_file files[3];
    struct umbj_setting settings[2];
    struct umbj_manifest manifest;
};

static int setup(void **state)
{
    static const char *const names[] = {"incoming", "bundles", "work"};
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-upload-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    f->fd = open(f->folder, O_RDONLY | O_DIRECTORY);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(umbj_folder_make(f->fd, names[i], &f->error), UMB_OK);
    }
    static const char *const paths[] = {"a.obj", "textures/deep/b.png", "empty"};
    for (int i = 0; i < 3; i++) {
        f->files[i] = (struct umbj_bundle_file){.path = paths[i], .size = i < 2 ? 8 : 0};
        umbs_sha256_bytes(CONTENT, f->files[i].size, f->files[i].sha256);
    }
    f->settings[0] = (struct umbj_setting){"resolution", "64"};
    f->settings[1] = (struct umbj_setting){"sun", "90,45"};
    f->manifest = (struct umbj_manifest){.scene = "a.obj",
                                         .files = f->files,
                                         .file_count = 3,
                                         .settings = f->settings,
                                         .setting_count = 2};
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbj_folder_empty(f->fd, ".");
    close(f->fd);
    rmdir(f->folder);
    free(f);
    return 0;
}

static enum umb_status check(struct fixture *f)
{
    uint64_t bytes;
    return umbj_manifest_check(&f->manifest, 1000, &bytes, &f->error);
}

static struct umbj_upload *begin(struct fixture *f, uint8_t key[UMBJ_HASH_BYTES])
{
    struct umbj_upload *upload;
    assert_int_equal(check(f), UMB_OK);
    assert_int_equal(umbj_manifest_key(&f->manifest, key, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_begin(f->folder, &f->manifest, key, NULL, &upload, &f->error),
                     UMB_OK);
    return upload;
}

static size_t names_in(struct fixture *f, const char *folder)
{
    struct umbj_names names;
    int fd = openat(f->fd, folder, O_RDONLY | O_DIRECTORY);
    assert_int_equal(umbj_names_read(fd, &names), 0);
    const size_t count = names.count;
    umbj_names_finish(&names);
    close(fd);
    return count;
}

static void a_bundle_is_unpacked_however_its_bytes_are_cut(void **state)
{
    struct fixture *f = *state;
    for (size_t cut = 0; cut <= 16; cut++) {
        char path[200], id[UMB_ID_TEXT_SIZE], read_back[16] = "";
        uint8_t key[UMBJ_HASH_BYTES];
        struct umbj_upload *upload = begin(f, key);
        assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT, cut, &f->error), UMB_OK);
        assert_int_equal(umbj_upload_write(upload, &(CONTENT CONTENT)[cut], 16 - cut, &f->error),
                         UMB_OK);
        assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_OK);
        umbj_upload_destroy(upload);
        umb_id_to_text(key, id);
        snprintf(path, sizeof path, "%s/bundles/%s/textures/deep/b.png", f->folder, id);
        int fd = open(path, O_RDONLY);
        assert_true(fd >= 0);
        assert_int_equal(read(fd, read_back, sizeof read_back), 8);
        close(fd);
        assert_memory_equal(read_back, CONTENT, 8);
        assert_int_equal(names_in(f, "incoming"), 0);
        assert_int_equal(names_in(f, "bundles"), 1); /* a second one of that key is not kept */
    }
}

/* A scene buffer must be refused, however its bytes arrive and under every name: the form is for
 * this program's own stages. */
static void a_scene_buffer_is_refused_under_every_name(void **state)
{
    static const char *const names[] = {"a.glb", "a.gltf", "a.obj", "a.ply", "a.stl", "a.png"};
    static const char buffer[] = "UMBSCF1\nrest";
    struct fixture *f = *state;
    for (size_t i = 0; i < 6; i++) {
        for (size_t cut = 0; cut < 8; cut++) {
            uint8_t key[UMBJ_HASH_BYTES];
            f->files[0].path = i < 5 ? names[i] : "a.obj";
            f->files[1].path = i < 5 ? "b.png" : names[i];
            f->manifest.scene = f->files[0].path;
            const size_t before = i < 5 ? 0 : 8;
            f->files[0].size = i < 5 ? sizeof buffer - 1 : 8;
            f->files[1].size = i < 5 ? 8 : sizeof buffer - 1;
            struct umbj_upload *upload = begin(f, key);
            assert_int_equal(umbj_upload_write(upload, CONTENT, before, &f->error), UMB_OK);
            assert_int_equal(umbj_upload_write(upload, buffer, cut, &f->error), UMB_OK);
            assert_int_equal(
                umbj_upload_write(upload, buffer + cut, sizeof buffer - 1 - cut, &f->error),
                UMB_E_ARGUMENT);
            assert_non_null(strstr(f->error.message, "UMBSCF1"));
            assert_non_null(strstr(f->error.message, names[i]));
            umbj_upload_destroy(upload);
            assert_int_equal(names_in(f, "incoming") + names_in(f, "bundles"), 0);
        }
    }
}

static void an_upload_that_ends_early_leaves_nothing(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    for (size_t count = 0; count < 16; count++) {
        struct umbj_upload *upload = begin(f, key);
        assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT, count, &f->error), UMB_OK);
        assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_E_ARGUMENT);
        umbj_upload_destroy(upload);
        assert_int_equal(names_in(f, "incoming") + names_in(f, "bundles"), 0);
    }
}

static void bytes_that_are_not_the_manifests_are_refused(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    struct umbj_upload *upload = begin(f, key);
    assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT "x", 17, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "more"));
    umbj_upload_destroy(upload);
    upload = begin(f, key);
    assert_int_equal(umbj_upload_write(upload, "v 0 0 1\n", 8, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "files[0].sha256"));
    umbj_upload_destroy(upload);
}

static void the_key_is_of_content_and_not_of_order(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES], other[UMBJ_HASH_BYTES];
    assert_int_equal(umbj_manifest_key(&f->manifest, key, &f->error), UMB_OK);
    const struct umbj_bundle_file first = f->files[0];
    f->files[0] = f->files[1];
    f->files[1] = first;
    assert_int_equal(umbj_manifest_key(&f->manifest, other, &f->error), UMB_OK);
    assert_memory_equal(key, other, sizeof key);
    const struct umbj_setting setting =
        f->settings[0]; /* lights keep the order they are given in */
    f->settings[0] = f->settings[1];
    f->settings[1] = setting;
    assert_int_equal(umbj_manifest_key(&f->manifest, other, &f->error), UMB_OK);
    assert_memory_not_equal(key, other, sizeof key);
    f->settings[1].value = "65";
    uint8_t third[UMBJ_HASH_BYTES];
    assert_int_equal(umbj_manifest_key(&f->manifest, third, &f->error), UMB_OK);
    assert_memory_not_equal(third, other, sizeof other);
}

static void paths_that_could_leave_the_folder_are_refused(void **state)
{
    static const char *const paths[] = {
        "",   "/a.obj", "..", "../a.obj", "a/../b.obj", "./a.obj",  "a//b.obj",
        "a/", "a/..",   ".",  "a\\b.obj", "a\nb.obj",   "a\x7f.obj"};
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; i++) {
        f->files[1].path = paths[i];
        assert_int_equal(check(f), UMB_E_ARGUMENT);
        assert_non_null(strstr(f->error.message, "files[1].path"));
    }
    char deep[2 * UMBJ_PATH_DEPTH_MAX + 8] = "";
    for (int i = 0; i <= UMBJ_PATH_DEPTH_MAX; i++) {
        memcpy(deep + 2 * i, "a/", 2);
    }
    deep[2 * UMBJ_PATH_DEPTH_MAX + 1] = '\0';
    f->files[1].path = deep;
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->files[1].path = "a.obj"; /* twice */
    assert_int_equal(check(f), UMB_E_ARGUMENT);
}

static void limits_are_met_before_anything_is_written(void **state)
{
    struct fixture *f = *state;
    f->files[1].size = UINT64_MAX; /* the sum must not wrap */
    assert_int_equal(check(f), UMB_E_TOO_LARGE);
    f->files[1].size = 8;
    f->settings[0].name = "output";
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->settings[0] = (struct umbj_setting){"resolution", "64\n--output=x"};
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->settings[0] = (struct umbj_setting){"static", "yes"};
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->settings[0].value = "";
    assert_int_equal(check(f), UMB_OK);
    f->manifest.scene = "empty";
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->manifest.scene = "b.obj";
    assert_int_equal(check(f), UMB_E_ARGUMENT);
    f->manifest.scene = "a.obj";
    f->manifest.priority = 11;
    assert_int_equal(check(f), UMB_E_ARGUMENT);
}

static void names_that_differ_only_by_case_are_one_name(void **state)
{
    static const struct {
        const char *one, *other;
        int is_taken;
    } cases[] = {
        {"b.ply", "B.ply", 0},      {"t/b.ply", "T/c.ply", 0},   {"t/b.ply", "t/B.ply", 0},
        {"t/u/b", "t/U/c", 0},      {"t/b.ply", "t/c.ply", 1},   {"b.ply", "b.plyx", 1},
        {"tt/b.ply", "T/b.ply", 1}, {"\xc3\xa4", "\xc3\x84", 1}, {"b[", "b{", 1},
    };
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        f->files[1].path = cases[i].one;
        f->files[2].path = cases[i].other;
        assert_int_equal(check(f), cases[i].is_taken ? UMB_OK : UMB_E_ARGUMENT);
        if (!cases[i].is_taken) {
            assert_non_null(strstr(f->error.message, cases[i].one));
            assert_non_null(strstr(f->error.message, cases[i].other));
            assert_non_null(strstr(f->error.message, "only by case"));
        }
    }
}

static void writing_ends_when_the_server_does(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    atomic_int stop = 0;
    struct umbj_upload *upload = NULL;
    assert_int_equal(umbj_manifest_key(&f->manifest, key, &f->error), UMB_OK);
    assert_int_equal(umbj_upload_begin(f->folder, &f->manifest, key, &stop, &upload, &f->error),
                     UMB_OK);
    assert_int_equal(umbj_upload_write(upload, CONTENT, 4, &f->error), UMB_OK);
    atomic_store(&stop, 1);
    assert_int_equal(umbj_upload_write(upload, CONTENT, 8, &f->error), UMB_E_UNAVAILABLE);
    assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_E_UNAVAILABLE);
    umbj_folder_remove_until(f->fd, "incoming", &stop);
    assert_int_equal(names_in(f, "incoming"), 1); /* removals end as well */
    umbj_upload_leave(upload);                    /* the flag may go now */
    umbj_upload_destroy(upload);
    assert_int_equal(names_in(f, "incoming"), 1); /* the next start sweeps it */
}

static void an_upload_without_its_folder_fails_each_time(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    struct umbj_upload *upload = begin(f, key);
    assert_int_equal(unlinkat(f->fd, "incoming", AT_REMOVEDIR), 0);
    assert_int_equal(umbj_upload_write(upload, CONTENT, 8, &f->error), UMB_E_IO);
    assert_int_equal(umbj_upload_write(upload, CONTENT, 8, &f->error), UMB_E_IO);
    assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_E_IO);
    umbj_upload_destroy(upload);
    umbj_upload_destroy(NULL);
}

/* One of the same key is still being removed. */
static void a_bundle_goes_away_beside_one_that_is_going(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    char gone[2][UMBJ_GONE_SIZE];
    for (int i = 0; i < 2; i++) {
        struct umbj_upload *upload = begin(f, key);
        assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT, 16, &f->error), UMB_OK);
        assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_OK);
        umbj_upload_destroy(upload);
        assert_int_equal(umbj_bundle_take_away(f->fd, key, gone[i]), 0);
    }
    assert_string_not_equal(gone[0], gone[1]);
    assert_int_equal(names_in(f, "incoming"), 2);
    assert_int_equal(names_in(f, "bundles"), 0);
    assert_int_equal(umbj_bundle_take_away(f->fd, key, gone[0]), 0);
    assert_string_equal(gone[0], "");
}

static void a_file_that_is_also_a_folder_is_refused(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    f->files[1].path = "a.obj/b.png";
    struct umbj_upload *upload = begin(f, key);
    assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT, 16, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "files[1].path"));
    umbj_upload_destroy(upload);
    assert_int_equal(names_in(f, "incoming"), 0);
}

static void removing_a_folder_does_not_follow_links(void **state)
{
    struct fixture *f = *state;
    int work = openat(f->fd, "work", O_RDONLY | O_DIRECTORY);
    assert_int_equal(mkdirat(f->fd, "bundles/kept", 0700), 0);
    assert_int_equal(mkdirat(work, "job", 0700), 0);
    assert_int_equal(symlinkat("../../bundles", work, "job/link"), 0);
    umbj_folder_remove(work, "job");
    close(work);
    assert_int_equal(names_in(f, "work"), 0);
    assert_int_equal(names_in(f, "bundles"), 1);
}

struct writer {
    int work;
    atomic_int ended;
    atomic_uint made; /* files */
};

static void *write_logs(void *user)
{
    struct writer *writer = user;
    char name[64];
    for (unsigned i = 0; !atomic_load(&writer->ended); i++) {
        snprintf(name, sizeof name, "job/tile/log.%u", i);
        int fd = openat(writer->work, name, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
        if (fd >= 0) {
            close(fd);
            atomic_fetch_add(&writer->made, 1);
        }
    }
    return NULL;
}

static void a_folder_is_gone_at_once_for_those_who_write_into_it(void **state)
{
    struct fixture *f = *state;
    struct writer writer = {.work = openat(f->fd, "work", O_RDONLY | O_DIRECTORY)};
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, write_logs, &writer), 0);
    for (int round = 0; round < 50; round++) {
        assert_int_equal(mkdirat(writer.work, "job", 0700), 0);
        assert_int_equal(mkdirat(writer.work, "job/tile", 0700), 0);
        for (unsigned made = atomic_load(&writer.made); atomic_load(&writer.made) < made + 3;) {
            (void)sched_yield();
        }
        umbj_folder_drop(writer.work, "job");
        assert_int_equal(faccessat(writer.work, "job", F_OK, 0), -1);
        umbj_folder_remove(writer.work, "job.gone"); /* a file that was being made meanwhile */
    }
    atomic_store(&writer.ended, 1);
    pthread_join(thread, NULL);
    close(writer.work);
}

static int remove_bundle(struct fixture *f, const uint8_t *key)
{
    char gone[UMBJ_GONE_SIZE];
    const int failed = umbj_bundle_take_away(f->fd, key, gone);
    if (gone[0] != '\0') {
        umbj_folder_remove(f->fd, gone);
    }
    return failed;
}

/* With few descriptors left, a removal goes as far as it can and then stops. */
static void a_bundle_that_cannot_be_removed_whole_is_never_taken_for_a_whole_one(void **state)
{
    struct fixture *f = *state;
    uint8_t key[UMBJ_HASH_BYTES];
    struct rlimit limit, few;
    for (int spare = 0; spare < 8; spare++) {
        struct umbj_upload *upload = begin(f, key);
        assert_int_equal(umbj_upload_write(upload, CONTENT CONTENT, 16, &f->error), UMB_OK);
        assert_int_equal(umbj_upload_accept(upload, &f->error), UMB_OK);
        umbj_upload_destroy(upload);
        const int next = dup(f->fd);
        close(next);
        assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
        few = limit;
        few.rlim_cur = (rlim_t)(next + spare);
        assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
        const int removed = remove_bundle(f, key);
        assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
        assert_int_equal(removed, 0);
        assert_int_equal(names_in(f, "bundles"), 0); /* what is left of it lies elsewhere */
        umbj_folder_empty(f->fd, "incoming");        /* as each start does */
        assert_int_equal(remove_bundle(f, key), 0);
        assert_int_equal(names_in(f, "incoming"), 0);
    }
}

int main(void)
{
#define UPLOAD_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        UPLOAD_TEST(a_bundle_is_unpacked_however_its_bytes_are_cut),
        UPLOAD_TEST(a_scene_buffer_is_refused_under_every_name),
        UPLOAD_TEST(an_upload_that_ends_early_leaves_nothing),
        UPLOAD_TEST(bytes_that_are_not_the_manifests_are_refused),
        UPLOAD_TEST(the_key_is_of_content_and_not_of_order),
        UPLOAD_TEST(paths_that_could_leave_the_folder_are_refused),
        UPLOAD_TEST(limits_are_met_before_anything_is_written),
        UPLOAD_TEST(a_file_that_is_also_a_folder_is_refused),
        UPLOAD_TEST(names_that_differ_only_by_case_are_one_name),
        UPLOAD_TEST(writing_ends_when_the_server_does),
        UPLOAD_TEST(an_upload_without_its_folder_fails_each_time),
        UPLOAD_TEST(a_bundle_goes_away_beside_one_that_is_going),
        UPLOAD_TEST(a_bundle_that_cannot_be_removed_whole_is_never_taken_for_a_whole_one),
        UPLOAD_TEST(removing_a_folder_does_not_follow_links),
        UPLOAD_TEST(a_folder_is_gone_at_once_for_those_who_write_into_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
