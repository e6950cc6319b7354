/* SPDX-License-Identifier: Apache-2.0 */
/* Credentials of a client, and its trust in servers: token, certificate, authorities and the
 * server's name, read once from the options. */
#include "rpc_client.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "net/tls_rules.h"

#define TOKEN_MAX    4096  /* characters */
#define PIPE_WAIT_MS 10000 /* Wait for a program that writes the token */

/* Reads up to `most` bytes; waits up to PIPE_WAIT_MS for each piece from a pipe. Returns the number
 * of bytes read, or -1. */
static ssize_t read_patiently(int fd, char *bytes, size_t most)
{
    size_t count = 0;
    while (count < most) {
        const ssize_t got = read(fd, bytes + count, most - count);
        if (got > 0) {
            count += (size_t)got;
        } else if (got == 0) {
            break;
        } else if (errno == EAGAIN) {
            struct pollfd ready = {.fd = fd, .events = POLLIN};
            if (poll(&ready, 1, PIPE_WAIT_MS) == 0) {
                errno = ETIMEDOUT;
                return -1;
            }
        } else if (errno != EINTR) {
            return -1;
        }
    }
    return (ssize_t)count;
}

/* Reads a token from a file or pipe that holds nothing else. A pipe without a writer counts as
 * empty. */
static enum umb_status read_token(const char *path, char token[TOKEN_MAX + 2],
                                  struct umb_error *error)
{
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0) {
        return umb_fail_errno(error, errno == EACCES ? UMB_E_PERMISSION : UMB_E_NO_INPUT, errno,
                              "cannot open the token file '%.150s'", path);
    }
    const ssize_t got = read_patiently(fd, token, TOKEN_MAX + 1);
    const int code = errno;
    (void)close(fd);
    if (got < 0) {
        return umb_fail_errno(error, UMB_E_IO, code, "cannot read the token file '%.150s'", path);
    }
    size_t count = (size_t)got;
    while (count > 0 && (token[count - 1] == '\n' || token[count - 1] == '\r')) {
        count--;
    }
    token[count] = '\0';
    if (count == 0 || count > TOKEN_MAX || strlen(token) != count) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "token file '%.150s': must hold one token of 1 to %d characters", path,
                        TOKEN_MAX);
    }
    return UMB_OK;
}

/* Makes the value of the authorization header. Blanks and control characters are refused. */
static enum umb_status make_bearer(const char *token, char **bearer, struct umb_error *error)
{
    size_t length = strlen(token);
    for (size_t i = 0; i < length; i++) {
        if (token[i] <= ' ' || token[i] > '~') {
            return umb_fail(
                error, UMB_E_ARGUMENT,
                "token: character %zu is a blank or no printable ASCII; a client gets the "
                "token alone, not a line of the daemon's file",
                i + 1);
        }
    }
    if (length == 0 || length > TOKEN_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "token: has %zu characters, must have 1 to %d",
                        length, TOKEN_MAX);
    }
    *bearer = malloc(length + sizeof "Bearer ");
    if (*bearer == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a client");
    }
    memcpy(*bearer, "Bearer ", 7);
    memcpy(*bearer + 7, token, length + 1);
    return UMB_OK;
}

static enum umb_status take_token(struct umb_client *client, struct umb_error *error)
{
    const struct umb_client_options *options = &client->options;
    char token[TOKEN_MAX + 2];
    if (options->token_file == NULL) {
        return options->token != NULL ? make_bearer(options->token, &client->bearer, error)
                                      : UMB_OK;
    }
    if (options->token != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "token and token_file exclude each other");
    }
    enum umb_status status = read_token(options->token_file, token, error);
    if (status == UMB_OK) {
        status = make_bearer(token, &client->bearer, error);
    }
    OPENSSL_cleanse(token, sizeof token);
    return status;
}

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

/* Makes the context of TLS from the files that the options name. */
static enum umb_status make_context(const struct umb_client_options *options, SSL_CTX **out,
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

static enum umb_status take_tls(struct umb_client *client, struct umb_error *error)
{
    const struct umb_client_options *options = &client->options;
    const char *file = options->ca_file != NULL            ? options->ca_file
                       : options->certificate_file != NULL ? options->certificate_file
                                                           : options->key_file;
    if (client->any_tls) {
        return make_context(options, &client->tls_context, error);
    }
    return file == NULL ? UMB_OK
                        : umb_fail(error, UMB_E_ARGUMENT,
                                   "'%.150s': certificates need a tls: address, not %.100s", file,
                                   client->endpoints[0].text);
}

enum umb_status umb__identity_take(struct umb_client *client, struct umb_error *error)
{
    struct umb_client_options *options = &client->options;
    enum umb_status status = take_tls(client, error);
    if (status == UMB_OK) {
        status = take_token(client, error);
    }
    if (status == UMB_OK && options->server_name != NULL) {
        client->server_name = strdup(options->server_name);
        if (client->server_name == NULL) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a client");
        }
    }
    /* Borrowed strings, which the caller may free. */
    options->ca_file = options->certificate_file = options->key_file = NULL;
    options->server_name = options->token = options->token_file = NULL;
    return status;
}

void umb__identity_forget(struct umb_client *client)
{
    SSL_CTX_free(client->tls_context);
    if (client->bearer != NULL) {
        OPENSSL_cleanse(client->bearer, strlen(client->bearer));
    }
    free(client->bearer);
    free(client->server_name);
}
