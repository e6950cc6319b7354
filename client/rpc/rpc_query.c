/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.Query, asynchronous and blocking. */
#include "base/try.h"
#include "rpc_client.h"
#include "base/reserved.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A query until its reply. */
struct query {
    size_t value_bytes;  /* Expected bytes of the answers */
    bool pack;           /* they may come packed */
    const uint8_t *base; /* [value_bytes] answers that they may be packed against; NULL: none */
    void *values;        /* [value_bytes] place of the answers; NULL: they stay in the message */
    struct umb_client_query_reply reply;
};

/* A query without a waiting thread. */
struct query_call {
    struct query query;
    umb_client_query_fn done;
    void *user;
    uint8_t base[]; /* [value_bytes] copy of the request's */
};

/* Returns the number of points of a request, or of pixels of its picture. */
static size_t point_count(const struct umb_client_query_request *request)
{
    return request->picture ? (size_t)request->picture->width * request->picture->height
                            : request->points.count;
}

static size_t value_bytes_of(const struct umb_client_query_request *request)
{
    return umb_answer_bytes(request->settings.format, point_count(request));
}

/* Encodes a request after checking it. */
static enum umb_status encode(const struct umb_client_query_request *request,
                              struct umbw_buffer *body, struct umb_error *error)
{
    if (UMB__UNKNOWN(request, "request", error) ||
        UMB__UNKNOWN(&request->settings, "settings", error) ||
        UMB__UNKNOWN(&request->dial, "dial", error) ||
        UMB__UNKNOWN(&request->points, "points", error) ||
        (request->picture && UMB__UNKNOWN(request->picture, "picture", error))) {
        return UMB_E_ARGUMENT;
    }
    struct umbw_query_request wire = {
        .settings = request->settings,
        .points = request->points,
        .want_stats = request->want_stats,
        .dial = request->dial,
        .pack = request->pack,
    };
    if (request->picture) {
        wire.has_picture = 1;
        wire.picture = *request->picture;
        wire.points.count = point_count(request);
    }
    if (request->pack && request->base) {
        wire.base_mark = umb_picture_mark(request->base, value_bytes_of(request));
    }
    UMB__TRY(umb__asset_take(request->asset, wire.asset, error));
    if (request->settings.footprint_m != 0 &&
        !umb_filter_get_info(request->settings.filter)->has_footprints) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "footprint_m: %g; the protocol has windows of a number of taps only",
                        request->settings.footprint_m);
    }
    enum umb_status status = umbw_encode_query_request(&wire, body, error);
    if (status != UMB_OK) {
        umbw_buffer_finish(body);
    }
    return status;
}

/* Unpacks answers into their place. */
static enum umb_status unpack(const struct umbw_query_reply *wire, struct query *query,
                              struct umb_error *error)
{
    const bool changes = wire->packing == UMBW_PACKING_CHANGES;
    if (!query->pack || !query->values || (changes && !query->base)) {
        return umb_fail(error, UMB_E_PROTOCOL, "packing: %s",
                        changes ? "changes of answers that are not here" : "was not asked for");
    }
    const enum umb_status status =
        umb_picture_unpack(wire->visibility, wire->visibility_bytes, changes ? query->base : NULL,
                           query->values, query->value_bytes, error);
    query->reply.packed_bytes = wire->visibility_bytes;
    query->reply.changes_only = changes;
    return status != UMB_E_CORRUPT ? status
                                   : umb_fail(error, UMB_E_PROTOCOL,
                                              "visibility: %zu packed bytes are not %zu answers'",
                                              wire->visibility_bytes, query->value_bytes);
}

/* Stores the answers at their destination, and checks their number. */
static enum umb_status take_answers(const struct umbw_query_reply *wire, struct query *query,
                                    struct umb_error *error)
{
    query->reply.value_bytes = query->value_bytes;
    query->reply.values = query->values != NULL ? query->values : wire->visibility;
    if (wire->packing != UMBW_PACKING_PLAIN) {
        return unpack(wire, query, error);
    }
    if (wire->visibility_bytes != query->value_bytes) {
        return umb_fail(error, UMB_E_PROTOCOL, "visibility: length is %zu bytes, must be %zu",
                        wire->visibility_bytes, query->value_bytes);
    }
    if (query->values != NULL && query->value_bytes > 0) {
        memcpy(query->values, wire->visibility, query->value_bytes);
    }
    return UMB_OK;
}

