/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Certificates, and the rules for sessions. A reload replaces the current context under a mutex.
 * OpenSSL counts references to contexts, so a session keeps the context with which it began.
 */
#include "daemon/transport/tls_context.h"

#include <openssl/err.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include "base/try.h"
#include "net/tls_rules.h"

struct umbd_tls {
    struct umbd_tls_files files;
    pthread_mutex_t mutex;
    SSL_CTX *context; /* under the mutex */
    atomic_uint generation;
};

/* Protocols of the sessions' listeners, as ALPN writes them. */
static const unsigned char http2[] = {2, 'h', '2'};
static const unsigned char http1[] = {8, 'h', 't', 't', 'p', '/', '1', '.', '1'};

/* A session for HTTP/1.1 is marked by its application data. */
static int select_protocol(SSL *ssl, const unsigned char **out, unsigned char *out_size,
                           const unsigned char *offered, unsigned offered_size, void *unused)
{
    const int is_http1 = SSL_get_app_data(ssl) != NULL;
    (void)unused;
    unsigned char *chosen = NULL;
    if (SSL_select_next_proto(&chosen, out_size, is_http1 ? http1 : http2,
                              is_http1 ? sizeof http1 : sizeof http2, offered,
                              offered_size) != OPENSSL_NPN_NEGOTIATED) {
        return SSL_TLSEXT_ERR_ALERT_FATAL;
    }
    *out = chosen;
    return SSL_TLSEXT_ERR_OK;
}

static enum umb_status load_files(SSL_CTX *context, const struct umbd_tls_files *files,
                                  struct umb_error *error)
{
    const struct umbn_tls_file named[] = {{"--tls-cert", files->certificate},
                                          {"--tls-key", files->key},
                                          {"--tls-client-ca", files->client_ca},
                                          {"--tls-crl", files->crl}};
    UMB__TRY(umbn_tls_files_check(named, sizeof named / sizeof named[0], error));
    UMB__TRY(umbn_tls_load_pair(context, &named[0], &named[1], error));
    if (files->client_ca == NULL) {
        return UMB_OK;
    }
    STACK_OF(X509_NAME) *names = SSL_load_client_CA_file(files->client_ca);
    if (names == NULL || SSL_CTX_load_verify_locations(context, files->client_ca, NULL) != 1) {
        sk_X509_NAME_pop_free(names, X509_NAME_free);
        return umbn_tls_refuse_file(&named[2], error);
    }
    if (files->crl != NULL) {
        X509_STORE *store = SSL_CTX_get_cert_store(context);
        X509_LOOKUP *lookup = X509_STORE_add_lookup(store, X509_LOOKUP_file());
        if (lookup == NULL || X509_load_crl_file(lookup, files->crl, X509_FILETYPE_PEM) < 1) {
            sk_X509_NAME_pop_free(names, X509_NAME_free);
            return umbn_tls_refuse_file(&named[3], error);
        }
        /* Every authority needs a current revocation list: if its list is missing or expired, all
         * its clients are refused. */
        X509_STORE_set_flags(store, X509_V_FLAG_CRL_CHECK | X509_V_FLAG_CRL_CHECK_ALL);
    }
    /* No session tickets: a ticket would admit a client again without a check of its
     * certificate. */
    SSL_CTX_set_options(context, SSL_OP_NO_TICKET);
    (void)SSL_CTX_set_num_tickets(context, 0);
    SSL_CTX_set_client_CA_list(context, names);
    SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, NULL);
    return UMB_OK;
}

static enum umb_status make_context(const struct umbd_tls_files *files, SSL_CTX **out,
                                    struct umb_error *error)
{
    static const unsigned char session_id[] = "umbraged";
    SSL_CTX *context;
    *out = NULL;
    UMB__TRY(umbn_tls_context_create(TLS_server_method(), &context, error));
    if (SSL_CTX_set_session_id_context(context, session_id, sizeof session_id - 1) != 1) {
        SSL_CTX_free(context);
        ERR_clear_error();
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot make a TLS context");
    }
    SSL_CTX_set_options(context, SSL_OP_CIPHER_SERVER_PREFERENCE);
    /* Idle connections keep no record buffers. */
    SSL_CTX_set_mode(context, SSL_MODE_RELEASE_BUFFERS);
    SSL_CTX_set_alpn_select_cb(context, select_protocol, NULL);
    enum umb_status status = load_files(context, files, error);
    if (status != UMB_OK) {
        SSL_CTX_free(context);
        return status;
    }
    *out = context;
    return UMB_OK;
}

enum umb_status umbd_tls_create(const struct umbd_tls_files *files, struct umbd_tls **out,
                                struct umb_error *error)
{
    *out = NULL;
    struct umbd_tls *tls = calloc(1, sizeof *tls);
    if (tls == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for TLS");
    }
    tls->files = *files;
    enum umb_status status = make_context(files, &tls->context, error);
    if (status != UMB_OK) {
        free(tls);
        return status;
    }
    pthread_mutex_init(&tls->mutex, NULL);
    *out = tls;
    return UMB_OK;
}

void umbd_tls_destroy(struct umbd_tls *tls)
{
    if (tls != NULL) {
        SSL_CTX_free(tls->context);
        pthread_mutex_destroy(&tls->mutex);
        free(tls);
    }
}

enum umb_status umbd_tls_reload(struct umbd_tls *tls, struct umb_error *error)
{
    SSL_CTX *fresh = NULL;
    UMB__TRY(make_context(&tls->files, &fresh, error));
    pthread_mutex_lock(&tls->mutex);
    SSL_CTX *old = tls->context;
    tls->context = fresh;
    atomic_fetch_add(&tls->generation, 1);
    pthread_mutex_unlock(&tls->mutex);
    SSL_CTX_free(old);
    return UMB_OK;
}

unsigned umbd_tls_generation(const struct umbd_tls *tls)
{
    return atomic_load(&tls->generation);
}

int umbd_tls_admits(struct umbd_tls *tls, SSL *session, unsigned *generation)
{
    pthread_mutex_lock(&tls->mutex);
    SSL_CTX *context = tls->context;
    *generation = atomic_load(&tls->generation);
    (void)SSL_CTX_up_ref(context);
    pthread_mutex_unlock(&tls->mutex);
    int admits = SSL_CTX_get_verify_mode(context) == SSL_VERIFY_NONE;
    X509 *shown = SSL_get0_peer_certificate(session);
    X509_STORE_CTX *check = X509_STORE_CTX_new();
    if (!admits && shown != NULL && check != NULL &&
        X509_STORE_CTX_init(check, SSL_CTX_get_cert_store(context), shown,
                            SSL_get_peer_cert_chain(session)) == 1) {
        (void)X509_STORE_CTX_set_default(check, "ssl_client");
        admits = X509_verify_cert(check) == 1;
    }
    X509_STORE_CTX_free(check);
    SSL_CTX_free(context);
    ERR_clear_error();
    return admits;
}

SSL *umbd_tls_session(struct umbd_tls *tls, int is_http1, unsigned *generation)
{
    pthread_mutex_lock(&tls->mutex);
    SSL *session = SSL_new(tls->context);
    *generation = atomic_load(&tls->generation);
    pthread_mutex_unlock(&tls->mutex);
    if (session == NULL || (is_http1 && SSL_set_app_data(session, tls) != 1)) {
        SSL_free(session);
        ERR_clear_error();
        return NULL;
    }
    SSL_set_accept_state(session);
    return session;
}
