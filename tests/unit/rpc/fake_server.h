/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FAKE_SERVER_H
#define UMBRAGE_TESTS_FAKE_SERVER_H
/*
 * A small gRPC server in a thread, which misbehaves on request: the asset's name in a query says
 * how it is answered. One thread a connection, blocking sockets.
 *
 * Names: ok not-found reset refuse refuse-once goaway-once silent garbage over-long http-503 html
 * no-status two-messages short compressed drop drop-inside bomb status-999 shed too-many
 * never-again away away-twice drop-once shed-once. "ok" answers each point with its x coordinate
 * (float).
 */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <nghttp2/nghttp2.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>
#include "wire/grpc.h"
#include "wire/messages.h"
#include "wire/questions.h"

#define FAKE_CONNECTIONS 16
#define FAKE_BODY_MAX    ((size_t)32 << 20)

struct fake_server {
    /* how it behaves as a whole; set before the start */
    bool http1;           /* answers like a web server of old */
    bool mute;            /* accepts and says nothing */
    bool early_error;     /* answers RESOURCE_EXHAUSTED to the headers, before the body */
    atomic_bool frozen;   /* the first connection stays open and says nothing more */
    bool goodbye;         /* greets with SETTINGS and GOAWAY and hangs up */
    uint32_t max_streams; /* 0 = 100 */
    const char *unix_path;
    /* what it saw */
    atomic_uint connections, requests, resets, streamed;
    int listener;
    int port;
    pthread_t thread;
    atomic_bool stop;
    pthread_t workers[FAKE_CONNECTIONS];
};

struct fake_stream {
    struct fake_stream *next;
    int32_t id;
    char path[64];
    char timeout[16];
    uint8_t *body;
    size_t body_size, body_capacity;
    uint8_t *reply;
    size_t reply_size, reply_sent;
    int drop_after; /* close the connection once so many reply bytes are sent; -1 = no */
    bool without_status;
    /* QueryStream: how much of the body is answered, whether an answer was begun */
    size_t taken;
    bool answering;
    const char *end; /* grpc-status that ends it, or NULL */
};

struct fake_connection {
    struct fake_server *server;
    unsigned number; /* from 0 */
    int socket;
    nghttp2_session *session;
    struct fake_stream *streams;
    bool hang_up;
};

static void fake_pause(long milliseconds)
{
    const struct timespec pause = {.tv_nsec = milliseconds * 1000000};
    (void)nanosleep(&pause, NULL);
}

static nghttp2_nv fake_header(const char *name, const char *value)
{
    nghttp2_nv pair = {.namelen = strlen(name), .valuelen = strlen(value)};
    memcpy(&pair.name, &name, sizeof pair.name);
    memcpy(&pair.value, &value, sizeof pair.value);
    return pair;
}

static void fake_append(struct fake_stream *stream, const void *bytes, size_t count)
{
    uint8_t *reply = realloc(stream->reply, stream->reply_size + count + 1);
    if (reply == NULL) {
        abort();
    }
    memcpy(reply + stream->reply_size, bytes, count);
    stream->reply = reply;
    stream->reply_size += count;
}

static void fake_append_buffer(struct fake_stream *stream, struct umbw_buffer *buffer)
{
    fake_append(stream, buffer->bytes, buffer->size);
    umbw_buffer_finish(buffer);
}

static ssize_t fake_read(nghttp2_session *session, int32_t id, uint8_t *buffer, size_t length,
                         uint32_t *flags, nghttp2_data_source *source, void *user)
{
    struct fake_stream *stream = source->ptr;
    struct fake_connection *connection = user;
    size_t left = stream->reply_size - stream->reply_sent;
    size_t count = left < length ? left : length;
    if (count > 0) {
        memcpy(buffer, stream->reply + stream->reply_sent, count);
    }
    stream->reply_sent += count;
    if (stream->drop_after >= 0) {
        connection->hang_up = true;
        return (ssize_t)count;
    }
    if (stream->answering && stream->end == NULL) {
        return count > 0 ? (ssize_t)count : NGHTTP2_ERR_DEFERRED;
    }
    if (count == left) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
        if (!stream->without_status) {
            nghttp2_nv trailer = fake_header("grpc-status", stream->end ? stream->end : "0");
            *flags |= NGHTTP2_DATA_FLAG_NO_END_STREAM;
            (void)nghttp2_submit_trailer(session, id, &trailer, 1);
        }
    }
    return (ssize_t)count;
}

