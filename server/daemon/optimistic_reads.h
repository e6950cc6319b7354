/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_OPTIMISTIC_READS_H
#define UMBRAGE_SERVER_DAEMON_OPTIMISTIC_READS_H
/*
 * Optimistic reads of small batches, revalidated before their answers are sent.
 *
 * An answer from a mapped file may be sent once a look at the file after the read has found it
 * unchanged (store/asset_map.h). The look is a system call that takes as long as ten look-ups. So a
 * small batch reads without it: its answers go into the body of its call, the loop notes which
 * version was read, and looks at each version once before it makes an HTTP/2 frame of any body. If
 * a file changed, every call that read it discards its unsent answers and fails.
 *
 *     umbd_optimistic_reads_find, umbs_entry_read_optimistic, umbd_optimistic_reads_add,
 *     umbd_call_commit ... umbd_optimistic_reads_revalidate, send
 *
 * The flush that ends the event revalidates, and the tick at the latest, so a version that was
 * replaced is not held longer than that. Threads: the loop's.
 */
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "wire/messages.h"

#define UMBD_OPTIMISTIC_READS_MAX 4 /* versions at once; more are revalidated early */

struct umbd_batch;
struct umbd_call;
struct umbd_loop;

struct umbd_optimistic_reads {
    uint64_t turn;  /* number of this round of reads, from 1 on; calls remember it */
    uint64_t at_ms; /* uv_now of the first */
    size_t count;
    struct {
        struct umbs_entry *entry;            /* one reference */
        char asked[UMBW_ASSET_NAME_MAX + 1]; /* the name or id that it was found by */
    } reads[UMBD_OPTIMISTIC_READS_MAX];
};

/* The version that was found by that name in this event, or NULL. Borrowed until the next
 * revalidation. */
struct umbs_entry *umbd_optimistic_reads_find(const struct umbd_loop *loop, const char *asked);

/* The call is about to commit what the batch's one part read; there must be room for a version.
 * Takes the part's reference if it has one to give. */
void umbd_optimistic_reads_add(struct umbd_call *call, struct umbd_batch *batch, const char *asked);

/* 1 if there is room for a further version. */
int umbd_optimistic_reads_has_room(const struct umbd_loop *loop);

/* Looks at every file that was read, fails calls where one has changed. Safe in call-backs. */
void umbd_optimistic_reads_revalidate(struct umbd_loop *loop);

#endif
