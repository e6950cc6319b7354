/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_HTTP1_REQUEST_H
#define UMBRAGE_NET_HTTP1_REQUEST_H
/*
 * Heads of HTTP/1.1 requests. The parser is strict: it accepts one spelling of each construct, so
 * that no proxy in front of the daemon can understand a request differently (request smuggling). A
 * request with a body is refused, because no method here has one.
 *
 * The functions are pure: they read the given bytes and write only the request.
 *
 * Source: RFC 9112 sections 2.2, 3, 5 and 6; RFC 9110 section 5.
 */
#include <stddef.h>
#include <stdint.h>

#define UMBN_HTTP1_HEAD_BYTES 8192 /* Most bytes of a request line and its header fields */
#define UMBN_HTTP1_FIELDS_MAX 64   /* Most header fields */

/* Part of the received bytes. bytes is NULL if the request does not have it. */
struct umbn_http1_text {
    const char *bytes;
    size_t size;
};

enum umbn_http1_method {
    UMBN_HTTP1_GET = 0,
    UMBN_HTTP1_HEAD,
    UMBN_HTTP1_OPTIONS,
    UMBN_HTTP1_OTHER,
};

struct umbn_http1_request {
    enum umbn_http1_method method;
    struct umbn_http1_text path; /* Path of the target, without the query */
    int keeps_open;              /* 1 if further requests may follow on the connection */
    int refusal;                 /* HTTP status with which the head is refused; 0: it is valid */
    const char *reason;          /* Text of the refusal; static */
    struct umbn_http1_text host;
    struct umbn_http1_text authorization;
    struct umbn_http1_text range;
    struct umbn_http1_text if_range;
    struct umbn_http1_text if_match;
    struct umbn_http1_text if_none_match;
    struct umbn_http1_text origin;
};

/*
 * Finds the end of a request's head.
 *
 * In:    bytes: [size], the begin of the request. seen: number of bytes searched before.
 * Returns the head's size with its empty line; 0 if the end has not come yet.
 */
size_t umbn_http1_head_size(const uint8_t *bytes, size_t size, size_t seen);

/*
 * Returns the status with which an incomplete head is refused already, or 0: 400 if its first byte
 * cannot begin a method, 414 or 431 if it is longer than UMBN_HTTP1_HEAD_BYTES.
 */
int umbn_http1_refuses_early(const uint8_t *bytes, size_t size);

/* Sets a request that is refused with that status. */
void umbn_http1_refuse(struct umbn_http1_request *request, int status);

/*
 * Parses a complete head. The texts of the request point into the bytes. On a refusal the fields
 * other than refusal, reason and keeps_open (0) may be set or not.
 */
void umbn_http1_parse(const uint8_t *head, size_t size, struct umbn_http1_request *request);

/* 1 if a text is that of a string, byte by byte. */
int umbn_http1_is(struct umbn_http1_text text, const char *string);

#endif
