/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_SESSION_H
#define UMBRAGE_CLI_CLI_SESSION_H
/*
 * How a sub-command reaches the daemon: options that all of them have (`.connects = true` in the
 * command), and what they mean.
 *
 *     umbc_parse fills parsed.session;   umbc_connect(parsed.session, &client, &error);
 *
 * or, for client options of one's own: umbc_session_read, then umb_client_open.
 * The address is --address, else UMBRAGE_ADDRESS, else the default; the token is what --token-file
 * holds, else UMBRAGE_TOKEN, else none. A token is never an argument: `ps` shows those.
 */
#include "cli_common.h"

extern const struct umbc_option UMBC_SESSION_OPTIONS[UMBC_SESSION_COUNT];

struct umbc_session {
    const char *address;
    struct umb_client_options
        options; /* those of tls: and the token set, the rest zero; borrowed */
};

/* Finds out address, files and token. In: values: struct umbc_parsed's session; borrowed as long as
 * the session is used. */
void umbc_session_read(const char *const values[UMBC_SESSION_COUNT], struct umbc_session *session);

/* Opens a client with the default options. */
UMB_CHECKED enum umb_status umbc_connect(const char *const values[UMBC_SESSION_COUNT],
                                         struct umb_client **client, struct umb_error *error);

/* The option --stall-timeout of commands that send or fetch files. */
#define UMBC_STALL_OPTION                                                                          \
    {                                                                                              \
        "stall-timeout", "SECONDS", "give up on a server that sends or takes nothing (120)", 0     \
    }

/* Opens a client with that option. In: command: its name; stall: the option's text, or NULL.
 * Returns -1 on success, else the exit code, after an error message. */
int umbc_connect_patiently(const char *const values[UMBC_SESSION_COUNT], const char *command,
                           const char *stall, struct umb_client **client);

#endif
