/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LISTENER_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LISTENER_H
/* Listening sockets of a loop: TCP, plain or with TLS, and Unix. */
#include "daemon/transport/acceptor.h"
#include "daemon/transport/loop.h"
#include "daemon/base/net_address.h"

struct umbd_listener {
    struct umbd_listener *next;
    struct umbd_loop *loop;
    struct umbd_acceptor acceptor;
    enum umbn_transport transport;
    enum umbd_language language;
    int logged; /* 1: its failure to accept is logged, and nothing was accepted since */
    char path[UMBN_UNIX_PATH_SIZE];    /* Path of a Unix socket, unlinked at close; "" */
    char text[UMBD_ADDRESS_TEXT_SIZE]; /* Address: tcp:HOST:PORT, tls:HOST:PORT, unix:PATH; with
                                          http+ before it for HTTP/1.1 */
};

/*
 * Opens the sockets that the service manager passes, or, if there are none, all addresses of the
 * options. A stale Unix socket, on which no process answers, is replaced; any other file at that
 * path is left alone. After a failure call umbd_listeners_close for the sockets already open.
 * Fails: E_UNAVAILABLE (in use, no permission), E_ARGUMENT (unknown host), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbd_listeners_open(struct umbd_loop *loop, struct umb_error *error);

/* Tries again to take connections that could not be taken. */
void umbd_listeners_tick(struct umbd_loop *loop);

/* Stops listening; the handles' memory is freed in the loop's next turn. */
void umbd_listeners_close(struct umbd_loop *loop);

#endif
