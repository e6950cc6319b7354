/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A whole connection of the daemon, in this process: store, loop and worker are the daemon's own, a
 * socket pair takes the place of the network. The input is a script of HTTP/2: frames that are
 * mostly well formed, calls of every method with and without a right, and raw bytes. The first byte
 * picks the script, requests of HTTP/1.1, or a test of the frame filter alone.
 *
 * Properties: the daemon sends only HTTP/2 frames that a server may send, or replies of HTTP/1.1
 * that have the length they tell; after the peer's end no connection, call or byte is held; the
 * filter passes the same bytes however they are split.
 */
#define _GNU_SOURCE /* memmem */
#include <errno.h>
#include <fcntl.h>
#include <nghttp2/nghttp2.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/sha256.h"
#include "daemon/daemon.h"
#include "daemon/service/services.h"
#include "daemon/transport/conn.h"
#include "daemon/transport/h2_filter.h"
#include "daemon/transport/loop.h"
#include "daemon/work/pool.h"
#include "format/content.h"
#include "fuzz.h"
#include "fuzz_folder.h"
#include "make_asset.h"
#include "wire/bakes.h"
#include "wire/volume_queries.h"
#include "wire/messages.h"
#include "wire/regions.h"
#include "wire/versions.h"

#define STREAMS_MOST 24
#define SEND_MOST    65536 /* bytes of one script on the wire */
#define WAIT_ROUNDS  5000  /* of a millisecond */
#define TOKEN        "0123456789abcdef0123456789abcdef"

static struct umbd_daemon daemon_of_all;

/* make_packed, but with the store's SHA-256. */
static void write_asset(const char *path)
{
    static const double origin[3] = {0, 0, 0};
    static const uint32_t log2_size = 6;
    const struct voxels voxels = {random_voxel, &log2_size, log2_size, 1};
    struct bytes packed = {0};
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 1, origin, &content);
    struct umb_sink sink = bytes_sink(&packed);
    FUZZ_DEMAND(umb__pack_write(&content, &octree, &umbs_sha256, &sink, id, NULL) == UMB_OK);
    fuzz_write(path, packed.data, packed.size);
    umb__octree_finish(&octree);
    bytes_finish(&packed);
}

static void start(void)
{
    static char store[300], tokens[300], listen[300];
    static const char *const fixed[] = {"--workers=1",
                                        "--loops=1",
                                        "--log-level=error",
                                        "--scrub-interval=0",
                                        "--max-points=2048",
                                        "--max-message=65536",
                                        "--connection-buffer=4MiB",
                                        "--max-buffer=8MiB"};
    static char *words[32] = {store, "--store", store, "--token-file", tokens, "--listen", listen};
    static struct umbd_options options;
    struct umb_error error = {0};
    char path[400];
    if (daemon_of_all.server.loops != NULL) {
        return;
    }
    (void)signal(SIGPIPE, SIG_IGN); /* as daemon_main.c does */
    (void)snprintf(store, sizeof store, "%s/store", fuzz_folder());
    (void)snprintf(tokens, sizeof tokens, "%s/tokens", fuzz_folder());
    (void)snprintf(listen, sizeof listen, "unix:%s/socket", fuzz_folder());
    FUZZ_DEMAND(mkdir(store, 0700) == 0);
    (void)snprintf(path, sizeof path, "%s/city.umb", store);
    write_asset(path);
    static const char line[] = "ann query,submit " TOKEN "\n";
    fuzz_write(tokens, line, sizeof line - 1);
    int count = 7;
    for (size_t i = 0; i < sizeof fixed / sizeof fixed[0]; i++) {
        words[count++] = (char *)(uintptr_t)fixed[i];
    }
    if (umbd_options_parse(count, words, &options, &error) != UMB_OK ||
        umbd_daemon_init(&daemon_of_all, &options, umbd_methods, &error) != UMB_OK ||
        umbd_loops_init(&daemon_of_all.server, &error) != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        abort();
    }
    daemon_of_all.server.daemon = &umbd_daemon_events;
}

/* ---- what the peer sends ---- */

struct script {
    const uint8_t *at, *end;
    int socket;
    nghttp2_hd_deflater *packer;
    int32_t next_stream;
    size_t sent;
};

