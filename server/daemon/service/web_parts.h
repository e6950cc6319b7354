/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_WEB_PARTS_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_WEB_PARTS_H
/*
 * Paths, byte ranges and entity tags of HTTP requests. Pure functions of texts that a peer wrote.
 *
 * Source: RFC 9110 sections 8.8.3 (ETag), 13.1 (conditions), 14.1 and 14.2 (ranges).
 */
#include "daemon/transport/http1_request.h"
#include "store/store.h"
#include "umbrage/region.h"

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
int umbd_web_route(struct umbd_http1_text path, struct umbd_web_route *route);

#define UMBD_RANGES_MAX 128 /* as of Regions.Stream */

enum umbd_ranges_result {
    UMBD_RANGES_NONE = 0,  /* Another unit than bytes: the field has no effect */
    UMBD_RANGES_OK,        /* At least one range with bytes */
    UMBD_RANGES_BEYOND,    /* All ranges begin behind the end */
    UMBD_RANGES_MALFORMED, /* No list of ranges */
    UMBD_RANGES_TOO_MANY,  /* More than UMBD_RANGES_MAX */
    UMBD_RANGES_OVERLAP,   /* Two ranges have a byte in common */
};

/*
 * Parses a Range field for a file of `size` bytes. Ranges that begin behind the end are left out;
 * the others are cut at the end. As no two ranges overlap, a reply is never larger than the file.
 *
 * Out:   ranges: [UMBD_RANGES_MAX], in the order of the field. count: number of ranges.
 */
enum umbd_ranges_result umbd_ranges_parse(struct umbd_http1_text field, uint64_t size,
                                          struct umb_range *ranges, size_t *count);

/*
 * Returns 1 if a field of conditions (If-Match, If-None-Match) lists an entity tag, or is `*`. A
 * malformed list has no tag from its first error on.
 *
 * In:    tag: strong tag, with its quotes. weakly: 1 = tags that are marked as weak count too.
 */
int umbd_tags_have(struct umbd_http1_text field, const char *tag, int weakly);

#endif
