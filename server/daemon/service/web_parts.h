/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_WEB_PARTS_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_WEB_PARTS_H
/*
 * Paths of HTTP requests for assets. A pure function of a text that a peer wrote.
 */
#include "net/http1_request.h"
#include "store/store.h"

struct umbd_web_route {
    char asset[UMBS_STORE_NAME_MAX + 1]; /* Name, or 64 hexadecimal digits in small letters */
    int by_id;                           /* 1: the path names the id */
};

/*
 * Returns 1 and the asset of a path, or 0 if no asset can have it. Paths are /assets/NAME.umb and
 * /assets/by-id/ID.umb. A path is only looked up in the table of assets; it never becomes a path of
 * the file system. Names need no percent-encoding, so every `%` is refused: a path has one
 * spelling.
 */
int umbd_web_route(struct umbn_http1_text path, struct umbd_web_route *route);

#endif
