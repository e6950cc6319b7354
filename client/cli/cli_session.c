/* SPDX-License-Identifier: Apache-2.0 */
/* Options that lead to the daemon, see cli_session.h. */
#include "cli_session.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const struct umbc_option UMBC_SESSION_OPTIONS[UMBC_SESSION_COUNT] = {
    [UMBC_SESSION_ADDRESS] = {"address", "ADDRESS",
                              "tcp:HOST:PORT, tls:HOST:PORT or unix:PATH, or several with commas: "
                              "replicas; else UMBRAGE_ADDRESS, "
                              "else " UMBC_DEFAULT_ADDRESS,
                              0},
    [UMBC_SESSION_CA] = {"tls-ca", "FILE",
                         "authorities that sign its certificate, else the system's", 0},
    [UMBC_SESSION_CERTIFICATE] = {"tls-cert", "FILE",
                                  "our certificate chain, where it asks for one", 0},
    [UMBC_SESSION_KEY] = {"tls-key", "FILE", "its key, if that is not in --tls-cert's file", 0},
    [UMBC_SESSION_NAME] = {"tls-name", "NAME", "name in its certificate, if it is not HOST", 0},
    [UMBC_SESSION_TOKEN] = {"token-file", "FILE", "a file with the token alone; else UMBRAGE_TOKEN",
                            0},
};

/* Reads a file that holds one line. */
static enum umb_status read_token(const char *path, char token[UMBC_TOKEN_MAX + 2],
                                  struct umb_error *error)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return umb_fail_errno(error, errno == EACCES ? UMB_E_PERMISSION : UMB_E_NO_INPUT, errno,
                              "cannot open the token file '%.150s'", path);
    }
    size_t count = fread(token, 1, UMBC_TOKEN_MAX + 1, file);
    bool failed = ferror(file) != 0;
    (void)fclose(file);
    if (failed) {
        return umb_fail(error, UMB_E_IO, "cannot read the token file '%.150s'", path);
    }
    while (count > 0 && (token[count - 1] == '\n' || token[count - 1] == '\r')) {
        count--;
    }
    token[count] = '\0';
    if (count == 0 || count > UMBC_TOKEN_MAX || strlen(token) != count) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "token file '%.150s': must hold one token of 1 to %d characters", path,
                        UMBC_TOKEN_MAX);
    }
    return UMB_OK;
}

enum umb_status umbc_session_read(const char *const values[UMBC_SESSION_COUNT],
                                  struct umbc_session *session, struct umb_error *error)
{
    const char *address = values[UMBC_SESSION_ADDRESS];
    const char *token = getenv("UMBRAGE_TOKEN");
    memset(session, 0, sizeof *session);
    if (address == NULL) {
        address = getenv("UMBRAGE_ADDRESS");
    }
    session->address = address == NULL || address[0] == '\0' ? UMBC_DEFAULT_ADDRESS : address;
    session->options.ca_file = values[UMBC_SESSION_CA];
    session->options.certificate_file = values[UMBC_SESSION_CERTIFICATE];
    session->options.key_file = values[UMBC_SESSION_KEY];
    session->options.server_name = values[UMBC_SESSION_NAME];
    if (values[UMBC_SESSION_TOKEN] != NULL) {
        enum umb_status status = read_token(values[UMBC_SESSION_TOKEN], session->token, error);
        session->options.token = status == UMB_OK ? session->token : NULL;
        return status;
    }
    session->options.token = token != NULL && token[0] != '\0' ? token : NULL;
    return UMB_OK;
}

enum umb_status umbc_connect(const char *const values[UMBC_SESSION_COUNT],
                             struct umb_client **client, struct umb_error *error)
{
    struct umbc_session session;
    *client = NULL;
    enum umb_status status = umbc_session_read(values, &session, error);
    return status == UMB_OK ? umb_client_open(session.address, &session.options, client, error)
                            : status;
}