static uint8_t next(struct script *script)
{
    return script->at < script->end ? *script->at++ : 0;
}

static const uint8_t *take(struct script *script, size_t want, size_t *got)
{
    const uint8_t *from = script->at;
    const size_t left = (size_t)(script->end - script->at);
    *got = left < want ? left : want;
    script->at += *got;
    return from;
}

static void turn(void)
{
    (void)uv_run(&daemon_of_all.server.loops[0].uv, UV_RUN_NOWAIT);
}

/* Position of the reader within a frame of the daemon's answer. */
static struct {
    uint8_t head[9];
    size_t head_bytes, payload_left;
} heard;

/* A server opens no streams, so its frames are on odd streams or on stream 0; no frame is longer
 * than allowed. */
static void check_frame(void)
{
    const uint8_t *h = heard.head;
    heard.head_bytes = 0;
    heard.payload_left = (size_t)h[0] << 16 | (size_t)h[1] << 8 | h[2];
    FUZZ_DEMAND(heard.payload_left <= UMBD_SEND_FRAME && h[3] <= NGHTTP2_CONTINUATION);
    FUZZ_DEMAND((h[5] & 0x80) == 0 && ((h[5] | h[6] | h[7] | h[8]) == 0 || h[8] % 2 == 1));
}

static void follow(const uint8_t *bytes, size_t count)
{
    while (count > 0) {
        size_t part = heard.payload_left < count ? heard.payload_left : count;
        if (part > 0) {
            heard.payload_left -= part;
        } else {
            heard.head[heard.head_bytes++] = *bytes;
            part = 1;
            if (heard.head_bytes == sizeof heard.head) {
                check_frame();
            }
        }
        bytes += part;
        count -= part;
    }
}

/* Reads what the daemon sent; returns 0 once the daemon has closed. */
static int hear(int socket)
{
    uint8_t bytes[16384];
    ssize_t count = 0;
    do {
        count = recv(socket, bytes, sizeof bytes, MSG_DONTWAIT);
        if (count > 0) {
            follow(bytes, (size_t)count);
        }
    } while (count > 0);
    return !(count == 0 || (errno != EAGAIN && errno != EINTR));
}

static void say(struct script *script, const void *bytes, size_t size)
{
    const uint8_t *from = bytes;
    script->sent += size;
    for (unsigned tries = 0; size > 0 && tries < 1000; tries++) {
        const ssize_t count = send(script->socket, from, size, MSG_DONTWAIT | MSG_NOSIGNAL);
        if (count > 0) {
            from += count;
            size -= (size_t)count;
        } else {
            turn();
            if (!hear(script->socket)) {
                return;
            }
        }
    }
}

static void say_frame(struct script *script, uint8_t type, uint8_t flags, uint32_t stream,
                      const void *payload, size_t size)
{
    const uint8_t head[9] = {(uint8_t)(size >> 16),
                             (uint8_t)(size >> 8),
                             (uint8_t)size,
                             type,
                             flags,
                             (uint8_t)(stream >> 24),
                             (uint8_t)(stream >> 16),
                             (uint8_t)(stream >> 8),
                             (uint8_t)stream};
    say(script, head, sizeof head);
    say(script, payload, size);
}

static nghttp2_nv header(const char *name, const char *value)
{
    return (nghttp2_nv){(uint8_t *)(uintptr_t)name, (uint8_t *)(uintptr_t)value, strlen(name),
                        strlen(value), NGHTTP2_NV_FLAG_NONE};
}

static const char *const paths[] = {
    UMBW_PATH_QUERY,          UMBW_PATH_STREAM,         UMBW_PATH_DESCRIBE,
    UMBW_PATH_LIST,           UMBW_PATH_LIMITS,         UMBW_PATH_CHECK,
    UMBW_PATH_WATCH,          UMBW_PATH_BAKES_SUBMIT,   UMBW_PATH_BAKES_WATCH,
    UMBW_PATH_BAKES_CANCEL,   UMBW_PATH_BAKES_LIST,     UMBW_PATH_BAKES_FETCH,
    UMBW_PATH_BAKES_DELETE,   UMBW_PATH_REGIONS_STREAM, UMBW_PATH_REGIONS_FOLLOW,
    UMBW_PATH_REGIONS_DERIVE, UMBW_PATH_SEGMENTS,       UMBW_PATH_COLUMNS,
    UMBW_PATH_BOXES,          UMBW_PATH_REFLECTION,     UMBW_PATH_REFLECTION_ALPHA,
    "/no.such/Method",        UMBW_PATH_SAMPLE,         UMBW_PATH_REGIONS_WATCH};

