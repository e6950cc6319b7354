/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's admin port, see load_metrics.h: a plain HTTP/1.0 request each time. */
#include "load/load_metrics.h"

#include <netdb.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define PAGE_BYTES ((size_t)1 << 20)
#define WAIT_S     2

/* Reads the value of the line "NAME VALUE", without labels. Returns false if there is none. */
static bool find_value(const char *text, const char *name, double *value)
{
    size_t length = strlen(name);
    for (const char *line = text; line != NULL && *line != '\0';) {
        if (strncmp(line, name, length) == 0 && line[length] == ' ') {
            char *end;
            *value = strtod(line + length + 1, &end);
            return end != line + length + 1;
        }
        line = strchr(line, '\n');
        line = line != NULL ? line + 1 : NULL;
    }
    return false;
}

enum umb_status umbc_server_figures_parse(const char *text, struct umbc_server_figures *figures,
                                          struct umb_error *error)
{
    memset(figures, 0, sizeof *figures);
    if (!find_value(text, "process_cpu_seconds_total", &figures->cpu_s) ||
        !find_value(text, "umbrage_queries_total", &figures->points)) {
        return umb_fail(error, UMB_E_PROTOCOL, "--admin: the reply has no metrics of umbraged");
    }
    (void)find_value(text, "process_resident_memory_bytes", &figures->rss);
    (void)find_value(text, "umbrage_shed_total", &figures->shed);
    (void)find_value(text, "umbrage_buffered_bytes", &figures->buffered);
    return UMB_OK;
}

/* A connected socket, or -1. */
static int connect_to(const char *admin)
{
    char host[256];
    const char *colon = strrchr(admin, ':');
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    struct addrinfo *found = NULL;
    const struct timeval wait = {.tv_sec = WAIT_S};
    bool bracketed = admin[0] == '[' && colon[-1] == ']';
    (void)snprintf(host, sizeof host, "%.*s", (int)(colon - admin) - (bracketed ? 2 : 0),
                   admin + (bracketed ? 1 : 0));
    if (getaddrinfo(host, colon + 1, &hints, &found) != 0) {
        return -1;
    }
    int fd = -1;
    for (const struct addrinfo *at = found; at != NULL && fd < 0; at = at->ai_next) {
        fd = socket(at->ai_family, at->ai_socktype | SOCK_CLOEXEC, at->ai_protocol);
        if (fd >= 0 && (setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait) != 0 ||
                        setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &wait, sizeof wait) != 0 ||
                        connect(fd, at->ai_addr, at->ai_addrlen) != 0)) {
            (void)close(fd);
            fd = -1;
        }
    }
    freeaddrinfo(found);
    return fd;
}

/* Sends the request and reads until the end. Returns the length of the page in bytes, or 0. */
static size_t fetch(int fd, const char *admin, char *page)
{
    char request[400];
    int length =
        snprintf(request, sizeof request,
                 "GET /metrics HTTP/1.0\r\nHost: %.255s\r\nConnection: close\r\n\r\n", admin);
    size_t size = 0;
    if (send(fd, request, (size_t)length, MSG_NOSIGNAL) != length) {
        return 0;
    }
    while (size < PAGE_BYTES - 1) {
        ssize_t count = recv(fd, page + size, PAGE_BYTES - 1 - size, 0);
        if (count <= 0) {
            break;
        }
        size += (size_t)count;
    }
    page[size] = '\0';
    return size;
}

enum umb_status umbc_server_figures_get(const char *admin, struct umbc_server_figures *figures,
                                        struct umb_error *error)
{
    const char *colon = strrchr(admin, ':');
    memset(figures, 0, sizeof *figures);
    if (colon == NULL || colon == admin || strlen(admin) > 255) {
        return umb_fail(error, UMB_E_ARGUMENT, "--admin '%.100s' is not HOST:PORT", admin);
    }
    char *page = malloc(PAGE_BYTES);
    if (page == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the daemon's metrics");
    }
    int fd = connect_to(admin);
    size_t size = fd >= 0 ? fetch(fd, admin, page) : 0;
    if (fd >= 0) {
        (void)close(fd);
    }
    enum umb_status status =
        size > 0 ? umbc_server_figures_parse(page, figures, error)
                 : umb_fail(error, UMB_E_UNAVAILABLE, "--admin %.100s: no answer", admin);
    free(page);
    return status;
}
