/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_ACCEPTOR_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_ACCEPTOR_H
/*
 * Accepting connections, also when descriptors or memory are short.
 *
 *     int code = umbd_socket_bind(address, &fd);
 *     code = umbd_acceptor_start(&acceptor, loop, fd, backlog);
 *     umbd_acceptor_tick(&acceptor);                    ten times a second or so
 *     umbd_acceptor_close(&acceptor, closed);
 *
 * libuv's own listening is not used. It holds one descriptor in reserve, with which it accepts and
 * drops connections when no other is left. If another thread takes that reserve meanwhile, libuv
 * asks the kernel again and again, and its loop does nothing else. The acceptor polls the socket
 * instead. A connection that cannot be accepted stays in the kernel's queue until the next tick,
 * and is served when a resource is free again.
 *
 * Threads: the loop's. A code is 0 or -errno, as libuv's are.
 */
#include <sys/socket.h>
#include <uv.h>

struct umbd_acceptor {
    uv_poll_t poll; /* Poll handle; its data is the acceptor */
    int fd;         /* Listening socket; -1: not started */
    int resting;    /* 1: a connection could not be taken, the tick tries again */
    void *user;
    /* Callback for a connection, non-blocking, which the callee owns. */
    void (*taken)(struct umbd_acceptor *acceptor, int fd);
    /* Callback when it starts to rest, with the reason. */
    void (*refused)(struct umbd_acceptor *acceptor, int code);
};

/* Makes a stream socket and binds it to an IPv4, IPv6 or Unix address. Out: fd: the caller's; -1 on
 * failure. */
int umbd_socket_bind(const struct sockaddr *address, int *fd);

/* Listens on fd and accepts connections. Set user, taken and refused first. Takes fd over, even on
 * failure. */
int umbd_acceptor_start(struct umbd_acceptor *acceptor, uv_loop_t *loop, int fd, int backlog);

/* Tries again to take what could not be taken. */
void umbd_acceptor_tick(struct umbd_acceptor *acceptor);

/* Closes the socket. Then calls closed with the acceptor's poll handle: in the loop's next turn, or
 * at once if the acceptor was never started. */
void umbd_acceptor_close(struct umbd_acceptor *acceptor, uv_close_cb closed);

#endif
