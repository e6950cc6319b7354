/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_TLS_H
#define UMBRAGE_RPC_RPC_TLS_H
/*
 * TLS of a client's connections, without I/O: records in, plain bytes out, and the other way round.
 *
 *     umb__tls_context_create once a client,
 *     umb__tls_create, umb__tls_open with no bytes: the hello is in `sealed`,
 *     umb__tls_open with what came, umb__tls_seal with what goes, umb__tls_destroy.
 *
 * TLS 1.2 or 1.3, of 1.2 only suites with forward secrecy and authenticated encryption; the server
 * must choose HTTP/2 (ALPN) and its certificate is always verified: chain, dates and name. There is
 * no switch that turns that off. No session is resumed.
 * Threads: a context is read only once made; a session has one owner.
 */
#include <openssl/ssl.h>
#include <stdbool.h>
#include <stdint.h>
#include "umbrage/client.h"
#include "wire/messages.h"

struct umb__tls; /* opaque: one connection's session */

/* Takes plain bytes; false ends the reading. */
typedef bool (*umb__plain_fn)(void *user, const uint8_t *bytes, size_t count);

/*
 * Reads the files that the options name.
 *
 * Fails: E_ARGUMENT or E_NO_INPUT (a file that cannot be used; it is named), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__tls_context_create(const struct umb_client_options *options,
                                                    SSL_CTX **context, struct umb_error *error);

/*
 * Makes a session.
 *
 * In:    name: that the certificate must have: a host's name, or an IP address.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a name that no certificate can have).
 */
UMB_CHECKED enum umb_status umb__tls_create(SSL_CTX *context, const char *name,
                                            struct umb__tls **tls, struct umb_error *error);
void umb__tls_destroy(struct umb__tls *tls); /* NULL is allowed */

/* True once the handshake is over: then plain bytes may be sealed. */
bool umb__tls_ready(const struct umb__tls *tls);

/*
 * Takes what came from the peer, goes on with the handshake, gives plain bytes to `take`. There may
 * be records to send afterwards, also after a failure: umb__tls_seal without bytes.
 *
 * Fails: E_UNAUTHENTICATED (a certificate that is not trusted, or the peer refuses ours),
 *        E_UNAVAILABLE (the peer said goodbye), E_PROTOCOL (no TLS, no HTTP/2).
 */
UMB_CHECKED enum umb_status umb__tls_open(struct umb__tls *tls, const uint8_t *bytes, size_t count,
                                          umb__plain_fn take, void *user, struct umb_error *error);

/* Appends records to `sealed`: of the bytes (none before the handshake is over), and what the
 * handshake has to say. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__tls_seal(struct umb__tls *tls, const uint8_t *bytes, size_t count,
                                          struct umbw_buffer *sealed, struct umb_error *error);

#endif
