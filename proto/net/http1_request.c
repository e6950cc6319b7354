/* SPDX-License-Identifier: Apache-2.0 */
/* See http1_request.h. */
#include "net/http1_request.h"

#include <string.h>
#include <strings.h>

/* The rest of the head that is being parsed. */
struct cursor {
    const char *at, *end;
};

/* RFC 9110, tchar. */
static int is_token_byte(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           (c != '\0' && strchr("!#$%&'*+-.^_`|~", c) != NULL);
}

/* Visible ASCII. */
static int is_visible(char c)
{
    return c > 0x20 && c < 0x7F;
}

/* A byte of a field's value: visible, a blank, a tab, or beyond ASCII. */
static int is_value_byte(char c)
{
    return is_visible(c) || c == ' ' || c == '\t' || ((unsigned char)c & 0x80) != 0;
}

int umbn_http1_is(struct umbn_http1_text text, const char *string)
{
    return text.bytes != NULL && text.size == strlen(string) &&
           memcmp(text.bytes, string, text.size) == 0;
}

/* The same without regard to case. */
static int is_name(struct umbn_http1_text text, const char *string)
{
    return text.size == strlen(string) && strncasecmp(text.bytes, string, text.size) == 0;
}

size_t umbn_http1_head_size(const uint8_t *bytes, size_t size, size_t seen)
{
    size_t from = seen > 3 ? seen - 3 : 0; /* the end may have begun in the searched bytes */
    for (; from + 4 <= size; from++) {
        const uint8_t *found = memchr(bytes + from, '\r', size - from - 3);
        if (found == NULL) {
            return 0;
        }
        from = (size_t)(found - bytes);
        if (memcmp(found, "\r\n\r\n", 4) == 0) {
            return from + 4;
        }
    }
    return 0;
}

int umbn_http1_refuses_early(const uint8_t *bytes, size_t size)
{
    if (size > 0 && !is_token_byte((char)bytes[0])) {
        return 400;
    }
    if (size < UMBN_HTTP1_HEAD_BYTES) {
        return 0;
    }
    return memchr(bytes, '\n', size) == NULL ? 414 : 431;
}

void umbn_http1_refuse(struct umbn_http1_request *request, int status)
{
    static const struct {
        int status;
        const char *reason;
    } reasons[] = {
        {400, "the request is malformed"},
        {413, "the request has a body; give none"},
        {414, "the request line is longer than 8192 bytes"},
        {417, "Expect is not supported"},
        {431, "the header fields are longer than 8192 bytes, or more than 64"},
        {501, "Transfer-Encoding is not supported"},
        {505, "the version must be HTTP/1.1 or HTTP/1.0"},
    };
    size_t i = 0;
    while (i + 1 < sizeof reasons / sizeof reasons[0] && reasons[i].status != status) {
        i++;
    }
    request->refusal = reasons[i].status;
    request->reason = reasons[i].reason;
    request->keeps_open = 0;
}

/* Takes the bytes up to a separator, which is skipped. Returns 0 if it does not come. */
static int take_until(struct cursor *cursor, char separator, struct umbn_http1_text *text)
{
    const char *found = memchr(cursor->at, separator, (size_t)(cursor->end - cursor->at));
    if (found == NULL) {
        return 0;
    }
    *text = (struct umbn_http1_text){cursor->at, (size_t)(found - cursor->at)};
    cursor->at = found + 1;
    return 1;
}

/* Takes a line without its end, which must be CR LF. */
static int take_line(struct cursor *cursor, struct umbn_http1_text *line)
{
    if (!take_until(cursor, '\n', line) || line->size == 0 || line->bytes[line->size - 1] != '\r') {
        return 0;
    }
    line->size--;
    return 1;
}

static int all(struct umbn_http1_text text, int (*is)(char c))
{
    size_t i = 0;
    while (i < text.size && is(text.bytes[i])) {
        i++;
    }
    return i == text.size;
}

static enum umbn_http1_method method_of(struct umbn_http1_text name)
{
    return umbn_http1_is(name, "GET")       ? UMBN_HTTP1_GET
           : umbn_http1_is(name, "HEAD")    ? UMBN_HTTP1_HEAD
           : umbn_http1_is(name, "OPTIONS") ? UMBN_HTTP1_OPTIONS
                                            : UMBN_HTTP1_OTHER;
}

/* Skips SCHEME://AUTHORITY of a target in absolute form, which proxies send. */
static void skip_authority(struct umbn_http1_text *target)
{
    static const char *const schemes[] = {"http://", "https://"};
    for (size_t i = 0; i < sizeof schemes / sizeof schemes[0]; i++) {
        const size_t length = strlen(schemes[i]);
        if (target->size > length && strncasecmp(target->bytes, schemes[i], length) == 0) {
            const char *slash = memchr(target->bytes + length, '/', target->size - length);
            const char *end = target->bytes + target->size;
            target->bytes = slash != NULL ? slash : end;
            target->size = (size_t)(end - target->bytes);
            return;
        }
    }
}

