/* SPDX-License-Identifier: Apache-2.0 */
/*
 * HTTP/1.1 of a connection. Received bytes wait in a buffer until a head is complete. One request
 * is answered at a time, and the next one (pipelining) waits in the buffer. When the buffer has
 * more than one head's bytes, the connection is not read from; so the buffer is bounded by a head
 * and by what one read can bring.
 *
 * A request that is refused ends the connection, because its body or its end is unknown. The daemon
 * then reads and discards for a second before it closes, because a close with unread bytes would
 * reset the connection, and the client could lose the refusal.
 */
#include <stdlib.h>
#include <string.h>

#include "daemon/transport/conn.h"
#include "daemon/transport/conn_tls.h"
#include "net/http1_request.h"

#define READ_BYTES    8192  /* read at once */
#define RECORD_BYTES  16384 /* a TLS record, which may be complete with the next byte */
#define BUFFER_BYTES  (UMBN_HTTP1_HEAD_BYTES + READ_BYTES + RECORD_BYTES)
#define BUFFER_STEP   4096
#define HEAD_MS       10000 /* time limit of a head, from its first byte */
#define LINGER_MS     1000
#define ERROR_NO_ROOM 1 /* of feed: more bytes than the buffer can have; never happens */

struct umbd_conn_http1 {
    uint8_t *bytes; /* [capacity]; received bytes that are no request yet: [size] at from */
    size_t from, size, capacity;
    size_t searched;        /* Bytes without the end of a head */
    uint64_t head_ms;       /* Time when the first of the bytes came; uv_now */
    int32_t number;         /* Number of the last request */
    int blank;              /* 1: an empty line came before the next request */
    int over;               /* 1: no further request is read */
    uint64_t linger_ms;     /* End of the time in which input is discarded; 0 = none */
    const char *last_words; /* Reply that ends the connection; NULL: none */
    size_t said;            /* Bytes of it that were sent */
};

static const char busy[] = "HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n"
                           "Retry-After: 1\r\nConnection: close\r\n\r\n";
static const char late[] = "HTTP/1.1 408 Request Timeout\r\nContent-Length: 0\r\n"
                           "Connection: close\r\n\r\n";

static enum umb_status start(struct umbd_conn *conn)
{
    conn->http1 = calloc(1, sizeof *conn->http1);
    return conn->http1 != NULL ? UMB_OK : UMB_E_NO_MEMORY;
}

static void drop_input(struct umbd_conn *conn)
{
    struct umbd_conn_http1 *http = conn->http1;
    umbd_conn_uncharge(conn, http->capacity);
    free(http->bytes);
    http->bytes = NULL;
    http->from = http->size = http->capacity = http->searched = 0;
}

static void stop(struct umbd_conn *conn)
{
    if (conn->http1 != NULL) {
        drop_input(conn);
        free(conn->http1);
        conn->http1 = NULL;
    }
}

/* Reads no further request; the connection closes when everything is sent. */
static void end_input(struct umbd_conn *conn)
{
    conn->http1->over = 1;
    drop_input(conn);
}

static void end_with(struct umbd_conn *conn, const char *last_words)
{
    conn->http1->last_words = last_words;
    conn->http1->said = 0;
    end_input(conn);
}

static size_t room(struct umbd_conn *conn, uint8_t **place)
{
    *place = conn->loop->read_buffer;
    return READ_BYTES;
}

static int has_room(const struct umbd_conn *conn)
{
    return conn->http1->size < UMBN_HTTP1_HEAD_BYTES;
}

