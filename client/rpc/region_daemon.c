/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A daemon as a region's source: Regions.Stream calls, several at once over the client's one
 * connection, so that a round takes one round trip. Ranges are gathered into requests of at most
 * REQUEST_BYTES. Replies are written to their places in one block, which is handed over in order.
 */
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "rpc_client.h"
#include "umbrage/region.h"
#include "wire/regions.h"

enum {
    REQUEST_BYTES = 256 << 10, /* Small, so that the first pages of a round do not wait for the
                                  last */
    AT_ONCE = 8,               /* Calls under way: 2 MiB, more than a link holds */
};

struct daemon_source {
    struct umb_client *client;
    char asset[UMBW_ASSET_NAME_MAX + 1];
    bool has_id; /* True once `id` is known from the asset's first answer. All later reads must be
                    of the asset with this id */
    uint8_t id[UMB_ID_BYTES];
    pthread_mutex_t lock;
    pthread_cond_t changed;
};

/* A read under way. */
struct gathering {
    struct daemon_source *source;
    uint8_t *bytes; /* Bytes of all ranges, contiguous */
    size_t under_way;
    enum umb_status status; /* first failure */
    struct umb_error error;
};

/* A call, and the place of its answer. */
struct gather_call {
    struct gathering *gathering;
    struct umbw_region_request request;
    uint8_t *place;
    size_t wanted, got;
};

static enum umb_status take_reply(struct gather_call *call, const uint8_t *message, size_t size,
                                  struct umb_error *error)
{
    struct daemon_source *source = call->gathering->source;
    struct umbw_region_reply reply;
    enum umb_status status = umbw_decode_region_reply(message, size, &reply, error);
    if (status != UMB_OK) {
        return umb_fail(error, UMB_E_PROTOCOL, "region: the server's reply is no RegionReply");
    }
    if (reply.data_size > call->wanted) {
        return umb_fail(error, UMB_E_PROTOCOL, "region: %zu bytes came, %zu were asked for",
                        reply.data_size, call->wanted);
    }
    if (source->has_id && memcmp(source->id, reply.asset_id, UMB_ID_BYTES) != 0) {
        return umb_fail(error, UMB_E_STATE, "region: '%.100s' is another asset now", source->asset);
    }
    memcpy(source->id, reply.asset_id, UMB_ID_BYTES);
    source->has_id = true;
    if (reply.data_size > 0) { /* data is NULL then */
        memcpy(call->place, reply.data, reply.data_size);
    }
    call->got = reply.data_size;
    return UMB_OK;
}

/* On the client's thread. */
static void on_reply(void *user, enum umb_status status, const uint8_t *message, size_t size,
                     const struct umb_error *error)
{
    struct gather_call *call = user;
    struct gathering *g = call->gathering;
    struct umb_error own = {0};
    pthread_mutex_lock(&g->source->lock);
    if (status == UMB_OK) {
        status = take_reply(call, message, size, &own);
        error = &own;
    }
    if (status != UMB_OK && g->status == UMB_OK) {
        g->status = status;
        g->error = *error;
    }
    g->under_way--;
    pthread_cond_signal(&g->source->changed);
    pthread_mutex_unlock(&g->source->lock);
}

/* Returns an upper bound for the number of calls that `cut` makes. Each call but the last is full:
 * it has REQUEST_BYTES bytes or UMBW_RANGES_MAX pieces of ranges. */
static size_t most_calls(size_t ranges, uint64_t total)
{
    const size_t full = (size_t)(total / REQUEST_BYTES);
    return full + (ranges + full) / UMBW_RANGES_MAX + 1;
}

/* Splits the ranges into calls. Returns their number. */
static size_t cut(const struct umb_range *ranges, size_t count, struct gathering *g,
                  struct gather_call *calls)
{
    struct gather_call *call = NULL;
    uint8_t *place = g->bytes;
    for (size_t i = 0; i < count; i++) {
        for (uint64_t at = 0, length; at < ranges[i].length; at += length) {
            if (call == NULL || call->wanted == REQUEST_BYTES ||
                call->request.count == UMBW_RANGES_MAX) {
                call = call == NULL ? calls : call + 1;
                *call = (struct gather_call){.gathering = g, .place = place};
                memcpy(call->request.asset, g->source->asset, sizeof g->source->asset);
            }
            const uint64_t room = REQUEST_BYTES - call->wanted, left = ranges[i].length - at;
            length = left < room ? left : room;
            call->request.ranges[call->request.count++] =
                (struct umb_range){ranges[i].offset + at, length};
            call->wanted += (size_t)length;
            place += length;
        }
    }
    return call == NULL ? 0 : (size_t)(call - calls) + 1;
}