/* METHOD SP TARGET SP VERSION. Returns 0, or the status of a refusal. */
static int parse_request_line(struct umbn_http1_text line, struct umbn_http1_request *request)
{
    struct cursor cursor = {line.bytes, line.bytes + line.size};
    struct umbn_http1_text name, target;
    if (!take_until(&cursor, ' ', &name) || name.size == 0 || !all(name, is_token_byte) ||
        !take_until(&cursor, ' ', &target) || target.size == 0 || !all(target, is_visible)) {
        return 400;
    }
    const struct umbn_http1_text version = {cursor.at, (size_t)(cursor.end - cursor.at)};
    if (version.size < 5 || memcmp(version.bytes, "HTTP/", 5) != 0) {
        return 400;
    }
    request->keeps_open = umbn_http1_is(version, "HTTP/1.1");
    if (!request->keeps_open && !umbn_http1_is(version, "HTTP/1.0")) {
        return 505;
    }
    request->method = method_of(name);
    if (request->method == UMBN_HTTP1_OPTIONS && umbn_http1_is(target, "*")) {
        request->path = target;
        return 0;
    }
    skip_authority(&target);
    if (target.size == 0 || target.bytes[0] != '/') {
        return 400;
    }
    const char *query = memchr(target.bytes, '?', target.size);
    request->path = target;
    request->path.size = query != NULL ? (size_t)(query - target.bytes) : target.size;
    return 0;
}

/* State of the header fields. */
struct fields {
    struct umbn_http1_request *request;
    size_t count;
    int has_length;
};

/* Returns true if a list of words with commas has a word. */
static int lists(struct umbn_http1_text value, const char *word)
{
    struct cursor cursor = {value.bytes, value.bytes + value.size};
    while (cursor.at < cursor.end) {
        struct umbn_http1_text item;
        if (!take_until(&cursor, ',', &item)) {
            item = (struct umbn_http1_text){cursor.at, (size_t)(cursor.end - cursor.at)};
            cursor.at = cursor.end;
        }
        while (item.size > 0 && strchr(" \t", item.bytes[0]) != NULL) {
            item.bytes++;
            item.size--;
        }
        while (item.size > 0 && strchr(" \t", item.bytes[item.size - 1]) != NULL) {
            item.size--;
        }
        if (is_name(item, word)) {
            return 1;
        }
    }
    return 0;
}

/*
 * Fields that tell the length of a body. A length of 0 is no body. Every other form is refused, and
 * the connection with it, so that no byte of a body is taken for the next request.
 */
static int take_framing(struct fields *fields, struct umbn_http1_text name,
                        struct umbn_http1_text value)
{
    if (is_name(name, "transfer-encoding")) {
        return 501;
    }
    if (!is_name(name, "content-length")) {
        return is_name(name, "expect") ? 417 : 0;
    }
    if (fields->has_length || value.size == 0) {
        return 400;
    }
    fields->has_length = 1;
    for (size_t i = 0; i < value.size; i++) {
        if (value.bytes[i] < '0' || value.bytes[i] > '9') {
            return 400;
        }
    }
    return umbn_http1_is(value, "0") ? 0 : 413;
}

/* Keeps a field that the daemon reads. A second one is refused. */
static int take_field(struct fields *fields, struct umbn_http1_text name,
                      struct umbn_http1_text value)
{
    struct umbn_http1_request *request = fields->request;
    const struct {
        const char *name;
        struct umbn_http1_text *place;
    } known[] = {
        {"host", &request->host},         {"authorization", &request->authorization},
        {"range", &request->range},       {"if-range", &request->if_range},
        {"if-match", &request->if_match}, {"if-none-match", &request->if_none_match},
        {"origin", &request->origin},
    };
    if (is_name(name, "connection")) {
        request->keeps_open &= !lists(value, "close");
        return 0;
    }
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (is_name(name, known[i].name)) {
            const int is_second = known[i].place->bytes != NULL;
            *known[i].place = value;
            return is_second ? 400 : 0;
        }
    }
    return take_framing(fields, name, value);
}

/* Reads a field line: NAME ":" OWS VALUE OWS. Refuses a blank before the colon, and a line that
 * begins with a blank, which would continue the line before it. */
static int parse_field(struct fields *fields, struct umbn_http1_text line)
{
    struct cursor cursor = {line.bytes, line.bytes + line.size};
    struct umbn_http1_text name;
    if (++fields->count > UMBN_HTTP1_FIELDS_MAX) {
        return 431;
    }
    if (!take_until(&cursor, ':', &name) || name.size == 0 || !all(name, is_token_byte)) {
        return 400;
    }
    struct umbn_http1_text value = {cursor.at, (size_t)(cursor.end - cursor.at)};
    if (!all(value, is_value_byte)) {
        return 400;
    }
    while (value.size > 0 && (value.bytes[0] == ' ' || value.bytes[0] == '\t')) {
        value.bytes++;
        value.size--;
    }
    while (value.size > 0 &&
           (value.bytes[value.size - 1] == ' ' || value.bytes[value.size - 1] == '\t')) {
        value.size--;
    }
    return take_field(fields, name, value);
}

static int parse_head(const uint8_t *head, size_t size, struct umbn_http1_request *request)
{
    struct cursor cursor = {(const char *)head, (const char *)head + size};
    struct fields fields = {.request = request};
    struct umbn_http1_text line;
    int refusal = take_line(&cursor, &line) ? parse_request_line(line, request) : 400;
    const int is_current = request->keeps_open;
    while (refusal == 0) {
        if (!take_line(&cursor, &line)) {
            return 400;
        }
        if (line.size == 0) {
            /* HTTP/1.1 requires exactly one Host. */
            return cursor.at != cursor.end || (is_current && request->host.bytes == NULL) ? 400 : 0;
        }
        refusal = parse_field(&fields, line);
    }
    return refusal;
}

void umbn_http1_parse(const uint8_t *head, size_t size, struct umbn_http1_request *request)
{
    memset(request, 0, sizeof *request);
    request->method = UMBN_HTTP1_OTHER;
    const int refusal = size <= UMBN_HTTP1_HEAD_BYTES ? parse_head(head, size, request)
                                                      : umbn_http1_refuses_early(head, size);
    if (refusal != 0) {
        umbn_http1_refuse(request, refusal);
    }
}
