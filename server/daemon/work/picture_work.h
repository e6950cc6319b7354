/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_PICTURE_WORK_H
#define UMBRAGE_SERVER_DAEMON_WORK_PICTURE_WORK_H
/*
 * Pictures: batches whose points are a picture's pixels, and whose answers are packed against the
 * stream's last ones.
 *
 * A stream keeps the answers of its last packed reply (struct umbd_kept_picture). A request that
 * names them by their mark moves them into its batch. The worker that ends the batch packs, and
 * leaves the new answers there for the stream. If a batch fails they are lost with it: the next
 * reply is whole.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/picture.h"

/* Answers that a client has. Owned by a call or a batch. */
struct umbd_kept_picture {
    uint8_t *values; /* malloc; NULL: none */
    size_t bytes;
    uint64_t mark;
};
void umbd_kept_picture_drop(struct umbd_kept_picture *kept);

/* Picture state of a batch. */
struct umbd_picture_work {
    int has_picture; /* 1 if the batch's positions are the picture's depths */
    struct umb_picture picture;
    int pack;
    /* Before the work: base of the packing; after it: these answers. */
    struct umbd_kept_picture kept;
    uint8_t *block; /* owned: room for a head, then the packed answers */
    size_t packed_bytes;
    int changes; /* 1 if packed as changes against the base */
};

struct umbd_batch;

/* Answers pixels first .. first + count - 1 of a batch with a picture. In: query, values: of one
 * part. first: a multiple of 8. */
void umbd_picture_work_run(const struct umbd_batch *batch, const struct umb_query *query,
                           size_t first, size_t count, struct umb_answers *answers);

/* Packs a batch's answers; called once, at its end. On failure the batch has its status. */
void umbd_picture_work_pack(struct umbd_batch *batch);

void umbd_picture_work_finish(struct umbd_picture_work *picture_work);

#endif
