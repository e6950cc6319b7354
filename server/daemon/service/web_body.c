/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See web_body.h. A body is a task that the call keeps (task.h) and sends once for each piece.
 * While it is away, only the worker touches it.
 *
 * The descriptor stays open until the last piece is read. So a file that is replaced by a rename
 * meanwhile is still sent whole. Each piece is read from a file whose stamp was that of the
 * asset's entry when it was opened; a change in place is found by the client, which proves pages by
 * the id.
 */
#include "daemon/service/web_body.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "daemon/service/web_parts.h"
#include "net/http1_fields.h"

#define PIECE_BYTES    ((size_t)256 << 10)
#define BOUNDARY_BYTES 16  /* random bytes of the boundary, which no file can contain knowingly */
#define PART_BYTES     256 /* most bytes before and behind a range of several */

struct body {
    struct umbd_task task;    /* First field */
    struct umbs_entry *entry; /* Owned */
    int fd;                   /* -1 = not open yet */
    int away;                 /* 1: a worker has it */
    int is_ready;             /* 1: the piece is read, and the one before is not taken yet */
    uint64_t file_bytes, body_bytes;
    char fields[UMBD_WEB_ASSET_BYTES];
    char boundary[2 * BOUNDARY_BYTES + 1]; /* "" = one part */
    size_t range, count;                   /* Number of the range under way, and of all */
    uint64_t done;                         /* Bytes of that range that were read */
    int is_partial;                        /* 1: ranges were asked for: status 206 */
    int is_begun;                          /* 1: the part's own head is written */
    uint8_t *piece; /* Piece being read, with UMBD_WEB_HEAD_BYTES before it; NULL: none */
    size_t piece_bytes, piece_capacity;
    struct umb_range ranges[]; /* [count] */
};

static struct body *of_task(struct umbd_task *task)
{
    return (struct body *)(void *)task;
}

static void free_body(struct umbd_task *task)
{
    struct body *body = of_task(task);
    umbs_entry_release(body->entry);
    if (body->fd >= 0) {
        (void)close(body->fd);
    }
    free(body->piece);
    free(body);
}

/* Writes what stands before a range of several. Returns its size. */
static size_t write_part(const struct body *body, const struct umb_range *range, char *text)
{
    return (size_t)snprintf(text, PART_BYTES,
                            "\r\n--%s\r\n" UMBD_WEB_TYPE "Content-Range: bytes %" PRIu64 "-%" PRIu64
                            "/%" PRIu64 "\r\n\r\n",
                            body->boundary, range->offset, range->offset + range->length - 1,
                            body->file_bytes);
}

/* Writes what stands behind the last one. */
static size_t write_end(const struct body *body, char *text)
{
    return (size_t)snprintf(text, PART_BYTES, "\r\n--%s--\r\n", body->boundary);
}

static uint64_t count_bytes(const struct body *body)
{
    char text[PART_BYTES];
    uint64_t bytes = body->boundary[0] != '\0' ? write_end(body, text) : 0;
    for (size_t i = 0; i < body->count; i++) {
        bytes += body->ranges[i].length;
        bytes += body->boundary[0] != '\0' ? write_part(body, &body->ranges[i], text) : 0;
    }
    return bytes;
}

/* --- On a worker --- */

static enum umb_status open_file(struct body *body, struct umb_error *error)
{
    uint64_t size = 0;
    enum umb_status status = umbs_entry_open_packed(body->entry, &body->fd, &size, error);
    return status == UMB_OK && size != body->file_bytes
               ? umb_fail(error, UMB_E_STATE,
                          "asset: its file has another size than when it was "
                          "loaded")
               : status;
}

/* Reads a part of the range under way into the piece. */
static enum umb_status read_range(struct body *body, struct umb_error *error)
{
    const struct umb_range *range = &body->ranges[body->range];
    uint8_t *to = body->piece + UMBD_WEB_HEAD_BYTES + body->piece_bytes;
    const uint64_t left = range->length - body->done;
    const size_t room = body->piece_capacity - body->piece_bytes;
    const ssize_t got =
        pread(body->fd, to, left < room ? (size_t)left : room, (off_t)(range->offset + body->done));
    if (got < 0 && errno == EINTR) {
        return UMB_OK;
    }
    if (got <= 0) {
        return umb_fail_errno(error, UMB_E_IO, got < 0 ? errno : EIO,
                              "asset: its file cannot be read");
    }
    body->done += (uint64_t)got;
    body->piece_bytes += (size_t)got;
    if (body->done == range->length) {
        body->range++;
        body->done = 0;
        body->is_begun = 0;
    }
    return UMB_OK;
}

