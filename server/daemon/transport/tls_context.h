/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_TLS_CONTEXT_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_TLS_CONTEXT_H
/*
 * The server's certificate and key, and its rules for clients in addition to net/tls_rules.h: only
 * the listener's protocol is accepted (ALPN "h2", or "http/1.1"); with a client authority, a client
 * also needs a certificate (mutual TLS).
 *
 * Threads: all functions from any thread; a session made before a reload keeps the old certificate.
 */
#include <openssl/ssl.h>
#include "umbrage/status.h"

struct umbd_tls; /* opaque */

struct umbd_tls_files {
    const char *certificate; /* PEM file: the server's certificate first, then the chain */
    const char *key;         /* PEM file: key of that certificate */
    const char *client_ca;   /* PEM file: authorities of clients; or NULL: no certificates wanted */
    const char *crl;         /* PEM file: their revocation lists; or NULL: none are checked */
};

/* Reads certificate files, whose names must live as long as the object. Fails: E_NO_INPUT,
 * E_ARGUMENT (a wrong kind of file, the key of another certificate), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_tls_create(const struct umbd_tls_files *files,
                                            struct umbd_tls **out, struct umb_error *error);
void umbd_tls_destroy(struct umbd_tls *tls);

/* Reads the files again. On failure the earlier content stays in use. */
UMB_CHECKED enum umb_status umbd_tls_reload(struct umbd_tls *tls, struct umb_error *error);

/* Makes a server-side session; SSL_free it. Returns NULL if memory is short. In: is_http1: 1 = the
 * session is for HTTP/1.1. Out: generation: number of the reload whose files the session uses. */
SSL *umbd_tls_session(struct umbd_tls *tls, int is_http1, unsigned *generation);

/* Returns a number that grows with every reload. The certificate of a session with a lower number
 * may no longer be accepted. Cost: one atomic read. */
unsigned umbd_tls_generation(const struct umbd_tls *tls);

/*
 * Verifies the certificate of a session's client with the current files. Returns 1 if it is
 * accepted.
 * Out:   generation: number of the reload whose files were used.
 * Cost:  as the verification in a handshake.
 */
int umbd_tls_admits(struct umbd_tls *tls, SSL *session, unsigned *generation);

#endif
