/* SPDX-License-Identifier: Apache-2.0 */
/* Addresses of daemons, see rpc_address.h. */
#include "rpc_address.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum umb_status parse_unix(const char *path, struct umb__address *address,
                                  struct umb_error *error)
{
    size_t length = strlen(path);
    if (length == 0 || length >= sizeof address->path) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "address '%.120s': the path has %zu bytes, must have 1 to %zu",
                        address->text, length, sizeof address->path - 1);
    }
    address->is_unix = true;
    memcpy(address->path, path, length + 1);
    (void)snprintf(address->authority, sizeof address->authority, "localhost");
    return UMB_OK;
}

static bool parse_port(const char *text, char port[6])
{
    unsigned value = 0;
    size_t length = 0;
    for (; text[length] != '\0'; length++) {
        if (text[length] < '0' || text[length] > '9' || length == 5) {
            return false;
        }
        value = value * 10 + (unsigned)(text[length] - '0');
    }
    if (value == 0 || value > 65535) {
        return false;
    }
    (void)snprintf(port, 6, "%u", value & 0xffffU);
    return true;
}

/* A host goes into :authority, so that only what a name or a number may hold is let through. */
static bool parse_host(const char *text, size_t length, struct umb__address *address)
{
    bool bracketed = length >= 2 && text[0] == '[' && text[length - 1] == ']';
    if (bracketed) {
        text++;
        length -= 2;
    }
    if (length == 0 || length >= sizeof address->host) {
        return false;
    }
    static const char allowed[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
    for (size_t i = 0; i < length; i++) {
        bool numeric_only = bracketed && (text[i] == ':' || text[i] == '%');
        if (text[i] == '\0' || (strchr(allowed, text[i]) == NULL && !numeric_only)) {
            return false;
        }
    }
    memcpy(address->host, text, length);
    address->host[length] = '\0';
    (void)snprintf(address->authority, sizeof address->authority, bracketed ? "[%s]:%s" : "%s:%s",
                   address->host, address->port);
    return true;
}

static enum umb_status parse_tcp(const char *text, struct umb__address *address,
                                 struct umb_error *error)
{
    const char *colon = strrchr(text, ':');
    if (colon == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "address '%.200s': must be %s:HOST:PORT",
                        address->text, address->is_tls ? "tls" : "tcp");
    }
    if (!parse_port(colon + 1, address->port)) {
        return umb_fail(error, UMB_E_ARGUMENT, "address '%.200s': the port must be 1 to 65535",
                        address->text);
    }
    if (!parse_host(text, (size_t)(colon - text), address)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "address '%.200s': the host must be a name, an IPv4 address or [IPv6]",
                        address->text);
    }
    return UMB_OK;
}

enum umb_status umb__address_parse(const char *text, struct umb__address *address,
                                   struct umb_error *error)
{
    memset(address, 0, sizeof *address);
    size_t length = strlen(text);
    if (length >= sizeof address->text) {
        return umb_fail(error, UMB_E_ARGUMENT, "address: %zu bytes are over the limit of %zu",
                        length, sizeof address->text - 1);
    }
    memcpy(address->text, text, length + 1);
    if (strncmp(text, "tcp:", 4) == 0) {
        return parse_tcp(text + 4, address, error);
    }
    if (strncmp(text, "tls:", 4) == 0) {
        address->is_tls = true;
        return parse_tcp(text + 4, address, error);
    }
    if (strncmp(text, "unix:", 5) == 0) {
        return parse_unix(text + 5, address, error);
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "address '%.200s': must be tcp:HOST:PORT, tls:HOST:PORT or unix:PATH", text);
}
