/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The HTTP/2 session of a connection: settings, limits, and nghttp2's callbacks, which turn frames
 * into events for the calls (server.h).
 *
 * Limits set here, with reasons (measured on nghttp2 1.52):
 * - Header blocks: 32 KiB, because one block of 1 MiB of references costs 1.5 s of CPU time.
 * - Header table: 4096 bytes. HAProxy 2.6 does not announce when it makes its own table smaller;
 *   nghttp2 answers that with COMPRESSION_ERROR.
 * - Streams: 256. Frames: 1 MiB, so that a batch of points is one frame.
 * - Windows: 64 MiB a connection and 16 MiB a stream, opened again by our code as bytes are taken.
 *
 * h2_guard.h counts what nghttp2 does not: decoded header bytes, cheap frames, and streams that the
 * peer makes us reset.
 *
 * Callbacks only queue frames; sending, receiving and closing happen outside of them.
 */
#include "daemon/transport/conn.h"

#include <string.h>

#define WINDOW_BYTES         (64 * 1024 * 1024) /* window of the connection */
#define STREAM_WINDOW_BYTES  (16 * 1024 * 1024)
#define FRAME_BYTES          (1024 * 1024)
#define HEADER_FRAME_BYTES   32768 /* encoded; decoded lists have UMBD_HEADER_BYTES_MAX at most */
#define RESET_BURST          1000  /* resets by the peer; a cancelled call is cheap here */
#define RESET_RATE           200
#define CONTINUATIONS_MAX    8
#define IN_PLACE_BYTES       (64 << 10) /* pieces of at least this size are read in place */
#define SMALL_BYTES          (8 << 10)  /* read from a connection whose turn was too long */
#define SETTINGS_ENTRIES_MAX 32

/*
 * Weak declarations of two functions of nghttp2 1.57 and 1.61; a missing one is NULL. Debian's 1.52
 * has both as a security patch, and other builds of 1.52 do not. So the linker decides, not the
 * version number.
 */
extern void nghttp2_option_set_stream_reset_rate_limit(nghttp2_option *option, uint64_t burst,
                                                       uint64_t rate)
    __attribute__((weak, visibility("default")));
extern void nghttp2_option_set_max_continuations(nghttp2_option *option, size_t value)
    __attribute__((weak, visibility("default")));

static struct umbd_call *find_call(nghttp2_session *session, int32_t stream_id)
{
    return nghttp2_session_get_stream_user_data(session, stream_id);
}

/* Returns true for frames that cost the peer nothing: all but requests and DATA frames with
 * content. */
static int is_control(const nghttp2_frame_hd *frame)
{
    switch (frame->type) {
    case NGHTTP2_HEADERS:
    case NGHTTP2_CONTINUATION:
        return 0;
    case NGHTTP2_DATA:
        return frame->length < UMBD_TINY_DATA && (frame->flags & NGHTTP2_FLAG_END_STREAM) == 0;
    default:
        return 1;
    }
}

static int on_begin_frame(nghttp2_session *session, const nghttp2_frame_hd *frame, void *user)
{
    struct umbd_conn *conn = user;
    if (!conn->terminated && is_control(frame) &&
        !umbd_bucket_take(&conn->control, umbd_loop_coarse_ns(conn->loop))) {
        umbd_conn_abuse(conn, UMBD_ABUSE_CONTROL, "too many control frames");
    }
    if (frame->type == NGHTTP2_DATA && frame->length >= UMBD_LONG_DATA) {
        umbd_bucket_credit(&conn->control, UMBD_LONG_CREDIT);
    }
    if (frame->length > HEADER_FRAME_BYTES &&
        (frame->type == NGHTTP2_HEADERS || frame->type == NGHTTP2_CONTINUATION)) {
        umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_HEADERS], 1);
        return NGHTTP2_ERR_CALLBACK_FAILURE; /* before a byte of it is decoded */
    }
    /* Limits the queued frames. Otherwise answers that a peer causes and does not read would pile
     * up in nghttp2. */
    if (!conn->terminated &&
        nghttp2_session_get_outbound_queue_size(session) > UMBD_QUEUED_FRAMES) {
        umbd_conn_abuse(conn, UMBD_ABUSE_QUEUE, "too many frames wait to be taken");
    }
    return 0;
}

