/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_view_server.h. Each connection has a thread, which waits for its peer alone. */
#define _GNU_SOURCE /* getrandom */
#include "cli_view_server.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "net/http1_fields.h"
#include "tool/clock.h"

#define CONNECTIONS_MAX 32
#define HEAD_S          10.0
#define SEND_S          10.0
#define SEND_RATE       (64.0 * 1024) /* Least bytes a second, beside SEND_S */
#define SEND_BUFFER     (128 << 10)
#define ROOM_S          1.0 /* Time for a connection that gives up its place */
#define LINGER_S        1.0
#define LINGER_BYTES    ((size_t)64 << 10)
#define PIECE_BYTES     ((size_t)256 << 10)
#define FIELDS_BYTES    512
#define PATH_BYTES      UMBN_HTTP1_HEAD_BYTES

struct connection;

struct server {
    struct umbc_view_site *site;
    const char *key;
    pthread_mutex_t lock; /* Guards the places, sockets in them, and waits_since */
    pthread_cond_t has_room;
    struct connection *places[CONNECTIONS_MAX]; /* NULL: free */
};

struct connection {
    struct server *server;
    struct connection **place;
    int socket;
    double waits_since; /* Begin of the wait for a request; infinite: one is answered */
    double stop_s;      /* Time at which the reply must have been taken */
    size_t size;        /* Bytes received that are no request yet */
    uint8_t *piece;     /* [PIECE_BYTES] */
    uint8_t head[UMBN_HTTP1_HEAD_BYTES];
};

/* What a reply has beside its body. */
struct reply {
    int status;
    const char *type;
    uint64_t first, length, size; /* Bytes of the body; of the whole file */
    bool is_head, keeps_open;
    const char *cache;
    const char *tag; /* Entity tag with its quotes, or "" */
};

/* What a page may load, also where it has no such rule itself: a picture of the scene is a page. */
#define POLICY                                                                                     \
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; "                 \
    "img-src 'self' blob: data:; connect-src 'self' blob: data:; base-uri 'none'; "                \
    "form-action 'none'; frame-ancestors 'none'"

/* Waits until the socket has an event. Returns false at the time stop_s. */
static bool wait_for(int socket, short events, double stop_s)
{
    for (;;) {
        const double left = stop_s - umbu_clock_s();
        struct pollfd event = {.fd = socket, .events = events};
        const int count = left > 0 ? poll(&event, 1, (int)(1e3 * left) + 1) : 0;
        if (count > 0 || (count == 0 && left <= 0)) {
            return count > 0;
        }
        if (count < 0 && errno != EINTR) {
            return false;
        }
    }
}

/* Sends all bytes. Returns false if the peer left, or has not taken them at the connection's
 * stop_s. */
static bool send_all(const struct connection *connection, const void *bytes, size_t size)
{
    const char *at = bytes;
    while (size > 0) {
        const ssize_t sent = send(connection->socket, at, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent > 0) {
            at += sent;
            size -= (size_t)sent;
        } else if (sent == 0 || (errno != EINTR && errno != EAGAIN && errno != EWOULDBLOCK) ||
                   !wait_for(connection->socket, POLLOUT, connection->stop_s)) {
            return false;
        }
        if (umbu_clock_s() > connection->stop_s) {
            return size == 0;
        }
    }
    return true;
}

/* Sends a head. Pages of other sites may neither read nor embed what is served, and no frame may
 * hold the viewer. */
static bool send_head(struct connection *connection, const struct reply *reply)
{
    char text[1536], range[96] = "", tag[96] = "";
    connection->stop_s = umbu_clock_s() + SEND_S + (double)reply->length / SEND_RATE;
    if (reply->tag[0] != '\0') {
        (void)snprintf(tag, sizeof tag, "ETag: %s\r\n", reply->tag);
    }
    if (reply->status == 206) {
        (void)snprintf(range, sizeof range, "Content-Range: bytes %llu-%llu/%llu\r\n",
                       (unsigned long long)reply->first,
                       (unsigned long long)(reply->first + reply->length - 1),
                       (unsigned long long)reply->size);
    } else if (reply->status == 416) {
        (void)snprintf(range, sizeof range, "Content-Range: bytes */%llu\r\n",
                       (unsigned long long)reply->size);
    }
    const int length =
        snprintf(text, sizeof text,
                 "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %llu\r\n%s%s%s"
                 "Cache-Control: %s\r\nAccept-Ranges: bytes\r\nX-Content-Type-Options: nosniff\r\n"
                 "Cross-Origin-Resource-Policy: same-origin\r\nX-Frame-Options: DENY\r\n"
                 "Referrer-Policy: no-referrer\r\nContent-Security-Policy: " POLICY "\r\n%s\r\n",
                 reply->status, umbn_http1_reason(reply->status), reply->type,
                 (unsigned long long)reply->length, range, tag,
                 reply->status == 405 ? "Allow: GET, HEAD\r\n" : "", reply->cache,
                 reply->keeps_open ? "" : "Connection: close\r\n");
    return send_all(connection, text, (size_t)length);
}

