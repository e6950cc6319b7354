/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Owing and settling proofs.
 *
 * Invariant: bytes of a body that are not proven are its last `owed_bytes`, and there are some only
 * while the call's owed_turn is the loop's: frames are made in a flush, which settles first.
 */
#include "daemon/proof.h"

#include <string.h>

#include "daemon/call.h"

struct umbs_entry *umbd_proof_find(const struct umbd_loop *loop, const char *asked)
{
    const struct umbd_proof *proof = &loop->proof;
    if (proof->count == 0 || proof->at_ms != uv_now(&loop->uv)) {
        return NULL;
    }
    for (size_t i = 0; i < proof->count; i++) {
        if (strcmp(proof->owed[i].asked, asked) == 0) {
            return proof->owed[i].entry;
        }
    }
    return NULL;
}

int umbd_proof_has_room(const struct umbd_loop *loop)
{
    return loop->proof.count < UMBD_OWED_MAX;
}

/* Where the version stands, or its new place. */
static size_t place_of(struct umbd_loop *loop, struct umbd_batch *batch, const char *asked)
{
    struct umbd_proof *proof = &loop->proof;
    struct umbs_entry *entry = batch->parts[0].entry;
    size_t i = 0;
    while (i < proof->count && proof->owed[i].entry != entry) {
        i++;
    }
    if (i == proof->count) {
        proof->owed[i].entry = entry;
        memcpy(proof->owed[i].asked, asked, strlen(asked) + 1);
        batch->is_borrowed = 1; /* its reference is ours now */
        if (proof->count++ == 0) {
            proof->at_ms = uv_now(&loop->uv);
        }
    }
    return i;
}

void umbd_proof_owe(struct umbd_call *call, struct umbd_batch *batch, const char *asked)
{
    struct umbd_loop *loop = call->conn->loop;
    const size_t place = place_of(loop, batch, asked);
    if (call->owed_turn != loop->proof.turn) {
        call->owed_turn = loop->proof.turn;
        call->owed = 0;
        call->owed_bytes = 0;
    }
    call->owed |= 1U << place;
}

static void fail_calls(struct umbd_loop *loop, uint64_t turn, unsigned place,
                       const struct umb_error *error)
{
    for (struct umbd_conn *conn = loop->first_conn; conn != NULL; conn = conn->next) {
        for (struct umbd_call *call = conn->calls; call != NULL; call = call->next) {
            if (call->owed_turn == turn && (call->owed & place) != 0) {
                umbd_call_take_back(call, error);
                umbd_loop_flush_later(conn);
            }
        }
    }
}

void umbd_proof_settle(struct umbd_loop *loop)
{
    struct umbd_proof *proof = &loop->proof;
    struct umb_error error;
    const size_t count = proof->count;
    if (count == 0) {
        return;
    }
    const uint64_t turn = proof->turn++;
    proof->count = 0;
    for (size_t i = 0; i < count; i++) {
        if (umbs_entry_prove(proof->owed[i].entry, &error) != UMB_OK) {
            fail_calls(loop, turn, 1U << i, &error);
        }
        umbs_entry_release(proof->owed[i].entry);
    }
}
