/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_ADMIN_H
#define UMBRAGE_SERVER_DAEMON_ADMIN_H
/*
 * The admin port: HTTP/1.1 on loopback for scrapers and probes. It answers GET and HEAD of
 * /metrics, /livez and /readyz. Limits: one request for each connection, 4 KiB a request, 5
 * seconds, 32 connections.
 */
#include "daemon/daemon.h"

/* Opens the admin port on the first loop, if the options name one. Only a failure at the start ends
 * the daemon. */
UMB_CHECKED enum umb_status umbd_admin_open(struct umbd_daemon *daemon, struct umb_error *error);

/* "http:HOST:PORT" of the open port, or NULL. */
const char *umbd_admin_text(const struct umbd_daemon *daemon);

void umbd_admin_tick(struct umbd_daemon *daemon, uint64_t now_ms);

/* Closes port and connections. */
void umbd_admin_close(struct umbd_daemon *daemon);

#endif