/* Refuses a request with a sentence. */
static bool refuse(struct connection *connection, struct reply *reply, int status,
                   const char *sentence)
{
    char text[256];
    const int length = snprintf(text, sizeof text, "%s\n", sentence);
    reply->status = status;
    reply->type = "text/plain; charset=utf-8";
    reply->cache = "no-store";
    reply->length = (uint64_t)length;
    return send_head(connection, reply) &&
           (reply->is_head || send_all(connection, text, (size_t)length));
}

static int hex_digit(char c)
{
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

/* Takes the key from the begin of a path. Returns false if it is not there. The time does not tell
 * how much of a wrong key is right. */
static bool take_key(const char *key, struct umbn_http1_text *path)
{
    const size_t length = UMBC_VIEW_KEY_SIZE - 1;
    unsigned differs = 0;
    if (path->size < length + 2 || path->bytes[length + 1] != '/') {
        return false;
    }
    for (size_t i = 0; i < length; i++) {
        differs |= (unsigned)(path->bytes[i + 1] ^ key[i]);
    }
    path->bytes += length + 1;
    path->size -= length + 1;
    return differs == 0;
}

/* Decodes a path without its first slash; "/" is the page. Returns false if it is malformed. */
static bool decode_path(struct umbn_http1_text path, char out[PATH_BYTES])
{
    size_t to = 0;
    for (size_t i = 1; i < path.size; i++) {
        char c = path.bytes[i];
        if (c == '%') {
            const int high = i + 2 < path.size ? hex_digit(path.bytes[i + 1]) : -1;
            const int low = high >= 0 ? hex_digit(path.bytes[i + 2]) : -1;
            if (low < 0 || (high | low) == 0) {
                return false;
            }
            c = (char)(high * 16 + low);
            i += 2;
        }
        out[to++] = c;
    }
    out[to] = '\0';
    if (to == 0) {
        memcpy(out, "index.html", sizeof "index.html");
    }
    return true;
}

/* Reads the Range field. A request for several ranges gets the whole file, as RFC 9110 allows. */
static int choose_range(const struct umbn_http1_request *request, struct reply *reply)
{
    struct umb_range ranges[UMBN_RANGES_MAX];
    size_t count;
    if (request->range.bytes == NULL ||
        (request->if_range.bytes != NULL &&
         (reply->tag[0] == '\0' || !umbn_http1_is(request->if_range, reply->tag)))) {
        return 200;
    }
    switch (umbn_ranges_parse(request->range, reply->size, ranges, &count)) {
    case UMBN_RANGES_OK:
        if (count == 1) {
            reply->first = ranges[0].offset;
            reply->length = ranges[0].length;
        }
        return count == 1 ? 206 : 200;
    case UMBN_RANGES_NONE:
        return 200;
    default:
        return 416;
    }
}

/* Sends the bytes of a body. If that fails, the caller must close the connection: the status is
 * already sent, so a short body is the only sign of the failure. */
static bool send_body(struct connection *connection, struct umbc_view_body *body,
                      const struct reply *reply)
{
    struct umb_error error;
    for (uint64_t done = 0; done < reply->length;) {
        const uint64_t left = reply->length - done;
        const size_t size = left < PIECE_BYTES ? (size_t)left : PIECE_BYTES;
        if (umbc_view_body_read(body, reply->first + done, connection->piece, size, &error) !=
            UMB_OK) {
            (void)fprintf(stderr, "umbrage view: %s\n", error.message);
            return false;
        }
        if (!send_all(connection, connection->piece, size)) {
            return false;
        }
        done += size;
    }
    return true;
}

static bool answer_file(struct connection *connection, const struct umbn_http1_request *request,
                        const struct umbc_view_file *file, struct reply *reply)
{
    struct umbc_view_body body;
    struct umb_error error;
    char id[UMB_ID_TEXT_SIZE], tag[UMB_ID_TEXT_SIZE + 2];
    if (umbc_view_body_open(connection->server->site, file, &body, &error) != UMB_OK) {
        return refuse(connection, reply, 404, "the file cannot be read");
    }
    reply->type = umbc_view_type(file);
    reply->length = reply->size = body.size;
    /* The asset's name has its id, so its bytes never change. */
    reply->cache = "no-cache";
    if (file->source == NULL && file->bytes == NULL) {
        umb_id_to_text(connection->server->site->head.id, id);
        (void)snprintf(tag, sizeof tag, "\"%s\"", id);
        reply->tag = tag; /* Browsers keep ranges of what has a tag alone */
        reply->cache = "private, max-age=31536000, immutable";
    }
    reply->status = choose_range(request, reply);
    const bool sent = reply->status == 416
                          ? refuse(connection, reply, 416, "Range: has no byte of the file")
                          : send_head(connection, reply) &&
                                (reply->is_head || send_body(connection, &body, reply));
    umbc_view_body_close(&body);
    reply->tag = "";
    return sent;
}

/* Answers a request. Returns true if another may follow. */
static bool answer(struct connection *connection, const struct umbn_http1_request *request)
{
    char path[PATH_BYTES];
    struct reply reply = {.is_head = request->method == UMBN_HTTP1_HEAD,
                          .keeps_open = request->keeps_open,
                          .tag = ""};
    struct umbn_http1_text place = request->path;
    bool sent;
    if (request->refusal != 0) {
        sent = refuse(connection, &reply, request->refusal, request->reason);
    } else if (request->host.bytes == NULL || !umbn_host_is_local(request->host)) {
        sent = refuse(connection, &reply, 421, "Host: is not this machine");
    } else if (request->method != UMBN_HTTP1_GET && request->method != UMBN_HTTP1_HEAD) {
        sent = refuse(connection, &reply, 405, "only GET and HEAD are allowed");
    } else {
        const struct umbc_view_file *file =
            take_key(connection->server->key, &place) && decode_path(place, path)
                ? umbc_view_site_find(connection->server->site, path)
                : NULL;
        sent = file != NULL ? answer_file(connection, request, file, &reply)
                            : refuse(connection, &reply, 404, "no such file");
    }
    return sent && reply.keeps_open;
}

/* Receives until a head is complete. Returns its size; 0 if the peer closed the connection, was too
 * slow, or sent a head that is refused. Out: refusal: HTTP status for a refused head, else 0. */
static size_t receive_head(struct connection *connection, int *refusal)
{
    const double stop_s = umbu_clock_s() + HEAD_S;
    size_t seen = 0;
    *refusal = 0;
    for (;;) {
        const size_t end = umbn_http1_head_size(connection->head, connection->size, seen);
        *refusal = end == 0 ? umbn_http1_refuses_early(connection->head, connection->size) : 0;
        if (end > 0 || *refusal != 0) {
            return end;
        }
        seen = connection->size;
        const ssize_t got = wait_for(connection->socket, POLLIN, stop_s)
                                ? recv(connection->socket, connection->head + seen,
                                       sizeof connection->head - seen, 0)
                                : 0;
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got <= 0) {
            return 0;
        }
        connection->size += (size_t)got;
    }
}