static void fake_send_reply(struct fake_connection *connection, struct fake_stream *stream,
                            const char *http_status, const char *content_type)
{
    const nghttp2_nv headers[] = {
        fake_header(":status", http_status),
        fake_header("content-type", content_type),
    };
    nghttp2_data_provider provider = {.source = {.ptr = stream}, .read_callback = fake_read};
    (void)nghttp2_submit_response(connection->session, stream->id, headers, 2, &provider);
}

static void fake_trailers_only(struct fake_connection *connection, int32_t id, const char *status,
                               const char *message)
{
    const nghttp2_nv headers[] = {
        fake_header(":status", "200"),
        fake_header("content-type", "application/grpc"),
        fake_header("grpc-status", status),
        fake_header("grpc-message", message),
    };
    (void)nghttp2_submit_response(connection->session, id, headers, 4, NULL);
}

/* A status with a hint when to come again. */
static void fake_hint(struct fake_connection *connection, int32_t id, const char *status,
                      const char *pushback)
{
    const nghttp2_nv headers[] = {
        fake_header(":status", "200"),
        fake_header("content-type", "application/grpc"),
        fake_header("grpc-status", status),
        fake_header("grpc-message", "queue: full"),
        fake_header("grpc-retry-pushback-ms", pushback),
    };
    (void)nghttp2_submit_response(connection->session, id, headers, 5, NULL);
}

