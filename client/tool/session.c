/* SPDX-License-Identifier: Apache-2.0 */
/* Options of the connection to a daemon, see session.h. */
#include "tool/session.h"

#include <stdlib.h>

#define AT(field) UMBU_AT(struct umbu_session, field)

const struct umbu_option UMBU_SESSION_OPTIONS[UMBU_SESSION_COUNT] = {
    {"address", "ADDRESS",
     "address of the daemon: tcp:HOST:PORT, tls:HOST:PORT or unix:PATH; several with commas are "
     "replicas",
     UMBU_TEXT, AT(address), .may_be_empty = true,
     .otherwise = "UMBRAGE_ADDRESS, else " UMBU_DEFAULT_ADDRESS},
    {"tls-ca", "FILE", "file of the authorities that sign the daemon's certificate", UMBU_TEXT,
     AT(options.ca_file), .otherwise = "the system's"},
    {"tls-cert", "FILE", "file of the client's certificate chain, for a daemon that asks for one",
     UMBU_TEXT, AT(options.certificate_file)},
    {"tls-key", "FILE", "file of the client's key, if the file of --tls-cert does not hold it",
     UMBU_TEXT, AT(options.key_file)},
    {"tls-name", "NAME", "name in the daemon's certificate, if it is not HOST", UMBU_TEXT,
     AT(options.server_name)},
    {"token-file", "FILE", "file with the token and nothing else", UMBU_TEXT,
     AT(options.token_file), .otherwise = "UMBRAGE_TOKEN"},
};

/* A variable of the environment; NULL if it is empty. */
static const char *variable(const char *name)
{
    const char *value = getenv(name);
    return value != NULL && value[0] != '\0' ? value : NULL;
}

void umbu_session_complete(struct umbu_session *session)
{
    if (session->address == NULL) {
        session->address = variable("UMBRAGE_ADDRESS");
    }
    if (session->address == NULL || session->address[0] == '\0') {
        session->address = UMBU_DEFAULT_ADDRESS;
    }
    if (session->options.token_file == NULL) {
        session->options.token = variable("UMBRAGE_TOKEN");
    }
}

enum umb_status umbu_connect(const struct umbu_session *session, struct umb_client **client,
                             struct umb_error *error)
{
    struct umbu_session complete = *session;
    umbu_session_complete(&complete);
    return umb_client_open(complete.address, &complete.options, client, error);
}