/* Appends the text of a part, or of the end. Returns 0 if the piece has no room for it. */
static int append_text(struct body *body)
{
    char text[PART_BYTES];
    const size_t size = body->range == body->count
                            ? write_end(body, text)
                            : write_part(body, &body->ranges[body->range], text);
    if (size > body->piece_capacity - body->piece_bytes) {
        return 0;
    }
    memcpy(body->piece + UMBD_WEB_HEAD_BYTES + body->piece_bytes, text, size);
    body->piece_bytes += size;
    body->is_begun = 1;
    return 1;
}

/* 1 if the last byte of the body is in the piece. */
static int is_whole(const struct body *body)
{
    return body->range == body->count && (body->boundary[0] == '\0' || body->is_begun);
}

/* Fills the piece. It is the `run` of a task with one record. */
static enum umb_status fill_piece(struct umbd_task *task, size_t first, size_t count,
                                  struct umbd_slice_result *result)
{
    struct body *body = of_task(task);
    enum umb_status status = body->fd < 0 ? open_file(body, &result->error) : UMB_OK;
    (void)first;
    (void)count;
    while (status == UMB_OK && !is_whole(body) && body->piece_bytes < body->piece_capacity) {
        if (body->boundary[0] != '\0' && !body->is_begun) {
            if (!append_text(body)) {
                break; /* with the next piece */
            }
        } else {
            status = read_range(body, &result->error);
        }
    }
    if (is_whole(body) && body->fd >= 0) { /* the last close may free a replaced file's blocks */
        (void)close(body->fd);
        body->fd = -1;
    }
    return status;
}

/* --- On the loop --- */

static size_t write_head(struct umbd_call *call, const struct body *body,
                         char head[UMBD_WEB_HEAD_BYTES])
{
    char fields[UMBD_WEB_FIELDS_BYTES];
    char range[80] = "";
    char type[96] = UMBD_WEB_TYPE;
    if (body->boundary[0] != '\0') {
        (void)snprintf(type, sizeof type, "Content-Type: multipart/byteranges; boundary=%s\r\n",
                       body->boundary);
    } else if (body->is_partial) {
        (void)snprintf(range, sizeof range,
                       "Content-Range: bytes %" PRIu64 "-%" PRIu64 "/%" PRIu64 "\r\n",
                       body->ranges[0].offset, body->ranges[0].offset + body->ranges[0].length - 1,
                       body->file_bytes);
    }
    (void)snprintf(fields, sizeof fields, "%s%s%s", body->fields, type, range);
    return umbd_web_head(call, body->is_partial ? 206 : 200, body->body_bytes, fields, head);
}

/* Hands the piece to the call, with the head before the first one. */
static void send_piece(struct umbd_call *call, struct body *body)
{
    size_t from = UMBD_WEB_HEAD_BYTES;
    if (!call->responded) {
        char head[UMBD_WEB_HEAD_BYTES];
        const size_t size = write_head(call, body, head);
        from -= size;
        memcpy(body->piece + from, head, size);
    }
    const size_t size = UMBD_WEB_HEAD_BYTES + body->piece_bytes;
    umbw_buffer_finish(&call->out);
    call->out = (struct umbw_buffer){body->piece, size, size};
    call->sent = from;
    call->progress_ms = umbd_call_now_ms(call);
    call->web->body_bytes += body->piece_bytes;
    call->reply_ended = is_whole(body);
    body->piece = NULL;
    body->is_ready = 0;
}

/* Sends the task for the next piece. Fails: E_BUSY, E_NO_MEMORY; another try may succeed. */
static enum umb_status next_piece(struct umbd_call *call, struct body *body,
                                  struct umb_error *error)
{
    if (body->piece == NULL) {
        body->piece = malloc(UMBD_WEB_HEAD_BYTES + body->piece_capacity);
    }
    if (body->piece == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a reply");
    }
    body->piece_bytes = 0;
    body->away = 1;
    enum umb_status status = umbd_call_send_task(call, &body->task, body->piece_capacity, error);
    body->away = status == UMB_OK;
    return status;
}

