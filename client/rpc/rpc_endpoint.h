/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_ENDPOINT_H
#define UMBRAGE_RPC_RPC_ENDPOINT_H
/*
 * The replicas of a client: the choice of one for each call, and the retries of calls without an
 * answer.
 *
 * Rendezvous hashing: every replica has a score for every asset, and a call goes to the one with
 * the highest. So all clients agree without communication, each replica has few assets in its
 * caches, and when a replica fails only its own assets move. A replica that recently could not be
 * reached is skipped.
 * Source: D. Thaler, C. Ravishankar, "Using name-based mappings to increase hit rates", 1998.
 *
 * Retries. A call that the server has not begun is sent again at once, twice at most. A call that
 * the server may have begun is retried only if it is safe, that is, changes nothing. Its connection
 * must have been lost, or the server must have said UNAVAILABLE or sent a retry pushback. It is
 * retried after the pushback, or after a pause that doubles with some noise, so that clients do not
 * retry in step. A retry budget protects a failing server from triple load: each such failure costs
 * a token, ten answers restore one, and while less than half of the tokens are left there are no
 * retries (gRPC proposal A6). A call without a reachable replica fails at once if none was ever
 * reached. Else it waits at most connect_timeout_ms for one to come back, since servers are
 * restarted.
 *
 * Loop thread only, but for umb__endpoints_parse.
 */
#include "rpc_client.h"

/* Reads "ADDRESS[,ADDRESS...]". Fails: E_ARGUMENT, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__endpoints_parse(struct umb_client *client, const char *text,
                                                 struct umb_error *error);

/* Assigns a call to its replica. The caller must dispatch the call afterwards. */
void umb__call_route(struct umb_client *client, struct umb__call *call);

/* Submits waiting calls to connections, and opens these if needed. */
void umb__client_dispatch(struct umb_client *client);

/* An answer came. */
void umb__client_earn(struct umb_client *client);

/* Returns true if a call over a stream may be sent again after a failure, and counts the try. */
bool umb__call_may_repeat(struct umb_client *client, struct umb__call *call);

#endif
