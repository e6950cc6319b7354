/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_NET_ADDRESS_H
#define UMBRAGE_NET_ADDRESS_H
/*
 * Addresses of daemons as text: tcp:HOST:PORT (HOST may be [::1]), tls:HOST:PORT or unix:PATH.
 * Client and daemon use the same grammar. No function here resolves a host name.
 */
#include <stddef.h>
#include "umbrage/status.h"

#define UMBN_HOST_SIZE      256
#define UMBN_UNIX_PATH_SIZE 108                  /* sun_path of Linux, NUL included */
#define UMBN_AUTHORITY_SIZE (UMBN_HOST_SIZE + 9) /* "[HOST]:65535" */

enum umbn_transport {
    UMBN_TCP = 0,
    UMBN_TLS,
    UMBN_UNIX,
};

struct umbn_address {
    enum umbn_transport transport;
    char host[UMBN_HOST_SIZE]; /* name or number, without brackets; empty for unix: */
    char port[6];              /* decimal, 0 to 65535 */
    char path[UMBN_UNIX_PATH_SIZE];
};

/*
 * Parses an address. A host has only letters, digits, '.', '-' and '_', or is an IPv6 number in
 * brackets. Every accepted host is therefore valid in an HTTP header.
 *
 * In:    field: name of the option or field, for messages ("--listen").
 * Fails: E_ARGUMENT; the message names the field and the text, and says what the text must be.
 */
UMB_CHECKED enum umb_status umbn_address_parse(const char *field, const char *text,
                                               struct umbn_address *address,
                                               struct umb_error *error);

/* Parses HOST:PORT alone into a TCP address. Fails: E_ARGUMENT, as umbn_address_parse. */
UMB_CHECKED enum umb_status umbn_address_parse_host(const char *field, const char *text,
                                                    struct umbn_address *address,
                                                    struct umb_error *error);

/* Writes the value of :authority for an address: HOST:PORT, or "localhost" for unix:. */
void umbn_address_authority(const struct umbn_address *address, char text[UMBN_AUTHORITY_SIZE]);

#endif
