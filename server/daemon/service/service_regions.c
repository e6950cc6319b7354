/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Regions.Stream and Follow: byte ranges of the packed file, unchanged. The workers read the file,
 * since that may block on the disk. A request is a batch without points, so the queue, fairness,
 * deadlines and cancelling are those of queries.
 */
#include "daemon/call/call_rights.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/transport/loop.h"
#include "wire/regions.h"

/* Bytes that a token or an address pays for as a point: about what an answer costs. */
#define BYTES_A_POINT 16

/* A read for the workers, placed after the batch. */
struct reading {
    struct umbs_entry *entry; /* owned */
    struct umbw_region_request request;
    struct umbw_region_reply reply; /* data: [data_size], owned */
    uint8_t *data;
};

/* Reads one range; shorter only at the end of the file. */
static enum umb_status read_range(int fd, const struct umbw_range *range, uint8_t *data,
                                  size_t *got, struct umb_error *error)
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

/* On a worker's thread. */
static enum umb_status read_all(const struct umbd_batch *batch, size_t first, size_t count,
                                struct umb_error *error)
{
    (void)first; /* there is one record */
    (void)count;
    struct reading *r = batch->work_user;
    int fd = -1;
    enum umb_status status = umbs_entry_open_packed(r->entry, &fd, &r->reply.file_bytes, error);
    for (size_t i = 0; i < r->request.count && status == UMB_OK; i++) {
        size_t got = 0;
        status = read_range(fd, &r->request.ranges[i], r->data + r->reply.data_size, &got, error);
        r->reply.data_size += got;
    }
    if (fd >= 0) {
        (void)close(fd);
    }
    return status;
}

static void free_reading(void *user)
{
    struct reading *r = user;
    if (r) {
        umbs_entry_release(r->entry);
        free(r->data);
        free(r);
    }
}

/* Makes the memory of a read. Out: reading, the caller's. */
static enum umb_status make_reading(struct umbd_call *call, struct reading **out, size_t *bytes,
                                    struct umb_error *error)
{
    struct reading *r = calloc(1, sizeof *r);
    *out = r;
    *bytes = 0;
    if (!r) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a region");
    }
    enum umb_status status =
        umbw_decode_region_request(call->message, call->message_size, &r->request, error);
    if (status == UMB_OK) {
        status = umbd_call_acquire(call, r->request.asset, &r->entry, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    for (size_t i = 0; i < r->request.count; i++) {
        *bytes += (size_t)r->request.ranges[i].length;
    }
    memcpy(r->reply.asset_id, umbs_entry_item(r->entry)->id, UMB_ID_BYTES);
    r->data = malloc(*bytes);
    return r->data ? UMB_OK
                   : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu bytes", *bytes);
}

enum umb_status umbd_call_send_work(struct umbd_call *call, const struct umbd_work *work,
                                    struct umb_error *error)
{
    static const struct umb_query_settings no_settings;
    const struct umb_points no_points = {.count = work->count};
    struct umbd_batch *batch;
    enum umb_status status = umbd_batch_create(0, &no_settings, &no_points, &batch, error);
    if (status != UMB_OK) {
        work->free(work->user);
        return status;
    }
    batch->work = work->run;
    batch->work_items = work->items;
    batch->work_end = work->end;
    batch->work_free = work->free;
    batch->work_user = work->user;
    batch->slice_points = work->slice;
    batch->slice_turns = work->turns;
    batch->deadline_ns = call->deadline_ns;
    batch->lane = call->conn->serial;
    batch->stream_id = call->stream_id;
    batch->done = umbd_loop_batch_done;
    batch->home = call->conn->loop;
    call->batch_bytes = work->bytes;
    call->batch = batch; /* before the submit: it may come home at once */
    status = umbd_pool_submit(call->conn->loop->daemon->pool, batch, error);
    if (status != UMB_OK) {
        call->batch = NULL;
        call->batch_bytes = 0;
        umbd_batch_destroy(batch);
    }
    return status;
}

void umbd_service_regions(struct umbd_call *call)
{
    struct reading *reading = NULL;
    struct umb_error error = {0};
    size_t bytes;
    enum umb_status status = make_reading(call, &reading, &bytes, &error);
    /* Read first, then copied into a message. */
    if (status == UMB_OK &&
        (!umbd_call_take_points(call, UMBD_CALL_POINTS + bytes / BYTES_A_POINT) ||
         !umbd_call_charge(call, call->charged + 2 * bytes))) {
        free_reading(reading);
        return;
    }
    if (status != UMB_OK) {
        free_reading(reading);
    } else {
        const struct umbd_work work = {.run = read_all,
                                       .free = free_reading,
                                       .user = reading,
                                       .count = 1,
                                       .slice = 1,
                                       .bytes = bytes};
        status = umbd_call_send_work(call, &work, &error);
    }
    if (status == UMB_E_BUSY) {
        call->pushback_ms = UMBD_PUSHBACK_MS;
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
    }
}

void umbd_service_regions_done(struct umbd_call *call, struct umbd_batch *batch)
{
    struct reading *reading = batch->work_user;
    struct umbw_buffer message = {0};
    enum umb_status status = batch->status;
    if (status == UMB_E_BUSY) {
        call->pushback_ms = UMBD_PUSHBACK_MS;
    }
    if (status == UMB_OK) {
        reading->reply.data = reading->data;
        status = umbw_encode_region_reply(&reading->reply, &message, &batch->error);
    }
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &batch->error);
        return;
    }
    umbd_call_reply(call, &message);
    if (!umbd_method_takes_many(call->method)) {
        umbd_call_finish(call);
    }
}
