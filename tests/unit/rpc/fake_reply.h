/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FAKE_REPLY_H
#define UMBRAGE_TESTS_FAKE_REPLY_H
/* State that the server of fake_server.h keeps for its connections and streams, and the parts of
 * its replies: headers, data, trailers. */
#include <nghttp2/nghttp2.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "wire/messages.h"

#define FAKE_CONNECTIONS 16

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

/* Sends a status with retry pushback: how long the client should wait. */
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

#endif
