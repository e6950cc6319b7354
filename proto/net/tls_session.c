/* SPDX-License-Identifier: Apache-2.0 */
/*
 * TLS sessions over a BIO of our own, which reads from the given bytes and writes into the owner's
 * sink.
 *
 * The read loop ends, because each turn takes a record from the input or asks for more input.
 * OpenSSL stores an incomplete record itself, so no input is left when it asks for more.
 */
#include "net/tls_session.h"

#include <openssl/err.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

struct umbn_tls {
    SSL *session;
    const uint8_t *in; /* bytes at hand */
    size_t in_size;
    umbn_records_fn sink;
    void *user; /* argument of the sink */
    bool ready;
    bool is_http1;
};

static int bio_read(BIO *bio, char *to, size_t count, size_t *got)
{
    struct umbn_tls *tls = BIO_get_data(bio);
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
    struct umbn_tls *tls = BIO_get_data(bio);
    BIO_clear_retry_flags(bio);
    bool taken = tls->sink(tls->user, (const uint8_t *)from, count);
    *put = taken ? count : 0;
    return taken;
}

static long bio_control(BIO *bio, int command, long number, void *pointer)
{
    (void)bio;
    (void)number;
    (void)pointer;
    return command == BIO_CTRL_FLUSH; /* No bytes are held back here */
}

/* One method for the process, made once and never freed. */
static BIO_METHOD *bio_method;

static void make_method(void)
{
    bio_method = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "umbrage");
    if (bio_method != NULL) {
        BIO_meth_set_read_ex(bio_method, bio_read);
        BIO_meth_set_write_ex(bio_method, bio_write);
        BIO_meth_set_ctrl(bio_method, bio_control);
    }
}

enum umb_status umbn_tls_create(SSL *session, umbn_records_fn sink, void *user,
                                struct umbn_tls **out)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_method);
    struct umbn_tls *tls = calloc(1, sizeof *tls);
    BIO *bio = bio_method != NULL ? BIO_new(bio_method) : NULL;
    *out = tls;
    if (tls == NULL || bio == NULL || session == NULL) {
        BIO_free(bio);
        SSL_free(session);
        free(tls);
        ERR_clear_error();
        *out = NULL;
        return UMB_E_NO_MEMORY;
    }
    *tls = (struct umbn_tls){.session = session, .sink = sink, .user = user};
    BIO_set_data(bio, tls);
    BIO_set_init(bio, 1);
    SSL_set_bio(session, bio, bio); /* Takes the one reference for both directions */
    return UMB_OK;
}

void umbn_tls_destroy(struct umbn_tls *tls)
{
    if (tls != NULL) {
        SSL_free(tls->session);
        free(tls);
    }
}

void umbn_tls_take_http1(struct umbn_tls *tls)
{
    tls->is_http1 = true;
}

SSL *umbn_tls_ssl(const struct umbn_tls *tls)
{
    return tls->session;
}

bool umbn_tls_ready(const struct umbn_tls *tls)
{
    return tls->ready;
}

/* Continues the handshake. Returns 0 while it waits or when it is over. */
static int shake_hands(struct umbn_tls *tls)
{
    const unsigned char *protocol = NULL;
    unsigned size = 0;
    int code = SSL_do_handshake(tls->session);
    if (code != 1) {
        return SSL_get_error(tls->session, code) == SSL_ERROR_WANT_READ ? 0 : UMBN_TLS_BROKEN;
    }
    /* OpenSSL accepts a peer that offers no protocol at all. */
    SSL_get0_alpn_selected(tls->session, &protocol, &size);
    tls->ready = tls->is_http1 ? size == 0 || (size == 8 && memcmp(protocol, "http/1.1", 8) == 0)
                               : size == 2 && memcmp(protocol, "h2", 2) == 0;
    return tls->ready ? 0 : UMBN_TLS_NO_PROTOCOL;
}

int umbn_tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count, umbn_plain_fn take,
                  void *user)
{
    uint8_t plain[UMBN_TLS_RECORD_BYTES];
    tls->in = bytes;
    tls->in_size = count;
    ERR_clear_error();
    if (!tls->ready) {
        int code = shake_hands(tls);
        if (code != 0 || !tls->ready) {
            return code;
        }
    }
    for (;;) {
        size_t got = 0;
        int code = SSL_read_ex(tls->session, plain, sizeof plain, &got);
        if (code != 1) {
            int reason = SSL_get_error(tls->session, code);
            return reason == SSL_ERROR_WANT_READ     ? 0
                   : reason == SSL_ERROR_ZERO_RETURN ? UMBN_TLS_OVER
                                                     : UMBN_TLS_BROKEN;
        }
        code = take(user, plain, got);
        if (code != 0) {
            return code;
        }
    }
}

bool umbn_tls_seal(struct umbn_tls *tls, const uint8_t *bytes, size_t count)
{
    size_t written = 0;
    ERR_clear_error();
    bool sealed =
        count == 0 || (SSL_write_ex(tls->session, bytes, count, &written) == 1 && written == count);
    if (!sealed) {
        ERR_clear_error();
    }
    return sealed;
}

void umbn_tls_bye(struct umbn_tls *tls)
{
    if (tls->ready) {
        ERR_clear_error();
        (void)SSL_shutdown(tls->session);
        ERR_clear_error();
    }
}
