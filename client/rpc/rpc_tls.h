/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_TLS_H
#define UMBRAGE_RPC_RPC_TLS_H
/*
 * The client's side of TLS (net/tls_session.h): the server must choose HTTP/2 (ALPN), and its
 * certificate is always verified: chain, dates and name. No option turns these checks off.
 *
 * Threads: a context is read only once made; a session has one owner.
 */
#include "net/tls_session.h"
#include "umbrage/client.h"

/*
 * Reads the files that the options name.
 *
 * Fails: E_ARGUMENT or E_NO_INPUT (a file that cannot be used; it is named), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umb__tls_context_create(const struct umb_client_options *options,
                                                    SSL_CTX **context, struct umb_error *error);

/*
 * Makes a session. Free it with umbn_tls_destroy.
 *
 * In:    name: host name or IP address that the certificate must have. sink, user: take the records
 *        to be sent.
 * Fails: E_NO_MEMORY, E_ARGUMENT (a name that no certificate can have).
 */
UMB_CHECKED enum umb_status umb__tls_create(SSL_CTX *context, const char *name,
                                            umbn_records_fn sink, void *user, struct umbn_tls **tls,
                                            struct umb_error *error);

/*
 * Takes bytes from the server, as umbn_tls_open; a value with which `take` stops is no failure.
 *
 * Fails: E_UNAUTHENTICATED (a certificate that is not trusted, or the server refuses ours),
 *        E_UNAVAILABLE (the server closed the session, or does not use TLS), E_PROTOCOL (no HTTP/2,
 *        broken records).
 */
UMB_CHECKED enum umb_status umb__tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count,
                                          umbn_plain_fn take, void *user, struct umb_error *error);

#endif
