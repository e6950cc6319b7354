/* SPDX-License-Identifier: Apache-2.0 */
/* TLS of a connection, see rpc_connection.h. */
#include "rpc_connection.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <string.h>
#include "net/tls_rules.h"

/* Sets the name that the certificate must have: an IP address, or a host name. A host name is also
 * sent to the server. */
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
    case UMBN_TLS_NO_PROTOCOL:
        return umb_fail(error, UMB_E_PROTOCOL, "the server speaks TLS, but not HTTP/2 (ALPN)");
    case UMBN_TLS_OVER:
        return umb_fail(error, UMB_E_UNAVAILABLE, "connection closed by the server");
    default:
        return UMB_OK;
    }
}
