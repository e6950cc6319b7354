/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_CALL_RIGHTS_H
#define UMBRAGE_SERVER_DAEMON_CALL_RIGHTS_H
/* What a call may do: its token, and the rates of token and address. */
#include "daemon/call.h"

/* Takes the authorization header. */
void umbd_call_authorization(struct umbd_call *call, const uint8_t *value, size_t size);

/* Looks whether the method may be called. Returns 1, or 0 and fails the call: UNAUTHENTICATED,
 * PERMISSION_DENIED. */
int umbd_call_is_allowed(struct umbd_call *call);

/* The call's token, looked for now; NULL: it has none, or it is not known any more. */
const struct umbd_token *umbd_call_token(struct umbd_call *call);

/*
 * Takes a reference to an asset for a call, as umbs_store_acquire. An asset that a job made is
 * E_NOT_FOUND for everybody but its owners and admins, in the same words as one that is not there,
 * also when its file is damaged: who has a scene must not learn whether somebody else had it baked.
 * One that also lies in the store under a name of its own is everybody's: nobody can take it away
 * by baking it again. _sees: the same question.
 */
UMB_CHECKED enum umb_status umbd_call_acquire(struct umbd_call *call, const char *name_or_id,
                                              struct umbs_entry **out, struct umb_error *error);
int umbd_call_sees(struct umbd_call *call, const uint8_t asset[UMB_ID_BYTES]);

/* 1 if health may report an asset's state: with a token file only to tokens with `query`. */
int umbd_call_may_name_assets(struct umbd_call *call);

/* Takes points off the rates, once for each request of a stream. Returns 1, or 0 and fails the
 * call: RESOURCE_EXHAUSTED, with the time after which to come again, or, if a reload took its token
 * away meanwhile, as umbd_call_is_allowed. */
int umbd_call_take_points(struct umbd_call *call, uint64_t points);

/* Takes points off the rates for work that has been allowed; what follows pays for them. */
void umbd_call_owe_points(struct umbd_call *call, uint64_t points);

/*
 * Charges a call that needs no rights to its address's rate, UMBD_OPEN_CALLS_PER_SECOND. This rate
 * is apart from --address-rate, so that a client over its rate does not fail a balancer's health
 * check. Each connection has UMBD_OPEN_CALLS_OF_ONE of its own beside it. Unix sockets have no
 * rate. Beyond the rate the call fails as above (_open), and the daemon stops reading from a
 * connection without rights for a moment. _refused: the same for a call that fails anyway.
 */
int umbd_call_take_open(struct umbd_call *call);
void umbd_call_refused(struct umbd_call *call);

/* Lets go of what a connection remembers. */
void umbd_conn_forget_rights(struct umbd_conn *conn);

#endif