static int on_begin_headers(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct umbd_conn *conn = user;
    if (frame->hd.type != NGHTTP2_HEADERS || frame->headers.cat != NGHTTP2_HCAT_REQUEST) {
        return 0;
    }
    const int was_reset = umbd_h2_filter_was_reset(&conn->filter, (uint32_t)frame->hd.stream_id);
    struct umbd_call *call = conn->server->calls->open(conn, frame->hd.stream_id, was_reset);
    if (call == NULL) {
        /* REFUSED_STREAM tells the client that no work was begun, so it may try again. nghttp2's
         * own reset would not say so. */
        nghttp2_submit_rst_stream(session, NGHTTP2_FLAG_NONE, frame->hd.stream_id,
                                  NGHTTP2_REFUSED_STREAM);
        return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
    }
    if (nghttp2_session_set_stream_user_data(session, frame->hd.stream_id, call) != 0) {
        conn->server->calls->close(call);
        return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
    }
    return 0;
}

static int on_header(nghttp2_session *session, const nghttp2_frame *frame, const uint8_t *name,
                     size_t name_size, const uint8_t *value, size_t value_size, uint8_t flags,
                     void *user)
{
    struct umbd_conn *conn = user;
    struct umbd_call *call = find_call(session, frame->hd.stream_id);
    (void)flags;
    if (call == NULL || conn->server->calls->header(call, name, name_size, value, value_size)) {
        return 0;
    }
    nghttp2_submit_rst_stream(session, NGHTTP2_FLAG_NONE, frame->hd.stream_id,
                              NGHTTP2_ENHANCE_YOUR_CALM);
    umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_HEADERS], 1);
    if (++conn->header_strikes >= UMBD_HEADER_STRIKES && !conn->terminated) {
        umbd_conn_abuse(conn, UMBD_ABUSE_HEADERS, "header lists over the limit");
    }
    return NGHTTP2_ERR_TEMPORAL_CALLBACK_FAILURE;
}

static int on_data(nghttp2_session *session, uint8_t flags, int32_t stream_id, const uint8_t *data,
                   size_t size, void *user)
{
    struct umbd_conn *conn = user;
    struct umbd_call *call = find_call(session, stream_id);
    (void)flags;
    if (call == NULL || conn->terminated) {
        nghttp2_session_consume_connection(session, size);
        return 0;
    }
    /* The kept bytes are counted and within the budget, so the windows may open again. */
    size_t taken = conn->server->calls->data(call, data, size);
    return nghttp2_session_consume_connection(session, size) == NGHTTP2_ERR_NOMEM ||
                   (taken > 0 &&
                    nghttp2_session_consume_stream(session, stream_id, taken) == NGHTTP2_ERR_NOMEM)
               ? NGHTTP2_ERR_CALLBACK_FAILURE
               : 0;
}

static int on_frame(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct umbd_conn *conn = user;
    if (frame->hd.type == NGHTTP2_SETTINGS && (frame->hd.flags & NGHTTP2_FLAG_ACK) == 0) {
        conn->is_greeted = 1;
    }
    if (frame->hd.type != NGHTTP2_HEADERS && frame->hd.type != NGHTTP2_DATA) {
        return 0;
    }
    struct umbd_call *call = find_call(session, frame->hd.stream_id);
    if (call == NULL) {
        return 0;
    }
    if (!conn->server->calls->headers_end(call)) {
        nghttp2_submit_rst_stream(session, NGHTTP2_FLAG_NONE, frame->hd.stream_id, NGHTTP2_CANCEL);
    } else if ((frame->hd.flags & NGHTTP2_FLAG_END_STREAM) != 0) {
        conn->server->calls->request_end(call);
    }
    return 0;
}

