/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_NET_ADDRESS_H
#define UMBRAGE_SERVER_DAEMON_NET_ADDRESS_H
/* Addresses as people write them: tcp:HOST:PORT (HOST may be [::1]), tls:HOST:PORT, unix:PATH. */
#include <netinet/in.h>
#include <stddef.h>
#include <sys/socket.h>
#include "umbrage/status.h"

#define UMBD_HOST_SIZE         256
#define UMBD_UNIX_PATH_SIZE    108 /* sun_path of Linux, NUL included */
#define UMBD_ADDRESS_TEXT_SIZE 160 /* "unix:" and a path, or "tcp:[v6]:port" */

enum umbd_transport {
    UMBD_TCP = 0,
    UMBD_TLS,
    UMBD_UNIX,
};

struct umbd_address {
    enum umbd_transport transport;
    char host[UMBD_HOST_SIZE]; /* without brackets */
    char port[6];
    char path[UMBD_UNIX_PATH_SIZE];
};

/* Parses. In: option: name for messages. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbd_address_parse(const char *option, const char *text,
                                               struct umbd_address *address,
                                               struct umb_error *error);

/* Parses HOST:PORT of the admin port, which must look like loopback; what the name stands for is
 * known only when it is looked up (umbd_address_is_loopback). Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbd_address_parse_admin(const char *text, struct umbd_address *address,
                                                     struct umb_error *error);

/* Looks a TCP host up. Blocks: for boot only. Fails: E_ARGUMENT (unknown host). */
UMB_CHECKED enum umb_status umbd_address_resolve(const struct umbd_address *address,
                                                 struct sockaddr_storage *out,
                                                 struct umb_error *error);

/* 1 if nobody but this machine can reach it. */
int umbd_address_is_loopback(const struct sockaddr_storage *address);

/* Writes a socket address as HOST:PORT. */
void umbd_address_text(const struct sockaddr_storage *address, char *text, size_t size);

#endif
