/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Packed assets over HTTP/1.1: GET and HEAD of /assets/NAME.umb and /assets/by-id/ID.umb, and the
 * preflight of browsers. Answers are the bytes of the packed file, whole or ranges of it; workers
 * read the file, because reading may block on the disk (web_body.h).
 *
 * The order of the checks decides what a caller without rights learns: nothing about any asset.
 */
#include "daemon/call/call.h"
#include "daemon/service/services.h"
#include "daemon/service/web_body.h"
#include "daemon/service/web_parts.h"
#include "net/http1_fields.h"

#include <stdio.h>
#include <string.h>

#define BYTES_A_POINT 16 /* as of Regions.Stream */
#define TAG_SIZE      (UMB_ID_TEXT_SIZE + 2)

/* Seconds for which a cache may use a reply without asking: of a name, which may stand for another
 * version soon, and of an id, whose bytes never change. */
#define NAME_SECONDS 5
#define ID_SECONDS   31536000

/* One request for an asset. */
struct asset_request {
    struct umbd_call *call;
    struct umbd_web_route route;
    struct umbs_entry *entry; /* Owned until a body takes it */
    uint64_t size;            /* Bytes of the packed file */
    char tag[TAG_SIZE];
    char fields[UMBD_WEB_ASSET_BYTES];
};

/* Refuses a request that any caller may send. It is charged to the rate of calls without rights. */
static void refuse(struct umbd_call *call, int status, const char *fields, const char *text)
{
    umbd_web_reply(call, status, fields, text);
    umbd_call_refused(call);
}

/*
 * Returns 1 if the request may be for this daemon. Without tokens a daemon on loopback serves every
 * process of the machine, and a web page reaches it under its own host name by DNS rebinding. So
 * plain HTTP then needs a Host that is this machine, unless the operator serves everyone.
 */
static int is_meant_for_us(const struct umbd_call *call)
{
    const struct umbn_http1_text host = call->web->request->host;
    const struct umbd_options *options = &call->server->options;
    return call->backend->tokens != NULL || options->without_tokens || call->conn->tls != NULL ||
           umbd_conn_is_local(call->conn) || host.bytes == NULL || umbn_host_is_local(host);
}

/* Answers a browser that asks whether a page may send a request. It carries no token. */
static void answer_preflight(struct umbd_call *call)
{
    static const char fields[] =
        "Allow: GET, HEAD, OPTIONS\r\n"
        "Access-Control-Allow-Methods: GET, HEAD\r\n"
        "Access-Control-Allow-Headers: Authorization, If-Match, If-None-Match, If-Range, Range\r\n"
        "Access-Control-Max-Age: 86400\r\n";
    if (umbd_call_take_open(call)) {
        umbd_web_reply(call, 204,
                       call->web->origin != NULL ? fields : "Allow: GET, HEAD, OPTIONS\r\n", "");
    }
}

/* Answers requests that are for no asset. Returns 0 if this one was. */
static int answer_others(struct umbd_call *call, struct umbd_web_route *route)
{
    const struct umbn_http1_request *request = call->web->request;
    if (request->refusal != 0) {
        refuse(call, request->refusal, "", request->reason);
    } else if (!is_meant_for_us(call)) {
        refuse(call, 421, "", "Host: is not this machine");
    } else if (request->method == UMBN_HTTP1_OPTIONS) {
        answer_preflight(call);
    } else if (request->method == UMBN_HTTP1_OTHER) {
        refuse(call, 405, "Allow: GET, HEAD, OPTIONS\r\n",
               "only GET, HEAD and OPTIONS are allowed");
    } else if (!umbd_web_route(request->path, route)) {
        refuse(call, 404, "", "no such path: try /assets/NAME.umb or /assets/by-id/ID.umb");
    } else {
        return 0;
    }
    return 1;
}

/* Checks rights, takes the price of the call and finds the asset. Returns 0 after a failure. */
static int acquire(struct asset_request *asset)
{
    struct umbd_call *call = asset->call;
    if (!umbd_call_is_allowed(call)) {
        umbd_call_refused(call);
        return 0;
    }
    umbd_call_admit(call);
    if (call->responded ||
        !umbd_call_ok(call, umbd_call_acquire(call, asset->route.asset, &asset->entry,
                                              umbd_call_error(call)))) {
        return 0;
    }
    const struct umbs_store_item *item = umbs_entry_item(asset->entry);
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(item->id, id);
    (void)snprintf(asset->tag, sizeof asset->tag, "\"%s\"", id);
    asset->size = item->packed_bytes;
    return 1;
}