/* Reads and discards for a while. A close with unread bytes would reset the connection, and the
 * peer might not receive the refusal. */
static void linger(struct connection *connection)
{
    static const struct linger reset = {.l_onoff = 1};
    const double stop_s = umbu_clock_s() + LINGER_S;
    if (umbu_clock_s() > connection->stop_s) { /* The kernel shall not go on with a slow peer */
        (void)setsockopt(connection->socket, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
        return;
    }
    size_t discarded = 0;
    (void)shutdown(connection->socket, SHUT_WR);
    while (discarded < LINGER_BYTES && wait_for(connection->socket, POLLIN, stop_s)) {
        const ssize_t got =
            recv(connection->socket, connection->head, sizeof connection->head, MSG_DONTWAIT);
        if (got <= 0) {
            return;
        }
        discarded += (size_t)got;
    }
}

static void set_waits_since(struct connection *connection, double since)
{
    pthread_mutex_lock(&connection->server->lock);
    connection->waits_since = since;
    pthread_mutex_unlock(&connection->server->lock);
}

static void serve_connection(struct connection *connection)
{
    for (bool goes_on = true; goes_on;) {
        struct umbn_http1_request request;
        int refusal;
        const size_t size = receive_head(connection, &refusal);
        if (refusal != 0) {
            request = (struct umbn_http1_request){.method = UMBN_HTTP1_OTHER};
            umbn_http1_refuse(&request, refusal);
        } else if (size == 0) {
            return;
        } else {
            umbn_http1_parse(connection->head, size, &request);
        }
        set_waits_since(connection, INFINITY);
        goes_on = answer(connection, &request);
        connection->size -= size;
        memmove(connection->head, connection->head + size, connection->size);
        set_waits_since(connection, umbu_clock_s());
    }
    linger(connection);
}

static void close_connection(struct connection *connection)
{
    struct server *server = connection->server;
    pthread_mutex_lock(&server->lock);
    *connection->place = NULL;
    (void)close(connection->socket);
    (void)pthread_cond_signal(&server->has_room);
    pthread_mutex_unlock(&server->lock);
    free(connection->piece);
    free(connection);
}

static void *run_connection(void *user)
{
    serve_connection(user);
    close_connection(user);
    return NULL;
}

/* Returns a free place, or NULL. Call it with the lock held. */
static struct connection **free_place(struct server *server)
{
    for (size_t i = 0; i < CONNECTIONS_MAX; i++) {
        if (server->places[i] == NULL) {
            return &server->places[i];
        }
    }
    return NULL;
}

/* Ends the connection that has waited longest for a request, and waits for its place. Returns NULL
 * if all connections are answering. Call it with the lock held. */
static struct connection **make_place(struct server *server)
{
    const struct connection *longest = server->places[0];
    struct connection **place = NULL;
    struct timespec stop;
    for (size_t i = 1; i < CONNECTIONS_MAX; i++) {
        const struct connection *one = server->places[i];
        longest = one->waits_since < longest->waits_since ? one : longest;
    }
    if (isinf(longest->waits_since) || clock_gettime(CLOCK_REALTIME, &stop) != 0) {
        return NULL;
    }
    (void)shutdown(longest->socket, SHUT_RDWR); /* Its thread wakes and closes it */
    stop.tv_sec += (time_t)ROOM_S;
    int failed = 0;
    while (failed == 0 && (place = free_place(server)) == NULL) {
        failed = pthread_cond_timedwait(&server->has_room, &server->lock, &stop);
    }
    return place;
}

/* Gives a connection a place. Returns false if there is none. */
static bool take_place(struct server *server, struct connection *connection)
{
    pthread_mutex_lock(&server->lock);
    struct connection **place = free_place(server);
    place = place != NULL ? place : make_place(server);
    if (place != NULL) {
        *place = connection;
        connection->place = place;
    }
    pthread_mutex_unlock(&server->lock);
    return place != NULL;
}

/* Starts a thread for a connection, or closes it. */
static void start(struct server *server, int socket)
{
    const int buffer = SEND_BUFFER; /* A slow peer holds little of the kernel's memory */
    pthread_t thread;
    struct connection *connection = calloc(1, sizeof *connection);
    uint8_t *piece = malloc(PIECE_BYTES);
    if (connection != NULL) {
        connection->server = server;
        connection->socket = socket;
        connection->piece = piece;
        connection->waits_since = umbu_clock_s();
    }
    if (connection == NULL || piece == NULL || !take_place(server, connection)) {
        free(connection);
        free(piece);
        (void)close(socket);
        return;
    }
    (void)setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof buffer);
    if (pthread_create(&thread, NULL, run_connection, connection) != 0) {
        close_connection(connection);
        return;
    }
    (void)pthread_detach(thread);
}