/* Logs the reason in a GOAWAY frame by which nghttp2 ends the session itself, because the peer
 * broke the protocol. */
static void note_goaway(struct umbd_conn *conn, const nghttp2_goaway *frame)
{
    char reason[64];
    char quoted[UMBS_LOG_QUOTE_SIZE];
    size_t size =
        frame->opaque_data_len < sizeof reason ? frame->opaque_data_len : sizeof reason - 1;
    if (frame->error_code == NGHTTP2_NO_ERROR || conn->terminated) {
        return;
    }
    if (size > 0) {
        memcpy(reason, frame->opaque_data, size);
    }
    reason[size] = '\0';
    umbd_count(&conn->server->metrics.abuse[UMBD_ABUSE_LIBRARY], 1);
    if (umbd_loop_may_log(conn->loop)) {
        UMBD_CONN_LOG(conn, UMB_LOG_INFO, "h2_goaway", "code=%s reason=%s",
                      nghttp2_http2_strerror(frame->error_code), umbs_log_quote(reason, quoted));
    }
}

static int on_frame_sent(nghttp2_session *session, const nghttp2_frame *frame, void *user)
{
    struct umbd_conn *conn = user;
    (void)session;
    if (frame->hd.type == NGHTTP2_GOAWAY) {
        note_goaway(conn, &frame->goaway);
    }
    if (frame->hd.type == NGHTTP2_DATA) {
        umbd_bucket_credit(&conn->control, UMBD_CONTROL_CREDIT);
    } else if (frame->hd.type == NGHTTP2_RST_STREAM &&
               frame->rst_stream.error_code != NGHTTP2_NO_ERROR &&
               frame->rst_stream.error_code != NGHTTP2_CANCEL && !conn->terminated &&
               !umbd_bucket_take(&conn->resets, uv_hrtime())) {
        umbd_conn_abuse(conn, UMBD_ABUSE_RESET_SENT, "too many streams that had to be reset");
    }
    return 0;
}

static int on_stream_close(nghttp2_session *session, int32_t stream_id, uint32_t code, void *user)
{
    const struct umbd_conn *conn = user;
    struct umbd_call *call = find_call(session, stream_id);
    (void)code;
    if (call != NULL) {
        nghttp2_session_set_stream_user_data(session, stream_id, NULL);
        conn->server->calls->close(call);
    }
    return 0;
}

static ssize_t frame_length(nghttp2_session *session, uint8_t type, int32_t stream_id,
                            int32_t session_window, int32_t stream_window, uint32_t max_frame,
                            void *user)
{
    int64_t length = UMBD_SEND_FRAME;
    (void)session;
    (void)type;
    (void)stream_id;
    (void)user;
    length = length < session_window ? length : session_window;
    length = length < stream_window ? length : stream_window;
    length = length < (int64_t)max_frame ? length : (int64_t)max_frame;
    return (ssize_t)length;
}

/* Copies one DATA frame straight from the reply into the loop's output. No other copy is made. */
static int send_data(nghttp2_session *session, nghttp2_frame *frame, const uint8_t *head,
                     size_t length, nghttp2_data_source *source, void *user)
{
    struct umbd_conn *conn = user;
    struct umbd_loop *loop = conn->loop;
    struct umbd_call *call = source->ptr;
    (void)session;
    (void)frame; /* never padded: there is no select_padding callback */
    if (loop->out_size + 9 + length > UMBD_OUT_CAPACITY - UMBD_OUT_RESERVE) {
        return NGHTTP2_ERR_WOULDBLOCK;
    }
    memcpy(loop->out + loop->out_size, head, 9);
    conn->server->calls->take_body(call, loop->out + loop->out_size + 9, length);
    loop->out_size += 9 + length;
    return 0;
}