static void fake_answer(struct fake_stream *stream, const struct umbw_query_request *request,
                        size_t count)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umbw_query_reply reply = {.has_stats = request->want_stats, .nanoseconds = 42};
    float *values = calloc(count + 1, sizeof *values);
    if (values == NULL) {
        abort();
    }
    for (size_t i = 0; i < count && request->points.format == UMB_POINT_F32; i++) {
        memcpy(&values[i], (const uint8_t *)request->points.positions + 12 * i, 4);
    }
    reply.visibility_bytes = count * sizeof *values;
    reply.stats.points = count;
    memset(reply.asset_id, 0xab, sizeof reply.asset_id);
    if (umbw_encode_query_reply_head(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
    fake_append(stream, values, reply.visibility_bytes);
    free(values);
}

static void fake_bomb(struct fake_connection *connection, int32_t id)
{
    static char value[4000];
    nghttp2_nv headers[40];
    memset(value, 'a', sizeof value - 1);
    headers[0] = fake_header(":status", "200");
    for (size_t i = 1; i < 40; i++) {
        headers[i] = fake_header("x-bomb", value);
    }
    (void)nghttp2_submit_response(connection->session, id, headers, 40, NULL);
}

static void fake_query(struct fake_connection *connection, struct fake_stream *stream,
                       const struct umbw_query_request *request)
{
    static const uint8_t garbage[] = {0, 0, 0, 0, 3, 0xff, 0xff, 0xff};
    static const uint8_t over_long[] = {0, 0x7f, 0xff, 0xff, 0xff, 1, 2, 3};
    const char *name = request->asset;
    const char *type = "application/grpc+proto";
    unsigned number = atomic_load(&connection->server->requests);
    bool first = number == 1;
    if (first && strcmp(name, "drop-once") == 0) {
        name = "drop";
    } else if (first && strcmp(name, "shed-once") == 0) {
        name = "shed";
    } else if (number <= 2 && strcmp(name, "away-twice") == 0) {
        name = "away";
    }
    if (strcmp(name, "away") == 0) {
        fake_trailers_only(connection, stream->id, "14", "draining");
    } else if (strcmp(name, "not-found") == 0) {
        fake_trailers_only(connection, stream->id, "5",
                           "asset: no %22not-found%22%0A caf%C3%A9 50%25");
    } else if (strcmp(name, "status-999") == 0) {
        fake_trailers_only(connection, stream->id, "9x9", "");
    } else if (strcmp(name, "shed") == 0) {
        fake_hint(connection, stream->id, "8", "50");
    } else if (strcmp(name, "never-again") == 0) {
        fake_hint(connection, stream->id, "8", "-1");
    } else if (strcmp(name, "away-for-good") == 0) {
        fake_hint(connection, stream->id, "14", "-1");
    } else if (strcmp(name, "away-a-while") == 0 && first) {
        fake_hint(connection, stream->id, "14", "400");
    } else if (strcmp(name, "too-many") == 0) {
        fake_trailers_only(connection, stream->id, "8", "points: 100 is over the limit of 1");
    } else if (strcmp(name, "reset") == 0) {
        (void)nghttp2_submit_rst_stream(connection->session, 0, stream->id, NGHTTP2_INTERNAL_ERROR);
    } else if (strcmp(name, "refuse") == 0 || (strcmp(name, "refuse-once") == 0 && first)) {
        (void)nghttp2_submit_rst_stream(connection->session, 0, stream->id, NGHTTP2_REFUSED_STREAM);
    } else if (strcmp(name, "goaway-once") == 0 && first) {
        (void)nghttp2_submit_goaway(connection->session, 0, 0, NGHTTP2_NO_ERROR, NULL, 0);
    } else if (strcmp(name, "silent") == 0) {
        return;
    } else if (strcmp(name, "http-503") == 0) {
        fake_append(stream, "<html>busy</html>", 17);
        stream->without_status = true;
        fake_send_reply(connection, stream, "503", "text/html");
    } else if (strcmp(name, "html") == 0) {
        fake_append(stream, "<html>hi</html>", 15);
        stream->without_status = true;
        fake_send_reply(connection, stream, "200", "text/html");
    } else if (strcmp(name, "garbage") == 0) {
        fake_append(stream, garbage, sizeof garbage);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "over-long") == 0) {
        fake_append(stream, over_long, sizeof over_long);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "compressed") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply[0] = 1;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "no-status") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->without_status = true;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "two-messages") == 0) {
        fake_answer(stream, request, request->points.count);
        fake_answer(stream, request, request->points.count);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "no-message") == 0) {
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "drop-inside") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply_size -= 1;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "short") == 0) {
        fake_answer(stream, request, request->points.count - 1);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "drop") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply_size /= 2;
        stream->drop_after = 0;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "bomb") == 0) {
        fake_bomb(connection, stream->id);
    } else {
        fake_answer(stream, request, request->points.count);
        fake_send_reply(connection, stream, "200", type);
    }
}

