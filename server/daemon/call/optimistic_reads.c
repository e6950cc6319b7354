/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Recording and revalidating optimistic reads.
 *
 * Invariant: the unvalidated bytes of a body are its last `unvalidated_bytes`. A body has such
 * bytes only while the call's optimistic_turn equals the loop's turn. HTTP/2 frames are made only
 * in a flush, which revalidates first.
 */
#include "daemon/call/optimistic_reads.h"

#include <string.h>

#include "daemon/call/call.h"

struct umbs_entry *umbd_optimistic_reads_find(const struct umbd_call_home *home, const char *asked)
{
    const struct umbd_optimistic_reads *optimistic = &home->optimistic;
    if (optimistic->count == 0 || optimistic->at_ms != uv_now(&home->loop->uv)) {
        return NULL;
    }
    for (size_t i = 0; i < optimistic->count; i++) {
        if (strcmp(optimistic->reads[i].asked, asked) == 0) {
            return optimistic->reads[i].entry;
        }
    }
    return NULL;
}

int umbd_optimistic_reads_has_room(const struct umbd_call_home *home)
{
    return home->optimistic.count < UMBD_OPTIMISTIC_READS_MAX;
}

/* Index of the batch's version in the list, or of its new place. */
static size_t place_of(struct umbd_call_home *home, struct umbd_batch *batch, const char *asked)
{
    struct umbd_optimistic_reads *optimistic = &home->optimistic;
    struct umbs_entry *entry = batch->parts[0].entry;
    size_t i = 0;
    while (i < optimistic->count && optimistic->reads[i].entry != entry) {
        i++;
    }
    if (i == optimistic->count) {
        optimistic->reads[i].entry = entry;
        memcpy(optimistic->reads[i].asked, asked, strlen(asked) + 1);
        batch->is_borrowed = 1; /* the reference is the list's now */
        if (optimistic->count++ == 0) {
            optimistic->at_ms = uv_now(&home->loop->uv);
        }
    }
    return i;
}

void umbd_optimistic_reads_add(struct umbd_call *call, struct umbd_batch *batch, const char *asked)
{
    struct umbd_call_home *home = call->home;
    const size_t place = place_of(home, batch, asked);
    if (call->optimistic_turn != home->optimistic.turn) {
        call->optimistic_turn = home->optimistic.turn;
        call->optimistic_reads = 0;
        call->unvalidated_bytes = 0;
    }
    call->optimistic_reads |= 1U << place;
}

static void fail_calls(struct umbd_call_home *home, uint64_t turn, unsigned place,
                       const struct umb_error *error)
{
    for (struct umbd_conn *conn = LIST_FIRST(&home->loop->conns); conn != NULL;
         conn = LIST_NEXT(conn, link)) {
        for (struct umbd_call *call = LIST_FIRST(&conn->calls); call != NULL;
             call = LIST_NEXT(call, link)) {
            if (call->optimistic_turn == turn && (call->optimistic_reads & place) != 0) {
                umbd_call_discard_unvalidated(call, error);
                umbd_loop_flush_later(conn);
            }
        }
    }
}

void umbd_optimistic_reads_revalidate(struct umbd_call_home *home)
{
    struct umbd_optimistic_reads *optimistic = &home->optimistic;
    struct umb_error error;
    const size_t count = optimistic->count;
    if (count == 0) {
        return;
    }
    const uint64_t turn = optimistic->turn++;
    optimistic->count = 0;
    for (size_t i = 0; i < count; i++) {
        if (umbs_entry_revalidate(optimistic->reads[i].entry, &error) != UMB_OK) {
            fail_calls(home, turn, 1U << i, &error);
        }
        umbs_entry_release(optimistic->reads[i].entry);
    }
}
