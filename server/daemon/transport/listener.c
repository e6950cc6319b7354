/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Opening listeners and accepting connections. When descriptors run out, new connections stay in
 * the kernel's queue until a descriptor is free (acceptor.h). An idle connection is closed, if
 * there is one, to free a descriptor. The shortage is counted, and logged at a limited rate.
 */
#define _GNU_SOURCE /* O_PATH */
#include "daemon/transport/listener.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/try.h"
#include "daemon/transport/conn.h"
#include "daemon/base/service_manager.h"

#define BACKLOG 1024

static void on_taken(struct umbd_acceptor *acceptor, int fd)
{
    struct umbd_listener *listener = acceptor->user;
    struct umbd_loop *to = umbd_loops_idlest(listener->loop->server);
    const struct umbd_socket socket = {
        .fd = fd, .transport = listener->transport, .language = listener->language};
    listener->logged = 0;
    if (to != listener->loop) {
        umbd_loop_hand(to, &socket);
    } else {
        umbd_conn_adopt(to, &socket);
    }
}

static void on_refused(struct umbd_acceptor *acceptor, int code)
{
    struct umbd_listener *listener = acceptor->user;
    struct umbd_loop *loop = listener->loop;
    umbd_count(&loop->server->metrics.connections_refused, 1);
    if (!listener->logged && umbd_loop_may_log(loop)) {
        listener->logged = 1;
        umbs_log_event(&loop->server->log, UMB_LOG_ERROR, "accept_failed", "reason=\"%s\"",
                       uv_strerror(code));
    }
    umbd_conn_evict(loop);
}

void umbd_listeners_tick(struct umbd_loop *loop)
{
    for (struct umbd_listener *at = loop->listeners; at != NULL; at = at->next) {
        umbd_acceptor_tick(&at->acceptor);
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

/*
 * Sets the permissions of a bound Unix socket's file, which the umask may have reduced. The file is
 * opened without following a link and must be a socket of this user. A file that another user put
 * there meanwhile is therefore left alone. Returns 0 or -errno.
 */
static int permit(const char *path, mode_t mode)
{
    struct stat facts;
    char itself[64];
    const int fd = open(path, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0) {
        return -errno;
    }
    int code = 0;
    (void)snprintf(itself, sizeof itself, "/proc/self/fd/%d", fd);
    if (fstat(fd, &facts) != 0) {
        code = -errno;
    } else if (!S_ISSOCK(facts.st_mode) || facts.st_uid != geteuid()) {
        code = -EPERM;
    } else if (chmod(itself, mode) != 0) {
        code = -errno;
    }
    (void)close(fd);
    return code;
}

/* Makes and binds a Unix socket and sets its permissions. That is before listen, and clients can
 * connect only after listen. */
static int bind_unix(struct umbd_listener *listener, const struct umbn_address *address, int *fd)
{
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    memcpy(name.sun_path, address->path, sizeof name.sun_path);
    remove_stale(address->path);
    int code = umbd_socket_bind((struct sockaddr *)&name, fd);
    if (code != 0) {
        return code;
    }
    memcpy(listener->path, address->path, sizeof listener->path);
    code = permit(address->path, listener->loop->server->options.socket_mode);
    if (code != 0) {
        (void)close(*fd);
        *fd = -1;
    }
    return code;
}

/* Writes the listener's address. It is known only after the bind: port 0 has become a real port,
 * and an inherited socket reports its address. */
static void name_listener(struct umbd_listener *listener)
{
    static const char *const prefixes[] = {
        [UMBN_TCP] = "tcp:", [UMBN_TLS] = "tls:", [UMBN_UNIX] = "unix:"};
    struct sockaddr_storage address = {0};
    socklen_t size = sizeof address;
    int length =
        snprintf(listener->text, sizeof listener->text, "%s%s",
                 listener->language == UMBD_HTTP1 ? "http+" : "", prefixes[listener->transport]);
    char *rest = listener->text + length;
    size_t room = sizeof listener->text - (size_t)length;
    (void)getsockname(listener->acceptor.fd, (struct sockaddr *)&address, &size);
    if (listener->transport == UMBN_UNIX) {
        struct sockaddr_un name = {0};
        memcpy(&name, &address, size < sizeof name ? size : sizeof name);
        snprintf(rest, room, "%.*s", (int)sizeof name.sun_path, name.sun_path);
    } else {
        umbd_address_text(&address, rest, room);
    }
}

/* Makes a listener of the loop, not bound yet. Fails: E_NO_MEMORY. */
static enum umb_status make_listener(struct umbd_loop *loop, enum umbn_transport transport,
                                     enum umbd_language language, struct umbd_listener **out,
                                     struct umb_error *error)
{
    struct umbd_listener *listener = *out = calloc(1, sizeof *listener);
    if (listener == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a listener");
    }
    listener->loop = loop;
    listener->transport = transport;
    listener->language = language;
    listener->acceptor = (struct umbd_acceptor){
        .fd = -1, .user = listener, .taken = on_taken, .refused = on_refused};
    struct umbd_listener **last = &loop->listeners;
    while (*last != NULL) {
        last = &(*last)->next;
    }
    *last = listener;
    return UMB_OK;
}

/* Starts to accept on a bound socket. Returns 0 or -errno. */
static int start(struct umbd_listener *listener, int fd, const char *from)
{
    struct umbd_loop *loop = listener->loop;
    int code = umbd_acceptor_start(&listener->acceptor, &loop->uv, fd, BACKLOG);
    if (code == 0) {
        name_listener(listener);
        umbs_log_event(&loop->server->log, UMB_LOG_INFO, "listening", "address=\"%s\" from=%s",
                       listener->text, from);
    }
    return code;
}

/* Refuses an address that opens the daemon to other machines without a token or a certificate.
 * Fails: E_ARGUMENT. */
static enum umb_status check_reach(const struct umbd_loop *loop, const char *option,
                                   enum umbn_transport transport,
                                   const struct sockaddr_storage *address, struct umb_error *error)
{
    char text[UMBD_ADDRESS_TEXT_SIZE];
    if (!umbd_options_serve_anyone(&loop->server->options, transport, address)) {
        return UMB_OK;
    }
    umbd_address_text(address, text, sizeof text);
    return umb_fail(error, UMB_E_ARGUMENT,
                    "%s: '%s' lets other machines query without a token: give --token-file "
                    "or --tls-client-ca, listen on 127.0.0.1, or allow it by --without-tokens",
                    option, text);
}

static enum umb_status open_one(struct umbd_loop *loop, enum umbd_language language,
                                const char *text, struct umb_error *error)
{
    const char *option = language == UMBD_HTTP1 ? "--http" : "--listen";
    struct umbn_address address;
    struct sockaddr_storage resolved;
    struct umbd_listener *listener;
    int fd = -1;
    UMB__TRY(umbn_address_parse(option, text, &address, error));
    const int is_unix = address.transport == UMBN_UNIX;
    if (!is_unix) {
        UMB__TRY(umbd_address_resolve(&address, &resolved, error));
        UMB__TRY(check_reach(loop, option, address.transport, &resolved, error));
    }
    UMB__TRY(make_listener(loop, address.transport, language, &listener, error));
    int code = is_unix ? bind_unix(listener, &address, &fd)
                       : umbd_socket_bind((struct sockaddr *)&resolved, &fd);
    if (code == 0) {
        code = start(listener, fd, "listen");
    }
    return code == 0 ? UMB_OK
                     : umb_fail(error, UMB_E_UNAVAILABLE, "%s: cannot listen on '%.120s': %s",
                                option, text, uv_strerror(code));
}

/* Finds the protocol of a socket from the service manager. Fails: E_ARGUMENT (not a listening
 * stream socket; as check_reach). */
static enum umb_status handed_transport(const struct umbd_loop *loop, int fd, int is_tls,
                                        enum umbn_transport *transport, struct umb_error *error)
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
    *transport = address.ss_family == AF_UNIX ? UMBN_UNIX : is_tls ? UMBN_TLS : UMBN_TCP;
    if ((address.ss_family != AF_UNIX && address.ss_family != AF_INET &&
         address.ss_family != AF_INET6) ||
        (is_tls && *transport == UMBN_UNIX)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "LISTEN_FDS: descriptor %d is neither TCP nor a plain Unix socket", fd);
    }
    return check_reach(loop, "LISTEN_FDS", *transport, &address, error);
}

