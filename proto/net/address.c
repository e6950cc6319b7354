/* SPDX-License-Identifier: Apache-2.0 */
/* See address.h. */
#include "net/address.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Returns true if all characters are allowed in a host: colons and IPv6 zones only between
 * brackets. */
static bool is_host(const char *text, size_t length, bool bracketed)
{
    static const char allowed[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
    for (size_t i = 0; i < length; i++) {
        if (strchr(allowed, text[i]) == NULL && !(bracketed && strchr(":%", text[i]) != NULL)) {
            return false;
        }
    }
    return length > 0 && length < UMBN_HOST_SIZE;
}

enum umb_status umbn_address_parse_host(const char *field, const char *text,
                                        struct umbn_address *address, struct umb_error *error)
{
    memset(address, 0, sizeof *address);
    const char *colon = strrchr(text, ':');
    if (colon == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.200s' is not HOST:PORT", field, text);
    }
    const char *host = text;
    size_t length = (size_t)(colon - text);
    bool bracketed = length >= 2 && host[0] == '[' && host[length - 1] == ']';
    if (bracketed) {
        host++;
        length -= 2;
    }
    if (!is_host(host, length, bracketed)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: '%.200s': the host must be a name, an IPv4 address or [IPv6]", field,
                        text);
    }
    const char *port = colon + 1;
    size_t digits = strspn(port, "0123456789");
    unsigned long number = digits > 0 && digits <= 5 ? strtoul(port, NULL, 10) : 65536;
    if (port[digits] != '\0' || number > 65535) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: port '%.20s' is not in 0..65535", field, port);
    }
    memcpy(address->host, host, length);
    (void)snprintf(address->port, sizeof address->port, "%lu", number);
    return UMB_OK;
}

static enum umb_status parse_path(const char *field, const char *path, struct umbn_address *address,
                                  struct umb_error *error)
{
    size_t length = strlen(path);
    memset(address, 0, sizeof *address);
    if (length == 0 || length >= sizeof address->path) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: unix path of %zu bytes, must be 1..%zu", field,
                        length, sizeof address->path - 1);
    }
    address->transport = UMBN_UNIX;
    memcpy(address->path, path, length + 1);
    return UMB_OK;
}

enum umb_status umbn_address_parse(const char *field, const char *text,
                                   struct umbn_address *address, struct umb_error *error)
{
    if (strncmp(text, "unix:", 5) == 0) {
        return parse_path(field, text + 5, address, error);
    }
    bool is_tls = strncmp(text, "tls:", 4) == 0;
    if (!is_tls && strncmp(text, "tcp:", 4) != 0) {
        memset(address, 0, sizeof *address);
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: '%.200s' is not tcp:HOST:PORT, tls:HOST:PORT or unix:PATH", field,
                        text);
    }
    enum umb_status status = umbn_address_parse_host(field, text + 4, address, error);
    address->transport = is_tls ? UMBN_TLS : UMBN_TCP;
    return status;
}

void umbn_address_authority(const struct umbn_address *address, char text[UMBN_AUTHORITY_SIZE])
{
    if (address->transport == UMBN_UNIX) {
        (void)snprintf(text, UMBN_AUTHORITY_SIZE, "localhost");
        return;
    }
    bool is_v6 = strchr(address->host, ':') != NULL;
    (void)snprintf(text, UMBN_AUTHORITY_SIZE, is_v6 ? "[%s]:%s" : "%s:%s", address->host,
                   address->port);
}
