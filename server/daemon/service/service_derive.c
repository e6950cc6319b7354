/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Regions.DeriveMap: shadow maps from an asset, made by one worker. It reads voxels in a file that
 * another process may cut short; the reading is then left midway. So all its memory comes from a
 * ledger, which knows what must be freed.
 */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/call/call_rights.h"
#include "daemon/transport/loop.h"
#include "tool/clock.h"
#include "wire/regions.h"

#define PIECE_BYTES ((size_t)256 << 10) /* bytes of the file in one message */
#define TURN_TEXELS 2048U /* texels of a turn, about a millisecond: 0.5 to 0.9 us a texel */

/* A block of the ledger; its memory follows it, aligned for any type. */
struct block {
    _Alignas(max_align_t) struct block *next;
    struct block *previous;
};

struct deriving {
    struct umbs_entry *entry; /* owned */
    const struct umbd_batch *batch;
    struct umbw_derive_request request;
    struct block ledger; /* head of a ring of the allocated blocks */
    struct umb_error error;
    enum umb_status status;
    const uint8_t *file; /* memory of the ledger */
    size_t size;
    struct umbw_buffer messages; /* the replies, prefixes included */
};

/* Allocator of struct umb_alloc: realloc, recorded. It reads no files, so it is never left
 * midway. */
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
    return atomic_load_explicit(&d->batch->given_up, memory_order_relaxed) ||
           (d->batch->deadline_ns != 0 && umbu_clock_ns() > d->batch->deadline_ns);
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

/* On a worker's thread. */
static enum umb_status work(const struct umbd_batch *batch, size_t first, size_t count,
                            struct umb_error *error)
{
    (void)first; /* there is one record */
    (void)count;
    struct deriving *d = batch->work_user;
    d->batch = batch;
    enum umb_status status = umbs_entry_read(d->entry, derive, d, error);
    if (status == UMB_OK && d->status != UMB_OK) {
        *error = d->error;
        status = d->status;
    }
    if (status == UMB_OK) {
        status = make_messages(d, error);
    }
    ledger_free(d);
    return status;
}

static void free_deriving(void *user)
{
    struct deriving *d = user;
    umbs_entry_release(d->entry);
    umbw_buffer_finish(&d->messages);
    free(d);
}

static uint64_t map_count(const struct deriving *d)
{
    return d->request.settings.cascades.count > 0 ? d->request.settings.cascades.count : 1;
}

/* Checks the size. The core limits the sides; this is the server's limit for one request. */
static enum umb_status check_texels(const struct umbd_call *call, const struct deriving *d,
                                    uint64_t *texels, struct umb_error *error)
{
    const struct umb_derive_settings *settings = &d->request.settings;
    const uint64_t limit = call->conn->loop->daemon->options.max_points;
    *texels = (uint64_t)settings->width * settings->height; /* below 2^64: both are 32 bits */
    if (*texels > limit / map_count(d)) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "width, height: %u x %u texels of %llu maps, the limit is %llu together",
                        settings->width, settings->height, (unsigned long long)map_count(d),
                        (unsigned long long)limit);
    }
    *texels *= map_count(d);
    return UMB_OK;
}

void umbd_service_derive(struct umbd_call *call)
{
    struct umb_error error = {0};
    struct deriving *d = calloc(1, sizeof *d);
    if (d == NULL) {
        umbd_call_fail_status(call, UMB_E_NO_MEMORY, NULL);
        return;
    }
    d->ledger.next = d->ledger.previous = &d->ledger;
    uint64_t texels = 0;
    enum umb_status status =
        umbw_decode_derive_request(call->message, call->message_size, &d->request, &error);
    if (status == UMB_OK) {
        status = umbd_call_acquire(call, d->request.asset, &d->entry, &error);
    }
    if (status == UMB_OK) {
        status = check_texels(call, d, &texels, &error);
    }
    if (status != UMB_OK) {
        free_deriving(d);
        umbd_call_fail_status(call, status, &error);
        return;
    }
    /* The file, and half of it as messages. */
    const uint64_t bytes = umb_derive_bytes(&d->request.settings) * 3 / 2;
    if (!umbd_call_take_points(call, UMBD_CALL_POINTS + texels) ||
        !umbd_call_charge(call, call->charged + (size_t)bytes)) {
        free_deriving(d);
        return;
    }
    const struct umbd_work job = {.run = work,
                                  .free = free_deriving,
                                  .user = d,
                                  .count = 1,
                                  .slice = 1,
                                  .turns = texels / TURN_TEXELS,
                                  .bytes = (size_t)bytes};
    status = umbd_call_send_work(call, &job, &error);
    if (status != UMB_OK) {
        umbd_call_fail_status(call, status, &error);
    }
}

void umbd_service_derive_done(struct umbd_call *call, struct umbd_batch *batch)
{
    struct deriving *d = batch->work_user;
    if (batch->status != UMB_OK) {
        umbd_call_fail_status(call, batch->status, &batch->error);
        return;
    }
    if (umbd_call_charge(call, d->messages.size)) {
        umbd_call_reply(call, &d->messages);
        umbd_call_finish(call);
    }
}