static enum umb_status start(struct gather_call *call, struct umb_error *error)
{
    struct gathering *g = call->gathering;
    struct umbw_buffer body = {NULL, 0, 0};
    enum umb_status status = umbw_encode_region_request(&call->request, &body, error);
    if (status != UMB_OK) {
        umbw_buffer_finish(&body);
        return status;
    }
    pthread_mutex_lock(&g->source->lock);
    g->under_way++;
    pthread_mutex_unlock(&g->source->lock);
    status = umb__call_start(g->source->client,
                             &(struct umb__call_plan){.path = UMBW_PATH_REGIONS_STREAM}, &body,
                             on_reply, call, error);
    if (status != UMB_OK) {
        pthread_mutex_lock(&g->source->lock);
        g->under_way--;
        pthread_mutex_unlock(&g->source->lock);
    }
    return status;
}

/* Waits until fewer than `most` calls are under way; returns the first failure. */
static enum umb_status wait_below(struct gathering *g, size_t most, struct umb_error *error)
{
    pthread_mutex_lock(&g->source->lock);
    while (g->under_way >= most) {
        pthread_cond_wait(&g->source->changed, &g->source->lock);
    }
    const enum umb_status status = g->status;
    pthread_mutex_unlock(&g->source->lock);
    if (status != UMB_OK && error) {
        *error = g->error;
    }
    return status;
}

/* Runs all calls; none is under way when it returns, also on failure. */
static enum umb_status run_calls(struct gathering *g, struct gather_call *calls, size_t count,
                                 struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        status = wait_below(g, AT_ONCE, error);
        if (status == UMB_OK) {
            status = start(&calls[i], error);
        }
    }
    const enum umb_status rest = wait_below(g, 1, status == UMB_OK ? error : NULL);
    return status == UMB_OK ? rest : status;
}

/* Returns how many of the given calls' bytes came, up to the first call that brought fewer than it
 * should. */
static size_t came(const uint8_t *bytes, uint64_t size, const struct gather_call *calls,
                   size_t call_count)
{
    for (size_t i = 0; i < call_count; i++) {
        const uint8_t *end = calls[i].place + calls[i].got;
        if (calls[i].place < bytes + size && bytes < calls[i].place + calls[i].wanted &&
            calls[i].got < calls[i].wanted) {
            return end > bytes ? (size_t)(end - bytes) : 0;
        }
    }
    return (size_t)size;
}

/* Hands the ranges over; the end of the file may cut the last one short. After a failure hands over
 * only the complete ranges, so that the region need not request them again. */
static enum umb_status hand_over(const struct gathering *g, const struct umb_range *ranges,
                                 size_t count, const struct gather_call *calls, size_t call_count,
                                 bool only_whole, umb_range_fn got, void *got_user)
{
    const uint8_t *at = g->bytes;
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        const size_t size = came(at, ranges[i].length, calls, call_count);
        if (!only_whole || size == ranges[i].length) {
            status = got(got_user, i, at, size);
        }
        at += ranges[i].length;
    }
    return status;
}

static enum umb_status read_ranges(void *user, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *got_user, struct umb_error *error)
{
    struct gathering g = {.source = user};
    uint64_t total = 0;
    for (size_t i = 0; i < count; i++) {
        total += ranges[i].length;
    }
    if (pthread_equal(pthread_self(), g.source->client->thread)) {
        return umb_fail(error, UMB_E_STATE, "a blocking call cannot be made from a callback");
    }
    struct gather_call *list = calloc(most_calls(count, total), sizeof *list);
    g.bytes = total < SIZE_MAX ? malloc((size_t)total + 1) : NULL;
    enum umb_status status =
        list && g.bytes ? UMB_OK
                        : umb_fail(error, UMB_E_NO_MEMORY, "region: no memory for %llu bytes",
                                   (unsigned long long)total);
    if (status == UMB_OK) {
        const size_t calls = cut(ranges, count, &g, list);
        status = run_calls(&g, list, calls, error);
        /* After a failure: `got` may write into *error. */
        const struct umb_error first = error ? *error : (struct umb_error){0};
        const enum umb_status handed =
            hand_over(&g, ranges, count, list, calls, status != UMB_OK, got, got_user);
        if (status != UMB_OK && error) {
            *error = first;
        }
        status = status == UMB_OK ? handed : status;
    }
    free(g.bytes);
    free(list);
    return status;
}

enum umb_status umb_region_daemon_open(struct umb_client *client, const char *asset,
                                       struct umb_region_source *source, struct umb_error *error)
{
    *source = (struct umb_region_source){0};
    char name[UMBW_ASSET_NAME_MAX + 1];
    UMB__TRY(umb__asset_take(asset, name, error));
    struct daemon_source *made = malloc(sizeof *made);
    if (!made) {
        return umb_fail(error, UMB_E_NO_MEMORY, "region: out of memory");
    }
    *made = (struct daemon_source){
        .client = client, .lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};
    memcpy(made->asset, name, sizeof made->asset);
    *source = (struct umb_region_source){.read = read_ranges, .user = made};
    return UMB_OK;
}

void umb_region_daemon_close(struct umb_region_source *source)
{
    struct daemon_source *made = source->user;
    if (made) {
        (void)pthread_cond_destroy(&made->changed);
        (void)pthread_mutex_destroy(&made->lock);
        free(made);
        source->user = NULL;
    }
}
