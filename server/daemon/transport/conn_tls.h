/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_CONN_TLS_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_CONN_TLS_H
/*
 * TLS of one connection of the daemon (net/tls_session.h). Records go into the loop's buffer. Data
 * is sealed only when it can be sent, so a connection keeps only unsent records of handshakes and
 * alerts.
 */
#include "daemon/transport/conn.h"
#include "net/tls_session.h"

#define UMBD_TLS_OVERHEAD 64 /* most bytes added by a record: head, nonce, tag, padding */
/* Bytes for the loop's whole output, sealed, and for a handshake. */
#define UMBD_SEALED_CAPACITY                                                                       \
    (UMBD_OUT_CAPACITY + (UMBD_OUT_CAPACITY / UMBN_TLS_RECORD_BYTES + 2) * UMBD_TLS_OVERHEAD +     \
     65536)

struct umbd_conn_tls {
    struct umbn_tls *session;
    unsigned generation; /* Number of the files that last verified the client */
    uint8_t *kept;       /* Records that wait to be sent */
    size_t kept_size;
};

/* Makes the session. After a result of umbn_tls_open that ends the session, flush the connection,
 * because there may be an alert, and close it. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_conn_tls_start(struct umbd_conn *conn);
void umbd_conn_tls_finish(struct umbd_conn *conn);

/*
 * Returns 0 if a reload of --tls-client-ca or --tls-crl no longer accepts the client's certificate,
 * else 1. Certificates are checked only after a reload, about a hundred connections in each tick.
 */
int umbd_conn_tls_is_admitted(struct umbd_conn *conn);

/* Seals the first `count` bytes of the loop's output. Out: bytes, size: the records to send.
 * Returns 0 on failure. */
int umbd_conn_tls_seal(struct umbd_conn *conn, size_t count, const uint8_t **bytes, size_t *size);

/* Keeps records that cannot be sent now. Returns 0 if there are too many, or memory is short. */
int umbd_conn_tls_keep(struct umbd_conn *conn);

#endif
