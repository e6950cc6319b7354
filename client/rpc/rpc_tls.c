/* SPDX-License-Identifier: Apache-2.0 */
/* See rpc_tls.h. */
#include "rpc_tls.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <string.h>
#include "base/try.h"
#include "net/tls_rules.h"

static enum umb_status load_files(SSL_CTX *context, const struct umb_client_options *options,
                                  struct umb_error *error)
{
    const struct umbn_tls_file files[] = {
        {"ca_file", options->ca_file},
        {"certificate_file", options->certificate_file},
        {"key_file", options->key_file != NULL ? options->key_file : options->certificate_file},
    };
    UMB__TRY(umbn_tls_files_check(files, sizeof files / sizeof files[0], error));
    if (options->ca_file != NULL) {
        if (SSL_CTX_load_verify_file(context, options->ca_file) != 1) {
            return umbn_tls_refuse_file(&files[0], error);
        }
    } else if (SSL_CTX_set_default_verify_paths(context) != 1) {
        ERR_clear_error(); /* Without authorities every server is refused, with that reason */
    }
    if (options->certificate_file != NULL) {
        return umbn_tls_load_pair(context, &files[1], &files[2], error);
    }
    return options->key_file == NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "key_file: '%.150s' needs a certificate_file",
                          options->key_file);
}

enum umb_status umb__tls_context_create(const struct umb_client_options *options, SSL_CTX **out,
                                        struct umb_error *error)
{
    static const unsigned char h2[] = {2, 'h', '2'};
    UMB__TRY(umbn_tls_context_create(TLS_client_method(), out, error));
    SSL_CTX_set_verify(*out, SSL_VERIFY_PEER, NULL);
    enum umb_status status = SSL_CTX_set_alpn_protos(*out, h2, sizeof h2) == 0
                                 ? load_files(*out, options, error)
                                 : umb_fail(error, UMB_E_NO_MEMORY, "cannot make a TLS context");
    if (status != UMB_OK) {
        SSL_CTX_free(*out);
        ERR_clear_error();
        *out = NULL;
    }
    return status;
}

/* Sets the certificate's required name: an address, or a host name, which is also sent. */
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

enum umb_status umb__tls_create(SSL_CTX *context, const char *name, umbn_records_fn sink,
                                void *user, struct umbn_tls **out, struct umb_error *error)
{
    *out = NULL;
    SSL *session = SSL_new(context);
    if (session != NULL) {
        SSL_set_connect_state(session);
        if (!expect_name(session, name)) {
            SSL_free(session);
            ERR_clear_error();
            return umb_fail(error, UMB_E_ARGUMENT,
                            "'%.200s' is no name that a certificate can have", name);
        }
    }
    return umbn_tls_create(session, sink, user, out) == UMB_OK
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for TLS");
}

/* Returns the reason of a failed handshake or read. */
static enum umb_status explain(const struct umbn_tls *tls, struct umb_error *error)
{
    char reason[160];
    bool ready = umbn_tls_ready(tls);
    long verdict = SSL_get_verify_result(umbn_tls_ssl(tls));
    if (!ready && verdict != X509_V_OK) {
        ERR_clear_error();
        return umb_fail(error, UMB_E_UNAUTHENTICATED, "the server's certificate is not trusted: %s",
                        X509_verify_cert_error_string(verdict));
    }
    /* Reasons from 1000 on are alerts that the server sent. */
    unsigned long code = ERR_peek_error();
    bool is_alert = ERR_GET_LIB(code) == ERR_LIB_SSL && ERR_GET_REASON(code) >= 1000;
    umbn_tls_take_reason(reason);
    if (is_alert) {
        return umb_fail(error, UMB_E_UNAUTHENTICATED, "the server ends TLS: %s", reason);
    }
    /* A failure before the end of the handshake means that the server has no TLS, such as a port of
     * plain gRPC. The service is not available at this address. */
    return ready ? umb_fail(error, UMB_E_PROTOCOL, "TLS is broken: %s", reason)
                 : umb_fail(error, UMB_E_UNAVAILABLE, "no TLS is spoken there: %s", reason);
}

enum umb_status umb__tls_open(struct umbn_tls *tls, const uint8_t *bytes, size_t count,
                              umbn_plain_fn take, void *user, struct umb_error *error)
{
    switch (umbn_tls_open(tls, bytes, count, take, user)) {
    case UMBN_TLS_BROKEN:
        return explain(tls, error);
    case UMBN_TLS_NO_H2:
        return umb_fail(error, UMB_E_PROTOCOL, "the server speaks TLS, but not HTTP/2 (ALPN)");
    case UMBN_TLS_OVER:
        return umb_fail(error, UMB_E_UNAVAILABLE, "connection closed by the server");
    default:
        return UMB_OK;
    }
}
