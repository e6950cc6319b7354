/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_BATCH_H
#define UMBRAGE_SERVER_DAEMON_WORK_BATCH_H
/*
 * A batch: the points or the picture of one request, and their answers.
 *
 * Life: umbd_batch_create, then umbd_batch_add for each part. A small batch is answered at once
 * (umbd_batch_run) into `values`. A large batch gets memory for its answers (umbd_batch_reserve)
 * and goes to the workers as a task. umbd_batch_destroy frees the batch.
 */
#include "daemon/base/daemon_metrics.h"
#include "daemon/work/task.h"
#include "store/store.h"
#include "umbrage/curve.h"
#include "umbrage/picture.h"

/* One light of one asset, asked of all points of a batch. */
struct umbd_part {
    struct umbs_entry *entry; /* Version that answers, owned */
    uint32_t light;
    uint32_t taps, level; /* Requested, or chosen by the batch's dial */
    double expected_ns;   /* Expected cost of a point, by the calibration of a budget; else 0 */
    struct umb_query query;
    struct umb_query_settings asked; /* Settings that the query was made of */
    uint64_t serial; /* Serial of the entry that the query was made of; 0: there is no query */
};

/* Answers that a client has. Owned by a call or a batch. */
struct umbd_kept_picture {
    uint8_t *values; /* Answers, malloc; NULL: none */
    size_t bytes;
    uint64_t mark;
};

/* Picture state of a batch. */
struct umbd_picture_work {
    int has_picture; /* 1: the batch's positions are the picture's depths */
    struct umb_picture picture;
    int pack;
    /* Before the work: base of the packing; after it: these answers. */
    struct umbd_kept_picture kept;
    uint8_t *block; /* Room for a head, then the packed answers; owned */
    size_t packed_bytes;
    int changes; /* 1 if packed as changes against the base */
};

struct umbd_batch {
    uint8_t *message; /* Message with the points, owned; NULL if they lie elsewhere */
    size_t part_count;
    struct umbd_part *parts; /* [part_limit] */
    size_t part_limit;
    struct umb_points points;
    /* Settings of all parts: `light` is that of the last part added, `taps` the largest of any
     * part. */
    struct umb_query_settings settings;
    struct umb_dial dial; /* Chooses taps and level of each part, if it has a limit */
    const struct umb_calibration *calibration; /* For a budget, until the parts are added */
    uint8_t *values;                           /* part_count blocks of part_bytes for the answers */
    size_t part_bytes, value_bytes;            /* Bytes of one part's answers, and of all */
    uint8_t *reply;                            /* Room for a head, then values, owned; NULL: none */
    size_t head_room;
    int want_stats, with_targets;
    int is_borrowed;   /* 1: the one part's entry is not the batch's own */
    int is_optimistic; /* 1: its reads are revalidated later (optimistic_reads.h) */
    struct umbd_picture_work picture_work; /* Picture instead of points, packing of answers */
    struct umbd_task task;                 /* The last field: its error is never cleared */
};

static inline struct umbd_batch *umbd_batch_of(struct umbd_task *task)
{
    return (struct umbd_batch *)(void *)((char *)task - offsetof(struct umbd_batch, task));
}

/* Makes a batch of up to part_limit parts. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_batch_create(size_t part_limit,
                                              const struct umb_query_settings *settings,
                                              const struct umb_points *points,
                                              struct umbd_batch **out, struct umb_error *error);

/* The same as umbd_batch_create for at most one part, but uses the memory of *spare if there is
 * any. umbd_batch_recycle, in place of umbd_batch_destroy, keeps the batch's memory in *spare; the
 * memory owns nothing else, so free() releases it. */
UMB_CHECKED enum umb_status umbd_batch_reuse(struct umbd_batch **spare,
                                             const struct umb_query_settings *settings,
                                             const struct umb_points *points,
                                             struct umbd_batch **out, struct umb_error *error);
void umbd_batch_recycle(struct umbd_batch *batch, struct umbd_batch **spare);

/* Adds a part. Takes entry over, even on failure, unless is_borrowed is set. Fails: as
 * umb_query_prepare. */
UMB_CHECKED enum umb_status umbd_batch_add(struct umbd_batch *batch, struct umbs_entry *entry,
                                           uint32_t light, struct umb_error *error);

/* Adds the one part of a reused batch again, without preparing its query. Takes entry over as
 * umbd_batch_add. Returns 1; or 0 if the last batch in this memory had another part. serial: the
 * entry's. */
int umbd_batch_repeat(struct umbd_batch *batch, struct umbs_entry *entry, uint64_t serial);

/* Allocates head_room bytes and the answers, and sets the task's functions and counts. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_batch_reserve(struct umbd_batch *batch, size_t head_room,
                                               struct umb_error *error);
void umbd_batch_destroy(struct umbd_batch *batch);

/* Checks and answers a whole batch on the calling thread, and stores the results in the batch's
 * task. */
void umbd_batch_run(struct umbd_batch *batch, struct umbd_metrics *metrics);

/*
 * Pictures (picture_work.c): batches whose points are a picture's pixels, and whose answers are
 * packed against the stream's last answers.
 *
 * A stream keeps the answers of its last packed reply (struct umbd_kept_picture). If a request
 * names these answers by their mark, they are moved into the request's batch. The worker that ends
 * the batch packs its answers and leaves the new ones in the batch for the stream. If a batch
 * fails, the kept answers are lost, and the next reply is whole.
 */
void umbd_kept_picture_drop(struct umbd_kept_picture *kept);

/* Answers pixels first .. first + count - 1 of a batch with a picture. In: query, answers: of one
 * part. first: a multiple of 8. */
void umbd_picture_work_run(const struct umbd_batch *batch, const struct umb_query *query,
                           size_t first, size_t count, struct umb_answers *answers);

/* Packs a batch's answers; called once, after the last slice. Fails: E_NO_MEMORY, as
 * umb_picture_pack. */
UMB_CHECKED enum umb_status umbd_picture_work_pack(struct umbd_batch *batch,
                                                   struct umb_error *error);

void umbd_picture_work_finish(struct umbd_picture_work *picture_work);

#endif
