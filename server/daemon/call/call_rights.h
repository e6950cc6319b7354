/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_CALL_RIGHTS_H
#define UMBRAGE_SERVER_DAEMON_CALL_CALL_RIGHTS_H
/* What a call may do: its token, and the rates of token and address. */
#include "daemon/call/call.h"

/* Takes the authorization header. */
void umbd_call_authorization(struct umbd_call *call, const uint8_t *value, size_t size);

/* Checks whether the method may be called. Returns 1, or 0 and fails the call: UNAUTHENTICATED,
 * PERMISSION_DENIED. */
int umbd_call_is_allowed(struct umbd_call *call);

/* The call's token, looked up now; NULL: it has none, or the token is no longer known. */
const struct umbd_token *umbd_call_token(struct umbd_call *call);

/*
 * Takes a reference to an asset for a call, as umbs_store_acquire. An asset of a job is E_NOT_FOUND
 * for every caller but its owners and admins. The words are those for a missing asset, also when
 * its file is damaged: the owner of a scene must not learn whether another owner had it baked. An
 * asset that also lies in the store under a name of its own is visible to all: baking it again
 * cannot hide it. _sees: tells whether a call may see an asset.
 */
UMB_CHECKED enum umb_status umbd_call_acquire(struct umbd_call *call, const char *name_or_id,
                                              struct umbs_entry **out, struct umb_error *error);
int umbd_call_sees(struct umbd_call *call, const uint8_t asset[UMB_ID_BYTES]);

/* 1 if health may report an asset's state: with a token file only to tokens with `query`. */
int umbd_call_may_name_assets(struct umbd_call *call);

/* Takes points off the rates, once for each request of a stream. Returns 1, or 0 and fails the
 * call: RESOURCE_EXHAUSTED with a retry delay, or, if a reload removed its token meanwhile, as
 * umbd_call_is_allowed. */
int umbd_call_take_points(struct umbd_call *call, uint64_t points);

/* Takes points off the rates for work that has been allowed; what follows pays for them. */
void umbd_call_owe_points(struct umbd_call *call, uint64_t points);

/*
 * Charges a call that needs no rights to its address's rate, UMBD_OPEN_CALLS_PER_SECOND. This rate
 * is separate from --address-rate, so that a client over its rate does not fail a balancer's health
 * check. Each connection also has UMBD_OPEN_CALLS_OF_ONE of its own. Unix sockets have no rate.
 * Beyond the rate the call fails as above (_open), and the daemon stops reading from a connection
 * without rights for a moment. _refused: charges a call that fails anyway.
 */
int umbd_call_take_open(struct umbd_call *call);
void umbd_call_refused(struct umbd_call *call);

/* Releases the token and the set that a connection remembers. */
void umbd_conn_forget_rights(struct umbd_conn *conn);

#endif
