/* SPDX-License-Identifier: Apache-2.0 */
/* See http1_fields.h. */
#include "net/http1_fields.h"

#include <string.h>
#include <strings.h>

int umbn_host_is_local(struct umbn_http1_text host)
{
    static const char *const names[] = {"localhost", "127.", "[::1]"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const size_t known = strlen(names[i]);
        size_t at = known;
        if (host.size < known || strncasecmp(host.bytes, names[i], known) != 0) {
            continue;
        }
        while (names[i][known - 1] == '.' && at < host.size &&
               ((host.bytes[at] >= '0' && host.bytes[at] <= '9') || host.bytes[at] == '.')) {
            at++;
        }
        return at == host.size || host.bytes[at] == ':';
    }
    return 0;
}

/* The rest of a field. */
struct rest {
    const char *at, *end;
};

static int is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static void skip_blanks(struct rest *rest)
{
    while (rest->at < rest->end && (*rest->at == ' ' || *rest->at == '\t')) {
        rest->at++;
    }
}

static int skip_byte(struct rest *rest, char c)
{
    const int found = rest->at < rest->end && *rest->at == c;
    rest->at += found;
    return found;
}

/* Takes a decimal number; one beyond 64 bits becomes the largest. Returns 0 without a digit. */
static int take_number(struct rest *rest, uint64_t *number)
{
    const char *from = rest->at;
    *number = 0;
    for (; rest->at < rest->end && is_digit(*rest->at); rest->at++) {
        const uint64_t digit = (uint64_t)(*rest->at - '0');
        *number = *number > (UINT64_MAX - digit) / 10 ? UINT64_MAX : *number * 10 + digit;
    }
    return rest->at > from;
}

/* Reads one range: FIRST-LAST, FIRST- or -LENGTH. Out: range: its length is 0 if it contains no
 * byte of the file. Returns 0 if it is malformed. */
static int take_range(struct rest *rest, uint64_t size, struct umb_range *range)
{
    uint64_t first = 0, last = UINT64_MAX;
    const int has_first = take_number(rest, &first);
    if (!skip_byte(rest, '-')) {
        return 0;
    }
    const int has_last = take_number(rest, &last);
    if (!has_first) { /* the last bytes */
        const uint64_t length = last < size ? last : size;
        *range = (struct umb_range){size - length, length};
        return has_last;
    }
    if (!has_last) {
        last = UINT64_MAX;
    }
    *range = (struct umb_range){first, 0};
    if (first < size) {
        range->length = last < size ? last - first + 1 : size - first;
    }
    return first <= last;
}

static int overlap(const struct umb_range *ranges, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < i; k++) {
            if (ranges[i].offset < ranges[k].offset + ranges[k].length &&
                ranges[k].offset < ranges[i].offset + ranges[i].length) {
                return 1;
            }
        }
    }
    return 0;
}

enum umbn_ranges_result umbn_ranges_parse(struct umbn_http1_text field, uint64_t size,
                                          struct umb_range *ranges, size_t *count)
{
    static const char unit[] = "bytes=";
    struct rest rest = {field.bytes, field.bytes + field.size};
    size_t listed = 0;
    *count = 0;
    if (field.size < sizeof unit - 1 || strncasecmp(field.bytes, unit, sizeof unit - 1) != 0) {
        return memchr(field.bytes, '=', field.size) != NULL ? UMBN_RANGES_NONE
                                                            : UMBN_RANGES_MALFORMED;
    }
    rest.at += sizeof unit - 1;
    do {
        struct umb_range range;
        skip_blanks(&rest);
        if (listed == UMBN_RANGES_MAX) {
            return UMBN_RANGES_TOO_MANY;
        }
        listed++;
        if (!take_range(&rest, size, &range)) {
            return UMBN_RANGES_MALFORMED;
        }
        if (range.length > 0) {
            ranges[(*count)++] = range;
        }
        skip_blanks(&rest);
    } while (skip_byte(&rest, ','));
    return rest.at != rest.end       ? UMBN_RANGES_MALFORMED
           : *count == 0             ? UMBN_RANGES_BEYOND
           : overlap(ranges, *count) ? UMBN_RANGES_OVERLAP
                                     : UMBN_RANGES_OK;
}

/* Takes one entity tag. Returns 0 if there is none. */
static int take_tag(struct rest *rest, struct umbn_http1_text *tag, int *is_weak)
{
    *is_weak = rest->end - rest->at >= 2 && memcmp(rest->at, "W/", 2) == 0;
    rest->at += *is_weak ? 2 : 0;
    const char *from = rest->at;
    if (!skip_byte(rest, '"')) {
        return 0;
    }
    const char *quote = memchr(rest->at, '"', (size_t)(rest->end - rest->at));
    if (quote == NULL) {
        return 0;
    }
    rest->at = quote + 1;
    *tag = (struct umbn_http1_text){from, (size_t)(rest->at - from)};
    return 1;
}

int umbn_tags_have(struct umbn_http1_text field, const char *tag, int weakly)
{
    struct rest rest = {field.bytes, field.bytes + field.size};
    struct umbn_http1_text found;
    int is_weak;
    if (umbn_http1_is(field, "*")) {
        return 1;
    }
    do {
        skip_blanks(&rest);
        if (!take_tag(&rest, &found, &is_weak)) {
            return 0;
        }
        if (umbn_http1_is(found, tag) && (weakly || !is_weak)) {
            return 1;
        }
        skip_blanks(&rest);
    } while (skip_byte(&rest, ','));
    return 0;
}

const char *umbn_http1_reason(int status)
{
    static const struct {
        int status;
        const char *reason;
    } reasons[] = {
        {200, "OK"},
        {204, "No Content"},
        {206, "Partial Content"},
        {304, "Not Modified"},
        {400, "Bad Request"},
        {401, "Unauthorized"},
        {403, "Forbidden"},
        {404, "Not Found"},
        {405, "Method Not Allowed"},
        {412, "Precondition Failed"},
        {413, "Content Too Large"},
        {414, "URI Too Long"},
        {416, "Range Not Satisfiable"},
        {417, "Expectation Failed"},
        {421, "Misdirected Request"},
        {429, "Too Many Requests"},
        {431, "Request Header Fields Too Large"},
        {501, "Not Implemented"},
        {503, "Service Unavailable"},
        {505, "HTTP Version Not Supported"},
        {500, "Internal Server Error"},
    };
    size_t i = 0;
    while (i + 1 < sizeof reasons / sizeof reasons[0] && reasons[i].status != status) {
        i++;
    }
    return reasons[i].reason;
}
