/* SPDX-License-Identifier: Apache-2.0 */
/* See net_address.h. */
#include "daemon/base/net_address.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum umb_status umbd_address_parse_admin(const char *text, struct umbn_address *address,
                                         struct umb_error *error)
{
    enum umb_status status = umbn_address_parse_host("--admin", text, address, error);
    if (status == UMB_OK && strcmp(address->host, "localhost") != 0 &&
        strcmp(address->host, "::1") != 0 && strncmp(address->host, "127.", 4) != 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--admin: '%.100s' is not a loopback host", text);
    }
    return status;
}

enum umb_status umbd_address_resolve(const struct umbn_address *address,
                                     struct sockaddr_storage *out, struct umb_error *error)
{
    struct addrinfo hints = {.ai_family = AF_UNSPEC,
                             .ai_socktype = SOCK_STREAM,
                             .ai_flags = AI_PASSIVE | AI_NUMERICSERV};
    struct addrinfo *found = NULL;
    memset(out, 0, sizeof *out);
    int code = getaddrinfo(address->host, address->port, &hints, &found);
    if (code != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "host '%.100s': %s", address->host,
                        gai_strerror(code));
    }
    memcpy(out, found->ai_addr, found->ai_addrlen);
    freeaddrinfo(found);
    return UMB_OK;
}

int umbd_address_is_loopback(const struct sockaddr_storage *address)
{
    struct sockaddr_in v4;
    struct sockaddr_in6 v6;
    if (address->ss_family == AF_INET) {
        memcpy(&v4, address, sizeof v4);
        return ntohl(v4.sin_addr.s_addr) >> 24 == 127;
    }
    memcpy(&v6, address, sizeof v6);
    return address->ss_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&v6.sin6_addr);
}

void umbd_address_text(const struct sockaddr_storage *address, char *text, size_t size)
{
    char host[INET6_ADDRSTRLEN] = "?";
    unsigned port = 0;
    if (address->ss_family == AF_INET) {
        struct sockaddr_in v4;
        memcpy(&v4, address, sizeof v4);
        inet_ntop(AF_INET, &v4.sin_addr, host, sizeof host);
        port = ntohs(v4.sin_port);
        snprintf(text, size, "%s:%u", host, port);
    } else if (address->ss_family == AF_INET6) {
        struct sockaddr_in6 v6;
        memcpy(&v6, address, sizeof v6);
        inet_ntop(AF_INET6, &v6.sin6_addr, host, sizeof host);
        port = ntohs(v6.sin6_port);
        snprintf(text, size, "[%s]:%u", host, port);
    } else {
        snprintf(text, size, "unknown");
    }
}
