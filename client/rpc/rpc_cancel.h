/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CANCEL_H
#define UMBRAGE_RPC_RPC_CANCEL_H
/*
 * Cancelling calls by their numbers, which are never used again: a call that has just ended is
 * simply not found. A cancelled call goes the way of one whose deadline has passed, with another
 * status.
 */
#include "rpc_client.h"

/* A number on its way from umb_client_cancel to the loop thread. */
struct umb__cancel {
    struct umb__cancel *next;
    uint64_t number;
};

/* Marks the call of each number as over, frees the list. True if there are any: they end with the
 * next look at deadlines. Loop thread, no lock held. */
bool umb__cancels_apply(struct umb_client *client, struct umb__cancel *cancels);

#endif
