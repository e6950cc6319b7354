/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CANCEL_H
#define UMBRAGE_RPC_RPC_CANCEL_H
/*
 * Cancels calls by their numbers, which are never reused, so the number of an ended call is simply
 * not found. A cancelled call ends as one whose deadline has passed, with another status.
 */
#include "rpc_client.h"

/* A number, passed from umb_client_cancel to the loop thread. */
struct umb__cancel {
    struct umb__cancel *next;
    uint64_t number;
};

/* Marks the calls of the numbers as cancelled, and frees the list. True if there are any: they end
 * at the next check of deadlines. Loop thread, no lock held. */
bool umb__cancels_apply(struct umb_client *client, struct umb__cancel *cancels);

#endif
