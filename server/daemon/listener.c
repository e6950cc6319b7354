/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Opening listeners and accepting. Running out of descriptors: libuv keeps one in reserve, uses it
 * to accept and drop the waiting connection, and so does not spin; the event is counted and logged
 * at a limited rate.
 */
#include "daemon/listener.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/conn.h"
#include "daemon/service_manager.h"

#define BACKLOG 1024

static void on_connection(uv_stream_t *server, int status)
{
    struct umbd_listener *listener = server->data;
    struct umbd_loop *loop = listener->loop;
    if (status < 0) {
        umbd_count(&loop->daemon->metrics.connections_refused, 1);
        if (umbd_loop_may_log(loop)) {
            umbs_log_event(&loop->daemon->log, UMB_LOG_ERROR, "accept_failed", "reason=\"%s\"",
                           uv_strerror(status));
        }
        return;
    }
    listener->waiting = !umbd_conn_accept(loop, server, listener->transport);
}

void umbd_listeners_tick(struct umbd_loop *loop)
{
    for (struct umbd_listener *at = loop->listeners; at != NULL; at = at->next) {
        if (at->waiting) {
            on_connection(&at->socket.stream, 0);
        }
    }
}

/* 1 if a process answers on a Unix socket. */
static int is_alive(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    memcpy(address.sun_path, path, strlen(path) + 1);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    if (fd < 0) {
        return 1;
    }
    int alive = connect(fd, (struct sockaddr *)&address, sizeof address) == 0 || errno == EAGAIN;
    close(fd);
    return alive;
}

static void remove_stale(const char *path)
{
    struct stat status;
    if (lstat(path, &status) == 0 && S_ISSOCK(status.st_mode) && !is_alive(path)) {
        unlink(path);
    }
}

/* libuv says EACCES where the folder of a socket is missing. */
static int is_folder_missing(const char *path)
{
    char folder[sizeof((struct sockaddr_un *)0)->sun_path];
    struct stat status;
    const char *end = strrchr(path, '/');
    if (end == NULL || end == path || (size_t)(end - path) >= sizeof folder) {
        return 0;
    }
    memcpy(folder, path, (size_t)(end - path));
    folder[end - path] = '\0';
    return stat(folder, &status) != 0 && errno == ENOENT;
}

static int bind_unix(struct umbd_listener *listener, const struct umbd_address *address)
{
    remove_stale(address->path);
    int code = uv_pipe_bind(&listener->socket.pipe, address->path);
    if (code == 0) {
        memcpy(listener->path, address->path, sizeof listener->path);
        snprintf(listener->text, sizeof listener->text, "unix:%s", address->path);
    }
    return code == UV_EACCES && is_folder_missing(address->path) ? UV_ENOENT : code;
}

static int bind_tcp(struct umbd_listener *listener, const struct sockaddr_storage *address)
{
    return uv_tcp_bind(&listener->socket.tcp, (const struct sockaddr *)address, 0);
}

/* Port 0 has become a real one only now. */
static void name_tcp(struct umbd_listener *listener)
{
    struct sockaddr_storage address;
    int size = sizeof address;
    memset(&address, 0, sizeof address);
    memcpy(listener->text, listener->transport == UMBD_TLS ? "tls:" : "tcp:", 5);
    uv_tcp_getsockname(&listener->socket.tcp, (struct sockaddr *)&address, &size);
    umbd_address_text(&address, listener->text + 4, sizeof listener->text - 4);
}

/* Makes a listener of the loop, not bound yet; NULL: out of memory. */
static struct umbd_listener *make_listener(struct umbd_loop *loop, enum umbd_transport transport)
{
    struct umbd_listener *listener = calloc(1, sizeof *listener);
    if (listener == NULL) {
        return NULL;
    }
    listener->loop = loop;
    listener->transport = transport;
    if (transport == UMBD_UNIX) {
        uv_pipe_init(&loop->uv, &listener->socket.pipe, 0);
    } else {
        uv_tcp_init(&loop->uv, &listener->socket.tcp);
    }
    listener->socket.handle.data = listener;
    struct umbd_listener **last = &loop->listeners;
    while (*last != NULL) {
        last = &(*last)->next;
    }
    *last = listener;
    return listener;
}

static void log_listening(const struct umbd_listener *listener, const char *from)
{
    umbs_log_event(&listener->loop->daemon->log, UMB_LOG_INFO, "listening",
                   "address=\"%s\" from=%s", listener->text, from);
}

