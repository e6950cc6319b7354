/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TLS_CONTEXT_H
#define UMBRAGE_SERVER_DAEMON_TLS_CONTEXT_H
/*
 * The server's certificate and key, and what it demands of clients beside net/tls_rules.h: ALPN
 * "h2" and nothing else; with a client authority also a client's certificate (mutual TLS).
 *
 * Threads: all functions from any thread; a session made before a reload keeps the old certificate.
 */
#include <openssl/ssl.h>
#include "umbrage/status.h"

struct umbd_tls; /* opaque */

struct umbd_tls_files {
    const char *certificate; /* PEM, the server's first, then the chain */
    const char *key;         /* PEM, of that certificate */
    const char *client_ca; /* PEM of the authorities of clients, or NULL: no certificates wanted */
    const char *crl;       /* PEM of their revocation lists, or NULL: none are looked at */
};

/* Reads the files; their names must live as long as the object. Fails: E_NO_INPUT, E_ARGUMENT (not
 * what they should be, the key of another certificate), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_tls_create(const struct umbd_tls_files *files,
                                            struct umbd_tls **out, struct umb_error *error);
void umbd_tls_destroy(struct umbd_tls *tls);

/* Reads the files again. On failure what was read before stays in use. */
UMB_CHECKED enum umb_status umbd_tls_reload(struct umbd_tls *tls, struct umb_error *error);

/* A new server-side session; SSL_free it. Out: generation: of the files that it was made of. NULL:
 * out of memory. */
SSL *umbd_tls_session(struct umbd_tls *tls, unsigned *generation);

/* Number that grows with every reload: certificates of older sessions may no longer be accepted.
 * One atomic read. */
unsigned umbd_tls_generation(const struct umbd_tls *tls);

/*
 * Verifies the certificate of a session's client by the current files. Returns 1 if it is accepted.
 * Out: generation: of the files that were used. Cost: a handshake's verification.
 */
int umbd_tls_admits(struct umbd_tls *tls, SSL *session, unsigned *generation);

#endif
