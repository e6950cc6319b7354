/* SPDX-License-Identifier: Apache-2.0 */
/*
 * TLS sessions over memory BIOs, see rpc_tls.h.
 *
 * Why reading ends: each turn takes a record out of the incoming BIO or wants more, and nothing is
 * put in meanwhile.
 */
#include "rpc_tls.h"

#include <arpa/inet.h>
#include <limits.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/open_status.h"
#include "wire/wire_buffer.h"

/* Of TLS 1.2 only what forward secrecy and authenticated encryption are part of, as the daemon. */
#define TLS12_CIPHERS "ECDHE+AESGCM:ECDHE+CHACHA20"
#define RECORD_BYTES  16384

struct umb__tls {
    SSL *session;
    BIO *in, *out; /* owned by the session */
    bool ready;
};

/* The first thing OpenSSL has to say; empties its queue. */
static void take_reason(char reason[160])
{
    unsigned long code = ERR_peek_error();
    const char *text = code != 0 ? ERR_reason_error_string(code) : NULL;
    (void)snprintf(reason, 160, "%s", text != NULL ? text : "no reason is known");
    ERR_clear_error();
}

static enum umb_status refuse_file(const char *option, const char *path, struct umb_error *error)
{
    char reason[160];
    take_reason(reason);
    return umb_fail(error, access(path, R_OK) == 0 ? UMB_E_ARGUMENT : UMB_E_NO_INPUT,
                    "%s: '%.150s' cannot be used: %s", option, path, reason);
}

/* A key under a password is refused: a library must not ask on the terminal. */
static int no_password(char *password, int size, int writing, void *unused)
{
    (void)password;
    (void)size;
    (void)writing;
    (void)unused;
    return -1;
}

static enum umb_status load_files(SSL_CTX *context, const struct umb_client_options *options,
                                  struct umb_error *error)
{
    const char *certificate = options->certificate_file;
    const char *key = options->key_file != NULL ? options->key_file : certificate;
    const char *const files[] = {options->ca_file, certificate, key};
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        if (files[i] != NULL && umb__is_special_file(files[i])) {
            return umb_fail(error, UMB_E_NO_INPUT, "'%.150s' is not a regular file", files[i]);
        }
    }
    if (options->ca_file != NULL) {
        if (SSL_CTX_load_verify_file(context, options->ca_file) != 1) {
            return refuse_file("ca_file", options->ca_file, error);
        }
    } else if (SSL_CTX_set_default_verify_paths(context) != 1) {
        ERR_clear_error(); /* none there: every server is refused, by the reason that it tells */
    }
    if (certificate == NULL) {
        return key == NULL ? UMB_OK
                           : umb_fail(error, UMB_E_ARGUMENT,
                                      "key_file: '%.150s' needs a certificate_file", key);
    }
    if (SSL_CTX_use_certificate_chain_file(context, certificate) != 1) {
        return refuse_file("certificate_file", certificate, error);
    }
    if (SSL_CTX_use_PrivateKey_file(context, key, SSL_FILETYPE_PEM) != 1 ||
        SSL_CTX_check_private_key(context) != 1) {
        return refuse_file("key_file", key, error);
    }
    return UMB_OK;
}

enum umb_status umb__tls_context_create(const struct umb_client_options *options, SSL_CTX **out,
                                        struct umb_error *error)
{
    static const unsigned char h2[] = {2, 'h', '2'};
    *out = NULL;
    SSL_CTX *context = SSL_CTX_new(TLS_client_method());
    if (context == NULL || SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) != 1 ||
        SSL_CTX_set_cipher_list(context, TLS12_CIPHERS) != 1 ||
        SSL_CTX_set_alpn_protos(context, h2, sizeof h2) != 0) {
        SSL_CTX_free(context);
        ERR_clear_error();
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot make a TLS context");
    }
    SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_verify(context, SSL_VERIFY_PEER, NULL);
    SSL_CTX_set_default_passwd_cb(context, no_password);
    enum umb_status status = load_files(context, options, error);
    if (status != UMB_OK) {
        SSL_CTX_free(context);
        return status;
    }
    *out = context;
    return UMB_OK;
}

