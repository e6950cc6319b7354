/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The filter of early resets. A frame head is 9 bytes: length (3), type, flags, stream id (4), big
 * endian (RFC 9113, section 4.1). If the end of a read cuts a head, its bytes are held back until
 * the rest comes. All other bytes are passed on in place, whole runs of frames at once.
 */
#include "daemon/transport/h2_filter.h"

#include <string.h>

#define PREFACE_BYTES   24
#define HEAD_BYTES      9
#define TYPE_DATA       0
#define TYPE_HEADERS    1
#define TYPE_RST_STREAM 3
#define FLAG_PADDED     8
#define TYPE_LAST_KNOWN 9 /* CONTINUATION */

void umbd_h2_filter_init(struct umbd_h2_filter *filter)
{
    memset(filter, 0, sizeof *filter);
    filter->preface_left = PREFACE_BYTES;
}

/* Reads the complete head; decides whether its frame is dropped. */
static void begin_frame(struct umbd_h2_filter *filter)
{
    const uint8_t *h = filter->head;
    uint32_t stream =
        ((uint32_t)h[5] << 24 | (uint32_t)h[6] << 16 | (uint32_t)h[7] << 8 | h[8]) & 0x7fffffffU;
    filter->payload_left = (uint32_t)h[0] << 16 | (uint32_t)h[1] << 8 | h[2];
    filter->head_bytes = 0;
    filter->dropping = 0;
    filter->data_stream = h[3] == TYPE_DATA && (h[4] & FLAG_PADDED) == 0 ? stream : 0;
    if (h[3] == TYPE_HEADERS && stream > filter->highest) {
        filter->highest = stream;
    } else if (h[3] == TYPE_RST_STREAM && filter->payload_left == 4 && stream % 2 == 1 &&
               stream > filter->highest) {
        filter->dropping = 1;
        filter->early[filter->next_early++ % UMBD_EARLY_RESETS] = stream;
        filter->odd++;
    } else if (h[3] > TYPE_LAST_KNOWN) {
        filter->odd++;
    }
}

static size_t smaller(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* Passes bytes[from .. to) on. */
static int pass(const uint8_t *bytes, size_t from, size_t to, umbd_emit_fn emit, void *user)
{
    return from < to ? emit(user, bytes + from, to - from) : 0;
}

/*
 * Reads the bytes of a frame head at `at`. *run is the start of the bytes not passed on yet. Moves
 * both pointers.
 */
static int take_head(struct umbd_h2_filter *filter, const uint8_t *bytes, size_t count, size_t *at,
                     size_t *run, umbd_emit_fn emit, void *user)
{
    unsigned held = filter->head_bytes;
    size_t part = smaller(HEAD_BYTES - held, count - *at);
    int code = 0;
    memcpy(filter->head + held, bytes + *at, part);
    filter->head_bytes += (unsigned)part;
    if (filter->head_bytes < HEAD_BYTES) {
        code = pass(bytes, *run, *at, emit, user);
        *run = *at + part;
    } else {
        begin_frame(filter);
        if (held > 0) {
            code = filter->dropping ? 0 : emit(user, filter->head, HEAD_BYTES);
            *run = *at + part;
        } else if (filter->dropping) {
            code = pass(bytes, *run, *at, emit, user);
            *run = *at + part;
        }
    }
    *at += part;
    return code;
}

int umbd_h2_filter_feed(struct umbd_h2_filter *filter, const uint8_t *bytes, size_t count,
                        umbd_emit_fn emit, void *user)
{
    size_t at = 0;
    size_t run = 0;
    int code = 0;
    while (at < count && code == 0) {
        if (filter->preface_left > 0) {
            size_t part = smaller(filter->preface_left, count - at);
            filter->preface_left -= (unsigned)part;
            at += part;
        } else if (filter->payload_left > 0) {
            size_t part = smaller(filter->payload_left, count - at);
            filter->payload_left -= (uint32_t)part;
            at += part;
            run = filter->dropping ? at : run;
        } else {
            code = take_head(filter, bytes, count, &at, &run, emit, user);
        }
    }
    return code != 0 ? code : pass(bytes, run, count, emit, user);
}

uint32_t umbd_h2_filter_data_left(const struct umbd_h2_filter *filter, uint32_t *stream_id)
{
    *stream_id = filter->data_stream;
    return filter->preface_left == 0 && filter->data_stream != 0 && filter->head_bytes == 0
               ? filter->payload_left
               : 0;
}

int umbd_h2_filter_was_reset(struct umbd_h2_filter *filter, uint32_t stream_id)
{
    int found = 0;
    for (size_t i = 0; filter->next_early > 0 && i < UMBD_EARLY_RESETS; i++) {
        if (filter->early[i] == stream_id) {
            filter->early[i] = 0; /* a peer may have reset it more than once */
            found = 1;
        }
    }
    return found;
}
