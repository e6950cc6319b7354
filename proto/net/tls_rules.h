/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_TLS_RULES_H
#define UMBRAGE_NET_TLS_RULES_H
/*
 * Rules for every TLS context of umbrage: TLS 1.2 or 1.3; for 1.2 only suites with forward secrecy
 * and authenticated encryption; no renegotiation, compression or session resumption; keys without a
 * password. Certificate files must be regular files, because OpenSSL would wait for the writer of a
 * pipe.
 *
 * Threads: all functions from any thread; a context has one owner while it is set up.
 */
#include <openssl/ssl.h>
#include "umbrage/status.h"

/* A file, and the option or field that names it, for messages. */
struct umbn_tls_file {
    const char *field;
    const char *path; /* NULL: none */
};

/* Makes a context of these rules. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbn_tls_context_create(const SSL_METHOD *method, SSL_CTX **context,
                                                    struct umb_error *error);

/* Fails with E_NO_INPUT if a file is a pipe, a device or a folder; the message names the first
 * one. */
UMB_CHECKED enum umb_status umbn_tls_files_check(const struct umbn_tls_file *files, size_t count,
                                                 struct umb_error *error);

/* Reads a certificate chain and its key (PEM). Fails: E_ARGUMENT or E_NO_INPUT; the message names
 * the file. */
UMB_CHECKED enum umb_status umbn_tls_load_pair(SSL_CTX *context,
                                               const struct umbn_tls_file *certificate,
                                               const struct umbn_tls_file *key,
                                               struct umb_error *error);

/* Reports OpenSSL's reason for a bad file and empties OpenSSL's error queue. Returns E_NO_INPUT if
 * the file cannot be read, else E_ARGUMENT. */
UMB_CHECKED enum umb_status umbn_tls_refuse_file(const struct umbn_tls_file *file,
                                                 struct umb_error *error);

/* Takes the first error of OpenSSL's queue as text; empties the queue. */
void umbn_tls_take_reason(char reason[160]);

#endif
