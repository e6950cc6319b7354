/* SPDX-License-Identifier: Apache-2.0 */
/* See acceptor.h. */
#define _GNU_SOURCE /* accept4 */
#include "daemon/transport/acceptor.h"

#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/un.h>
#include <unistd.h>

#define TAKEN_MAX 64 /* Most connections accepted in one event; other work has its turn then */

int umbd_socket_bind(const struct sockaddr *address, int *fd)
{
    const int on = 1;
    const socklen_t size = address->sa_family == AF_UNIX    ? sizeof(struct sockaddr_un)
                           : address->sa_family == AF_INET6 ? sizeof(struct sockaddr_in6)
                                                            : sizeof(struct sockaddr_in);
    *fd = socket(address->sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (*fd < 0) {
        return -errno;
    }
    if ((address->sa_family != AF_UNIX &&
         setsockopt(*fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0) ||
        bind(*fd, address, size) != 0) {
        int code = -errno;
        (void)close(*fd);
        *fd = -1;
        return code;
    }
    return 0;
}

/* Returns 1 if the error concerns one connection only, so that another may wait behind it. */
static int is_of_one(int code)
{
    return code == EINTR || code == ECONNABORTED || code == EPROTO || code == EPERM ||
           code == ENETDOWN || code == EHOSTDOWN || code == EHOSTUNREACH || code == ENETUNREACH ||
           code == ENOPROTOOPT || code == ENONET || code == EOPNOTSUPP;
}

/* Returns 1 if a connection waits. accept reports a lack of descriptors even if no connection
 * waits. */
static int is_waiting(int fd)
{
    struct pollfd listening = {.fd = fd, .events = POLLIN};
    return poll(&listening, 1, 0) != 0;
}

/* Accepts the waiting connections. A permanent failure stops the poll, because the same event would
 * otherwise come again at once. */
static void take(struct umbd_acceptor *acceptor)
{
    for (int i = 0; i < TAKEN_MAX; i++) {
        int fd = accept4(acceptor->fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        int code = fd < 0 ? errno : 0;
        if (fd >= 0) {
            acceptor->taken(acceptor, fd);
        } else if (code == EAGAIN || code == EWOULDBLOCK || !is_waiting(acceptor->fd)) {
            return;
        } else if (!is_of_one(code)) {
            (void)uv_poll_stop(&acceptor->poll);
            acceptor->resting = 1;
            acceptor->refused(acceptor, -code);
            return;
        }
    }
}

static void on_event(uv_poll_t *poll, int status, int events)
{
    (void)status;
    (void)events;
    take(poll->data);
}

int umbd_acceptor_start(struct umbd_acceptor *acceptor, uv_loop_t *loop, int fd, int backlog)
{
    int code = listen(fd, backlog) != 0 ? -errno : uv_poll_init(loop, &acceptor->poll, fd);
    if (code != 0) {
        (void)close(fd);
        return code;
    }
    acceptor->fd = fd;
    acceptor->poll.data = acceptor;
    return uv_poll_start(&acceptor->poll, UV_READABLE, on_event);
}

void umbd_acceptor_tick(struct umbd_acceptor *acceptor)
{
    if (acceptor->resting) {
        acceptor->resting = 0;
        (void)uv_poll_start(&acceptor->poll, UV_READABLE, on_event);
    }
}

void umbd_acceptor_close(struct umbd_acceptor *acceptor, uv_close_cb closed)
{
    if (acceptor->fd < 0) {
        acceptor->poll.data = acceptor;
        closed((uv_handle_t *)&acceptor->poll);
        return;
    }
    uv_close((uv_handle_t *)&acceptor->poll, closed);
    (void)close(acceptor->fd);
    acceptor->fd = -1;
}
