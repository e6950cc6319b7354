/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The parent's side of an import, with importers that misbehave: this program starts itself as the
 * importer, and the scene's name says what it is to do.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "scene/scene.h"
#include "scene/scene_broker.h"
#include "scene/scene_builder.h"
#include "scene/scene_contract.h"

static char folder[256];

/* ---- the importer that misbehaves ---- */

static enum umb_status write_fd(void *user, const void *data, size_t count)
{
    return write(*(int *)user, data, count) == (ssize_t)count ? UMB_OK : UMB_E_IO;
}

static int write_triangle(void)
{
    struct umbs_scene_builder builder;
    int fd = UMBS_CHILD_FD_OUTPUT;
    const struct umb_sink sink = {write_fd, &fd};
    static const uint32_t corners[3] = {0, 1, 2};
    int good = 1;
    umbs_scene_builder_init(&builder, UMBS_FORMAT_OBJ, 1, 0);
    for (int i = 0; i < 3; i++) {
        const double position[3] = {i == 1, i == 2, 0};
        good &= umbs_scene_add_vertex(&builder, position, NULL, NULL) == UMB_OK;
    }
    good &= umbs_scene_add_triangle(&builder, corners, NULL) == UMB_OK;
    good &= umbs_scene_end_mesh(&builder, 0, 3, 1, UMBS_NO_INDEX, NULL) == UMB_OK;
    good &= umbs_scene_add_instance(&builder, 0, NULL, NULL) == UMB_OK;
    good &= umbs_scene_builder_write(&builder, &sink, NULL) == UMB_OK;
    umbs_scene_builder_finish(&builder);
    return good ? 0 : 70;
}

static void say(const char *text)
{
    ssize_t written = write(2, text, strlen(text));
    (void)written;
}

static int open_descriptors(void)
{
    int count = 0;
    for (int fd = 0; fd < 64; fd++) {
        count += fcntl(fd, F_GETFD) >= 0;
    }
    return count;
}

static int spam(void)
{
    char block[4096];
    memset(block, 'x', sizeof(block));
    for (int i = 0; i < 100; i++) {
        ssize_t written = write(2, block, sizeof(block));
        (void)written;
    }
    return 65;
}

static int overflow_output(void)
{
    static char block[1 << 16];
    (void)signal(SIGXFSZ, SIG_DFL);
    while (write(UMBS_CHILD_FD_OUTPUT, block, sizeof(block)) > 0) {
    }
    return 0;
}

/* Requests the scene itself, at most `times` times; then hands in a scene. */
static int ask(int times)
{
    int fd = 0;
    for (int i = 0; i < times && fd >= 0; i++) {
        fd = umbs_broker_open(UMBS_CHILD_FD_FILES, i % 2 == 0 ? "asks" : "absent");
        if (fd >= 0) {
            (void)close(fd);
        } else if (i % 2 != 0 && errno == ENOENT) {
            fd = 0;
        }
    }
    return write_triangle();
}

static int misbehave(const char *name)
{
    if (strcmp(name, "good") == 0) {
        return write_triangle();
    }
    if (strcmp(name, "abort") == 0) {
        (void)raise(SIGSEGV);
    } else if (strcmp(name, "sleep") == 0) {
        (void)sleep(100);
    } else if (strcmp(name, "silent") == 0) {
        (void)close(2);
        (void)sleep(100);
    } else if (strcmp(name, "spin") == 0) {
        for (volatile unsigned i = 0;; i++) { /* a fast core wraps within the second */
        }
    } else if (strcmp(name, "refuse") == 0) {
        say("refuse: bad \x1b[31mscene\nand more\n");
        return 65;
    } else if (strcmp(name, "limit") == 0) {
        say("limit: too much\n");
        return 75;
    } else if (strcmp(name, "odd") == 0) {
        say("odd: words\n");
        return 42;
    } else if (strcmp(name, "asks") == 0) {
        return ask(8);
    } else if (strcmp(name, "asks_on") == 0) {
        return ask(1000000000);
    } else if (strcmp(name, "garbage") == 0) {
        ssize_t written = write(UMBS_CHILD_FD_OUTPUT, "garbage, garbage", 16);
        (void)written;
    } else if (strcmp(name, "spam") == 0) {
        return spam();
    } else if (strcmp(name, "overflow") == 0) {
        return overflow_output();
    } else if (strcmp(name, "descriptors") == 0) {
        if (open_descriptors() != 6) {
            say("descriptors: more than the six agreed on\n");
            return 65;
        }
        return write_triangle();
    } else if (strcmp(name, "orphan") == 0) {
        pid_t child = fork();
        if (child == 0) {
            (void)sleep(100);
            _exit(0);
        }
        return write_triangle();
    }
    return 0;
}

