/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_NET_ADDRESS_H
#define UMBRAGE_SERVER_DAEMON_BASE_NET_ADDRESS_H
/* Socket addresses from the daemon's addresses (net/address.h). */
#include <netinet/in.h>
#include <stddef.h>
#include <sys/socket.h>
#include "net/address.h"

#define UMBD_ADDRESS_TEXT_SIZE 160 /* "unix:" and a path, or "tcp:[v6]:port" */

/* Parses HOST:PORT of the admin port. The host must look like a loopback address or name. The real
 * address of a name is known only after its look-up (umbd_address_is_loopback). Fails:
 * E_ARGUMENT. */
UMB_CHECKED enum umb_status umbd_address_parse_admin(const char *text, struct umbn_address *address,
                                                     struct umb_error *error);

/* Resolves the host of a TCP address. It blocks, so call it only at the start. Fails: E_ARGUMENT
 * (unknown host). */
UMB_CHECKED enum umb_status umbd_address_resolve(const struct umbn_address *address,
                                                 struct sockaddr_storage *out,
                                                 struct umb_error *error);

/* 1 if only this machine can reach the address. */
int umbd_address_is_loopback(const struct sockaddr_storage *address);

/* Writes a socket address as HOST:PORT. */
void umbd_address_text(const struct sockaddr_storage *address, char *text, size_t size);

#endif
