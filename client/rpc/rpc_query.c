/* SPDX-License-Identifier: Apache-2.0 */
/* Shadows.Query, asynchronous and blocking. */
#include "base/try.h"
#include "rpc_client.h"
#include "base/reserved.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* State of an asynchronous query until its reply. */
struct query_call {
    umb_client_query_fn done;
    void *user;
    size_t value_bytes; /* Expected bytes of the answers */
    int pack;           /* they may come packed */
    uint8_t *base;      /* [value_bytes] owned; NULL: none */
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

/* Destination of a reply's answers. */
struct answer_place {
    size_t value_bytes;  /* that they must have */
    const uint8_t *base; /* [value_bytes], base that they may be packed against; NULL: none */
    void *values;        /* [value_bytes] for packed answers; NULL: the request asked for none */
};

/* Unpacks answers into their destination. */
static enum umb_status unpack(const struct umbw_query_reply *wire, const struct answer_place *place,
                              struct umb_client_query_reply *reply, struct umb_error *error)
{
    const bool changes = wire->packing == UMBW_PACKING_CHANGES;
    if (!place->values || (changes && !place->base)) {
        return umb_fail(error, UMB_E_PROTOCOL, "packing: %s",
                        changes ? "changes of answers that are not here" : "was not asked for");
    }
    enum umb_status status =
        umb_picture_unpack(wire->visibility, wire->visibility_bytes, changes ? place->base : NULL,
                           place->values, place->value_bytes, error);
    if (status == UMB_E_CORRUPT) {
        return umb_fail(error, UMB_E_PROTOCOL, "visibility: %zu packed bytes are not %zu answers'",
                        wire->visibility_bytes, place->value_bytes);
    }
    reply->values = place->values;
    reply->packed_bytes = wire->visibility_bytes;
    reply->changes_only = changes;
    return status;
}

/* Reads a reply and checks its number of answers. */
static enum umb_status decode(const uint8_t *message, size_t size, const struct answer_place *place,
                              struct umb_client_query_reply *reply, struct umb_error *error)
{
    struct umbw_query_reply wire;
    enum umb_status status = umbw_decode_query_reply(message, size, &wire, error);
    memset(reply, 0, sizeof *reply);
    if (status == UMB_OK && wire.packing != UMBW_PACKING_PLAIN) {
        status = unpack(&wire, place, reply, error);
    } else if (status == UMB_OK && wire.visibility_bytes != place->value_bytes) {
        status = umb_fail(error, UMB_E_PROTOCOL, "visibility: length is %zu bytes, must be %zu",
                          wire.visibility_bytes, place->value_bytes);
    } else {
        reply->values = wire.visibility;
    }
    if (status != UMB_OK) {
        return status;
    }
    reply->value_bytes = place->value_bytes;
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
    struct umb_client_query_reply reply;
    struct umb_error detail = {.status = UMB_OK};
    struct umb_error fault;
    uint8_t *values = NULL;
    if (status == UMB_OK) {
        values = call->pack ? malloc(call->value_bytes + 1) : NULL;
        const struct answer_place place = {call->value_bytes, call->base, values};
        status = call->pack && !values
                     ? umb_fail(&detail, UMB_E_NO_MEMORY, "out of memory for the answers")
                     : decode(message, size, &place, &reply, &detail);
        if (status != UMB_OK) {
            status = umb__reply_fault(status, &detail, &fault);
            error = &fault;
        }
    }
    call->done(call->user, status, status == UMB_OK ? &reply : NULL,
               status == UMB_OK ? NULL : error);
    free(values);
    free(call->base);
    free(call);
}

/* Makes the state of a query until its reply. NULL: out of memory. */
static struct query_call *make_call(const struct umb_client_query_request *request,
                                    umb_client_query_fn done, void *user)
{
    struct query_call *call = calloc(1, sizeof *call);
    if (call == NULL) {
        return NULL;
    }
    call->done = done;
    call->user = user;
    call->pack = request->pack;
    call->value_bytes = value_bytes_of(request);
    if (request->pack && request->base) {
        call->base = malloc(call->value_bytes + 1);
        if (call->base == NULL) {
            free(call);
            return NULL;
        }
        memcpy(call->base, request->base, call->value_bytes);
    }
    return call;
}

enum umb_status umb_client_query_start(struct umb_client *client,
                                       const struct umb_client_query_request *request,
                                       umb_client_query_fn done, void *user, uint64_t *number,
                                       struct umb_error *error)
{
    struct umbw_buffer body = {NULL, 0, 0};
    UMB__TRY(encode(request, &body, error));
    struct query_call *call = make_call(request, done, user);
    if (call == NULL) {
        umbw_buffer_finish(&body);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a call");
    }
    struct umb__call_plan plan = plan_of(request);
    plan.number = number;
    enum umb_status status = umb__call_start(client, &plan, &body, on_query_done, call, error);
    if (status != UMB_OK) {
        free(call->base);
        free(call);
    }
    return status;
}

/* Destination of a blocking query's reply. */
struct query_target {
    void *values;
    struct answer_place place;
    struct umb_client_query_reply *reply; /* may be NULL */
};

static enum umb_status decode_to_target(void *out, const uint8_t *message, size_t size,
                                        struct umb_error *error)
{
    struct query_target *target = out;
    struct umb_client_query_reply reply;
    UMB__TRY(decode(message, size, &target->place, &reply, error));
    if (reply.value_bytes > 0 && reply.values != target->values) {
        memcpy(target->values, reply.values, reply.value_bytes);
    }
    if (target->reply != NULL) {
        *target->reply = reply;
        target->reply->values = target->values;
    }
    return UMB_OK;
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
    struct query_target target = {
        .values = values,
        .place = {value_bytes_of(request), request->pack ? request->base : NULL,
                  request->pack ? values : NULL},
        .reply = reply,
    };
    const struct umb__call_plan plan = plan_of(request);
    return umb__call_wait(client, &plan, &body, decode_to_target, &target, error);
}