enum {
    END_STREAM = 1,
    BAD_TOKEN = 2,
    NO_TOKEN = 4,
    DEADLINE = 8,
    GZIP = 16,
    OPEN_HEADERS = 32, /* no END_HEADERS */
    OLD_STREAM = 64,
    ODD_FIELD = 128, /* of the script's own bytes */
};

static void say_headers(struct script *script)
{
    const uint8_t path = next(script), how = next(script);
    nghttp2_nv fields[12];
    uint8_t block[4096];
    size_t count = 0, size;
    fields[count++] = header(":method", "POST");
    fields[count++] = header(":scheme", "http");
    fields[count++] = header(":path", paths[path % (sizeof paths / sizeof paths[0])]);
    fields[count++] = header(":authority", "localhost");
    fields[count++] = header("content-type", "application/grpc");
    fields[count++] = header("te", "trailers");
    if ((how & NO_TOKEN) == 0) {
        fields[count++] =
            header("authorization", how & BAD_TOKEN ? "Bearer " TOKEN "x" : "Bearer " TOKEN);
    }
    if (how & DEADLINE) {
        fields[count++] = header("grpc-timeout", next(script) & 1 ? "1n" : "20S");
    }
    if (how & GZIP) {
        fields[count++] = header("grpc-encoding", "gzip");
        fields[count++] = header("grpc-accept-encoding", "gzip,identity");
    }
    if (how & ODD_FIELD) {
        const uint8_t *text = take(script, next(script) % 64, &size);
        const size_t name = size / 2;
        fields[count++] =
            (nghttp2_nv){(uint8_t *)(uintptr_t)text, (uint8_t *)(uintptr_t)(text + name), name,
                         size - name, NGHTTP2_NV_FLAG_NONE};
    }
    const ssize_t length =
        nghttp2_hd_deflate_hd(script->packer, block, sizeof block, fields, count);
    if (length < 0) {
        return;
    }
    uint32_t stream = (uint32_t)script->next_stream;
    if ((how & OLD_STREAM) == 0 && script->next_stream < 2 * STREAMS_MOST) {
        script->next_stream += 2;
    } else {
        stream = stream > 2 ? stream - 2 : stream;
    }
    say_frame(script, NGHTTP2_HEADERS,
              (uint8_t)((how & END_STREAM) | (how & OPEN_HEADERS ? 0 : NGHTTP2_FLAG_END_HEADERS)),
              stream, block, (size_t)length);
}

static uint32_t some_stream(struct script *script)
{
    return 1 + 2U * (next(script) % STREAMS_MOST);
}

/* Makes a message with its prefix, or raw bytes; all of it or only the beginning. */
static void say_data(struct script *script)
{
    const uint8_t how = next(script);
    const uint32_t stream = how & 0x80 ? some_stream(script) : (uint32_t)script->next_stream - 2;
    uint8_t payload[5 + 4096];
    size_t size, want = next(script);
    want |= how & 0x40 ? (size_t)(next(script) & 15) << 8 : 0;
    const uint8_t *bytes = take(script, want, &size);
    const size_t prefix = how & 2 ? 0 : 5;
    const size_t said = how & 4 ? size + next(script) : size;
    const uint8_t head[5] = {how & 8 ? 1 : 0, 0, (uint8_t)(said >> 16), (uint8_t)(said >> 8),
                             (uint8_t)said};
    memcpy(payload, head, prefix);
    memcpy(payload + prefix, bytes, size);
    say_frame(script, NGHTTP2_DATA, how & 1, stream, payload, prefix + size);
}

static void say_any_frame(struct script *script)
{
    const uint8_t type = next(script) % 12, flags = next(script);
    const uint32_t stream = next(script) & 1 ? some_stream(script) : 0;
    size_t size;
    const uint8_t *payload = take(script, next(script), &size);
    say_frame(script, type, flags, stream, payload, size);
}

