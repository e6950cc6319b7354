/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_OPTIMISTIC_READS_H
#define UMBRAGE_SERVER_DAEMON_OPTIMISTIC_READS_H
/*
 * The proofs that a loop owes for answers of small batches.
 *
 * What was read from a mapped file may leave once the file has been looked at after the read and
 * found unchanged (store/asset_map.h). The look is a system call that takes as long as ten
 * look-ups, so small batches only peek: their answers go into the bodies of their calls, the loop
 * notes which versions it read, and before a frame is made of any body each of them is looked at
 * once. Where one has changed, the calls that read it take back what is not proven and fail.
 *
 *     umbd_optimistic_reads_find -> peek -> umbd_optimistic_reads_add -> umbd_call_commit ... umbd_optimistic_reads_revalidate -> send
 *
 * Everything is settled by the flush that ends the event, and by the tick at the latest, so a
 * version that was replaced is not held longer than that. Threads: the loop's.
 */
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "wire/messages.h"

#define UMBD_OPTIMISTIC_READS_MAX 4 /* versions at once; more are settled early */

struct umbd_batch;
struct umbd_call;
struct umbd_loop;

struct umbd_optimistic_reads {
    uint64_t turn;  /* of what is owed now, from 1 on; calls remember it */
    uint64_t at_ms; /* uv_now of the first */
    size_t count;
    struct {
        struct umbs_entry *entry;            /* one reference */
        char asked[UMBW_ASSET_NAME_MAX + 1]; /* the name or id that it was found by */
    } optimistic_reads[UMBD_OPTIMISTIC_READS_MAX];
};

/* The version that was found by that name in this event, or NULL. Borrowed until the next settle.
 */
struct umbs_entry *umbd_optimistic_reads_find(const struct umbd_loop *loop, const char *asked);

/* The call is about to commit what the batch's one part peeked; there must be room for a version.
 * Takes the part's reference if it has one to give. */
void umbd_optimistic_reads_add(struct umbd_call *call, struct umbd_batch *batch, const char *asked);

/* 1 if a further version may be owed. */
int umbd_optimistic_reads_has_room(const struct umbd_loop *loop);

/* Looks at every file that is owed, fails calls where one has changed. Safe in call-backs. */
void umbd_optimistic_reads_revalidate(struct umbd_loop *loop);

#endif
