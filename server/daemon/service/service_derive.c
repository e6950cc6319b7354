/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Regions.DeriveMap: shadow maps from an asset, made by one worker. The worker reads voxels in a
 * mapped file that another process may cut short; a fault then ends the reading midway. All its
 * memory therefore comes from an allocator that lists its blocks, so that they can be freed.
 */
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "wire/regions.h"

#define PIECE_BYTES ((size_t)256 << 10) /* bytes of the file in one message */
#define SEAM_TEXELS UINT64_C(36864)     /* texels that take as long as the match of one seam */
#define TURN_TEXELS 2048U /* texels of a turn, about a millisecond: 0.5 to 0.9 us a texel */

/* Header of an allocated block. The memory after the header is aligned for any type. */
struct block {
    _Alignas(max_align_t) struct block *next;
    struct block *previous;
};

struct deriving {
    struct umbd_task task;    /* The first field */
    struct umbs_entry *entry; /* owned */
    struct umbw_derive_request request;
    struct block ledger; /* head of a ring of the allocated blocks */
    struct umb_error error;
    enum umb_status status;
    const uint8_t *file; /* memory of the ledger */
    size_t size;
    struct umbw_buffer messages; /* the replies, prefixes included */
};

/* Allocates, resizes and frees like realloc, and lists the blocks (struct umb_alloc). It reads no
 * mapped file, so no fault can end it midway. */
static void *ledger_resize(void *user, void *memory, size_t bytes)
{
    struct deriving *d = user;
    struct block *old = memory ? (struct block *)(void *)((char *)memory - sizeof *old) : NULL;
    if (old != NULL) {
        old->next->previous = old->previous;
        old->previous->next = old->next;
    }
    if (bytes == 0) {
        free(old);
        return NULL;
    }
    struct block *block =
        bytes < SIZE_MAX - sizeof *block ? realloc(old, sizeof *block + bytes) : NULL;
    struct block *noted = block != NULL ? block : old;
    if (noted != NULL) {
        noted->next = d->ledger.next;
        noted->previous = &d->ledger;
        noted->next->previous = noted;
        d->ledger.next = noted;
    }
    return block != NULL ? block + 1 : NULL;
}

static void ledger_free(struct deriving *d)
{
    while (d->ledger.next != &d->ledger) {
        (void)ledger_resize(d, d->ledger.next + 1, 0);
    }
}

static int is_given_up(void *user)
{
    const struct deriving *d = user;
    return umbd_task_stopped(&d->task) != UMB_OK;
}

/* Reads voxels; may be left midway. */
static void derive(void *user)
{
    struct deriving *d = user;
    const struct umb_alloc alloc = {ledger_resize, d};
    struct umb_derive_settings settings = d->request.settings;
    struct umb_derived *derived;
    settings.cancelled = is_given_up;
    settings.cancel_user = d;
    d->status = umb__derive(umbs_entry_asset(d->entry), &settings,
                            settings.cascades.count > 0 ? &d->request.view : NULL, &alloc, &derived,
                            &d->error);
    if (d->status == UMB_OK) {
        d->status = umb_derived_ktx2(derived, &d->file, &d->size, &d->error);
    } /* the ledger frees what was derived */
}

static enum umb_status make_messages(struct deriving *d, struct umb_error *error)
{
    struct umbw_region_reply reply = {.file_bytes = d->size};
    enum umb_status status = UMB_OK;
    memcpy(reply.asset_id, umbs_entry_item(d->entry)->id, UMB_ID_BYTES);
    for (size_t at = 0; at < d->size && status == UMB_OK; at += reply.data_size) {
        reply.data = d->file + at;
        reply.data_size = d->size - at < PIECE_BYTES ? d->size - at : PIECE_BYTES;
        status = umbw_encode_region_reply(&reply, &d->messages, error);
    }
    return status;
}

/* Derives the maps on a worker's thread. It is the `run` of a task with one record. */
static enum umb_status work(struct umbd_task *task, size_t first, size_t count,
                            struct umbd_slice_result *result)
{
    (void)first;
    (void)count;
    struct deriving *d = (struct deriving *)task;
    enum umb_status status = umbs_entry_read(d->entry, derive, d, &result->error);
    if (status == UMB_OK && d->status != UMB_OK) {
        result->error = d->error;
        status = umbd_task_result(task, d->status, &result->error);
    }
    if (status == UMB_OK) {
        status = make_messages(d, &result->error);
    }
    ledger_free(d);
    return status;
}

static void free_deriving(struct umbd_task *task)
{
    struct deriving *d = (struct deriving *)task;
    umbs_entry_release(d->entry);
    umbw_buffer_finish(&d->messages);
    free(d);
}

static uint64_t map_count(const struct deriving *d)
{
    return d->request.settings.cascades.count > 0 ? d->request.settings.cascades.count : 1;
}

/* Checks the number of texels against the server's limit for one request. The core limits the
 * sides. */
static enum umb_status check_texels(const struct umbd_call *call, const struct deriving *d,
                                    uint64_t *texels, struct umb_error *error)
{
    const struct umb_derive_settings *settings = &d->request.settings;
    const uint64_t limit = call->server->options.max_points;
    *texels = (uint64_t)settings->width * settings->height; /* below 2^64: both are 32 bits */
    if (*texels > limit / map_count(d)) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "width, height: %u x %u texels of %llu maps, the limit is %llu together",
                        settings->width, settings->height, (unsigned long long)map_count(d),
                        (unsigned long long)limit);
    }
    *texels *= map_count(d);
    *texels += settings->match_contrast ? SEAM_TEXELS * (map_count(d) - 1) : 0;
    return UMB_OK;
}

static void answer(struct umbd_call *call, struct umbd_task *task)
{
    struct deriving *d = (struct deriving *)task;
    if (task->status != UMB_OK) {
        umbd_call_fail_status(call, task->status, &task->error);
    } else if (umbd_call_charge(call, d->messages.size)) {
        umbd_call_reply(call, &d->messages);
        umbd_call_finish(call);
    }
}

/* Reads the request, and finds the version that answers it. */
static enum umb_status ready(struct umbd_call *call, struct deriving *d, uint64_t *texels,
                             struct umb_error *error)
{
    UMB__TRY(umbw_decode_derive_request(call->message, call->message_size, &d->request, error));
    UMB__TRY(umbd_call_acquire(call, d->request.asset, &d->entry, error));
    return check_texels(call, d, texels, error);
}

/* Submits the task. Returns 0 after failing the call. */
static int submit(struct umbd_call *call, struct deriving *d)
{
    uint64_t texels = 0;
    if (!umbd_call_ok(call, ready(call, d, &texels, umbd_call_error(call)))) {
        return 0;
    }
    /* The file, and half of it as messages. */
    const size_t bytes = (size_t)(umb_derive_bytes(&d->request.settings) * 3 / 2);
    d->task.turns = texels / TURN_TEXELS;
    return umbd_call_take_points(call, UMBD_CALL_POINTS + texels) &&
           umbd_call_charge(call, call->charged + bytes) &&
           umbd_call_ok(call, umbd_call_send_task(call, &d->task, bytes, umbd_call_error(call)));
}

void umbd_derive_serve(struct umbd_call *call)
{
    struct deriving *d = calloc(1, sizeof *d);
    if (d == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    d->ledger.next = d->ledger.previous = &d->ledger;
    d->task.run = work;
    d->task.answer = answer;
    d->task.free = free_deriving;
    d->task.count = d->task.slice = 1;
    if (!submit(call, d)) {
        free_deriving(&d->task);
    }
}
