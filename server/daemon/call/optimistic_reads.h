/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_OPTIMISTIC_READS_H
#define UMBRAGE_SERVER_DAEMON_CALL_OPTIMISTIC_READS_H
/*
 * Optimistic reads of small batches, revalidated before their answers are sent.
 *
 * An answer from a mapped file may be sent once a check after the read has found the file unchanged
 * (store/asset_map.h). The check is a system call that takes as long as ten look-ups. A small batch
 * therefore reads without a check. Its answers go into the body of its call, and the loop records
 * the version that was read. Before the loop makes an HTTP/2 frame of any body, it checks each
 * recorded version once. If a file changed, every call that read it discards its unsent answers and
 * fails.
 *
 *     umbd_optimistic_reads_find, umbs_entry_read_optimistic, umbd_optimistic_reads_add,
 *     umbd_call_commit ... umbd_optimistic_reads_revalidate, send
 *
 * The flush at the end of an event revalidates, at the latest the flush of the next tick. So a
 * replaced version is not held longer than until then. Threads: the loop's.
 */
#include <stddef.h>
#include <stdint.h>
#include "store/store.h"
#include "wire/messages.h"

#define UMBD_OPTIMISTIC_READS_MAX                                                                  \
    4 /* number of versions at once; a further one revalidates early */

struct umbd_batch;
struct umbd_call;
struct umbd_call_home;

struct umbd_optimistic_reads {
    uint64_t turn;  /* Number of this round of reads, from 1 on; calls remember it */
    uint64_t at_ms; /* Time of the first read, uv_now */
    size_t count;
    struct {
        struct umbs_entry *entry;            /* Version that was read, with one reference */
        char asked[UMBW_ASSET_NAME_MAX + 1]; /* Name or id that found it */
    } reads[UMBD_OPTIMISTIC_READS_MAX];
};

/* Returns the version that this event found under that name, or NULL. It is borrowed until the next
 * revalidation. */
struct umbs_entry *umbd_optimistic_reads_find(const struct umbd_call_home *home, const char *asked);

/* Records which version a batch of one part read, before the call queues the batch's answers. Call
 * it only if there is room for a further version. A reference that the batch holds to the version
 * passes to the record. */
void umbd_optimistic_reads_add(struct umbd_call *call, struct umbd_batch *batch, const char *asked);

/* 1 if there is room for a further version. */
int umbd_optimistic_reads_has_room(const struct umbd_call_home *home);

/* Checks every file that was read, and fails the calls that read a changed one. Safe in
 * callbacks. */
void umbd_optimistic_reads_revalidate(struct umbd_call_home *home);

#endif
