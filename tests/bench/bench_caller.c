/* SPDX-License-Identifier: Apache-2.0 */
/* The client of the service races: nghttp2 over non-blocking sockets and poll. */
#include "bench_caller.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <nghttp2/nghttp2.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "bench_report.h"
#include "wire/messages.h"

#define WINDOW      (64 * 1024 * 1024)
#define FRAME       (1024 * 1024)
#define READ_BYTES  (256 * 1024)
#define RAW_HEAD    8  /* length, id */
#define CHECKED     16 /* replies looked at as a whole, on each connection */
#define PATIENCE_MS 60000

struct reply {
    uint8_t *bytes;
    size_t size, capacity;
};

struct link {
    const struct caller_job *job;
    int socket;
    nghttp2_session *session;
    size_t to_begin, under_way, done;
    struct reply in; /* raw frames, or the bytes of the stream */
    size_t checked;
    uint8_t *out; /* what the socket did not take */
    size_t out_at, out_size, out_capacity;
    int32_t stream_id;
    size_t body_at;  /* within the prefixed message under way on the stream */
    size_t to_write; /* messages of the stream not written yet */
};

/* A unary call. */
struct call {
    struct link *link;
    size_t body_at;
    struct reply in;
    int ok;
};

static uint8_t prefix[UMBW_PREFIX_BYTES]; /* of the request */

static void append(struct reply *reply, const uint8_t *bytes, size_t size)
{
    if (reply->size + size > reply->capacity) {
        reply->capacity = 2 * (reply->size + size);
        reply->bytes = realloc(reply->bytes, reply->capacity);
        if (reply->bytes == NULL) {
            bench_fail("no memory");
        }
    }
    memcpy(reply->bytes + reply->size, bytes, size);
    reply->size += size;
}

static void check_message(struct link *link, const uint8_t *message, size_t size)
{
    const struct caller_job *job = link->job;
    struct umbw_query_reply reply;
    struct umb_error error;
    if (size < job->value_bytes) {
        bench_fail("a reply of %zu bytes for %zu answers", size, job->value_bytes);
    }
    if (link->checked++ >= CHECKED) {
        return;
    }
    bench_must(umbw_decode_query_reply(message, size, &reply, &error), &error, "reply");
    if (reply.visibility_bytes != job->value_bytes ||
        memcmp(reply.visibility, job->values, job->value_bytes) != 0) {
        bench_fail("a reply with other answers");
    }
}

static uint32_t big_endian(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

/* Removes complete messages from the front of the received bytes. In: head: bytes before a message,
 * which hold its length at `at`. */
static void take_messages(struct link *link, size_t head, size_t at)
{
    size_t used = 0;
    while (link->in.size - used >= head) {
        const uint8_t *from = link->in.bytes + used;
        size_t size = big_endian(from + at);
        if (link->in.size - used < head + size) {
            break;
        }
        check_message(link, from + head, size);
        used += head + size;
        link->done++;
        link->under_way--;
    }
    memmove(link->in.bytes, link->in.bytes + used, link->in.size - used);
    link->in.size -= used;
}

static size_t copy_request(const struct link *link, size_t at, uint8_t *to, size_t room)
{
    size_t copied = 0;
    if (at < sizeof prefix) {
        copied = sizeof prefix - at < room ? sizeof prefix - at : room;
        memcpy(to, prefix + at, copied);
        at += copied;
    }
    if (at >= sizeof prefix && copied < room) {
        size_t rest = link->job->message_size - (at - sizeof prefix);
        rest = rest < room - copied ? rest : room - copied;
        memcpy(to + copied, link->job->message + (at - sizeof prefix), rest);
        copied += rest;
    }
    return copied;
}

static ssize_t read_call(nghttp2_session *session, int32_t stream_id, uint8_t *to, size_t room,
                         uint32_t *flags, nghttp2_data_source *source, void *user)
{
    struct call *call = source->ptr;
    (void)session;
    (void)stream_id;
    (void)user;
    size_t copied = copy_request(call->link, call->body_at, to, room);
    call->body_at += copied;
    if (call->body_at == sizeof prefix + call->link->job->message_size) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
    }
    return (ssize_t)copied;
}

static ssize_t read_stream(nghttp2_session *session, int32_t stream_id, uint8_t *to, size_t room,
                           uint32_t *flags, nghttp2_data_source *source, void *user)
{
    struct link *link = source->ptr;
    size_t whole = sizeof prefix + link->job->message_size;
    size_t copied = 0;
    (void)session;
    (void)stream_id;
    (void)user;
    while (link->to_write > 0 && copied < room) {
        size_t part = copy_request(link, link->body_at, to + copied, room - copied);
        copied += part;
        link->body_at += part;
        if (link->body_at == whole) {
            link->body_at = 0;
            link->to_write--;
        }
    }
    if (link->to_begin == 0 && link->to_write == 0) {
        *flags |= NGHTTP2_DATA_FLAG_EOF;
    } else if (copied == 0) {
        return NGHTTP2_ERR_DEFERRED;
    }
    return (ssize_t)copied;
}

