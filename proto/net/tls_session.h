/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_TLS_SESSION_H
#define UMBRAGE_NET_TLS_SESSION_H
/*
 * TLS of one connection, without I/O. A session turns records into plain bytes and plain bytes into
 * records.
 *
 *     Life: umbn_tls_create; umbn_tls_open without bytes, which sends a client's hello;
 *     umbn_tls_open for received bytes and umbn_tls_seal for bytes to send; umbn_tls_destroy.
 *
 * OpenSSL's records go straight to the owner's sink, during calls of umbn_tls_open, _seal and _bye.
 * A session has no buffer, so an idle connection costs no buffer memory. Threads: a session has one
 * owner.
 */
#include <openssl/ssl.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

#define UMBN_TLS_RECORD_BYTES 16384 /* plain bytes of a record */

struct umbn_tls; /* opaque */

/* Takes plain bytes; returns 0, or another value to stop reading. */
typedef int (*umbn_plain_fn)(void *user, const uint8_t *bytes, size_t count);

/* Callback for records to be sent. If it returns false (no room, no memory), the session ends. */
typedef bool (*umbn_records_fn)(void *user, const uint8_t *bytes, size_t count);

/*
 * Makes a session.
 *
 * In:    session: set up to connect or accept; NULL is E_NO_MEMORY. sink, user: must live as long
 *        as the session.
 * Owns:  takes the session, also on failure.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbn_tls_create(SSL *session, umbn_records_fn sink, void *user,
                                            struct umbn_tls **tls);
void umbn_tls_destroy(struct umbn_tls *tls); /* NULL is allowed */

/* Sets the protocol to HTTP/1.1. A peer that offers no protocol (ALPN) is then accepted, too.
 * Without this call the protocol is HTTP/2, which both peers must name. Call it before the first
 * umbn_tls_open. */
void umbn_tls_take_http1(struct umbn_tls *tls);

/* Returns OpenSSL's session, borrowed, to read certificates and results. */
SSL *umbn_tls_ssl(const struct umbn_tls *tls);

/* True once the handshake is complete: plain bytes may then be sealed. */
bool umbn_tls_ready(const struct umbn_tls *tls);

/* Results of umbn_tls_open besides 0 and values that `take` returns. */
enum umbn_tls_end {
    UMBN_TLS_BROKEN = -100000, /* No TLS, no trust, or an alert: OpenSSL's queue has the reason */
    UMBN_TLS_OVER = -100001,   /* the peer said goodbye */
    UMBN_TLS_NO_PROTOCOL = -100002, /* the peers did not agree on the protocol (ALPN) */
};

/*
 * Takes bytes from the peer, continues the handshake and passes plain bytes to `take`. After a
 * failure the sink may hold an alert, which should be sent.
 *
 * Returns 0, the value with which `take` stopped, or a value of enum umbn_tls_end.
 */
int umbn_tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count, umbn_plain_fn take,
                  void *user);

/* Seals bytes into the sink. Returns false if the sink refused a record or the session is
 * broken. */
bool umbn_tls_seal(struct umbn_tls *tls, const uint8_t *bytes, size_t count);

/* Sends close_notify to the sink, if the handshake is complete. */
void umbn_tls_bye(struct umbn_tls *tls);

#endif
