/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_ADDRESS_H
#define UMBRAGE_RPC_RPC_ADDRESS_H
/* Where a daemon listens: "tcp:HOST:PORT" (HOST may be [::1]), "tls:HOST:PORT" or "unix:PATH". */
#include <stdbool.h>
#include "umbrage/status.h"

struct umb__address {
    char text[320];      /* as given, for messages */
    char authority[280]; /* for :authority: HOST:PORT, or localhost */
    bool is_unix;
    bool is_tls;    /* a HOST and a PORT, and TLS on top */
    char host[256]; /* tcp, tls: without brackets */
    char port[6];   /* tcp, tls: decimal, 1..65535 */
    char path[108]; /* unix: sun_path's size on Linux */
};

/* Parses an address. Fails: E_ARGUMENT, naming what is wrong. */
UMB_CHECKED enum umb_status umb__address_parse(const char *text, struct umb__address *address,
                                               struct umb_error *error);

#endif
