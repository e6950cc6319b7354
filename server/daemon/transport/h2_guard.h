/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_H2_GUARD_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_H2_GUARD_H
/*
 * Counters for two things that nghttp2 does not count: decoded header bytes of one block, and cheap
 * frames of one connection. The functions are pure arithmetic on the caller's memory; the
 * connection decides what to do.
 *
 * Measured on nghttp2 1.52: without a count one 16 kB header block decodes to 48 MB, and 300 000
 * PING, SETTINGS, PRIORITY, empty DATA or unknown frames pass without a limit.
 */
#include <stddef.h>
#include <stdint.h>

#define UMBD_HEADER_FIELDS_MAX 64   /* number of fields of one request, trailers included */
#define UMBD_HEADER_BYTES_MAX  8192 /* RFC 9113 size: name + value + 32 a field */
#define UMBD_HEADER_STRIKES    3    /* number of over-long blocks before the connection ends */
#define UMBD_CONTROL_BURST     1000 /* number of control frames at once */
#define UMBD_CONTROL_RATE      200  /* control frames a second after the burst */
#define UMBD_CONTROL_CREDIT    8    /* number of control frames that a sent DATA frame pays for */
/* Bytes of a DATA frame below which it counts as a control frame, unless it ends its stream. */
#define UMBD_TINY_DATA 256
/* Bytes of a DATA frame that pays for the small DATA frames and WINDOW_UPDATEs that come with it.
 * For every frame of about 16 KiB, HAProxy 2.6 sends 0.9 small DATA frames and 0.4
 * WINDOW_UPDATEs. */
#define UMBD_LONG_DATA   4096
#define UMBD_LONG_CREDIT 4

/* A token bucket: tokens are added at a rate, up to a burst; each event takes some. */
struct umbd_bucket {
    uint64_t tokens_ns; /* Level, in nanoseconds of inflow */
    uint64_t burst_ns;
    uint64_t token_ns; /* Inflow time of one token */
    uint64_t last_ns;
};

/* Starts a full bucket. In: per_second: 1..1e9; burst * (1e9 / per_second) must fit 63 bits. */
void umbd_bucket_init(struct umbd_bucket *bucket, uint32_t burst, uint32_t per_second,
                      uint64_t now_ns);

/* Takes one token; returns 1, or 0 and takes nothing if none is left. */
int umbd_bucket_take(struct umbd_bucket *bucket, uint64_t now_ns);

/* Gives tokens, never above the burst. */
void umbd_bucket_credit(struct umbd_bucket *bucket, uint32_t tokens);

/* Counts the decoded header fields of one request. Zero it before use. */
struct umbd_header_budget {
    uint32_t fields, bytes;
};

/* Counts one header field. Returns 1, or 0 if the request's headers now exceed a limit. */
int umbd_header_take(struct umbd_header_budget *budget, size_t name_bytes, size_t value_bytes);

#endif