/* Writes the fields of every reply that shows the asset. Shared caches may keep replies only if
 * every caller may have them. */
static void describe(struct asset_request *asset)
{
    const char *who = asset->call->backend->tokens != NULL ? "private" : "public";
    (void)snprintf(asset->fields, sizeof asset->fields,
                   "ETag: %s\r\nAccept-Ranges: bytes\r\nCache-Control: %s, max-age=%d, %s\r\n",
                   asset->tag, who, asset->route.by_id ? ID_SECONDS : NAME_SECONDS,
                   asset->route.by_id ? "immutable" : "must-revalidate");
}

/* Answers a request whose conditions do not hold. Returns 0 if they do. */
static int answer_conditions(struct asset_request *asset)
{
    struct umbd_call *call = asset->call;
    const struct umbn_http1_request *request = call->web->request;
    if (request->if_match.bytes != NULL && !umbn_tags_have(request->if_match, asset->tag, 0)) {
        umbd_web_reply(call, 412, "", "If-Match: the asset has another id");
        return 1;
    }
    if (request->if_none_match.bytes != NULL &&
        umbn_tags_have(request->if_none_match, asset->tag, 1)) {
        describe(asset);
        umbd_web_reply(call, 304, asset->fields, "");
        return 1;
    }
    return 0;
}

static void refuse_ranges(struct asset_request *asset, enum umbn_ranges_result result)
{
    static const char *const reasons[] = {
        [UMBN_RANGES_BEYOND] = "Range: begins behind the end of the asset",
        [UMBN_RANGES_MALFORMED] = "Range: give bytes=FIRST-LAST, or several with commas",
        [UMBN_RANGES_TOO_MANY] = "Range: more than 128 ranges",
        [UMBN_RANGES_OVERLAP] = "Range: two ranges overlap",
    };
    char fields[64];
    (void)snprintf(fields, sizeof fields, "Content-Range: bytes */%llu\r\n",
                   (unsigned long long)asset->size);
    umbd_web_reply(asset->call, 416, fields, reasons[result]);
}

/* Finds the ranges that the request wants. Returns 0 after refusing them; *count is 0 for the whole
 * file. RFC 9110 defines ranges for GET only. */
static int find_ranges(struct asset_request *asset, struct umb_range *ranges, size_t *count)
{
    const struct umbn_http1_request *request = asset->call->web->request;
    *count = 0;
    if (request->range.bytes == NULL || request->method != UMBN_HTTP1_GET ||
        (request->if_range.bytes != NULL && !umbn_http1_is(request->if_range, asset->tag))) {
        return 1;
    }
    const enum umbn_ranges_result result =
        umbn_ranges_parse(request->range, asset->size, ranges, count);
    if (result != UMBN_RANGES_OK && result != UMBN_RANGES_NONE) {
        refuse_ranges(asset, result);
        return 0;
    }
    return 1;
}

/* Answers with the file or its ranges. */
static void answer_bytes(struct asset_request *asset)
{
    struct umbd_call *call = asset->call;
    struct umb_range ranges[UMBN_RANGES_MAX];
    size_t count;
    if (!find_ranges(asset, ranges, &count)) {
        return;
    }
    describe(asset);
    if (call->web->is_head) {
        char head[UMBD_WEB_HEAD_BYTES];
        char fields[UMBD_WEB_FIELDS_BYTES];
        (void)snprintf(fields, sizeof fields, "%s" UMBD_WEB_TYPE, asset->fields);
        const size_t size = umbd_web_head(call, 200, asset->size, fields, head);
        umbd_web_send(call, head, size);
        return;
    }
    const uint64_t bytes = umbd_web_body_begin(call, &asset->entry, asset->fields, ranges, count);
    if (bytes > 0) {
        umbd_call_owe_points(call, bytes / BYTES_A_POINT);
    }
}

void umbd_web_serve(struct umbd_call *call)
{
    struct asset_request asset = {.call = call};
    if (answer_others(call, &asset.route)) {
        return;
    }
    if (acquire(&asset) && !answer_conditions(&asset)) {
        answer_bytes(&asset);
    }
    umbs_entry_release(asset.entry);
}
