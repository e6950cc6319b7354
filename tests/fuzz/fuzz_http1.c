/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the daemon reads of an HTTP/1.1 request: the end of its head, the head, paths, ranges and
 * entity tags. The first byte is the size of the file for the ranges; the rest is the request.
 *
 * Properties: the end is found wherever the bytes are split; an accepted head has one line end, no
 * body and no control byte, and its texts lie inside it; accepted ranges are inside the file and
 * have no byte in common; a path that names an asset is written in one way only.
 */
#include <string.h>

#include "daemon/service/web_parts.h"
#include "net/http1_fields.h"
#include "net/http1_request.h"
#include "fuzz.h"

static void check_split(const uint8_t *bytes, size_t size)
{
    const size_t end = umbn_http1_head_size(bytes, size, 0);
    for (size_t have = 0, seen = 0; have <= size; seen = have, have += 1 + have % 7) {
        const size_t found = umbn_http1_head_size(bytes, have, seen);
        FUZZ_DEMAND(found == (end != 0 && end <= have ? end : 0) || (end != 0 && end <= seen));
        if (found != 0) {
            break;
        }
    }
    FUZZ_DEMAND(end == 0 || (end >= 4 && memcmp(bytes + end - 4, "\r\n\r\n", 4) == 0));
}

static void check_inside(struct umbn_http1_text text, const uint8_t *head, size_t size)
{
    const char *begin = (const char *)head;
    FUZZ_DEMAND(text.bytes == NULL ||
                (text.bytes >= begin && text.bytes + text.size <= begin + size));
}

static void check_ranges(struct umbn_http1_text field, uint64_t size)
{
    struct umb_range ranges[UMBN_RANGES_MAX];
    size_t count = 0;
    uint64_t bytes = 0;
    const enum umbn_ranges_result result = umbn_ranges_parse(field, size, ranges, &count);
    FUZZ_DEMAND(count <= UMBN_RANGES_MAX && (result != UMBN_RANGES_OK || count > 0));
    for (size_t i = 0; i < count; i++) {
        FUZZ_DEMAND(ranges[i].length > 0 && ranges[i].length <= size &&
                    ranges[i].offset <= size - ranges[i].length);
        bytes += ranges[i].length;
    }
    FUZZ_DEMAND(result != UMBN_RANGES_OK || bytes <= size); /* no two have a byte in common */
}

static void check_path(struct umbn_http1_text path)
{
    struct umbd_web_route route;
    char again[sizeof route.asset + 32];
    if (umbd_web_route(path, &route)) {
        (void)snprintf(again, sizeof again, "/assets/%s%s.umb", route.by_id ? "by-id/" : "",
                       route.asset);
        FUZZ_DEMAND(umbn_http1_is(path, again));
    }
}

static void check_head(const uint8_t *head, size_t size, uint64_t file_size)
{
    struct umbn_http1_request request;
    umbn_http1_parse(head, size, &request);
    if (request.refusal != 0) {
        FUZZ_DEMAND(request.reason != NULL && !request.keeps_open && request.refusal >= 400);
        return;
    }
    for (size_t i = 0; i < size; i++) {
        FUZZ_DEMAND((head[i] >= 0x20 && head[i] != 0x7F) || head[i] == '\t' ||
                    (head[i] == '\r' && i + 1 < size && head[i + 1] == '\n') ||
                    (head[i] == '\n' && i > 0 && head[i - 1] == '\r'));
    }
    const struct umbn_http1_text texts[] = {
        request.path,     request.host,          request.authorization, request.range,
        request.if_range, request.if_none_match, request.if_match,      request.origin};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        check_inside(texts[i], head, size);
        if (texts[i].bytes != NULL) {
            check_ranges(texts[i], file_size);
            const int strongly = umbn_tags_have(texts[i], "\"a\"", 0);
            FUZZ_DEMAND(strongly <= umbn_tags_have(texts[i], "\"a\"", 1));
        }
    }
    check_path(request.path);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 2 || size > 2 * UMBN_HTTP1_HEAD_BYTES) {
        return 0;
    }
    const uint8_t *bytes = data + 1;
    size--;
    check_split(bytes, size);
    const int early = umbn_http1_refuses_early(bytes, size);
    FUZZ_DEMAND(early == 0 || early == 400 || early == 414 || early == 431);
    const size_t end = umbn_http1_head_size(bytes, size, 0);
    check_head(bytes, end != 0 ? end : size, (uint64_t)data[0] * 97);
    return 0;
}
