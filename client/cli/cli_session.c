/* SPDX-License-Identifier: Apache-2.0 */
/* Options that lead to the daemon, see cli_session.h. */
#include "cli_session.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STALL_MAX_S 86400

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

void umbc_session_read(const char *const values[UMBC_SESSION_COUNT], struct umbc_session *session)
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
    session->options.token_file = values[UMBC_SESSION_TOKEN];
    if (session->options.token_file == NULL && token != NULL && token[0] != '\0') {
        session->options.token = token;
    }
}

enum umb_status umbc_connect(const char *const values[UMBC_SESSION_COUNT],
                             struct umb_client **client, struct umb_error *error)
{
    struct umbc_session session;
    umbc_session_read(values, &session);
    return umb_client_open(session.address, &session.options, client, error);
}

int umbc_connect_patiently(const char *const values[UMBC_SESSION_COUNT], const char *command,
                           const char *stall, struct umb_client **client)
{
    struct umbc_session session;
    struct umb_error error = {.status = UMB_OK};
    unsigned long long seconds = 0;
    umbc_session_read(values, &session);
    if (stall != NULL && (!umbc_parse_count(stall, STALL_MAX_S, &seconds) || seconds == 0)) {
        return umbc_usage_error(
            "%s: --stall-timeout: '%s' is not a whole number of 1 to %d seconds", command, stall,
            STALL_MAX_S);
    }
    session.options.stall_timeout_ms = (uint32_t)seconds * 1000;
    return umb_client_open(session.address, &session.options, client, &error) == UMB_OK
               ? -1
               : umbc_complain(&error);
}