static nghttp2_session_callbacks *make_callbacks(void)
{
    nghttp2_session_callbacks *callbacks = NULL;
    if (nghttp2_session_callbacks_new(&callbacks) != 0) {
        return NULL;
    }
    nghttp2_session_callbacks_set_on_begin_frame_callback(callbacks, on_begin_frame);
    nghttp2_session_callbacks_set_on_begin_headers_callback(callbacks, on_begin_headers);
    nghttp2_session_callbacks_set_on_header_callback(callbacks, on_header);
    nghttp2_session_callbacks_set_on_data_chunk_recv_callback(callbacks, on_data);
    nghttp2_session_callbacks_set_on_frame_recv_callback(callbacks, on_frame);
    nghttp2_session_callbacks_set_on_frame_send_callback(callbacks, on_frame_sent);
    nghttp2_session_callbacks_set_on_stream_close_callback(callbacks, on_stream_close);
    nghttp2_session_callbacks_set_data_source_read_length_callback(callbacks, frame_length);
    nghttp2_session_callbacks_set_send_data_callback(callbacks, send_data);
    return callbacks;
}

static nghttp2_option *make_option(void)
{
    nghttp2_option *option = NULL;
    if (nghttp2_option_new(&option) != 0) {
        return NULL;
    }
    nghttp2_option_set_no_auto_window_update(option, 1);
    nghttp2_option_set_max_settings(option, SETTINGS_ENTRIES_MAX);
    /* Without this option nghttp2 keeps 256 closed streams (80 KiB) for priorities, which are
     * unused here. */
    nghttp2_option_set_no_closed_streams(option, 1);
    if (nghttp2_option_set_stream_reset_rate_limit) {
        nghttp2_option_set_stream_reset_rate_limit(option, RESET_BURST, RESET_RATE);
    }
    if (nghttp2_option_set_max_continuations) {
        nghttp2_option_set_max_continuations(option, CONTINUATIONS_MAX);
    }
    return option;
}

static int queue_settings(nghttp2_session *session)
{
    static const nghttp2_settings_entry settings[] = {
        {NGHTTP2_SETTINGS_MAX_CONCURRENT_STREAMS, UMBD_STREAMS_MAX},
        {NGHTTP2_SETTINGS_INITIAL_WINDOW_SIZE, STREAM_WINDOW_BYTES},
        {NGHTTP2_SETTINGS_MAX_FRAME_SIZE, FRAME_BYTES},
        {NGHTTP2_SETTINGS_MAX_HEADER_LIST_SIZE, UMBD_HEADER_BYTES_MAX},
    };
    int code = nghttp2_submit_settings(session, NGHTTP2_FLAG_NONE, settings,
                                       sizeof settings / sizeof settings[0]);
    /* The SETTINGS frame sets the window of streams only; the connection's window needs its own
     * call. */
    return code != 0
               ? code
               : nghttp2_session_set_local_window_size(session, NGHTTP2_FLAG_NONE, 0, WINDOW_BYTES);
}

static enum umb_status start(struct umbd_conn *conn)
{
    nghttp2_session_callbacks *callbacks = make_callbacks();
    nghttp2_option *option = make_option();
    int code = NGHTTP2_ERR_NOMEM;
    if (callbacks != NULL && option != NULL) {
        code = nghttp2_session_server_new2(&conn->session, callbacks, conn, option);
    }
    nghttp2_session_callbacks_del(callbacks);
    nghttp2_option_del(option);
    if (code == 0) {
        code = queue_settings(conn->session);
    }
    uint64_t now_ns = uv_hrtime();
    umbd_h2_filter_init(&conn->filter);
    umbd_bucket_init(&conn->control, UMBD_CONTROL_BURST, UMBD_CONTROL_RATE, now_ns);
    umbd_bucket_init(&conn->resets, RESET_BURST, RESET_RATE, now_ns);
    return code == 0 ? UMB_OK : UMB_E_NO_MEMORY;
}

