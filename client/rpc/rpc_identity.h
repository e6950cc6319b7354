/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_IDENTITY_H
#define UMBRAGE_RPC_RPC_IDENTITY_H
/*
 * Credentials of a client, and its trust in servers: token, certificate, authorities and the
 * server's name. They are read from the options once, when the client is opened.
 */
#include "rpc_client.h"

/*
 * Reads the files that the options name into tls_context, bearer and server_name of a client whose
 * endpoints are known. Its options then have NULL for all borrowed strings.
 *
 * Fails: E_ARGUMENT (token, or a file that cannot be used, or files without a tls: address),
 *        E_NO_INPUT, E_PERMISSION or E_IO (a file that cannot be read), E_NO_MEMORY.
 *        umb__identity_forget frees all that was read, also after a failure.
 */
UMB_CHECKED enum umb_status umb__identity_take(struct umb_client *client, struct umb_error *error);

/* Frees the credentials; a token is wiped from memory. */
void umb__identity_forget(struct umb_client *client);

#endif