/* Makes room for `count` more bytes. Returns 0 if a budget or memory is exhausted. */
static int grow(struct umbd_conn *conn, size_t count)
{
    struct umbd_conn_http1 *http = conn->http1;
    uint64_t limit;
    const char *option;
    const size_t needed = (http->size + count + BUFFER_STEP - 1) / BUFFER_STEP * BUFFER_STEP;
    if (http->from > 0) {
        memmove(http->bytes, http->bytes + http->from, http->size);
        http->from = 0;
    }
    if (needed <= http->capacity) {
        return 1;
    }
    if (!umbd_conn_charge(conn, needed - http->capacity, &limit, &option)) {
        umbd_count(&conn->server->metrics.shed, 1);
        return 0;
    }
    uint8_t *bytes = realloc(http->bytes, needed);
    if (bytes == NULL) {
        umbd_conn_uncharge(conn, needed - http->capacity);
        return 0;
    }
    http->bytes = bytes;
    http->capacity = needed;
    return 1;
}

/* Removes bytes from the begin of the buffer. */
static void consume(struct umbd_conn *conn, size_t count)
{
    struct umbd_conn_http1 *http = conn->http1;
    http->from += count;
    http->size -= count;
    http->searched = 0;
    http->head_ms = uv_now(&conn->loop->uv);
    if (http->size == 0) {
        drop_input(conn);
    }
}

/* Opens the call of a request, or of a refused head. */
static void open_call(struct umbd_conn *conn, struct umbn_http1_request *request)
{
    struct umbd_conn_http1 *http = conn->http1;
    conn->is_greeted = 1;
    conn->last_request = conn->leaving || !request->keeps_open;
    if (request->refusal != 0) {
        http->linger_ms = uv_now(&conn->loop->uv) + LINGER_MS;
        umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_REQUEST], 1);
    }
    http->number = http->number < INT32_MAX ? http->number + 1 : 1;
    if (conn->server->calls->web_request(conn, http->number, request) == NULL) {
        end_with(conn, busy);
    } else if (conn->last_request) {
        end_input(conn);
    }
}

/* Begins the next request of the buffer, unless one is under way. Returns 1 if it did. */
static int begin_next(struct umbd_conn *conn)
{
    struct umbd_conn_http1 *http = conn->http1;
    struct umbn_http1_request request;
    if (http->over || conn->terminated || !LIST_EMPTY(&conn->calls) || http->size == 0) {
        return 0;
    }
    const uint8_t *bytes = http->bytes + http->from;
    if (!http->blank && bytes[0] == '\r' && (http->size == 1 || bytes[1] == '\n')) {
        http->blank = http->size > 1; /* RFC 9112 section 2.2: an empty line before a request */
        if (http->blank) {
            consume(conn, 2);
        }
        return http->blank;
    }
    const size_t size = umbn_http1_head_size(bytes, http->size, http->searched);
    http->searched = http->size;
    if (size > 0) {
        http->blank = 0;
        umbn_http1_parse(bytes, size, &request);
        open_call(conn, &request);
        if (!http->over && !conn->terminated) {
            consume(conn, size);
        }
        return 1;
    }
    const int refusal = umbn_http1_refuses_early(bytes, http->size);
    if (refusal == 0) {
        return 0;
    }
    memset(&request, 0, sizeof request);
    umbn_http1_refuse(&request, refusal);
    open_call(conn, &request);
    return 1;
}

static int feed(void *user, const uint8_t *bytes, size_t count)
{
    struct umbd_conn *conn = user;
    struct umbd_conn_http1 *http = conn->http1;
    if (http->over || conn->terminated) {
        return 0; /* discarded */
    }
    if (count > BUFFER_BYTES - http->size) {
        return ERROR_NO_ROOM;
    }
    if (!grow(conn, count)) {
        end_with(conn, busy);
        return 0;
    }
    if (http->size == 0) {
        http->head_ms = uv_now(&conn->loop->uv);
    }
    memcpy(http->bytes + http->from + http->size, bytes, count);
    http->size += count;
    (void)begin_next(conn);
    return 0;
}

/* Returns how many of `size` bytes the loop's output has room for. */
static size_t room_for(const struct umbd_loop *loop, size_t size)
{
    const size_t left = UMBD_OUT_SOFT - loop->out_size;
    return size < left ? size : left;
}