static nghttp2_nv field(const char *name, const char *value)
{
    return (nghttp2_nv){(uint8_t *)(uintptr_t)name, (uint8_t *)(uintptr_t)value, strlen(name),
                        strlen(value), NGHTTP2_NV_FLAG_NONE};
}

static int32_t begin_call(struct link *link, const char *path, nghttp2_data_provider *provider,
                          void *user)
{
    nghttp2_nv fields[] = {
        field(":method", "POST"),     field(":scheme", "http"),
        field(":path", path),         field(":authority", "127.0.0.1"),
        field("te", "trailers"),      field("content-type", "application/grpc"),
        field("user-agent", "bench"),
    };
    int32_t id = nghttp2_submit_request(link->session, NULL, fields,
                                        sizeof fields / sizeof fields[0], provider, user);
    if (id < 0) {
        bench_fail("request: %s", nghttp2_strerror(id));
    }
    return id;
}

/* Begins what may be begun. */
static void begin_more(struct link *link)
{
    while (link->to_begin > 0 && link->under_way < CALLER_UNDER_WAY) {
        link->to_begin--;
        link->under_way++;
        link->to_write++;
        if (link->job->protocol == CALLER_UNARY) {
            struct call *call = calloc(1, sizeof *call);
            if (call == NULL) {
                bench_fail("no memory");
            }
            call->link = link;
            nghttp2_data_provider provider = {.source.ptr = call, .read_callback = read_call};
            (void)begin_call(link, UMBW_PATH_QUERY, &provider, call);
        }
    }
    if (link->job->protocol == CALLER_STREAM) {
        nghttp2_data_provider provider = {.source.ptr = link, .read_callback = read_stream};
        if (link->stream_id == 0) {
            link->stream_id = begin_call(link, UMBW_PATH_STREAM, &provider, NULL);
        } else {
            (void)nghttp2_session_resume_data(link->session, link->stream_id);
        }
    }
}

static int on_header(nghttp2_session *session, const nghttp2_frame *frame, const uint8_t *name,
                     size_t name_size, const uint8_t *value, size_t value_size, uint8_t flags,
                     void *user)
{
    struct call *call = nghttp2_session_get_stream_user_data(session, frame->hd.stream_id);
    (void)flags;
    (void)user;
    if (name_size == 11 && memcmp(name, "grpc-status", 11) == 0) {
        if (value_size != 1 || value[0] != '0') {
            bench_fail("a call failed with status %.*s", (int)value_size, (const char *)value);
        }
        if (call != NULL) {
            call->ok = 1;
        }
    }
    return 0;
}

static int on_data(nghttp2_session *session, uint8_t flags, int32_t stream_id, const uint8_t *data,
                   size_t size, void *user)
{
    struct link *link = user;
    struct call *call = nghttp2_session_get_stream_user_data(session, stream_id);
    (void)flags;
    append(call != NULL ? &call->in : &link->in, data, size);
    if (call == NULL) {
        take_messages(link, UMBW_PREFIX_BYTES, 1);
        begin_more(link);
    }
    return 0;
}

static int on_close(nghttp2_session *session, int32_t stream_id, uint32_t code, void *user)
{
    struct link *link = user;
    struct call *call = nghttp2_session_get_stream_user_data(session, stream_id);
    if (call == NULL) {
        return 0;
    }
    if (code != 0 || !call->ok || call->in.size < UMBW_PREFIX_BYTES) {
        bench_fail("a call ended with %s", nghttp2_http2_strerror(code));
    }
    check_message(link, call->in.bytes + UMBW_PREFIX_BYTES, call->in.size - UMBW_PREFIX_BYTES);
    free(call->in.bytes);
    free(call);
    link->done++;
    link->under_way--;
    begin_more(link);
    return 0;
}

static ssize_t frame_length(nghttp2_session *session, uint8_t type, int32_t stream_id,
                            int32_t session_window, int32_t stream_window, uint32_t max_frame,
                            void *user)
{
    int64_t length = FRAME;
    (void)session;
    (void)type;
    (void)stream_id;
    (void)user;
    length = length < session_window ? length : session_window;
    length = length < stream_window ? length : stream_window;
    return (ssize_t)(length < (int64_t)max_frame ? length : (int64_t)max_frame);
}

static void open_session(struct link *link)
{
    nghttp2_session_callbacks *callbacks;
    const nghttp2_settings_entry settings[] = {
        {NGHTTP2_SETTINGS_INITIAL_WINDOW_SIZE, WINDOW},
        {NGHTTP2_SETTINGS_MAX_FRAME_SIZE, FRAME},
        {NGHTTP2_SETTINGS_ENABLE_PUSH, 0},
    };
    if (nghttp2_session_callbacks_new(&callbacks) != 0) {
        bench_fail("no memory");
    }
    nghttp2_session_callbacks_set_on_header_callback(callbacks, on_header);
    nghttp2_session_callbacks_set_on_data_chunk_recv_callback(callbacks, on_data);
    nghttp2_session_callbacks_set_on_stream_close_callback(callbacks, on_close);
    nghttp2_session_callbacks_set_data_source_read_length_callback(callbacks, frame_length);
    if (nghttp2_session_client_new(&link->session, callbacks, link) != 0 ||
        nghttp2_submit_settings(link->session, 0, settings, 3) != 0 ||
        nghttp2_session_set_local_window_size(link->session, 0, 0, WINDOW) != 0) {
        bench_fail("no memory");
    }
    nghttp2_session_callbacks_del(callbacks);
}