/* Protocol of a socket from the service manager. The socket's name tells it: "tls", "http" or
 * "https"; any other name means gRPC without TLS. */
struct handed_kind {
    int is_tls;
    enum umbd_language language;
};

static struct handed_kind handed_kind(unsigned index)
{
    const int is_https = umbd_handed_is_named(index, "https");
    const int is_http = is_https || umbd_handed_is_named(index, "http");
    return (struct handed_kind){.is_tls = is_https || umbd_handed_is_named(index, "tls"),
                                .language = is_http ? UMBD_HTTP1 : UMBD_HTTP2};
}

static enum umb_status open_handed(struct umbd_loop *loop, int fd, const struct handed_kind *kind,
                                   struct umb_error *error)
{
    enum umbn_transport transport = UMBN_TCP;
    struct umbd_listener *listener;
    UMB__TRY(handed_transport(loop, fd, kind->is_tls, &transport, error));
    if (transport == UMBN_TLS && loop->server->tls == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "LISTEN_FDS: a socket named tls or https needs --tls-cert and --tls-key");
    }
    UMB__TRY(make_listener(loop, transport, kind->language, &listener, error));
    /* The path belongs to the service manager, which keeps the socket; so it is not removed at the
     * end. */
    int code = start(listener, fd, "service_manager");
    return code == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_UNAVAILABLE,
                          "LISTEN_FDS: cannot listen on descriptor %d: %s", fd, uv_strerror(code));
}

enum umb_status umbd_listeners_open(struct umbd_loop *loop, struct umb_error *error)
{
    const struct umbd_options *options = &loop->server->options;
    struct handed_kind kinds[UMBD_LISTEN_MAX]; /* read before the names are forgotten */
    for (unsigned i = 0; i < UMBD_LISTEN_MAX; i++) {
        kinds[i] = handed_kind(i);
    }
    const unsigned handed = umbd_handed_sockets();
    for (unsigned i = 0; i < handed; i++) {
        UMB__TRY(open_handed(loop, UMBD_HANDED_FIRST + (int)i, &kinds[i], error));
    }
    for (size_t i = 0; handed == 0 && i < options->listen_count; i++) {
        UMB__TRY(open_one(loop, UMBD_HTTP2, options->listen[i], error));
    }
    for (size_t i = 0; handed == 0 && i < options->http_count; i++) {
        UMB__TRY(open_one(loop, UMBD_HTTP1, options->http[i], error));
    }
    return UMB_OK;
}

static void on_closed(uv_handle_t *handle)
{
    struct umbd_acceptor *acceptor = handle->data;
    free(acceptor->user);
}

void umbd_listeners_close(struct umbd_loop *loop)
{
    while (loop->listeners != NULL) {
        struct umbd_listener *listener = loop->listeners;
        loop->listeners = listener->next;
        if (listener->path[0] != '\0') {
            unlink(listener->path);
        }
        umbd_acceptor_close(&listener->acceptor, on_closed);
    }
}
