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
 * libuv's own listening holds one descriptor in reserve. When there is no other, it uses that one
 * to accept and drop waiting connections. If another thread takes the reserve meanwhile, libuv asks
 * the kernel again and again, and its loop does nothing else. Here the socket is polled. A
 * connection that cannot be taken stays in the kernel's queue until the next tick, and is served
 * when a resource is free again.
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

/* Makes a stream socket and binds it to an address of IPv4, IPv6 or a Unix socket. Out: fd: the
 * caller's; -1 on failure. */
int umbd_socket_bind(const struct sockaddr *address, int *fd);

/* Listens on fd and accepts connections. Set user, taken and refused before. Takes fd over, also on
 * failure. */
int umbd_acceptor_start(struct umbd_acceptor *acceptor, uv_loop_t *loop, int fd, int backlog);

/* Tries again to take what could not be taken. */
void umbd_acceptor_tick(struct umbd_acceptor *acceptor);

/* Closes the socket. Calls closed(the acceptor's poll handle) in the loop's next turn, or at once
 * if it was never started. */
void umbd_acceptor_close(struct umbd_acceptor *acceptor, uv_close_cb closed);

#endif
