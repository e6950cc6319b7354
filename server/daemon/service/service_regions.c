/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Regions.Stream and Follow: byte ranges of the packed file, unchanged. Workers read the file,
 * because reading may block on the disk.
 */
#include "daemon/call/call.h"
#include "daemon/service/services.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "wire/regions.h"

/* Bytes of a range that count as a point on rates: about the cost of an answer. */
#define BYTES_A_POINT 16

/* A read for the workers. */
struct reading {
    struct umbd_task task;    /* The first field */
    struct umbs_entry *entry; /* owned */
    struct umbw_region_request request;
    struct umbw_region_reply reply; /* data: [data_size], owned */
    uint8_t *data;
};

/* Reads one range; shorter only at the end of the file. */
static enum umb_status read_range(int fd, const struct umb_range *range, uint8_t *data, size_t *got,
                                  struct umb_error *error)
{
    *got = 0;
    while (*got < range->length) {
        const ssize_t count =
            pread(fd, data + *got, (size_t)range->length - *got, (off_t)(range->offset + *got));
        if (count < 0 && errno == EINTR) {
            continue;
        }
        if (count < 0) {
            return umb_fail_errno(error, UMB_E_IO, errno, "asset: its file cannot be read");
        }
        if (count == 0) {
            break;
        }
        *got += (size_t)count;
    }
    return UMB_OK;
}

/* Reads the ranges on a worker's thread. It is the `run` of a task with one record. */
static enum umb_status read_all(struct umbd_task *task, size_t first, size_t count,
                                struct umbd_slice_result *result)
{
    (void)first;
    (void)count;
    struct reading *r = (struct reading *)task;
    int fd = -1;
    enum umb_status status =
        umbs_entry_open_packed(r->entry, &fd, &r->reply.file_bytes, &result->error);
    for (size_t i = 0; i < r->request.count && status == UMB_OK; i++) {
        size_t got = 0;
        status = read_range(fd, &r->request.ranges[i], r->data + r->reply.data_size, &got,
                            &result->error);
        r->reply.data_size += got;
    }
    if (fd >= 0) {
        (void)close(fd);
    }
    return status;
}

static void free_reading(struct umbd_task *task)
{
    struct reading *r = (struct reading *)task;
    umbs_entry_release(r->entry);
    free(r->data);
    free(r);
}

static void answer(struct umbd_call *call, struct umbd_task *task)
{
    struct reading *reading = (struct reading *)task;
    struct umbw_buffer message = {0};
    enum umb_status status = task->status;
    if (status == UMB_OK) {
        reading->reply.data = reading->data;
        status = umbw_encode_region_reply(&reading->reply, &message, &task->error);
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &task->error);
        return;
    }
    umbd_call_reply(call, &message);
    if (!umbd_takes_many(call->method)) {
        umbd_call_finish(call);
    }
}

/* Reads the request and makes room for its bytes. */
static enum umb_status ready(struct umbd_call *call, struct reading *r, size_t *bytes,
                             struct umb_error *error)
{
    *bytes = 0;
    UMB__TRY(umbw_decode_region_request(call->message, call->message_size, &r->request, error));
    UMB__TRY(umbd_call_acquire(call, r->request.asset, &r->entry, error));
    for (size_t i = 0; i < r->request.count; i++) {
        *bytes += (size_t)r->request.ranges[i].length;
    }
    memcpy(r->reply.asset_id, umbs_entry_item(r->entry)->id, UMB_ID_BYTES);
    r->data = malloc(*bytes);
    return r->data ? UMB_OK
                   : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu bytes", *bytes);
}

void umbd_regions_serve(struct umbd_call *call)
{
    struct reading *r = calloc(1, sizeof *r);
    size_t bytes;
    if (r == NULL) {
        (void)umbd_call_ok(
            call, umb_fail(umbd_call_error(call), UMB_E_NO_MEMORY, "out of memory for a region"));
        return;
    }
    r->task.run = read_all;
    r->task.answer = answer;
    r->task.free = free_reading;
    r->task.count = r->task.slice = 1;
    if (!umbd_call_ok(call, ready(call, r, &bytes, umbd_call_error(call))) ||
        !umbd_call_take_points(call, UMBD_CALL_POINTS + bytes / BYTES_A_POINT) ||
        !umbd_call_charge(call, call->charged + 2 * bytes) || /* read, then copied */
        !umbd_call_ok(call, umbd_call_send_task(call, &r->task, bytes, umbd_call_error(call)))) {
        free_reading(&r->task);
    }
}