static void stop(struct umbd_conn *conn)
{
    nghttp2_session_del(conn->session);
    conn->session = NULL;
}

/*
 * Chooses the memory into which libuv reads the next bytes. If a large part of one DATA frame is
 * still to come, that is the frame's message, else the loop's buffer. A read into a message gets
 * bytes of that frame alone. Nothing reads them again once the call has them, so the call may drop
 * its message. libuv reads and calls back at once, so the call cannot end in between.
 */
static size_t room(struct umbd_conn *conn, uint8_t **place)
{
    uint32_t stream_id = 0;
    const uint32_t left = umbd_h2_filter_data_left(&conn->filter, &stream_id);
    if (conn->tls == NULL && left >= IN_PLACE_BYTES) {
        struct umbd_call *call = find_call(conn->session, (int32_t)stream_id);
        const size_t got = call != NULL ? conn->server->calls->room(call, left, place) : 0;
        if (got >= IN_PLACE_BYTES) {
            return got;
        }
    }
    *place = conn->loop->read_buffer;
    return conn->was_long ? SMALL_BYTES : UMBD_READ_BYTES;
}

static int has_room(const struct umbd_conn *conn)
{
    (void)conn;
    return 1; /* flow control limits the peer */
}

/* Hands filtered bytes to the session; returns 0 or nghttp2's error. */
static int feed_session(void *user, const uint8_t *bytes, size_t count)
{
    struct umbd_conn *conn = user;
    ssize_t used = nghttp2_session_mem_recv(conn->session, bytes, count);
    return used < 0 ? (int)used : 0;
}

static int feed(void *user, const uint8_t *bytes, size_t count)
{
    struct umbd_conn *conn = user;
    return umbd_h2_filter_feed(&conn->filter, bytes, count, feed_session, conn);
}

static int collect(struct umbd_conn *conn)
{
    struct umbd_loop *loop = conn->loop;
    while (loop->out_size < UMBD_OUT_SOFT) {
        const uint8_t *bytes = NULL;
        ssize_t count = nghttp2_session_mem_send(conn->session, &bytes);
        if (count <= 0) {
            return (int)count;
        }
        if ((size_t)count > UMBD_OUT_CAPACITY - loop->out_size) {
            /* A frame longer than the reserve: the daemon sends none. */
            return NGHTTP2_ERR_BUFFER_ERROR;
        }
        memcpy(loop->out + loop->out_size, bytes, (size_t)count);
        loop->out_size += (size_t)count;
    }
    return 0;
}

static int is_over(const struct umbd_conn *conn)
{
    return !nghttp2_session_want_read(conn->session) && !nghttp2_session_want_write(conn->session);
}

/* The calls have a timer of their own for header blocks. */
static int is_late(struct umbd_conn *conn, uint64_t now_ms)
{
    (void)conn;
    (void)now_ms;
    return 0;
}

static void terminate(struct umbd_conn *conn, uint32_t code)
{
    nghttp2_session_terminate_session(conn->session, code);
}

static void notice(struct umbd_conn *conn)
{
    nghttp2_submit_shutdown_notice(conn->session);
}

static void last_call(struct umbd_conn *conn)
{
    nghttp2_submit_goaway(conn->session, NGHTTP2_FLAG_NONE,
                          nghttp2_session_get_last_proc_stream_id(conn->session), NGHTTP2_NO_ERROR,
                          NULL, 0);
}

static struct umbd_call *find(struct umbd_conn *conn, int32_t stream_id)
{
    return find_call(conn->session, stream_id);
}

const struct umbd_protocol umbd_protocol_h2 = {
    .start = start,
    .stop = stop,
    .room = room,
    .has_room = has_room,
    .feed = feed,
    .collect = collect,
    .error_text = nghttp2_strerror,
    .is_over = is_over,
    .is_late = is_late,
    .terminate = terminate,
    .notice = notice,
    .last_call = last_call,
    .find = find,
};