/* Ends the call whose reply is sent. */
static void end_call(struct umbd_conn *conn, struct umbd_call *call)
{
    conn->server->calls->close(call);
    conn->http1->head_ms = uv_now(&conn->loop->uv);
    if (conn->last_request || conn->leaving) {
        end_input(conn);
    } else if (conn->paused) {
        umbd_loop_flush_later(conn); /* and reads again */
    }
}

static void collect_last_words(struct umbd_conn *conn)
{
    struct umbd_conn_http1 *http = conn->http1;
    struct umbd_loop *loop = conn->loop;
    const size_t count = room_for(loop, strlen(http->last_words) - http->said);
    memcpy(loop->out + loop->out_size, http->last_words + http->said, count);
    loop->out_size += count;
    http->said += count;
    if (http->last_words[http->said] == '\0') {
        http->last_words = NULL;
    }
}

static int collect(struct umbd_conn *conn)
{
    const struct umbd_call_events *calls = conn->server->calls;
    struct umbd_loop *loop = conn->loop;
    while (loop->out_size < UMBD_OUT_SOFT) {
        struct umbd_call *call = LIST_FIRST(&conn->calls);
        const size_t count = call != NULL ? room_for(loop, calls->web_unsent(call)) : 0;
        if (count > 0) {
            calls->take_body(call, loop->out + loop->out_size, count);
            loop->out_size += count;
        } else if (call != NULL && calls->web_is_over(call)) {
            end_call(conn, call);
        } else if (call == NULL && conn->http1->last_words != NULL) {
            collect_last_words(conn);
        } else if (!begin_next(conn)) {
            break;
        }
    }
    return 0;
}

static const char *error_text(int code)
{
    (void)code;
    return "more bytes than the connection has room for";
}

static int is_over(const struct umbd_conn *conn)
{
    const struct umbd_conn_http1 *http = conn->http1;
    return (http->over || conn->terminated) && LIST_EMPTY(&conn->calls) &&
           http->last_words == NULL && http->linger_ms == 0;
}

static int is_late(struct umbd_conn *conn, uint64_t now_ms)
{
    struct umbd_conn_http1 *http = conn->http1;
    const uint64_t first_ms = conn->server->options.handshake_timeout_ms;
    if (http->linger_ms != 0 && now_ms >= http->linger_ms) {
        http->linger_ms = 0;
    }
    if (http->over || conn->terminated || !LIST_EMPTY(&conn->calls)) {
        return 0;
    }
    if (http->size > 0 && (now_ms - http->head_ms > HEAD_MS ||
                           (!conn->is_greeted && now_ms - conn->opened_ms > first_ms))) {
        end_with(conn, late);
        return 1;
    }
    /* Browsers open connections ahead of need: one without a request is no abuse. */
    if (!conn->is_greeted && now_ms - conn->opened_ms > first_ms &&
        (conn->tls == NULL || umbn_tls_ready(conn->tls->session))) {
        conn->is_greeted = 1;
        end_input(conn);
    }
    return 0;
}

static void terminate(struct umbd_conn *conn, uint32_t code)
{
    (void)code;
    conn->http1->last_words = NULL;
    conn->http1->linger_ms = 0;
    drop_input(conn);
}

/* Replies say it from now on. */
static void notice(struct umbd_conn *conn)
{
    (void)conn;
}

static void last_call(struct umbd_conn *conn)
{
    if (conn->working == 0) {
        umbd_conn_close(conn, "no request with rights is under way");
    }
}

static struct umbd_call *find(struct umbd_conn *conn, int32_t number)
{
    return conn->server->calls->web_find(conn, number);
}

const struct umbd_protocol umbd_protocol_http1 = {
    .start = start,
    .stop = stop,
    .room = room,
    .has_room = has_room,
    .feed = feed,
    .collect = collect,
    .error_text = error_text,
    .is_over = is_over,
    .is_late = is_late,
    .terminate = terminate,
    .notice = notice,
    .last_call = last_call,
    .find = find,
};
