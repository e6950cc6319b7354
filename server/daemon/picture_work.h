/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_PICTURE_WORK_H
#define UMBRAGE_SERVER_DAEMON_PICTURE_WORK_H
/*
 * Frame loops: batches whose points are a picture's pixels, and whose answers are packed against
 * the stream's last ones.
 *
 * A stream keeps the answers of its last packed reply (struct umbd_kept_picture). A request that
 * names them by their mark takes them along in its batch; the worker that ends the batch packs, and
 * leaves the new answers there for the stream. A batch that fails takes them with it: the next
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

/* Of a batch. */
struct umbd_picture_work {
    int has_picture; /* its depths are the batch's positions */
    struct umb_picture picture;
    int pack;
    struct umbd_kept_picture kept; /* before: what to pack against; after: these answers */
    uint8_t *block;                /* owned: room for a head, then the packed answers */
    size_t packed_bytes;
    int changes; /* packed against what was kept */
};

struct umbd_batch;

/* Answers pixels first .. first + count - 1 of a batch with a picture. In: query, values: of one
 * part. first: a multiple of 8. */
void umbd_picture_work_run(const struct umbd_batch *batch, const struct umb_query *query,
                           size_t first, size_t count, struct umb_answers *answers);

/* Packs a batch's answers; called once, by whoever ends it. On failure the batch has its status. */
void umbd_picture_work_pack(struct umbd_batch *batch);

void umbd_picture_work_finish(struct umbd_picture_work *picture_work);

#endif