/* ---- the tests ---- */

static const char *path_of(const char *name)
{
    static char path[512];
    (void)snprintf(path, sizeof(path), "%s/%s", folder, name);
    return path;
}

static void make_file(const char *name)
{
    FILE *file = fopen(path_of(name), "w");
    assert_non_null(file);
    assert_true(fputs("scene\n", file) >= 0);
    assert_int_equal(fclose(file), 0);
}

static enum umb_status import_with(const char *name, struct umbs_import_options options,
                                   struct umbs_scene **scene, struct umb_error *error)
{
    make_file(name);
    memset(error, 0, sizeof(*error));
    if (options.importer_path == NULL) {
        options.importer_path = "/proc/self/exe";
    }
    return umbs_scene_import(path_of(name), &options, scene, error);
}

static void expect(const char *name, enum umb_status status, const char *words)
{
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.timeout_s = 20, .max_memory_bytes = 1 << 22};
    enum umb_status got = import_with(name, options, &scene, &error);
    if (got != status || strstr(error.message, words) == NULL) {
        print_error("%s: %s, '%s'\n", name, umb_status_name(got), error.message);
    }
    assert_int_equal(got, status);
    assert_null(scene);
    assert_non_null(strstr(error.message, words));
}

static void good_importer_gives_a_scene(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.timeout_s = 20};
    assert_int_equal(import_with("good", options, &scene, &error), UMB_OK);
    assert_int_equal(scene->view.triangle_count, 1);
    umbs_scene_destroy(scene);
    umbs_scene_destroy(NULL);
}

static void importer_sees_only_the_agreed_descriptors(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    int leak = open(folder, O_RDONLY); /* without CLOEXEC */
    const struct umbs_import_options options = {.timeout_s = 20};
    assert_true(leak >= 0);
    enum umb_status status = import_with("descriptors", options, &scene, &error);
    (void)close(leak);
    assert_string_equal(error.message, "");
    assert_int_equal(status, UMB_OK);
    umbs_scene_destroy(scene);
}

/* Imitates a service that was started without standard streams: the scene itself is then descriptor
 * 0. */
static void caller_without_standard_streams_imports(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.timeout_s = 20};
    int kept[3];
    make_file("descriptors");
    for (int i = 0; i < 3; i++) {
        kept[i] = fcntl(i, F_DUPFD_CLOEXEC, 20);
        assert_true(kept[i] >= 0);
    }
    for (int i = 0; i < 3; i++) {
        (void)close(i);
    }
    enum umb_status status = import_with("descriptors", options, &scene, &error);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(dup2(kept[i], i), i);
        (void)close(kept[i]);
    }
    assert_string_equal(error.message, "");
    assert_int_equal(status, UMB_OK);
    umbs_scene_destroy(scene);
}

static void crash_is_a_bad_scene(void **state)
{
    (void)state;
    /* A sanitizer turns the signal into a report and an exit code of its own. */
    expect("abort", UMB_E_BAD_SCENE, "abort: importer ");
}

