/* SPDX-License-Identifier: Apache-2.0 */
/* Parsing and printing of addresses. */
#include "daemon/net_address.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum umb_status parse_host_port(const char *option, const char *text,
                                       struct umbd_address *address, struct umb_error *error)
{
    const char *colon = strrchr(text, ':');
    const char *host = text;
    size_t length = colon != NULL ? (size_t)(colon - text) : 0;
    if (length >= 2 && host[0] == '[' && host[length - 1] == ']') {
        host++;
        length -= 2;
    } else if (length > 0 && memchr(host, ':', length) != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.100s': write an IPv6 host in brackets",
                        option, text);
    }
    if (length == 0 || length >= sizeof address->host) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.100s' is not HOST:PORT", option, text);
    }
    const char *port = colon + 1;
    size_t digits = strspn(port, "0123456789");
    unsigned long number = digits > 0 && digits <= 5 ? strtoul(port, NULL, 10) : 65536;
    if (port[digits] != '\0' || number > 65535) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: port '%.20s' is not in 0..65535", option, port);
    }
    memcpy(address->host, host, length);
    address->host[length] = '\0';
    snprintf(address->port, sizeof address->port, "%lu", number);
    return UMB_OK;
}

enum umb_status umbd_address_parse(const char *option, const char *text,
                                   struct umbd_address *address, struct umb_error *error)
{
    memset(address, 0, sizeof *address);
    if (strncmp(text, "unix:", 5) == 0) {
        size_t length = strlen(text + 5);
        if (length == 0 || length >= sizeof address->path) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: unix path of %zu bytes, must be 1..%zu",
                            option, length, sizeof address->path - 1);
        }
        memcpy(address->path, text + 5, length + 1);
        address->transport = UMBD_UNIX;
        return UMB_OK;
    }
    if (strncmp(text, "tls:", 4) == 0) {
        address->transport = UMBD_TLS;
    } else if (strncmp(text, "tcp:", 4) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: '%.100s' is not tcp:HOST:PORT, tls:HOST:PORT or unix:PATH", option,
                        text);
    }
    return parse_host_port(option, text + 4, address, error);
}

enum umb_status umbd_address_parse_admin(const char *text, struct umbd_address *address,
                                         struct umb_error *error)
{
    memset(address, 0, sizeof *address);
    enum umb_status status = parse_host_port("--admin", text, address, error);
    if (status == UMB_OK && strcmp(address->host, "localhost") != 0 &&
        strcmp(address->host, "::1") != 0 && strncmp(address->host, "127.", 4) != 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--admin: '%.100s' is not a loopback host", text);
    }
    return status;
}

enum umb_status umbd_address_resolve(const struct umbd_address *address,
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
