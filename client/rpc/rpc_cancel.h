/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_CANCEL_H
#define UMBRAGE_RPC_RPC_CANCEL_H
/*
 * Cancelling calls by a tag that their caller chose: a pointer that is compared and never followed,
 * so that a call that has just ended is simply not found. A cancelled call goes the way of one
 * whose deadline has passed, with another status.
 */
#include "rpc_client.h"

/* A tag on its way from umb_client_query_cancel to the loop thread. */
struct umb__cancel {
    struct umb__cancel *next;
    const void *tag;
};

/* Marks the calls of each tag as over, frees the list. True if there are any: they end with the
 * next look at deadlines. Loop thread, no lock held. */
bool umb__cancels_apply(struct umb_client *client, struct umb__cancel *cancels);

#endif
