/* SPDX-License-Identifier: Apache-2.0 */
/* Files requested by name over a socket, by an importer that behaves and by one that does not. */
#define _GNU_SOURCE /* O_PATH */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/open_beneath.h"
#include "scene/scene_broker.h"

static char folder_path[64];
static int folder, ends[2];
static pthread_t parent;

static void *serve(void *unused)
{
    struct pollfd wanted = {.fd = ends[0], .events = POLLIN};
    uint32_t left = UINT32_MAX;
    (void)unused;
    while (poll(&wanted, 1, 10000) > 0 && umbs_broker_serve(ends[0], folder, &left) > 0) {
    }
    return NULL;
}

static int set_up(void **state)
{
    (void)state;
    (void)snprintf(folder_path, sizeof(folder_path), "/tmp/umbrage-test-XXXXXX");
    if (mkdtemp(folder_path) == NULL) {
        return -1;
    }
    folder = open(folder_path, O_PATH | O_DIRECTORY | O_CLOEXEC);
    int file = openat(folder, "a.mtl", O_CREAT | O_WRONLY, 0600);
    int good = file >= 0 && write(file, "words", 5) == 5 && close(file) == 0 &&
               mkdirat(folder, "inner", 0700) == 0 &&
               symlinkat("/etc/passwd", folder, "out") == 0 &&
               mkfifoat(folder, "pipe", 0600) == 0 && umbs_broker_pair(ends) == 0 &&
               pthread_create(&parent, NULL, serve, NULL) == 0;
    return good ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    (void)close(ends[1]);
    (void)pthread_join(parent, NULL);
    (void)close(ends[0]);
    (void)unlinkat(folder, "a.mtl", 0);
    (void)unlinkat(folder, "out", 0);
    (void)unlinkat(folder, "pipe", 0);
    (void)unlinkat(folder, "inner", AT_REMOVEDIR);
    (void)close(folder);
    return rmdir(folder_path);
}

static void a_file_beneath_the_folder_is_handed_over(void **state)
{
    char text[8];
    (void)state;
    for (int i = 0; i < 100; i++) { /* nothing is used up */
        int fd = umbs_broker_open(ends[1], "inner/../a.mtl");
        assert_true(fd >= 0);
        assert_int_equal(read(fd, text, sizeof(text)), 5);
        assert_memory_equal(text, "words", 5);
        assert_int_equal(close(fd), 0);
    }
}

static atomic_int renaming;

/* Renames a file back and forth until told to stop. */
static void *rename_on_and_on(void *unused)
{
    (void)unused;
    while (atomic_load(&renaming)) {
        (void)renameat(folder, "b.mtl", folder, "c.mtl");
        (void)renameat(folder, "c.mtl", folder, "b.mtl");
    }
    return NULL;
}

static void renames_elsewhere_make_no_name_fail(void **state)
{
    (void)state;
    pthread_t other;
    int failures = 0, file = openat(folder, "b.mtl", O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    assert_true(file >= 0 && close(file) == 0);
    atomic_store(&renaming, 1);
    assert_int_equal(pthread_create(&other, NULL, rename_on_and_on, NULL), 0);
    for (int i = 0; i < 20000; i++) {
        int fd = umbs_open_beneath(folder, "inner/../a.mtl");
        failures += fd < 0;
        if (fd >= 0) {
            (void)close(fd);
        }
    }
    atomic_store(&renaming, 0);
    assert_int_equal(pthread_join(other, NULL), 0);
    (void)unlinkat(folder, "b.mtl", 0);
    (void)unlinkat(folder, "c.mtl", 0);
    assert_int_equal(failures, 0);
}

static void names_that_leave_the_folder_are_refused(void **state)
{
    static const char *const names[] = {"/etc/passwd", "../x", "inner/../../x", "out"};
    (void)state;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        assert_int_equal(umbs_broker_open(ends[1], names[i]), -1);
        assert_true(errno == EXDEV || errno == ELOOP);
    }
}

static void only_regular_files_are_handed_over(void **state)
{
    (void)state;
    assert_int_equal(umbs_broker_open(ends[1], "inner"), -1);
    assert_int_equal(errno, EISDIR);
    assert_int_equal(umbs_broker_open(ends[1], "pipe"), -1); /* without waiting for a writer */
    assert_int_equal(errno, ENODEV);
    assert_int_equal(umbs_broker_open(ends[1], "missing"), -1);
    assert_int_equal(errno, ENOENT);
}

static void foreign_requests_are_answered_with_an_error(void **state)
{
    static char long_name[70000];
    const struct {
        const void *bytes;
        size_t size;
        int code;
    } requests[] = {
        {"a\0b", 3, EINVAL},
        {long_name, UMBS_BENEATH_NAME_BYTES, ENAMETOOLONG},
        {long_name, sizeof(long_name), ENAMETOOLONG},
    };
    (void)state;
    memset(long_name, 'x', sizeof(long_name));
    for (size_t i = 0; i < sizeof(requests) / sizeof(requests[0]); i++) {
        int32_t code = 0;
        assert_int_equal(send(ends[1], requests[i].bytes, requests[i].size, MSG_NOSIGNAL),
                         requests[i].size);
        assert_int_equal(recv(ends[1], &code, sizeof(code), 0), sizeof(code));
        assert_int_equal(code, requests[i].code);
    }
    long_name[sizeof(long_name) - 1] = '\0';
    assert_int_equal(umbs_broker_open(ends[1], long_name), -1);
    assert_int_equal(errno, ENAMETOOLONG);
}

static void requests_without_end_block_nobody(void **state)
{
    (void)state;
    for (int i = 0; i < 3000; i++) { /* never takes an answer */
        (void)send(ends[1], "a.mtl", 5, MSG_NOSIGNAL | MSG_DONTWAIT);
    }
    int32_t code;
    while (recv(ends[1], &code, sizeof(code), MSG_DONTWAIT) > 0) {
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_file_beneath_the_folder_is_handed_over, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(renames_elsewhere_make_no_name_fail, set_up, tear_down),
        cmocka_unit_test_setup_teardown(names_that_leave_the_folder_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(only_regular_files_are_handed_over, set_up, tear_down),
        cmocka_unit_test_setup_teardown(foreign_requests_are_answered_with_an_error, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(requests_without_end_block_nobody, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
