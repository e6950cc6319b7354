/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_ADMIN_H
#define UMBRAGE_SERVER_DAEMON_ADMIN_H
/*
 * The admin port: HTTP/1.1 on loopback for scrapers and probes. GET or HEAD /metrics, /livez,
 * /readyz; one request a connection, 4 KiB of it, 5 seconds, 32 connections.
 */
#include "daemon/daemon.h"

/* Opens the port of the options on the first loop, if they name one. A failure is fatal only at
 * boot. */
UMB_CHECKED enum umb_status umbd_admin_open(struct umbd_daemon *daemon, struct umb_error *error);

/* "http:HOST:PORT" of the open port, or NULL. */
const char *umbd_admin_text(const struct umbd_daemon *daemon);

void umbd_admin_tick(struct umbd_daemon *daemon, uint64_t now_ms);

/* Closes port and connections. */
void umbd_admin_close(struct umbd_daemon *daemon);

#endif
