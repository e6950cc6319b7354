/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_VIEW_SERVER_H
#define UMBRAGE_CLI_CLI_VIEW_SERVER_H
/*
 * A web server for one user on this machine. It listens on 127.0.0.1 alone and answers GET and HEAD
 * of the files of a site, below a path whose first part is random: other users of the machine do
 * not know it. It requires a Host that is this machine, because a web page elsewhere could reach it
 * under a name of its own (DNS rebinding). Heads are parsed as the daemon parses them
 * (net/http1_request.h).
 *
 * Bounds: 32 connections, 8 KiB a head, 10 s from the begin of a head to its end. A reply takes at
 * most 10 s and a second for each 64 KiB. If all connections are taken, a new one replaces the one
 * that has waited longest for a request; without such a one it is closed.
 */
#include "cli_view_site.h"

#define UMBC_VIEW_KEY_SIZE 33 /* Bytes of the key with its end: 128 random bits in hexadecimal */

struct umbc_view_listener {
    int socket;
    unsigned port;
    char key[UMBC_VIEW_KEY_SIZE]; /* First part of every path */
};

/* Listens. In: listener->port: 0 = any. Fails: E_UNAVAILABLE. */
UMB_CHECKED enum umb_status umbc_view_listen(struct umbc_view_listener *listener,
                                             struct umb_error *error);

/* Serves until the process ends. Returns only after a failure of the listener: E_IO. */
UMB_CHECKED enum umb_status umbc_view_serve(const struct umbc_view_listener *listener,
                                            struct umbc_view_site *site, struct umb_error *error);

#endif