static void fake_list(struct fake_stream *stream)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umbw_asset_summary assets[2] = {{.name = "a", .light_count = 1}, {.name = "b"}};
    struct umbw_list_reply reply = {.count = 2, .assets = assets};
    if (umbw_encode_list_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

static void fake_describe(struct fake_stream *stream)
{
    char plan[] = "effect=closed state=on\n";
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umbw_light light = {.info = {.name = "sun"}, .resolution = 1024, .closed = 1};
    struct umbw_describe_reply reply = {
        .summary = {.name = "a"}, .light_count = 1, .lights = &light, .plan = plan};
    if (umbw_encode_describe_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

static void fake_health(struct fake_stream *stream)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    if (umbw_encode_health_reply(1, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

/* Segments: of segment i share i is lit, in i stretches, each from its number on; "lies" tells one
 * stretch less than it counts, "few" answers one segment less. Other questions get no answer. */
static void fake_segments(struct fake_stream *stream)
{
    struct umbw_question_request request;
    struct umbw_buffer buffer = {NULL, 0, 0};
    double lit[16], stretches[16 * 16][2];
    uint32_t counts[16];
    size_t told = 0;
    if (umbw_decode_question_request(UMBW_SEGMENTS, stream->body + 5, stream->body_size - 5, 1000,
                                     &request, NULL) != UMB_OK) {
        return; /* an empty reply */
    }
    for (uint32_t i = 0; i < request.count && i < 16; i++) {
        lit[i] = counts[i] = i;
        for (uint32_t k = 0; k < i && k < request.max_stretches; k++, told++) {
            stretches[told][0] = k;
            stretches[told][1] = k + 0.5;
        }
    }
    const struct umbw_question_reply reply = {
        .question = UMBW_SEGMENTS,
        .asset_id = {0xab},
        .has_stats = request.want_stats,
        .nodes = 7,
        .count = request.count - (strcmp(request.asset, "few") == 0),
        .fields = {(const void *)lit, (const void *)lit, (const void *)counts,
                   (const void *)stretches},
        .stretch_count = told - (strcmp(request.asset, "lies") == 0)};
    if (umbw_encode_question_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

static void fake_respond(struct fake_connection *connection, struct fake_stream *stream)
{
    struct umbw_query_request request;
    int64_t nanoseconds;
    if (stream->body_size < UMBW_PREFIX_BYTES ||
        umbw_timeout_parse(stream->timeout, strlen(stream->timeout), &nanoseconds) != UMB_OK) {
        fake_trailers_only(connection, stream->id, "13", "no prefix or no timeout");
    } else if (strcmp(stream->path, UMBW_PATH_QUERY) == 0) {
        if (umbw_decode_query_request(stream->body + 5, stream->body_size - 5, SIZE_MAX, &request,
                                      NULL) == UMB_OK) {
            fake_query(connection, stream, &request);
        } else {
            fake_trailers_only(connection, stream->id, "3", "cannot decode");
        }
    } else {
        if (strcmp(stream->path, UMBW_PATH_LIST) == 0) {
            fake_list(stream);
        } else if (strcmp(stream->path, UMBW_PATH_DESCRIBE) == 0) {
            fake_describe(stream);
        } else if (strncmp(stream->path, "/umbrage.v1.Questions/", 22) == 0) {
            fake_segments(stream);
        } else {
            fake_health(stream);
        }
        fake_send_reply(connection, stream, "200", "application/grpc");
    }
}

/* Answers the requests of a QueryStream that are there. "silent" and what follows get no answer,
 * "not-found" ends the stream, "away" ends it as a server that shuts down, "drop" the connection.
 */
static void fake_stream_respond(struct fake_connection *connection, struct fake_stream *stream)
{
    struct umbw_query_request request;
    while (stream->end == NULL && !connection->hang_up && stream->body_size - stream->taken >= 5) {
        const uint8_t *at = stream->body + stream->taken;
        size_t size = (size_t)at[3] << 8 | (size_t)at[4] | (size_t)at[2] << 16;
        if (stream->body_size - stream->taken - 5 < size) {
            break;
        }
        if (umbw_decode_query_request(at + 5, size, SIZE_MAX, &request, NULL) != UMB_OK) {
            abort();
        }
        atomic_fetch_add(&connection->server->streamed, 1);
        if (strcmp(request.asset, "silent") == 0) {
            return;
        }
        stream->taken += 5 + size;
        if (strcmp(request.asset, "drop") == 0) {
            connection->hang_up = true;
        } else if (strcmp(request.asset, "not-found") == 0) {
            stream->end = "5";
        } else if (strcmp(request.asset, "away") == 0) {
            stream->end = "14";
        } else {
            fake_answer(stream, &request, request.points.count);
        }
    }
    if (!stream->answering) {
        stream->answering = true;
        fake_send_reply(connection, stream, "200", "application/grpc");
    } else {
        (void)nghttp2_session_resume_data(connection->session, stream->id);
    }
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
        if (poll(&entry, 1, 20) <= 0) {
            continue;
        }
        ssize_t count = recv(connection->socket, block, 65536, 0);
        /* Who said goodbye only reads on until the other side hangs up. */
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
