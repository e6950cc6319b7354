/* SPDX-License-Identifier: Apache-2.0 */
/*
 * TLS sessions over a BIO of our own: it reads from the bytes at hand and appends to the loop's
 * sealed buffer, which is flushed or kept before another connection uses it.
 *
 * Why reading ends: each turn takes a record from the bytes at hand or wants more, and then none
 * are left, because the library keeps a record that is not whole itself.
 */
#include "daemon/conn_tls.h"

#include <openssl/err.h>
#include <stdlib.h>
#include <string.h>

#define KEPT_MAX  65536 /* bytes of records kept for a peer that takes none */
#define LOOKS_MAX 256   /* certificates verified again in a tick: 20 ms */

struct umbd_conn_tls {
    SSL *session;
    const uint8_t *in; /* bytes at hand */
    size_t in_size;
    int ready;
    unsigned generation; /* Of the files that its client was last judged by */
    uint8_t *kept;       /* records that wait to be sent */
    size_t kept_size;
};

static int bio_read(BIO *bio, char *to, size_t count, size_t *got)
{
    struct umbd_conn *conn = BIO_get_data(bio);
    struct umbd_conn_tls *tls = conn->tls;
    BIO_clear_retry_flags(bio);
    *got = tls->in_size < count ? tls->in_size : count;
    if (*got == 0) {
        BIO_set_retry_read(bio);
        return 0;
    }
    memcpy(to, tls->in, *got);
    tls->in += *got;
    tls->in_size -= *got;
    return 1;
}

static int bio_write(BIO *bio, const char *from, size_t count, size_t *put)
{
    struct umbd_conn *conn = BIO_get_data(bio);
    struct umbd_loop *loop = conn->loop;
    BIO_clear_retry_flags(bio);
    *put = 0;
    if (count > UMBD_SEALED_CAPACITY - loop->sealed_size) {
        return 0; /* more than output and a handshake can be: the session ends */
    }
    memcpy(loop->sealed + loop->sealed_size, from, count);
    loop->sealed_size += count;
    *put = count;
    return 1;
}

static long bio_control(BIO *bio, int command, long number, void *pointer)
{
    (void)bio;
    (void)number;
    (void)pointer;
    return command == BIO_CTRL_FLUSH; /* nothing is held back here */
}

/* One method for the process; made once, kept for ever. */
static BIO_METHOD *bio_method;

static void make_method(void)
{
    bio_method = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "umbraged");
    if (bio_method != NULL) {
        BIO_meth_set_read_ex(bio_method, bio_read);
        BIO_meth_set_write_ex(bio_method, bio_write);
        BIO_meth_set_ctrl(bio_method, bio_control);
    }
}

enum umb_status umbd_conn_tls_start(struct umbd_conn *conn)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_method);
    if (conn->loop->sealed == NULL) {
        conn->loop->sealed = malloc(UMBD_SEALED_CAPACITY);
    }
    struct umbd_conn_tls *tls = calloc(1, sizeof *tls);
    BIO *bio = bio_method != NULL ? BIO_new(bio_method) : NULL;
    if (tls != NULL) {
        tls->session = umbd_tls_session(conn->loop->daemon->tls, &tls->generation);
    }
    if (tls == NULL || bio == NULL || tls->session == NULL || conn->loop->sealed == NULL) {
        BIO_free(bio);
        SSL_free(tls != NULL ? tls->session : NULL);
        free(tls);
        ERR_clear_error();
        return UMB_E_NO_MEMORY;
    }
    BIO_set_data(bio, conn);
    BIO_set_init(bio, 1);
    SSL_set_bio(tls->session, bio, bio); /* takes the one reference that stands for both */
    conn->tls = tls;
    return UMB_OK;
}

void umbd_conn_tls_finish(struct umbd_conn *conn)
{
    if (conn->tls != NULL) {
        SSL_free(conn->tls->session);
        free(conn->tls->kept);
        free(conn->tls);
        conn->tls = NULL;
    }
}

int umbd_conn_tls_ready(const struct umbd_conn *conn)
{
    return conn->tls->ready;
}

int umbd_conn_tls_is_admitted(struct umbd_conn *conn)
{
    struct umbd_tls *context = conn->loop->daemon->tls;
    if (!conn->tls->ready || conn->tls->generation == umbd_tls_generation(context) ||
        conn->loop->tls_looks >= LOOKS_MAX) {
        return 1;
    }
    conn->loop->tls_looks++;
    return umbd_tls_admits(context, conn->tls->session, &conn->tls->generation);
}

/* Goes on with the handshake. Returns 1 when it is over, 0 if it waits, -1 if it failed. */
static int shake_hands(struct umbd_conn_tls *tls)
{
    const unsigned char *protocol = NULL;
    unsigned size = 0;
    int code = SSL_do_handshake(tls->session);
    if (code != 1) {
        return SSL_get_error(tls->session, code) == SSL_ERROR_WANT_READ ? 0 : -1;
    }
    /* A client that offers no protocol at all is let through by the library. */
    SSL_get0_alpn_selected(tls->session, &protocol, &size);
    tls->ready = size == 2 && memcmp(protocol, "h2", 2) == 0;
    return tls->ready ? 1 : -1;
}

int umbd_conn_tls_open(struct umbd_conn *conn, const uint8_t *bytes, size_t count,
                       umbd_emit_fn emit, void *user)
{
    struct umbd_conn_tls *tls = conn->tls;
    uint8_t plain[UMBD_TLS_RECORD];
    tls->in = bytes;
    tls->in_size = count;
    ERR_clear_error();
    if (!tls->ready) {
        int code = shake_hands(tls);
        if (code <= 0) {
            return code == 0 ? 0 : UMBD_TLS_BROKEN;
        }
    }
    for (;;) {
        size_t got = 0;
        int code = SSL_read_ex(tls->session, plain, sizeof plain, &got);
        if (code != 1) {
            int reason = SSL_get_error(tls->session, code);
            return reason == SSL_ERROR_WANT_READ     ? 0
                   : reason == SSL_ERROR_ZERO_RETURN ? UMBD_TLS_OVER
                                                     : UMBD_TLS_BROKEN;
        }
        code = emit(user, plain, got);
        if (code != 0) {
            return code;
        }
    }
}

/* Puts what was kept before what is sealed now. Returns 0 if it does not fit. */
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
    size_t written = 0;
    if (conn->tls->kept_size > 0 && !take_kept(conn)) {
        return 0;
    }
    ERR_clear_error();
    if (count > 0 &&
        (SSL_write_ex(conn->tls->session, loop->out, count, &written) != 1 || written != count)) {
        ERR_clear_error();
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

void umbd_conn_tls_bye(struct umbd_conn *conn)
{
    if (conn->tls->ready) {
        ERR_clear_error();
        (void)SSL_shutdown(conn->tls->session);
        ERR_clear_error();
    }
}