static void say_small_frame(struct script *script)
{
    const uint8_t kind = next(script);
    const uint8_t payload[8] = {0,           next(script), next(script), next(script), next(script),
                                next(script)};
    if (kind % 4 == 0) {
        say_frame(script, NGHTTP2_RST_STREAM, 0, some_stream(script), payload, 4);
    } else if (kind % 4 == 1) {
        say_frame(script, NGHTTP2_WINDOW_UPDATE, 0, kind & 4 ? some_stream(script) : 0, payload, 4);
    } else if (kind % 4 == 2) {
        say_frame(script, NGHTTP2_SETTINGS, 0, 0, payload, 6);
    } else {
        say_frame(script, NGHTTP2_PING, kind & 4 ? NGHTTP2_FLAG_ACK : 0, 0, payload, 8);
    }
}

static void play(struct script *script)
{
    static const char preface[] = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
    const uint8_t begin = next(script);
    if (begin != 255) {
        say(script, preface, sizeof preface - 1);
        say_frame(script, NGHTTP2_SETTINGS, 0, 0, NULL, 0);
    }
    while (script->at < script->end && script->sent < SEND_MOST) {
        const uint8_t what = next(script);
        size_t size;
        if (what < 100) {
            say_headers(script);
        } else if (what < 190) {
            say_data(script);
        } else if (what < 205) {
            say_small_frame(script);
        } else if (what < 215) {
            say_any_frame(script);
        } else if (what < 220) {
            const uint8_t *bytes = take(script, next(script), &size);
            say(script, bytes, size);
        } else {
            turn();
            (void)(what & 1 ? hear(script->socket) : 0);
        }
    }
}

/* Connects a peer; returns its socket. */
static int connect_peer(enum umbd_language language)
{
    int sockets[2];
    start();
    FUZZ_DEMAND(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, sockets) == 0);
    const struct umbd_socket accepted = {
        .fd = sockets[1], .transport = UMBN_UNIX, .language = language};
    umbd_conn_adopt(&daemon_of_all.server.loops[0], &accepted);
    return sockets[0];
}

/* Demands that the daemon lets go of everything after its peer has left. */
static void leave(int socket)
{
    struct umbd_loop *loop = &daemon_of_all.server.loops[0];
    (void)close(socket);
    for (unsigned i = 0; loop->conn_count > 0 || atomic_load(&daemon_of_all.server.buffered) > 0;
         i++) {
        FUZZ_DEMAND(i < WAIT_ROUNDS);
        turn();
        if (i > 16) {
            (void)poll(NULL, 0, 1); /* a worker has it */
        }
    }
    FUZZ_DEMAND(umbd_pool_depth(daemon_of_all.backend.pool) == 0 && LIST_EMPTY(&loop->conns));
}

static void connection(const uint8_t *data, size_t size)
{
    struct script script = {data, data + size, connect_peer(UMBD_HTTP2), NULL, 1, 0};
    memset(&heard, 0, sizeof heard);
    FUZZ_DEMAND(nghttp2_hd_deflate_new(&script.packer, 4096) == 0);
    play(&script);
    for (unsigned i = 0; i < 8; i++) {
        turn();
        (void)hear(script.socket);
    }
    nghttp2_hd_deflate_del(script.packer);
    leave(script.socket);
}

/* ---- HTTP/1.1 ---- */

/* Where in a reply the daemon's answer is. */
static struct {
    char head[4096];
    size_t head_bytes, body_left;
} replies;

/* Ends a head: the number of body bytes that follow it. 204 and 304 have none. */
static void check_reply(void)
{
    const char *length = strstr(replies.head, "\r\nContent-Length: ");
    FUZZ_DEMAND(strncmp(replies.head, "HTTP/1.1 ", 9) == 0);
    const int has_body =
        strncmp(replies.head + 9, "204", 3) != 0 && strncmp(replies.head + 9, "304", 3) != 0;
    FUZZ_DEMAND(!has_body || length != NULL);
    replies.body_left = has_body ? strtoul(length + 18, NULL, 10) : 0;
    replies.head_bytes = 0;
}

