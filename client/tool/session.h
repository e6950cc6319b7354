/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_SESSION_H
#define UMBRAGE_TOOL_SESSION_H
/*
 * The options of commands that connect to a daemon.
 *
 *     struct settings { ...; struct umbu_session session; };
 *     .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct settings, session)}
 *     umbu_connect(&settings.session, &client, &error);
 *
 * The address is --address, else UMBRAGE_ADDRESS, else UMBU_DEFAULT_ADDRESS; the token is the
 * content of --token-file, else UMBRAGE_TOKEN, else none. No argument holds a token: `ps` shows
 * arguments.
 */
#include "tool/options.h"
#include "umbrage/client.h"

#define UMBU_DEFAULT_ADDRESS "tcp:127.0.0.1:7420"

/* Address, TLS settings and token of a connection, from the options and the environment; borrowed
 * from both. */
struct umbu_session {
    const char *address;               /* Address of the daemon; NULL or empty: not given */
    struct umb_client_options options; /* TLS and token from here; a command may set others */
};

#define UMBU_SESSION_COUNT 6
extern const struct umbu_option UMBU_SESSION_OPTIONS[UMBU_SESSION_COUNT];

/* The section of a command whose settings have a session as `field`. */
#define UMBU_SESSION(type, field)                                                                  \
    {                                                                                              \
        "the daemon", UMBU_SESSION_OPTIONS, UMBU_SESSION_COUNT, offsetof(type, field)              \
    }

/* Row of the option --stall-timeout, for commands that send or fetch files. In: type: type of the
 * command's settings. */
#define UMBU_STALL_ROW(type)                                                                       \
    {                                                                                              \
        "stall-timeout", "TIME",                                                                   \
            "time after which a server that sends or takes nothing has failed",                    \
            UMBU_TIME(1000, 86400000), UMBU_AT(type, session.options.stall_timeout_ms),            \
            .otherwise = "120s"                                                                    \
    }

/* Sets address and token from the environment, unless an option gave them. */
void umbu_session_complete(struct umbu_session *session);

/* Completes a copy of the session and opens a client. Fails: as umb_client_open. */
UMB_CHECKED enum umb_status umbu_connect(const struct umbu_session *session,
                                         struct umb_client **client, struct umb_error *error);

#endif