static void open_link(struct link *link, const struct caller_job *job)
{
    struct sockaddr_in address = {.sin_family = AF_INET,
                                  .sin_port = htons(job->port),
                                  .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int one = 1;
    link->job = job;
    link->to_begin = job->calls / CALLER_CONNECTIONS;
    link->socket = socket(AF_INET, SOCK_STREAM, 0);
    if (link->socket < 0 ||
        connect(link->socket, (struct sockaddr *)&address, sizeof address) != 0 ||
        fcntl(link->socket, F_SETFL, O_NONBLOCK) != 0) {
        bench_fail("cannot connect to port %u", (unsigned)job->port);
    }
    (void)setsockopt(link->socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    if (job->protocol != CALLER_RAW) {
        open_session(link);
    }
}

/* Appends bytes to those that wait to be sent. */
static void queue_out(struct link *link, const uint8_t *bytes, size_t size)
{
    if (link->out_size + size > link->out_capacity) {
        link->out_capacity = 2 * (link->out_size + size);
        link->out = realloc(link->out, link->out_capacity);
        if (link->out == NULL) {
            bench_fail("no memory");
        }
    }
    memcpy(link->out + link->out_size, bytes, size);
    link->out_size += size;
}

static void make_output(struct link *link)
{
    if (link->job->protocol == CALLER_RAW) {
        begin_more(link);
        for (; link->to_write > 0; link->to_write--) {
            uint8_t head[RAW_HEAD] = {0};
            memcpy(head, prefix + 1, 4);
            queue_out(link, head, sizeof head);
            queue_out(link, link->job->message, link->job->message_size);
        }
        return;
    }
    const uint8_t *bytes;
    ssize_t size;
    while (link->out_size < FRAME && (size = nghttp2_session_mem_send(link->session, &bytes)) > 0) {
        queue_out(link, bytes, (size_t)size);
    }
}

static void send_output(struct link *link)
{
    for (;;) {
        if (link->out_at == link->out_size) {
            link->out_at = link->out_size = 0;
            make_output(link);
            if (link->out_size == 0) {
                return;
            }
        }
        ssize_t sent = write(link->socket, link->out + link->out_at, link->out_size - link->out_at);
        if (sent < 0) {
            if (errno == EAGAIN) {
                return;
            }
            bench_fail("the server closed the connection");
        }
        link->out_at += (size_t)sent;
    }
}

static void receive(struct link *link, uint8_t *buffer)
{
    ssize_t size = read(link->socket, buffer, READ_BYTES);
    if (size <= 0) {
        if (size < 0 && errno == EAGAIN) {
            return;
        }
        bench_fail("the server closed the connection");
    }
    if (link->job->protocol == CALLER_RAW) {
        append(&link->in, buffer, (size_t)size);
        take_messages(link, RAW_HEAD, 0);
    } else if (nghttp2_session_mem_recv(link->session, buffer, (size_t)size) < 0) {
        bench_fail("the server breaks HTTP/2");
    }
}

static void close_link(struct link *link)
{
    nghttp2_session_del(link->session);
    (void)close(link->socket);
    free(link->in.bytes);
    free(link->out);
}

void caller_run(const struct caller_job *job)
{
    struct link links[CALLER_CONNECTIONS] = {0};
    struct pollfd polls[CALLER_CONNECTIONS] = {0};
    uint8_t *buffer = malloc(READ_BYTES);
    size_t done = 0;
    const size_t wanted = job->calls / CALLER_CONNECTIONS * CALLER_CONNECTIONS;
    if (buffer == NULL) {
        bench_fail("no memory");
    }
    for (size_t i = 0; i < 4; i++) {
        prefix[1 + i] = (uint8_t)(job->message_size >> (24 - 8 * i));
    }
    for (size_t i = 0; i < CALLER_CONNECTIONS; i++) {
        open_link(&links[i], job);
        begin_more(&links[i]);
        send_output(&links[i]);
    }
    while (done < wanted) {
        for (size_t i = 0; i < CALLER_CONNECTIONS; i++) {
            polls[i].fd = links[i].socket;
            polls[i].events = (short)(POLLIN | (links[i].out_at < links[i].out_size ? POLLOUT : 0));
        }
        if (poll(polls, CALLER_CONNECTIONS, PATIENCE_MS) <= 0) {
            bench_fail("no reply for a minute");
        }
        done = 0;
        for (size_t i = 0; i < CALLER_CONNECTIONS; i++) {
            if ((polls[i].revents & (POLLIN | POLLHUP | POLLERR)) != 0) {
                receive(&links[i], buffer);
            }
            if (polls[i].revents != 0) {
                send_output(&links[i]);
            }
            done += links[i].done;
        }
    }
    for (size_t i = 0; i < CALLER_CONNECTIONS; i++) {
        close_link(&links[i]);
    }
    free(buffer);
}
