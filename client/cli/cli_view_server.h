/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_VIEW_SERVER_H
#define UMBRAGE_CLI_CLI_VIEW_SERVER_H
/*
 * A web server for one user on this machine. It listens on 127.0.0.1 alone, answers GET and HEAD of
 * the files of a site, and requires a Host field that names this machine: otherwise a foreign web
 * page could reach the server through a host name of its own (DNS rebinding). Heads are parsed as
 * the daemon parses them (net/http1_request.h).
 *
 * Bounds: 32 connections, 8 KiB a head, 10 s from the first byte of a head to its last, 30 s for a
 * peer that accepts no bytes.
 */
#include "cli_view_site.h"

/* Listens. In: port: 0 = any. Out: port: the port. Fails: E_UNAVAILABLE. */
UMB_CHECKED enum umb_status umbc_view_listen(unsigned *port, int *listener,
                                             struct umb_error *error);

/* Serves until the process ends. Returns only after a failure of the listener: E_IO. */
UMB_CHECKED enum umb_status umbc_view_serve(int listener, struct umbc_view_site *site,
                                            struct umb_error *error);

#endif
