/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_TLS_SESSION_H
#define UMBRAGE_NET_TLS_SESSION_H
/*
 * TLS of one connection, without I/O: records in, plain bytes out, and the other way round.
 *
 *     umbn_tls_create, umbn_tls_open with no bytes (a client's hello),
 *     umbn_tls_open with what came, umbn_tls_seal with what goes, umbn_tls_destroy.
 *
 * Records to be sent go to the owner's sink as OpenSSL makes them, in calls of open, seal and bye.
 * A session keeps no buffer of its own, so that an idle connection costs none. Threads: a session
 * has one owner.
 */
#include <openssl/ssl.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBN_TLS_RECORD_BYTES 16384 /* plain bytes of a record */

struct umbn_tls; /* opaque */

/* Takes plain bytes; returns 0, or another value to stop the reading. */
typedef int (*umbn_plain_fn)(void *user, const uint8_t *bytes, size_t count);

/* Takes records to be sent; false (no room, no memory) ends the session. */
typedef bool (*umbn_records_fn)(void *user, const uint8_t *bytes, size_t count);

/*
 * Makes a session.
 *
 * In:    session: set up for its side (connect or accept); NULL is E_NO_MEMORY.
 *        sink, user: must live as long as the session.
 * Owns:  takes the session, also on failure.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbn_tls_create(SSL *session, umbn_records_fn sink, void *user,
                                            struct umbn_tls **tls);
void umbn_tls_destroy(struct umbn_tls *tls); /* NULL is allowed */

/* Returns OpenSSL's session, borrowed: for certificates and verdicts. */
SSL *umbn_tls_ssl(const struct umbn_tls *tls);

/* True once the handshake is over: then plain bytes may be sealed. */
bool umbn_tls_ready(const struct umbn_tls *tls);

/* Results of umbn_tls_open besides 0 and what `take` returned. */
enum umbn_tls_end {
    UMBN_TLS_BROKEN = -100000, /* no TLS, no trust, or an alert: OpenSSL's queue has the reason */
    UMBN_TLS_OVER = -100001,   /* the peer said goodbye */
    UMBN_TLS_NO_H2 = -100002,  /* the peers did not agree on HTTP/2 (ALPN) */
};

/*
 * Takes what came from the peer, goes on with the handshake and gives plain bytes to `take`. After
 * a failure there may be an alert in the sink, which should be sent.
 *
 * Returns 0, what take returned to stop, or a value of enum umbn_tls_end.
 */
int umbn_tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count, umbn_plain_fn take,
                  void *user);

/* Seals bytes into the sink. False if the sink refused, or the session is broken. */
bool umbn_tls_seal(struct umbn_tls *tls, const uint8_t *bytes, size_t count);

/* Says goodbye, once the handshake is over; the record goes to the sink. */
void umbn_tls_bye(struct umbn_tls *tls);

#endif
