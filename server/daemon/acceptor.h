/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_ACCEPTOR_H
#define UMBRAGE_SERVER_DAEMON_ACCEPTOR_H
/*
 * Accepting connections, also where descriptors or memory are short.
 *
 *     int code = umbd_socket_bind(address, size, &fd);
 *     code = umbd_acceptor_start(&acceptor, loop, fd, backlog);
 *     umbd_acceptor_tick(&acceptor);                    ten times a second or so
 *     umbd_acceptor_close(&acceptor, closed);
 *
 * libuv's own listening holds one descriptor in reserve and, when there is no other, takes and
 * drops who waits. Where another thread gets the one in reserve meanwhile, it asks the kernel over
 * and over and its loop does nothing else. Here the socket is polled: a connection that cannot be
 * taken stays in the kernel's queue, nobody looks at it until the next tick, and it is served when
 * something was given back.
 *
 * Threads: the loop's. A code is 0 or -errno, as libuv's are.
 */
#include <sys/socket.h>
#include <uv.h>

struct umbd_acceptor {
    uv_poll_t poll; /* its data is the acceptor */
    int fd;         /* the listening socket; -1: not started */
    int resting;    /* 1: a connection could not be taken, the tick tries again */
    void *user;
    void (*taken)(struct umbd_acceptor *acceptor, int fd); /* a connection, non-blocking: yours */
    void (*refused)(struct umbd_acceptor *acceptor, int code); /* it rests now, for this reason */
};

/* Makes a stream socket and binds it. Out: fd: the caller's; -1 on failure. */
int umbd_socket_bind(const struct sockaddr *address, socklen_t size, int *fd);

/* Listens and begins to take. user, taken and refused are set. Takes fd over, also on failure. */
int umbd_acceptor_start(struct umbd_acceptor *acceptor, uv_loop_t *loop, int fd, int backlog);

/* Tries again to take what could not be taken. */
void umbd_acceptor_tick(struct umbd_acceptor *acceptor);

/* Closes the socket; calls closed(the acceptor's poll handle) when the loop has run once more, or
 * at once if it was never started. */
void umbd_acceptor_close(struct umbd_acceptor *acceptor, uv_close_cb closed);

#endif
