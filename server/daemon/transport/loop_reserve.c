/* SPDX-License-Identifier: Apache-2.0 */
/* See loop_reserve.h: a short watch on the highest descriptor grows the table. */
#define _GNU_SOURCE /* dup3 */
#include "daemon/transport/loop_reserve.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

static void on_event(uv_poll_t *poll, int status, int events)
{
    (void)poll;
    (void)status;
    (void)events;
}

enum umb_status umbd_loop_reserve(uv_loop_t *loop, struct umb_error *error)
{
    struct rlimit limit;
    uv_poll_t poll;
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0 || getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur > (1U << 24)) {
        enum umb_status status = umb_fail_errno(error, UMB_E_LIMIT, fd < 0 ? errno : ERANGE,
                                                "cannot prepare a loop for its descriptors");
        if (fd >= 0) {
            (void)close(fd);
        }
        return status;
    }
    /* The highest number may be in use already (a sanitizer's, a parent's): then the one below. */
    int high = -1;
    for (int number = (int)limit.rlim_cur - 1; high < 0 && number > fd; number--) {
        if (fcntl(number, F_GETFD) < 0) {
            high = dup3(fd, number, O_CLOEXEC);
        }
    }
    if (high >= 0 && uv_poll_init(loop, &poll, high) == 0) {
        (void)uv_poll_start(&poll, UV_READABLE, on_event);
        (void)uv_poll_stop(&poll);
        uv_close((uv_handle_t *)&poll, NULL);
        (void)uv_run(loop, UV_RUN_NOWAIT); /* closes the handle */
    }
    if (high >= 0) {
        (void)close(high);
    }
    (void)close(fd);
    return UMB_OK;
}