static void follow_replies(const uint8_t *bytes, size_t count)
{
    while (count > 0) {
        size_t part = replies.body_left < count ? replies.body_left : count;
        replies.body_left -= part;
        if (part == 0) {
            FUZZ_DEMAND(replies.head_bytes < sizeof replies.head - 1);
            replies.head[replies.head_bytes++] = (char)*bytes;
            replies.head[replies.head_bytes] = '\0';
            part = 1;
            if (replies.head_bytes >= 4 &&
                strcmp(replies.head + replies.head_bytes - 4, "\r\n\r\n") == 0) {
                check_reply();
            }
        }
        bytes += part;
        count -= part;
    }
}

static int hear_replies(int socket)
{
    uint8_t bytes[16384];
    ssize_t count;
    while ((count = recv(socket, bytes, sizeof bytes, MSG_DONTWAIT)) > 0) {
        follow_replies(bytes, (size_t)count);
    }
    return count != 0 && (errno == EAGAIN || errno == EINTR);
}

/* The first byte is the size of the pieces in which the bytes are sent. Replies to HEAD
 * have lengths without bodies, so replies are followed only without that word. */
static void web_connection(const uint8_t *data, size_t size)
{
    const size_t piece = size > 0 ? 1 + (size_t)data[0] * 8 : 1;
    const int socket = connect_peer(UMBD_HTTP1);
    const int has_head = size > 1 && memmem(data + 1, size - 1, "HEAD", 4) != NULL;
    int is_open = 1;
    memset(&replies, 0, sizeof replies);
    for (size_t at = 1; at < size && is_open; at += piece) {
        const size_t count = piece < size - at ? piece : size - at;
        is_open = send(socket, data + at, count, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)count;
        turn();
        is_open = is_open && (has_head || hear_replies(socket));
    }
    for (unsigned i = 0; i < 8 && is_open; i++) {
        turn();
        (void)poll(NULL, 0, i == 4 ? 1 : 0); /* a worker reads the file */
        is_open = has_head || hear_replies(socket);
    }
    leave(socket);
}

/* ---- the filter ---- */

struct passed {
    uint8_t bytes[4096];
    size_t size;
};

static int keep(void *user, const uint8_t *bytes, size_t count)
{
    struct passed *passed = user;
    FUZZ_DEMAND(count <= sizeof passed->bytes - passed->size);
    memcpy(passed->bytes + passed->size, bytes, count);
    passed->size += count;
    return 0;
}

static void filter(const uint8_t *data, size_t size)
{
    struct umbd_h2_filter whole, pieces;
    struct passed one = {.size = 0}, many = {.size = 0};
    if (size < 8 || size > sizeof one.bytes) {
        return;
    }
    const uint8_t *bytes = data + 8;
    size -= 8;
    umbd_h2_filter_init(&whole);
    umbd_h2_filter_init(&pieces);
    FUZZ_DEMAND(umbd_h2_filter_feed(&whole, bytes, size, keep, &one) == 0);
    for (size_t at = 0, i = 0; at < size; i++) {
        const size_t piece = 1 + data[i % 8] % 40;
        const size_t count = piece < size - at ? piece : size - at;
        FUZZ_DEMAND(umbd_h2_filter_feed(&pieces, bytes + at, count, keep, &many) == 0);
        at += count;
    }
    FUZZ_DEMAND(one.size == many.size && memcmp(one.bytes, many.bytes, one.size) == 0);
    FUZZ_DEMAND(one.size <= size && (size < 24 || memcmp(one.bytes, bytes, 24) == 0));
    FUZZ_DEMAND(whole.odd == pieces.odd && whole.highest == pieces.highest);
    uint32_t stream = 0, other = 0;
    FUZZ_DEMAND(umbd_h2_filter_data_left(&whole, &stream) ==
                umbd_h2_filter_data_left(&pieces, &other));
    stream = data[0] | 1U; /* clients open odd ones */
    FUZZ_DEMAND(umbd_h2_filter_was_reset(&whole, stream) ==
                umbd_h2_filter_was_reset(&pieces, stream));
    FUZZ_DEMAND(!umbd_h2_filter_was_reset(&whole, stream)); /* said once */
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0 || size > 16384) {
        return 0;
    }
    if (data[0] % 8 == 7) {
        filter(data + 1, size - 1);
    } else if (data[0] % 8 == 5) {
        web_connection(data + 1, size - 1);
    } else {
        connection(data + 1, size - 1);
    }
    return 0;
}
