/* SPDX-License-Identifier: Apache-2.0 */
/* TLS of a connection, see conn_tls.h. The loop's buffer of sealed records is shared: it is flushed
 * or its records are kept before another connection uses it. */
#include "daemon/transport/conn_tls.h"

#include <stdlib.h>
#include <string.h>

#define KEPT_MAX  65536 /* bytes of records kept for a peer that reads none */
#define LOOKS_MAX 256   /* certificates verified again in one tick: 20 ms */

/* Appends records to the loop's buffer. Returns false if they exceed its capacity, which is enough
 * for all output and a handshake. */
static bool put_records(void *user, const uint8_t *bytes, size_t count)
{
    struct umbd_loop *loop = ((struct umbd_conn *)user)->loop;
    if (count > UMBD_SEALED_CAPACITY - loop->sealed_size) {
        return false;
    }
    memcpy(loop->sealed + loop->sealed_size, bytes, count);
    loop->sealed_size += count;
    return true;
}

enum umb_status umbd_conn_tls_start(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    if (loop->sealed == NULL) {
        loop->sealed = malloc(UMBD_SEALED_CAPACITY);
    }
    struct umbd_conn_tls *tls = calloc(1, sizeof *tls);
    if (tls == NULL || loop->sealed == NULL) {
        free(tls);
        return UMB_E_NO_MEMORY;
    }
    const int is_http1 = conn->language == UMBD_HTTP1;
    SSL *session = umbd_tls_session(loop->server->tls, is_http1, &tls->generation);
    enum umb_status status = umbn_tls_create(session, put_records, conn, &tls->session);
    if (status != UMB_OK) {
        free(tls);
        return status;
    }
    if (is_http1) {
        umbn_tls_take_http1(tls->session);
    }
    conn->tls = tls;
    return UMB_OK;
}

void umbd_conn_tls_finish(struct umbd_conn *conn)
{
    if (conn->tls != NULL) {
        umbn_tls_destroy(conn->tls->session);
        free(conn->tls->kept);
        free(conn->tls);
        conn->tls = NULL;
    }
}

int umbd_conn_tls_is_admitted(struct umbd_conn *conn)
{
    struct umbd_tls *context = conn->server->tls;
    if (!umbn_tls_ready(conn->tls->session) ||
        conn->tls->generation == umbd_tls_generation(context) ||
        conn->loop->tls_looks >= LOOKS_MAX) {
        return 1;
    }
    conn->loop->tls_looks++;
    return umbd_tls_admits(context, umbn_tls_ssl(conn->tls->session), &conn->tls->generation);
}

/* Puts the kept records before the newly sealed ones. Returns 0 if they exceed the buffer. */
static int take_kept(struct umbd_conn *conn)
{
    struct umbd_conn_tls *tls = conn->tls;
    struct umbd_loop *loop = conn->loop;
    if (tls->kept_size > UMBD_SEALED_CAPACITY - loop->sealed_size) {
        return 0;
    }
    memmove(loop->sealed + tls->kept_size, loop->sealed, loop->sealed_size);
    memcpy(loop->sealed, tls->kept, tls->kept_size);
    loop->sealed_size += tls->kept_size;
    free(tls->kept);
    tls->kept = NULL;
    tls->kept_size = 0;
    return 1;
}

int umbd_conn_tls_seal(struct umbd_conn *conn, size_t count, const uint8_t **bytes, size_t *size)
{
    struct umbd_loop *loop = conn->loop;
    if ((conn->tls->kept_size > 0 && !take_kept(conn)) ||
        !umbn_tls_seal(conn->tls->session, loop->out, count)) {
        return 0;
    }
    *bytes = loop->sealed;
    *size = loop->sealed_size;
    loop->sealed_size = 0;
    return 1;
}

int umbd_conn_tls_keep(struct umbd_conn *conn)
{
    struct umbd_conn_tls *tls = conn->tls;
    struct umbd_loop *loop = conn->loop;
    size_t count = loop->sealed_size;
    if (count == 0) {
        return 1;
    }
    loop->sealed_size = 0;
    if (tls->kept_size + count > KEPT_MAX) {
        return 0;
    }
    uint8_t *bytes = realloc(tls->kept, tls->kept_size + count);
    if (bytes == NULL) {
        return 0;
    }
    memcpy(bytes + tls->kept_size, loop->sealed, count);
    tls->kept = bytes;
    tls->kept_size += count;
    return 1;
}
