/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_ENDPOINT_H
#define UMBRAGE_RPC_RPC_ENDPOINT_H
/*
 * The replicas of a client: which one a call goes to, and what becomes of a call that got no
 * answer.
 *
 * Rendezvous hashing: every replica has a score for every asset, and a call goes to the one with
 * the highest. So all clients agree without talking, each replica keeps few assets in its caches,
 * and when one goes only its own assets move. One that could not be reached lately is passed over.
 * Source: D. Thaler, C. Ravishankar, "Using name-based mappings to increase hit rates", 1998.
 *
 * Trying again. A call that the server has not begun goes on at once, twice at most. One that it
 * may have begun is asked again only if it is safe, that is, changes nothing, and the connection
 * was lost or the server said UNAVAILABLE or after how long to come again: after that long, or
 * after a pause that doubles and has noise in it, so that clients do not come in step. A budget
 * keeps a failing server from being asked thrice as much: each such failure costs a token, ten
 * answers give one back, and below half nothing is asked again (gRPC proposal A6). A call that no
 * replica could be reached for fails at once if none ever was; else it waits for one to come back,
 * connect_timeout_ms at most: servers are restarted.
 *
 * Loop thread only, but for umb__endpoints_parse.
 */
#include "rpc_client.h"

/* Reads "ADDRESS[,ADDRESS...]". Fails: E_ARGUMENT, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__endpoints_parse(struct umb_client *client, const char *text,
                                                 struct umb_error *error);
void umb__endpoints_free(struct umb_client *client);

/* The part of a call's key that is its asset: any number, the same for the same text. */
uint64_t umb__asset_key(const char *asset);

/* Puts a call to the replica that it should go to. A dispatch must follow. */
void umb__call_route(struct umb_client *client, struct umb__call *call);

/* Gives waiting calls to connections, opening them if needed. */
void umb__client_dispatch(struct umb_client *client);

/* Notes a failed or successful connection for the pause before the next try. */
void umb__endpoint_backoff(struct umb__endpoint *endpoint, bool failed);

/* Ends a call, well or not, unless it is worth another try. begun: the server may have acted on it.
 */
void umb__call_conclude(struct umb_client *client, struct umb__call *call, enum umb_status status,
                        const struct umb_error *error, bool begun);

/* The calls that wait for a replica which cannot be reached: each goes to another, waits, or ends.
 */
void umb__endpoint_unreached(struct umb__endpoint *endpoint, const struct umb_error *reason);

/* A connection ended before it took a call: a try of all that wait for it, so that a server that
 * greets and hangs up is not asked without end. */
void umb__endpoint_deserted(struct umb__endpoint *endpoint, const struct umb_error *reason);

/* A connection was lost that had taken calls: one failure, however many they were. */
void umb__client_spend(struct umb_client *client);

/* An answer came. */
void umb__client_earn(struct umb_client *client);

/* True if requests over a stream may be asked again after a failure; counts the try. */
bool umb__call_may_repeat(struct umb_client *client, struct umb__call *call);

#endif
