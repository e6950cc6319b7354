/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FAKE_SERVER_H
#define UMBRAGE_TESTS_FAKE_SERVER_H
/*
 * A small gRPC server in a thread, which misbehaves on request: as a whole, by the first fields of
 * struct fake_server, and call by call, as fake_answers.h says. One thread a connection, blocking
 * sockets.
 */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>
#include "fake_answers.h"

#define FAKE_BODY_MAX ((size_t)32 << 20)

static void fake_pause(long milliseconds)
{
    const struct timespec pause = {.tv_nsec = milliseconds * 1000000};
    (void)nanosleep(&pause, NULL);
}

static int fake_on_begin(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct fake_connection *connection = user;
    if (frame->hd.type == NGHTTP2_HEADERS && frame->headers.cat == NGHTTP2_HCAT_REQUEST) {
        struct fake_stream *stream = calloc(1, sizeof *stream);
        if (stream == NULL) {
            abort();
        }
        stream->id = frame->hd.stream_id;
        stream->drop_after = -1;
        stream->next = connection->streams;
        connection->streams = stream;
        (void)nghttp2_session_set_stream_user_data(session, stream->id, stream);
        atomic_fetch_add(&connection->server->requests, 1);
    }
    return 0;
}

static int fake_on_header(nghttp2_session *session, const nghttp2_frame *frame, const uint8_t *name,
                          size_t name_size, const uint8_t *value, size_t value_size, uint8_t flags,
                          void *user)
{
    (void)flags;
    (void)user;
    struct fake_stream *stream = nghttp2_session_get_stream_user_data(session, frame->hd.stream_id);
    if (stream != NULL && name_size == 5 && memcmp(name, ":path", 5) == 0) {
        (void)snprintf(stream->path, sizeof stream->path, "%.*s", (int)value_size,
                       (const char *)value);
    }
    if (stream != NULL && name_size == 12 && memcmp(name, "grpc-timeout", 12) == 0) {
        (void)snprintf(stream->timeout, sizeof stream->timeout, "%.*s", (int)value_size,
                       (const char *)value);
    }
    return 0;
}

static int fake_on_data(nghttp2_session *session, uint8_t flags, int32_t id, const uint8_t *data,
                        size_t size, void *user)
{
    (void)flags;
    struct fake_connection *connection = user;
    struct fake_stream *stream = nghttp2_session_get_stream_user_data(session, id);
    if (stream == NULL || stream->body_size + size > FAKE_BODY_MAX) {
        return 0;
    }
    if (stream->body_size + size > stream->body_capacity) {
        stream->body_capacity = 2 * (stream->body_size + size);
        stream->body = realloc(stream->body, stream->body_capacity);
        if (stream->body == NULL) {
            abort();
        }
    }
    memcpy(stream->body + stream->body_size, data, size);
    stream->body_size += size;
    if (strcmp(stream->path, UMBW_PATH_STREAM) == 0) {
        fake_stream_respond(connection, stream);
    }
    return 0;
}

static int fake_on_frame(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct fake_connection *connection = user;
    struct fake_stream *stream =
        frame->hd.stream_id == 0
            ? NULL
            : nghttp2_session_get_stream_user_data(session, frame->hd.stream_id);
    if (frame->hd.type == NGHTTP2_RST_STREAM) {
        atomic_fetch_add(&connection->server->resets, 1);
    }
    if (stream == NULL) {
        return 0;
    }
    if (connection->server->early_error) {
        if (frame->hd.type == NGHTTP2_HEADERS) {
            fake_trailers_only(connection, stream->id, "8", "points: too many");
        }
    } else if ((frame->hd.flags & NGHTTP2_FLAG_END_STREAM) != 0 &&
               (frame->hd.type == NGHTTP2_DATA || frame->hd.type == NGHTTP2_HEADERS)) {
        fake_respond(connection, stream);
    }
    return 0;
}

static bool fake_send_all(struct fake_connection *connection)
{
    for (;;) {
        const uint8_t *bytes;
        ssize_t count = nghttp2_session_mem_send(connection->session, &bytes);
        if (count <= 0) {
            return count == 0;
        }
        for (ssize_t sent = 0; sent < count;) {
            ssize_t n =
                send(connection->socket, bytes + sent, (size_t)(count - sent), MSG_NOSIGNAL);
            if (n <= 0) {
                return false;
            }
            sent += n;
        }
        if (connection->hang_up) {
            return false;
        }
    }
}