static enum umb_status decode(void *out, const uint8_t *message, size_t size,
                              struct umb_error *error)
{
    struct query *query = out;
    struct umb_client_query_reply *reply = &query->reply;
    struct umbw_query_reply wire;
    memset(reply, 0, sizeof *reply);
    UMB__TRY(umbw_decode_query_reply(message, size, &wire, error));
    UMB__TRY(take_answers(&wire, query, error));
    memcpy(reply->asset_id, wire.asset_id, sizeof reply->asset_id);
    reply->stats = wire.stats;
    reply->nanoseconds = wire.nanoseconds;
    reply->level = wire.level;
    reply->taps = wire.taps;
    reply->bound_m = wire.bound_m;
    reply->visibility_error = wire.visibility_error;
    reply->lines = wire.lines;
    reply->expected_ns = wire.expected_ns;
    return UMB_OK;
}

static struct query query_of(const struct umb_client_query_request *request)
{
    return (struct query){.value_bytes = value_bytes_of(request),
                          .pack = request->pack != 0,
                          .base = request->pack ? request->base : NULL};
}

/* Starts a query as a call of its own, or over its stream. */
static struct umb__call_plan plan_of(const struct umb_client_query_request *request)
{
    return (struct umb__call_plan){
        .path = UMBW_PATH_QUERY,
        .asset = request->asset,
        .safe = true,
        .timeout_ms = request->timeout_ms,
        .stream = request->stream,
    };
}

static void on_query_done(void *user, enum umb_status status, const uint8_t *message, size_t size,
                          const struct umb_error *error)
{
    struct query_call *call = user;
    struct query *query = &call->query;
    struct umb_error detail = {.status = UMB_OK};
    struct umb_error fault;
    if (status == UMB_OK) {
        query->values = query->pack ? malloc(query->value_bytes + 1) : NULL;
        status = query->pack && query->values == NULL
                     ? umb_fail(&detail, UMB_E_NO_MEMORY, "out of memory for the answers")
                     : decode(query, message, size, &detail);
        if (status != UMB_OK) {
            status = umb__reply_fault(status, &detail, &fault);
            error = &fault;
        }
    }
    call->done(call->user, status, status == UMB_OK ? &query->reply : NULL,
               status == UMB_OK ? NULL : error);
    free(query->values);
    free(call);
}

enum umb_status umb_client_query_start(struct umb_client *client,
                                       const struct umb_client_query_request *request,
                                       umb_client_query_fn done, void *user, uint64_t *number,
                                       struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    UMB__TRY(encode(request, &body, error));
    const struct query query = query_of(request);
    const size_t base_bytes = query.base != NULL ? query.value_bytes : 0;
    struct query_call *call = malloc(sizeof *call + base_bytes);
    if (call == NULL) {
        umbw_buffer_finish(&body);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a call");
    }
    *call = (struct query_call){.query = query, .done = done, .user = user};
    if (query.base != NULL) {
        memcpy(call->base, query.base, base_bytes);
        call->query.base = call->base;
    }
    struct umb__call_plan plan = plan_of(request);
    plan.number = number;
    enum umb_status status = umb__call_start(client, &plan, &body, on_query_done, call, error);
    if (status != UMB_OK) {
        free(call);
    }
    return status;
}

enum umb_status umb_client_query(struct umb_client *client,
                                 const struct umb_client_query_request *request, void *values,
                                 struct umb_client_query_reply *reply, struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    if (reply != NULL) {
        memset(reply, 0, sizeof *reply);
    }
    if (values != NULL && values == request->base) {
        return umb_fail(error, UMB_E_ARGUMENT, "base: overlaps the memory of the answers");
    }
    UMB__TRY(encode(request, &body, error));
    struct query query = query_of(request);
    query.values = values;
    const struct umb__call_plan plan = plan_of(request);
    UMB__TRY(umb__call_wait(client, &plan, &body, decode, &query, error));
    if (reply != NULL) {
        *reply = query.reply;
        reply->values = values;
    }
    return UMB_OK;
}