static void refusal_brings_its_first_line_made_clean(void **state)
{
    (void)state;
    expect("refuse", UMB_E_BAD_SCENE, "refuse: bad ?[31mscene");
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.timeout_s = 20};
    assert_int_equal(import_with("refuse", options, &scene, &error), UMB_E_BAD_SCENE);
    assert_null(strstr(error.message, "more"));
}

static void limits_and_odd_codes_are_told_apart(void **state)
{
    (void)state;
    expect("limit", UMB_E_LIMIT, "limit: too much");
    expect("odd", UMB_E_BAD_SCENE, "odd: importer failed (exit code 42): odd: words");
    expect("spam", UMB_E_BAD_SCENE, "xxxx");
}

static void broken_output_is_a_bad_scene(void **state)
{
    (void)state;
    expect("garbage", UMB_E_BAD_SCENE, "scene buffer: size is 16");
    expect("nothing", UMB_E_BAD_SCENE, "nothing: importer wrote no scene");
}

static void too_much_output_is_a_limit(void **state)
{
    (void)state;
    expect("overflow", UMB_E_LIMIT, "limit of output");
}

static void expect_timeout(const char *name)
{
    struct umbs_scene *scene;
    struct umb_error error;
    struct timespec start, end;
    const struct umbs_import_options options = {.timeout_s = 1};
    (void)clock_gettime(CLOCK_MONOTONIC, &start);
    assert_int_equal(import_with(name, options, &scene, &error), UMB_E_LIMIT);
    (void)clock_gettime(CLOCK_MONOTONIC, &end);
    assert_null(scene);
    /* One second plus scheduling on a busy machine; without the limit the import would take a
     * hundred. */
    assert_in_range((uintmax_t)(end.tv_sec - start.tv_sec), 0, 15);
}

static void hanging_importers_are_ended(void **state)
{
    (void)state;
    expect_timeout("sleep");
    expect_timeout("silent");
    expect_timeout("spin");
}

static void process_left_behind_does_not_hold_the_import(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.timeout_s = 20};
    assert_int_equal(import_with("orphan", options, &scene, &error), UMB_OK);
    umbs_scene_destroy(scene);
}

static void missing_input_and_folders_are_no_input(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error = {0};
    const struct umbs_import_options options = {.importer_path = "/proc/self/exe"};
    assert_int_equal(umbs_scene_import(path_of("absent.obj"), &options, &scene, &error),
                     UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, "absent.obj"));
    assert_int_equal(umbs_scene_import(folder, &options, &scene, &error), UMB_E_NO_INPUT);
    assert_non_null(strstr(error.message, "is a folder"));
    assert_int_equal(mkfifo(path_of("pipe.obj"), 0600), 0);
    assert_int_equal(umbs_scene_import(path_of("pipe.obj"), &options, &scene, &error),
                     UMB_E_NO_INPUT);
    assert_int_equal(unlink(path_of("pipe.obj")), 0);
    assert_null(scene);
}

struct hook {
    int calls;
    struct umbs_importer importer;
    enum umb_status answer;
};

static enum umb_status shut_in(void *user, const struct umbs_importer *importer,
                               struct umb_error *error)
{
    struct hook *hook = user;
    hook->calls++;
    hook->importer = *importer;
    return hook->answer == UMB_OK ? UMB_OK : umb_fail(error, hook->answer, "no sandbox");
}

/* The caller must be told of the running importer once. If the importer cannot enter its sandbox,
 * its scene must not be accepted, and no process may stay. */
static void the_caller_shuts_itself_in_or_nothing_is_read(void **state)
{
    static const enum umb_status answers[] = {UMB_OK, UMB_E_UNAVAILABLE};
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct umbs_scene *scene;
        struct umb_error error;
        struct hook hook = {.answer = answers[i]};
        const struct umbs_import_options options = {
            .timeout_s = 20, .shut_in = shut_in, .user = &hook};
        assert_int_equal(import_with("good", options, &scene, &error), answers[i]);
        assert_int_equal(hook.calls, 1);
        assert_true(hook.importer.process > 1 && hook.importer.files > 2);
        assert_int_equal(kill(hook.importer.process, 0), -1);
        assert_string_equal(error.message, i == 0 ? "" : "no sandbox");
        assert_int_equal(scene != NULL, i == 0);
        umbs_scene_destroy(scene);
    }
}