static void fake_session(struct fake_connection *connection)
{
    struct fake_server *server = connection->server;
    nghttp2_session_callbacks *callbacks;
    const nghttp2_settings_entry settings[] = {
        {NGHTTP2_SETTINGS_MAX_CONCURRENT_STREAMS,
         server->max_streams == 0 ? 100 : server->max_streams},
        {NGHTTP2_SETTINGS_INITIAL_WINDOW_SIZE, 1 << 20},
        {NGHTTP2_SETTINGS_MAX_FRAME_SIZE, 1 << 20},
    };
    if (nghttp2_session_callbacks_new(&callbacks) != 0) {
        abort();
    }
    nghttp2_session_callbacks_set_on_begin_headers_callback(callbacks, fake_on_begin);
    nghttp2_session_callbacks_set_on_header_callback(callbacks, fake_on_header);
    nghttp2_session_callbacks_set_on_data_chunk_recv_callback(callbacks, fake_on_data);
    nghttp2_session_callbacks_set_on_frame_recv_callback(callbacks, fake_on_frame);
    nghttp2_option *option;
    if (nghttp2_option_new(&option) != 0) {
        abort();
    }
    nghttp2_option_set_max_send_header_block_length(option, 1 << 20); /* for the bomb */
    if (nghttp2_session_server_new2(&connection->session, callbacks, connection, option) != 0 ||
        nghttp2_submit_settings(connection->session, 0, settings, 3) != 0) {
        abort();
    }
    nghttp2_session_callbacks_del(callbacks);
    nghttp2_option_del(option);
    if (server->goodbye) {
        (void)nghttp2_submit_goaway(connection->session, 0, 0, NGHTTP2_NO_ERROR, NULL, 0);
    }
    uint8_t *block = malloc(65536);
    if (block == NULL) {
        abort();
    }
    while (fake_send_all(connection) && !atomic_load(&server->stop)) {
        struct pollfd entry = {.fd = connection->socket, .events = POLLIN};
        if (connection->number == 0 && atomic_load(&server->frozen)) {
            fake_pause(10);
            continue;
        }
        if (poll(&entry, 1, 20) <= 0 || (connection->number == 0 && atomic_load(&server->frozen))) {
            continue; /* what came when it was frozen is not read */
        }
        ssize_t count = recv(connection->socket, block, 65536, 0);
        /* A server that has sent GOAWAY only reads on until the client hangs up. */
        if (count <= 0 || (!server->goodbye && nghttp2_session_mem_recv(connection->session, block,
                                                                        (size_t)count) < 0)) {
            break;
        }
    }
    free(block);
    nghttp2_session_del(connection->session);
}

static void fake_http1(struct fake_connection *connection)
{
    static const char text[] = "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n";
    char block[256];
    (void)recv(connection->socket, block, sizeof block, 0);
    (void)send(connection->socket, text, sizeof text - 1, MSG_NOSIGNAL);
    fake_pause(50);
}

static void *fake_worker(void *user)
{
    struct fake_connection *connection = user;
    if (connection->server->http1) {
        fake_http1(connection);
    } else if (connection->server->mute) {
        while (!atomic_load(&connection->server->stop)) {
            fake_pause(10);
        }
    } else {
        fake_session(connection);
    }
    (void)close(connection->socket);
    while (connection->streams != NULL) {
        struct fake_stream *stream = connection->streams;
        connection->streams = stream->next;
        free(stream->body);
        free(stream->reply);
        free(stream);
    }
    free(connection);
    return NULL;
}

static void *fake_accept(void *user)
{
    struct fake_server *server = user;
    while (!atomic_load(&server->stop)) {
        struct pollfd entry = {.fd = server->listener, .events = POLLIN};
        if (poll(&entry, 1, 20) <= 0) {
            continue;
        }
        int client = accept(server->listener, NULL, NULL);
        unsigned number = atomic_load(&server->connections);
        if (client < 0 || number == FAKE_CONNECTIONS) {
            abort();
        }
        struct fake_connection *connection = calloc(1, sizeof *connection);
        if (connection == NULL) {
            abort();
        }
        connection->server = server;
        connection->socket = client;
        connection->number = number;
        if (pthread_create(&server->workers[number], NULL, fake_worker, connection) != 0) {
            abort();
        }
        atomic_store(&server->connections, number + 1);
    }
    return NULL;
}

/* Listens on a free port (or `port`) of 127.0.0.1, or on unix_path, and writes its address. */
static void fake_start(struct fake_server *server, int port, char address[128])
{
    struct sockaddr_in tcp = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    struct sockaddr_un local = {.sun_family = AF_UNIX};
    socklen_t size = sizeof tcp;
    int on = 1;
    tcp.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    bool is_unix = server->unix_path != NULL;
    server->listener = socket(is_unix ? AF_UNIX : AF_INET, SOCK_STREAM, 0);
    (void)setsockopt(server->listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    int code;
    if (is_unix) {
        (void)snprintf(local.sun_path, sizeof local.sun_path, "%s", server->unix_path);
        code = bind(server->listener, (struct sockaddr *)&local, sizeof local);
        (void)snprintf(address, 128, "unix:%s", server->unix_path);
    } else {
        code = bind(server->listener, (struct sockaddr *)&tcp, sizeof tcp);
        (void)getsockname(server->listener, (struct sockaddr *)&tcp, &size);
        server->port = ntohs(tcp.sin_port);
        (void)snprintf(address, 128, "tcp:127.0.0.1:%d", server->port);
    }
    if (code != 0 || listen(server->listener, 16) != 0 ||
        pthread_create(&server->thread, NULL, fake_accept, server) != 0) {
        abort();
    }
}

static void fake_stop(struct fake_server *server)
{
    atomic_store(&server->stop, true);
    (void)pthread_join(server->thread, NULL);
    for (unsigned i = 0; i < atomic_load(&server->connections); i++) {
        (void)pthread_join(server->workers[i], NULL);
    }
    (void)close(server->listener);
    if (server->unix_path != NULL) {
        (void)unlink(server->unix_path);
    }
}

#endif