static enum umb_status open_one(struct umbd_loop *loop, const char *text, struct umb_error *error)
{
    struct umbd_address address;
    struct sockaddr_storage resolved;
    enum umb_status status = umbd_address_parse("--listen", text, &address, error);
    if (status == UMB_OK && address.transport != UMBD_UNIX) {
        status = umbd_address_resolve(&address, &resolved, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    struct umbd_listener *listener = make_listener(loop, address.transport);
    if (listener == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a listener");
    }
    int code = address.transport == UMBD_UNIX ? bind_unix(listener, &address)
                                              : bind_tcp(listener, &resolved);
    if (code == 0) {
        code = uv_listen(&listener->socket.stream, BACKLOG, on_connection);
    }
    if (code != 0) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "--listen: cannot listen on '%.120s': %s", text,
                        uv_strerror(code));
    }
    if (address.transport != UMBD_UNIX) {
        name_tcp(listener);
    }
    log_listening(listener, "listen");
    return UMB_OK;
}

/* What a socket of the service manager speaks. Fails: E_ARGUMENT (not a listening stream socket).
 */
static enum umb_status handed_transport(int fd, int is_tls, enum umbd_transport *transport,
                                        struct umb_error *error)
{
    struct sockaddr_storage address = {0};
    socklen_t size = sizeof address;
    int listens = 0;
    socklen_t listens_size = sizeof listens;
    if (getsockname(fd, (struct sockaddr *)&address, &size) != 0 ||
        getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &listens_size) != 0 || !listens) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "LISTEN_FDS: descriptor %d is not a listening stream socket", fd);
    }
    *transport = address.ss_family == AF_UNIX ? UMBD_UNIX : is_tls ? UMBD_TLS : UMBD_TCP;
    if ((address.ss_family != AF_UNIX && address.ss_family != AF_INET &&
         address.ss_family != AF_INET6) ||
        (is_tls && *transport == UMBD_UNIX)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "LISTEN_FDS: descriptor %d is neither TCP nor a plain Unix socket", fd);
    }
    return UMB_OK;
}

/* The path belongs to the manager, which keeps the socket: it is not removed at the end. */
static void name_handed_unix(struct umbd_listener *listener)
{
    char path[UMBD_UNIX_PATH_SIZE] = "";
    size_t size = sizeof path - 1;
    (void)uv_pipe_getsockname(&listener->socket.pipe, path, &size);
    snprintf(listener->text, sizeof listener->text, "unix:%s", path);
}

static enum umb_status open_handed(struct umbd_loop *loop, int fd, int is_tls,
                                   struct umb_error *error)
{
    enum umbd_transport transport = UMBD_TCP;
    enum umb_status status = handed_transport(fd, is_tls, &transport, error);
    if (status == UMB_OK && transport == UMBD_TLS && loop->daemon->tls == NULL) {
        status = umb_fail(error, UMB_E_ARGUMENT,
                          "LISTEN_FDS: a socket named tls needs --tls-cert and --tls-key");
    }
    if (status != UMB_OK) {
        return status;
    }
    struct umbd_listener *listener = make_listener(loop, transport);
    if (listener == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a listener");
    }
    int code = transport == UMBD_UNIX ? uv_pipe_open(&listener->socket.pipe, fd)
                                      : uv_tcp_open(&listener->socket.tcp, fd);
    if (code == 0) {
        code = uv_listen(&listener->socket.stream, BACKLOG, on_connection);
    }
    if (code != 0) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "LISTEN_FDS: cannot listen on descriptor %d: %s",
                        fd, uv_strerror(code));
    }
    if (transport == UMBD_UNIX) {
        name_handed_unix(listener);
    } else {
        name_tcp(listener);
    }
    log_listening(listener, "service_manager");
    return UMB_OK;
}

enum umb_status umbd_listeners_open(struct umbd_loop *loop, struct umb_error *error)
{
    const struct umbd_options *options = &loop->daemon->options;
    unsigned tls = 0; /* bit set of the handed sockets */
    for (unsigned i = 0; i < UMBD_LISTEN_MAX; i++) {
        tls |= (unsigned)umbd_handed_is_named(i, "tls") << i;
    }
    unsigned handed = umbd_handed_sockets();
    enum umb_status status = UMB_OK;
    for (unsigned i = 0; status == UMB_OK && i < handed; i++) {
        status = open_handed(loop, UMBD_HANDED_FIRST + (int)i, (int)(tls >> i & 1U), error);
    }
    for (size_t i = 0; status == UMB_OK && handed == 0 && i < options->listen_count; i++) {
        status = open_one(loop, options->listen[i], error);
    }
    return status;
}

static void on_closed(uv_handle_t *handle)
{
    free(handle->data);
}

void umbd_listeners_close(struct umbd_loop *loop)
{
    while (loop->listeners != NULL) {
        struct umbd_listener *listener = loop->listeners;
        loop->listeners = listener->next;
        if (listener->path[0] != '\0') {
            unlink(listener->path);
        }
        uv_close(&listener->socket.handle, on_closed);
    }
}