static void large_input_is_a_limit(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    const struct umbs_import_options options = {.max_input_bytes = 5};
    assert_int_equal(import_with("good", options, &scene, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "6 bytes, limit 5"));
}

/* Look-ups that find nothing must count, too: the default limit ends an endless series of them. */
static void look_ups_of_files_are_a_limit(void **state)
{
    static const struct {
        const char *name;
        uint32_t most;
        enum umb_status status;
        const char *words;
    } cases[] = {
        {"asks", 8, UMB_OK, ""},
        {"asks", 7, UMB_E_LIMIT, "asks: asks for files more than 7 times, the limit of a scene"},
        {"asks_on", 0, UMB_E_LIMIT, "more than 65536 times"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbs_scene *scene;
        struct umb_error error;
        const struct umbs_import_options options = {.timeout_s = 60, .max_files = cases[i].most};
        assert_int_equal(import_with(cases[i].name, options, &scene, &error), cases[i].status);
        assert_non_null(strstr(error.message, cases[i].words));
        assert_int_equal(scene != NULL, cases[i].status == UMB_OK);
        umbs_scene_destroy(scene);
    }
}

static void missing_importer_is_unavailable(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    char path[300];
    (void)snprintf(path, sizeof(path), "%s/importer", folder);
    const struct umbs_import_options options = {.importer_path = path};
    assert_int_equal(import_with("good", options, &scene, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "importer"));
    const struct umbs_import_options folder_options = {.importer_path = folder};
    assert_int_equal(import_with("good", folder_options, &scene, &error), UMB_E_UNAVAILABLE);
}

static int make_folder(void **state)
{
    (void)state;
    const char *base = getenv("TMPDIR");
    (void)snprintf(folder, sizeof(folder), "%s/umbrage-test-XXXXXX", base != NULL ? base : "/tmp");
    return mkdtemp(folder) != NULL ? 0 : -1;
}

static int remove_folder(void **state)
{
    (void)state;
    static const char *const names[] = {
        "good",    "abort",   "sleep", "silent",   "spin",   "refuse",      "limit", "odd",
        "garbage", "nothing", "spam",  "overflow", "orphan", "descriptors", "asks",  "asks_on"};
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        (void)unlink(path_of(names[i]));
    }
    return rmdir(folder);
}

int main(int argc, char **argv)
{
    if (argc == UMBS_CHILD_ARG_COUNT && strcmp(argv[1], UMBS_CHILD_COMMAND) == 0) {
        return misbehave(argv[UMBS_CHILD_ARG_NAME]);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(good_importer_gives_a_scene),
        cmocka_unit_test(importer_sees_only_the_agreed_descriptors),
        cmocka_unit_test(caller_without_standard_streams_imports),
        cmocka_unit_test(crash_is_a_bad_scene),
        cmocka_unit_test(refusal_brings_its_first_line_made_clean),
        cmocka_unit_test(limits_and_odd_codes_are_told_apart),
        cmocka_unit_test(broken_output_is_a_bad_scene),
        cmocka_unit_test(too_much_output_is_a_limit),
        cmocka_unit_test(hanging_importers_are_ended),
        cmocka_unit_test(process_left_behind_does_not_hold_the_import),
        cmocka_unit_test(missing_input_and_folders_are_no_input),
        cmocka_unit_test(the_caller_shuts_itself_in_or_nothing_is_read),
        cmocka_unit_test(large_input_is_a_limit),
        cmocka_unit_test(look_ups_of_files_are_a_limit),
        cmocka_unit_test(missing_importer_is_unavailable),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
