/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_HTTP1_FIELDS_H
#define UMBRAGE_NET_HTTP1_FIELDS_H
/*
 * Hosts, byte ranges and entity tags of HTTP requests. Pure functions of texts that a peer wrote.
 *
 * Source: RFC 9110 sections 7.2 (Host), 8.8.3 (ETag), 13.1 (conditions), 14.1 and 14.2 (ranges).
 */
#include "net/http1_request.h"
#include "umbrage/region.h"

/*
 * Returns 1 if the value of a Host header names this machine: localhost, 127.*, [::1], each also
 * with a port. In a DNS rebinding attack, a web page's own name resolves to 127.0.0.1, and the
 * browser sends that name as the host.
 */
int umbn_host_is_local(struct umbn_http1_text host);

#define UMBN_RANGES_MAX 128 /* as of Regions.Stream */

enum umbn_ranges_result {
    UMBN_RANGES_NONE = 0,  /* Another unit than bytes: the field has no effect */
    UMBN_RANGES_OK,        /* At least one range with bytes */
    UMBN_RANGES_BEYOND,    /* All ranges begin behind the end */
    UMBN_RANGES_MALFORMED, /* No list of ranges */
    UMBN_RANGES_TOO_MANY,  /* More than UMBN_RANGES_MAX */
    UMBN_RANGES_OVERLAP,   /* Two ranges have a byte in common */
};

/*
 * Parses a Range field for a file of `size` bytes. Ranges that begin behind the end are left out;
 * the others are cut at the end. As no two ranges overlap, a reply is never larger than the file.
 *
 * Out:   ranges: [UMBN_RANGES_MAX], in the order of the field. count: number of ranges.
 */
enum umbn_ranges_result umbn_ranges_parse(struct umbn_http1_text field, uint64_t size,
                                          struct umb_range *ranges, size_t *count);

/*
 * Returns 1 if a field of conditions (If-Match, If-None-Match) lists an entity tag, or is `*`. A
 * malformed list has no tag from its first error on.
 *
 * In:    tag: strong tag, with its quotes. weakly: 1 = tags that are marked as weak count too.
 */
int umbn_tags_have(struct umbn_http1_text field, const char *tag, int weakly);

/* Returns the reason phrase of an answer's status; of 500 for a status that is never sent. */
const char *umbn_http1_reason(int status);

#endif