/* What the certificate must be for: an address, or a name (which the server is told, too). */
static bool expect_name(SSL *session, const char *name)
{
    unsigned char number[sizeof(struct in6_addr)];
    X509_VERIFY_PARAM *rules = SSL_get0_param(session);
    if (inet_pton(AF_INET, name, number) == 1 || inet_pton(AF_INET6, name, number) == 1) {
        return X509_VERIFY_PARAM_set1_ip_asc(rules, name) == 1;
    }
    X509_VERIFY_PARAM_set_hostflags(rules, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
    return X509_VERIFY_PARAM_set1_host(rules, name, 0) == 1 &&
           SSL_set_tlsext_host_name(session, name) == 1;
}

enum umb_status umb__tls_create(SSL_CTX *context, const char *name, struct umb__tls **out,
                                struct umb_error *error)
{
    *out = NULL;
    struct umb__tls *tls = calloc(1, sizeof *tls);
    if (tls == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for TLS");
    }
    tls->session = SSL_new(context);
    tls->in = BIO_new(BIO_s_mem());
    tls->out = BIO_new(BIO_s_mem());
    if (tls->session == NULL || tls->in == NULL || tls->out == NULL) {
        BIO_free(tls->in);
        BIO_free(tls->out);
        SSL_free(tls->session);
        free(tls);
        ERR_clear_error();
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for TLS");
    }
    SSL_set_bio(tls->session, tls->in, tls->out);
    SSL_set_connect_state(tls->session);
    if (!expect_name(tls->session, name)) {
        umb__tls_destroy(tls);
        ERR_clear_error();
        return umb_fail(error, UMB_E_ARGUMENT, "'%.200s' is no name that a certificate can have",
                        name);
    }
    *out = tls;
    return UMB_OK;
}

void umb__tls_destroy(struct umb__tls *tls)
{
    if (tls != NULL) {
        SSL_free(tls->session);
        free(tls);
    }
}

bool umb__tls_ready(const struct umb__tls *tls)
{
    return tls->ready;
}

/* Why a handshake or a read failed for good. */
static enum umb_status explain(struct umb__tls *tls, struct umb_error *error)
{
    char reason[160];
    long verdict = SSL_get_verify_result(tls->session);
    if (!tls->ready && verdict != X509_V_OK) {
        ERR_clear_error();
        return umb_fail(error, UMB_E_UNAUTHENTICATED, "the server's certificate is not trusted: %s",
                        X509_verify_cert_error_string(verdict));
    }
    /* Alerts of the peer have the reasons 1000 and above: what it thinks of us. */
    unsigned long code = ERR_peek_error();
    bool is_alert = ERR_GET_LIB(code) == ERR_LIB_SSL && ERR_GET_REASON(code) >= 1000;
    take_reason(reason);
    if (is_alert) {
        return umb_fail(error, UMB_E_UNAUTHENTICATED, "the server ends TLS: %s", reason);
    }
    /* Before the handshake is over there is nobody who speaks TLS, as on a port of plain gRPC: the
     * service is not to be had at this address. */
    return tls->ready ? umb_fail(error, UMB_E_PROTOCOL, "TLS is broken: %s", reason)
                      : umb_fail(error, UMB_E_UNAVAILABLE, "no TLS is spoken there: %s", reason);
}

/* Goes on with the handshake; ready once it is over. */
static enum umb_status shake_hands(struct umb__tls *tls, struct umb_error *error)
{
    const unsigned char *protocol = NULL;
    unsigned size = 0;
    int code = SSL_do_handshake(tls->session);
    if (code != 1) {
        return SSL_get_error(tls->session, code) == SSL_ERROR_WANT_READ ? UMB_OK
                                                                        : explain(tls, error);
    }
    SSL_get0_alpn_selected(tls->session, &protocol, &size);
    if (size != 2 || memcmp(protocol, "h2", 2) != 0) {
        return umb_fail(error, UMB_E_PROTOCOL, "the server speaks TLS, but not HTTP/2 (ALPN)");
    }
    tls->ready = true;
    return UMB_OK;
}

/* Gives all plain bytes that are there. */
static enum umb_status read_plain(struct umb__tls *tls, umb__plain_fn take, void *user,
                                  struct umb_error *error)
{
    uint8_t plain[RECORD_BYTES];
    for (;;) {
        size_t got = 0;
        int code = SSL_read_ex(tls->session, plain, sizeof plain, &got);
        if (code == 1) {
            if (!take(user, plain, got)) {
                return UMB_OK;
            }
            continue;
        }
        switch (SSL_get_error(tls->session, code)) {
        case SSL_ERROR_WANT_READ:
            return UMB_OK;
        case SSL_ERROR_ZERO_RETURN:
            return umb_fail(error, UMB_E_UNAVAILABLE, "connection closed by the server");
        default:
            return explain(tls, error);
        }
    }
}

enum umb_status umb__tls_open(struct umb__tls *tls, const uint8_t *bytes, size_t count,
                              umb__plain_fn take, void *user, struct umb_error *error)
{
    ERR_clear_error();
    while (count > 0) {
        int piece = count > INT_MAX ? INT_MAX : (int)count;
        int put = BIO_write(tls->in, bytes, piece);
        if (put <= 0) {
            ERR_clear_error();
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for TLS");
        }
        bytes += put;
        count -= (size_t)put;
    }
    if (!tls->ready) {
        enum umb_status status = shake_hands(tls, error);
        if (status != UMB_OK || !tls->ready) {
            return status;
        }
    }
    return read_plain(tls, take, user, error);
}

enum umb_status umb__tls_seal(struct umb__tls *tls, const uint8_t *bytes, size_t count,
                              struct umbw_buffer *sealed, struct umb_error *error)
{
    size_t written = 0;
    char *records = NULL;
    ERR_clear_error();
    if (count > 0 &&
        (SSL_write_ex(tls->session, bytes, count, &written) != 1 || written != count)) {
        ERR_clear_error();
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot encrypt: out of memory");
    }
    long size = BIO_get_mem_data(tls->out, &records);
    if (size <= 0) {
        return UMB_OK;
    }
    enum umb_status status = umbw_buffer_reserve(sealed, (size_t)size, error);
    if (status == UMB_OK) {
        memcpy(sealed->bytes + sealed->size, records, (size_t)size);
        sealed->size += (size_t)size;
        (void)BIO_reset(tls->out);
    }
    return status;
}
