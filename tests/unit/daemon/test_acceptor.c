/* SPDX-License-Identifier: Apache-2.0 */
/* Accepting with few descriptors. A daemon that has none: tests/system/test_descriptors.py. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <errno.h>
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/un.h>
#include <unistd.h>
#include <cmocka.h>

#include "daemon/transport/acceptor.h"

enum {
    COMERS = 3
};

struct tally {
    int taken[COMERS]; /* descriptors */
    int taken_count, refused_count, code;
};

static void on_taken(struct umbd_acceptor *acceptor, int fd)
{
    struct tally *tally = acceptor->user;
    assert_true(tally->taken_count < COMERS);
    tally->taken[tally->taken_count++] = fd;
}

static void on_refused(struct umbd_acceptor *acceptor, int code)
{
    struct tally *tally = acceptor->user;
    tally->refused_count++;
    tally->code = code;
}

static void on_closed(uv_handle_t *handle)
{
    (void)handle;
}

/* Leaves so many descriptors to be opened; open: any that is. */
static void leave(int count, int open)
{
    struct rlimit limit;
    int free_ones[COMERS];
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    for (int i = 0; i < count; i++) {
        free_ones[i] = fcntl(open, F_DUPFD_CLOEXEC, 0);
        assert_true(free_ones[i] >= 0);
    }
    limit.rlim_cur = (rlim_t)free_ones[count - 1] + 1;
    for (int i = 0; i < count; i++) {
        close(free_ones[i]);
    }
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
}

static void the_last_descriptor_is_used_and_nobody_is_refused_who_is_not_there(void **state)
{
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    char folder[] = "/tmp/umbrage-acceptor-XXXXXX";
    int comers[COMERS], fd = -1;
    struct tally tally = {0};
    struct umbd_acceptor acceptor = {
        .fd = -1, .user = &tally, .taken = on_taken, .refused = on_refused};
    struct rlimit whole;
    uv_loop_t loop;
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(name.sun_path, sizeof name.sun_path, "%s/socket", folder);
    assert_int_equal(uv_loop_init(&loop), 0);
    assert_int_equal(umbd_socket_bind((struct sockaddr *)&name, &fd), 0);
    assert_int_equal(umbd_acceptor_start(&acceptor, &loop, fd, COMERS), 0);
    for (int i = 0; i < COMERS; i++) {
        comers[i] = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
        assert_true(comers[i] >= 0);
    }
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &whole), 0);

    leave(2, comers[0]);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(connect(comers[i], (struct sockaddr *)&name, sizeof name), 0);
    }
    uv_run(&loop, UV_RUN_NOWAIT);
    assert_int_equal(tally.taken_count, 2);
    assert_int_equal(tally.refused_count, 0);
    assert_int_equal(acceptor.resting, 0);

    assert_int_equal(connect(comers[2], (struct sockaddr *)&name, sizeof name), 0);
    uv_run(&loop, UV_RUN_NOWAIT);
    assert_int_equal(tally.refused_count, 1);
    assert_int_equal(tally.code, -EMFILE);
    uv_run(&loop, UV_RUN_NOWAIT); /* it rests */
    assert_int_equal(tally.refused_count, 1);
    close(tally.taken[0]);
    umbd_acceptor_tick(&acceptor);
    uv_run(&loop, UV_RUN_NOWAIT);
    assert_int_equal(tally.taken_count, 3);
    assert_int_equal(tally.refused_count, 1);

    assert_int_equal(setrlimit(RLIMIT_NOFILE, &whole), 0);
    umbd_acceptor_close(&acceptor, on_closed);
    uv_run(&loop, UV_RUN_DEFAULT);
    assert_int_equal(uv_loop_close(&loop), 0);
    for (int i = 0; i < COMERS; i++) {
        close(comers[i]);
    }
    close(tally.taken[1]);
    close(tally.taken[2]);
    assert_int_equal(unlink(name.sun_path), 0);
    assert_int_equal(rmdir(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_last_descriptor_is_used_and_nobody_is_refused_who_is_not_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