/* Sends the ready piece if the piece before it was taken, and lets a worker read the next piece
 * meanwhile. If the workers' queue is full, the tick tries again. */
static void go_on(struct umbd_call *call, struct body *body)
{
    struct umb_error error;
    if (body->is_ready && umbd_call_unsent(call) == 0) {
        send_piece(call, body);
    }
    if (!body->is_ready && !body->away && !is_whole(body)) {
        (void)!next_piece(call, body, &error);
    }
}

static void answer_piece(struct umbd_call *call, struct umbd_task *task)
{
    struct body *body = of_task(task);
    body->away = 0;
    if (call->reply_ended) {
        return; /* the call failed meanwhile */
    }
    if (task->status == UMB_OK) {
        body->is_ready = 1;
        go_on(call, body);
    } else {
        umbd_call_fail_work(call, task->status, &task->error);
    }
}

/* Makes a random boundary. Returns 0 if the kernel has no random bytes. */
static int make_boundary(char *text)
{
    uint8_t bytes[BOUNDARY_BYTES];
    if (getrandom(bytes, sizeof bytes, GRND_NONBLOCK) != (ssize_t)sizeof bytes) {
        return 0;
    }
    for (size_t i = 0; i < sizeof bytes; i++) {
        (void)snprintf(text + 2 * i, 3, "%02x", bytes[i]);
    }
    return 1;
}

/* Makes the body of a reply; NULL: out of memory, or of random bytes. */
static struct body *make_body(const struct umbs_entry *entry, const char *fields,
                              const struct umb_range *ranges, size_t count)
{
    const size_t parts = count > 0 ? count : 1;
    struct body *body = calloc(1, sizeof *body + parts * sizeof body->ranges[0]);
    if (body == NULL || (count > 1 && !make_boundary(body->boundary))) {
        free(body);
        return NULL;
    }
    body->task.run = fill_piece;
    body->task.answer = answer_piece;
    body->task.free = free_body;
    body->task.is_kept = 1;
    body->task.count = body->task.slice = 1;
    body->fd = -1;
    body->file_bytes = umbs_entry_item(entry)->packed_bytes;
    body->count = parts;
    body->is_partial = count > 0;
    body->ranges[0] = (struct umb_range){0, body->file_bytes};
    if (count > 0) {
        memcpy(body->ranges, ranges, count * sizeof *ranges);
    }
    (void)snprintf(body->fields, sizeof body->fields, "%s", fields);
    body->body_bytes = count_bytes(body);
    body->piece_capacity = body->body_bytes < PIECE_BYTES ? (size_t)body->body_bytes : PIECE_BYTES;
    return body;
}

uint64_t umbd_web_body_begin(struct umbd_call *call, struct umbs_entry **entry, const char *fields,
                             const struct umb_range *ranges, size_t count)
{
    struct body *body = make_body(*entry, fields, ranges, count);
    struct umb_error *error = umbd_call_error(call);
    if (body == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return 0;
    }
    body->entry = *entry;
    *entry = NULL;
    const size_t pieces = body->body_bytes > body->piece_capacity ? 2 : 1;
    if (!umbd_call_charge(call,
                          sizeof *body + pieces * (UMBD_WEB_HEAD_BYTES + body->piece_capacity))) {
        free_body(&body->task);
        return 0;
    }
    const uint64_t bytes = body->body_bytes; /* the body is the worker's from here on */
    const enum umb_status status = next_piece(call, body, error);
    if (status != UMB_OK) {
        umbd_call_fail_work(call, status, error);
        free_body(&body->task);
        return 0;
    }
    call->state = body;
    return bytes;
}

void umbd_web_send(struct umbd_call *call, const char *head, size_t size)
{
    call->reply_ended = 1;
    call->out.bytes = malloc(size);
    if (call->out.bytes == NULL) {
        umbd_web_cut(call);
        return;
    }
    memcpy(call->out.bytes, head, size);
    call->out.size = call->out.capacity = size;
}

void umbd_web_body_more(struct umbd_call *call)
{
    struct body *body = call->state;
    if (body != NULL && !body->away && !call->reply_ended) {
        go_on(call, body);
    }
}

void umbd_web_body_close(struct umbd_call *call)
{
    struct body *body = call->state;
    if (body != NULL && !body->away) {
        free_body(&body->task);
    }
    call->state = NULL;
}
