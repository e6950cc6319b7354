/* SPDX-License-Identifier: Apache-2.0 */
/* See tls_rules.h. */
#include "net/tls_rules.h"

#include <openssl/err.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define TLS12_CIPHERS "ECDHE+AESGCM:ECDHE+CHACHA20"

/* Refuses keys with a password: OpenSSL would ask for it on the terminal, and a daemon that reloads
 * its files would hang. */
static int no_password(char *password, int size, int writing, void *unused)
{
    (void)password;
    (void)size;
    (void)writing;
    (void)unused;
    return -1;
}

enum umb_status umbn_tls_context_create(const SSL_METHOD *method, SSL_CTX **out,
                                        struct umb_error *error)
{
    SSL_CTX *context = SSL_CTX_new(method);
    *out = NULL;
    if (context == NULL || SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) != 1 ||
        SSL_CTX_set_cipher_list(context, TLS12_CIPHERS) != 1) {
        SSL_CTX_free(context);
        ERR_clear_error();
        return umb_fail(error, UMB_E_NO_MEMORY, "cannot make a TLS context");
    }
    SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_default_passwd_cb(context, no_password);
    *out = context;
    return UMB_OK;
}

enum umb_status umbn_tls_files_check(const struct umbn_tls_file *files, size_t count,
                                     struct umb_error *error)
{
    for (size_t i = 0; i < count; i++) {
        struct stat info;
        if (files[i].path != NULL && stat(files[i].path, &info) == 0 && !S_ISREG(info.st_mode)) {
            return umb_fail(error, UMB_E_NO_INPUT, "%s: '%.150s' is not a regular file",
                            files[i].field, files[i].path);
        }
    }
    return UMB_OK;
}

void umbn_tls_take_reason(char reason[160])
{
    unsigned long code = ERR_peek_error();
    /* The errors of files are errno, for which OpenSSL has no text. */
    const char *text =
        ERR_SYSTEM_ERROR(code) ? strerror(ERR_GET_REASON(code)) : ERR_reason_error_string(code);
    (void)snprintf(reason, 160, "%s", text != NULL ? text : "OpenSSL gives no reason");
    ERR_clear_error();
}

enum umb_status umbn_tls_refuse_file(const struct umbn_tls_file *file, struct umb_error *error)
{
    char reason[160];
    umbn_tls_take_reason(reason);
    return umb_fail(error, access(file->path, R_OK) == 0 ? UMB_E_ARGUMENT : UMB_E_NO_INPUT,
                    "%s: '%.150s' cannot be used: %s", file->field, file->path, reason);
}

enum umb_status umbn_tls_load_pair(SSL_CTX *context, const struct umbn_tls_file *certificate,
                                   const struct umbn_tls_file *key, struct umb_error *error)
{
    if (SSL_CTX_use_certificate_chain_file(context, certificate->path) != 1) {
        return umbn_tls_refuse_file(certificate, error);
    }
    if (SSL_CTX_use_PrivateKey_file(context, key->path, SSL_FILETYPE_PEM) != 1 ||
        SSL_CTX_check_private_key(context) != 1) {
        return umbn_tls_refuse_file(key, error);
    }
    return UMB_OK;
}
