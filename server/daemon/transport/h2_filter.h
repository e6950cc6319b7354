/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_H2_FILTER_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_H2_FILTER_H
/*
 * A filter for frames on their way to nghttp2. It removes RST_STREAM frames of streams that the
 * peer has not opened yet.
 *
 * Why:   gRPC's C core (Python, C++, Ruby; seen with 1.51) writes the RST_STREAM of a call
 *        cancelled at once before the HEADERS of the same call. By RFC 9113 that is a connection
 *        error: nghttp2 would end the session and with it every other call of that client. The
 *        filter remembers such a stream. When its HEADERS come, they begin a call that is already
 *        cancelled.
 *
 * Everything else passes unchanged, in the same order. The functions are pure; the state is in the
 * caller's memory.
 */
#include <stddef.h>
#include <stdint.h>

#define UMBD_EARLY_RESETS 256 /* number of resets remembered: as many as streams may be open */

struct umbd_h2_filter {
    unsigned preface_left; /* Bytes of the client preface still to come */
    uint8_t head[9];       /* Head of the next frame */
    unsigned head_bytes;
    uint32_t payload_left; /* Bytes left of the current frame */
    int dropping;          /* 1 if the current frame is dropped */
    uint32_t data_stream;  /* Stream of the current frame if it is DATA without padding, or 0 */
    uint32_t highest;      /* Highest stream opened by HEADERS */
    uint32_t early[UMBD_EARLY_RESETS]; /* Streams reset early, 0 = none */
    unsigned next_early;
    /* Number of early resets, and of frames of unknown types; both wrap. nghttp2 skips unknown
     * types without a report, so the count of cheap frames adds them from this field. */
    unsigned odd;
};

/* Takes bytes; returns 0, or another value to stop. */
typedef int (*umbd_emit_fn)(void *user, const uint8_t *bytes, size_t count);

void umbd_h2_filter_init(struct umbd_h2_filter *filter);

/* Passes bytes to `emit`, in one or more pieces. Returns 0, or the value with which emit
 * stopped. */
int umbd_h2_filter_feed(struct umbd_h2_filter *filter, const uint8_t *bytes, size_t count,
                        umbd_emit_fn emit, void *user);

/* Returns how many bytes of the current DATA frame are still to come, and the frame's stream; 0 if
 * the current frame is no DATA frame or contains padding. */
uint32_t umbd_h2_filter_data_left(const struct umbd_h2_filter *filter, uint32_t *stream_id);

/* 1 if that stream was reset before it was opened; reported once. */
int umbd_h2_filter_was_reset(struct umbd_h2_filter *filter, uint32_t stream_id);

#endif
