/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_IDENTITY_H
#define UMBRAGE_RPC_RPC_IDENTITY_H
/*
 * Who a client says that it is, and whom it believes: its token, its certificate, the authorities
 * and the server's name, taken from the options once, when the client is opened.
 */
#include "rpc_client.h"

/*
 * Reads the files that the options name into tls_context, bearer and server_name of a client whose
 * endpoints are known; of its options, all borrowed ones are NULL then.
 *
 * Fails: E_ARGUMENT (token, or a file that cannot be used, or files without a tls: address),
 *        E_NO_INPUT, E_PERMISSION or E_IO (a file that cannot be read), E_NO_MEMORY. What was read
 *        is forgotten by umb__identity_forget.
 */
UMB_CHECKED enum umb_status umb__identity_take(struct umb_client *client, struct umb_error *error);

/* Frees it; a token leaves no bytes behind. */
void umb__identity_forget(struct umb_client *client);

#endif
