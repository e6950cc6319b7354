/* SPDX-License-Identifier: Apache-2.0 */
/* See web_parts.h. */
#include "daemon/service/web_parts.h"

#include <string.h>
#include <strings.h>

#define BEGIN "/assets/"
#define IDS   "by-id/"
#define END   ".umb"

static int is_name_byte(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           (c != '\0' && strchr("._-/", c) != NULL);
}

static int is_id_byte(char c)
{
    return (c >= 'a' && c <= 'f') || (c >= '0' && c <= '9');
}

/* Removes a prefix; returns 0 if the text does not begin with it. */
static int skip(struct umbd_http1_text *text, const char *prefix)
{
    const size_t length = strlen(prefix);
    if (text->size < length || memcmp(text->bytes, prefix, length) != 0) {
        return 0;
    }
    text->bytes += length;
    text->size -= length;
    return 1;
}

int umbd_web_route(struct umbd_http1_text path, struct umbd_web_route *route)
{
    const size_t end = strlen(END);
    if (!skip(&path, BEGIN) || path.size <= end ||
        memcmp(path.bytes + path.size - end, END, end) != 0) {
        return 0;
    }
    path.size -= end;
    route->by_id = skip(&path, IDS);
    if (path.size == 0 || path.size > UMBS_STORE_NAME_MAX ||
        (route->by_id && path.size != UMB_ID_TEXT_SIZE - 1)) {
        return 0;
    }
    for (size_t i = 0; i < path.size; i++) {
        if (!(route->by_id ? is_id_byte(path.bytes[i]) : is_name_byte(path.bytes[i]))) {
            return 0;
        }
    }
    memcpy(route->asset, path.bytes, path.size);
    route->asset[path.size] = '\0';
    return 1;
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

/* Takes FIRST-LAST, FIRST- or -LENGTH. Out: range: length 0 if it has no byte of the file. Returns
 * 0 if it is malformed. */
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

enum umbd_ranges_result umbd_ranges_parse(struct umbd_http1_text field, uint64_t size,
                                          struct umb_range *ranges, size_t *count)
{
    static const char unit[] = "bytes=";
    struct rest rest = {field.bytes, field.bytes + field.size};
    size_t listed = 0;
    *count = 0;
    if (field.size < sizeof unit - 1 || strncasecmp(field.bytes, unit, sizeof unit - 1) != 0) {
        return memchr(field.bytes, '=', field.size) != NULL ? UMBD_RANGES_NONE
                                                            : UMBD_RANGES_MALFORMED;
    }
    rest.at += sizeof unit - 1;
    do {
        struct umb_range range;
        skip_blanks(&rest);
        if (listed == UMBD_RANGES_MAX) {
            return UMBD_RANGES_TOO_MANY;
        }
        listed++;
        if (!take_range(&rest, size, &range)) {
            return UMBD_RANGES_MALFORMED;
        }
        if (range.length > 0) {
            ranges[(*count)++] = range;
        }
        skip_blanks(&rest);
    } while (skip_byte(&rest, ','));
    return rest.at != rest.end       ? UMBD_RANGES_MALFORMED
           : *count == 0             ? UMBD_RANGES_BEYOND
           : overlap(ranges, *count) ? UMBD_RANGES_OVERLAP
                                     : UMBD_RANGES_OK;
}

/* Takes one entity tag. Returns 0 if there is none. */
static int take_tag(struct rest *rest, struct umbd_http1_text *tag, int *is_weak)
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
    *tag = (struct umbd_http1_text){from, (size_t)(rest->at - from)};
    return 1;
}

int umbd_tags_have(struct umbd_http1_text field, const char *tag, int weakly)
{
    struct rest rest = {field.bytes, field.bytes + field.size};
    struct umbd_http1_text found;
    int is_weak;
    if (umbd_http1_is(field, "*")) {
        return 1;
    }
    do {
        skip_blanks(&rest);
        if (!take_tag(&rest, &found, &is_weak)) {
            return 0;
        }
        if (umbd_http1_is(found, tag) && (weakly || !is_weak)) {
            return 1;
        }
        skip_blanks(&rest);
    } while (skip_byte(&rest, ','));
    return 0;
}