/* Makes a key. Returns false if the system has no random bits. */
static bool make_key(char key[UMBC_VIEW_KEY_SIZE])
{
    uint8_t bytes[(UMBC_VIEW_KEY_SIZE - 1) / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes) {
        return false;
    }
    for (size_t i = 0; i < sizeof bytes; i++) {
        (void)snprintf(key + 2 * i, 3, "%02x", bytes[i]);
    }
    return true;
}

enum umb_status umbc_view_listen(struct umbc_view_listener *listener, struct umb_error *error)
{
    struct sockaddr_in address = {.sin_family = AF_INET,
                                  .sin_port = htons((uint16_t)listener->port)};
    socklen_t size = sizeof address;
    const int on = 1;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int end = listener->socket = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (end < 0 || setsockopt(end, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        bind(end, (const struct sockaddr *)&address, sizeof address) != 0 ||
        listen(end, CONNECTIONS_MAX) != 0 ||
        getsockname(end, (struct sockaddr *)&address, &size) != 0 || !make_key(listener->key)) {
        const int code = errno;
        if (end >= 0) {
            (void)close(end);
        }
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, code,
                              "--port: cannot listen on 127.0.0.1:%u", listener->port);
    }
    listener->port = ntohs(address.sin_port);
    return UMB_OK;
}

enum umb_status umbc_view_serve(const struct umbc_view_listener *listener,
                                struct umbc_view_site *site, struct umb_error *error)
{
    struct server server = {.site = site,
                            .key = listener->key,
                            .lock = PTHREAD_MUTEX_INITIALIZER,
                            .has_room = PTHREAD_COND_INITIALIZER};
    for (;;) {
        const int socket = accept(listener->socket, NULL, NULL);
        if (socket >= 0) {
            start(&server, socket);
        } else if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) {
            (void)poll(NULL, 0, 100); /* until a connection has ended */
        } else if (errno != EINTR && errno != ECONNABORTED && errno != EAGAIN && errno != EPROTO) {
            return umb_fail_errno(error, UMB_E_IO, errno, "view: cannot accept connections");
        }
    }
}
