/* SPDX-License-Identifier: Apache-2.0 */
/* See log.h; source of the escapes: RFC 8259, section 7. */
#include "common/log.h"

#include <stdio.h>
#include <string.h>

struct json_line {
    char *out;
    size_t length, capacity;
    int full;
};

static void put(struct json_line *json, const char *text, size_t length)
{
    /* The last byte is kept for the closing brace. */
    if (json->full || length >= json->capacity - json->length) {
        json->full = 1;
        return;
    }
    memcpy(json->out + json->length, text, length);
    json->length += length;
}

/* Writes one character of a value; a byte that is not printable ASCII becomes \u00NN. */
static void put_character(struct json_line *json, unsigned char c)
{
    char text[8];
    if (c == '"' || c == '\\') {
        text[0] = '\\';
        text[1] = (char)c;
        put(json, text, 2);
    } else if (c < 0x20 || c > 0x7e) {
        put(json, text, (size_t)snprintf(text, sizeof text, "\\u%04x", c));
    } else {
        put(json, (const char *)&c, 1);
    }
}

static int hex_digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* Writes a quoted value that starts after its opening quote. Returns the text after the closing
 * one. */
static const char *put_quoted(struct json_line *json, const char *at)
{
    put(json, "\"", 1);
    for (; *at != '\0' && *at != '"'; at++) {
        if (at[0] == '\\' && at[1] == 'x' && hex_digit(at[2]) >= 0 && hex_digit(at[3]) >= 0) {
            put_character(json, (unsigned char)(hex_digit(at[2]) * 16 + hex_digit(at[3])));
            at += 3;
        } else {
            put_character(json, (unsigned char)*at);
        }
    }
    put(json, "\"", 1);
    return *at == '"' ? at + 1 : at;
}

/* True for a JSON number: an optional sign, digits without a leading zero, an optional fraction. */
static int is_number(const char *text, size_t length)
{
    size_t at = length > 0 && text[0] == '-';
    size_t digits = strspn(text + at, "0123456789");
    if (digits == 0 || at + digits > length || (digits > 1 && text[at] == '0')) {
        return 0;
    }
    at += digits;
    if (at < length && text[at] == '.') {
        size_t fraction = strspn(text + at + 1, "0123456789");
        at += fraction > 0 ? 1 + fraction : 0;
    }
    return at == length;
}

static const char *put_bare(struct json_line *json, const char *at)
{
    size_t length = strcspn(at, " ");
    if (is_number(at, length)) {
        put(json, at, length);
        return at + length;
    }
    put(json, "\"", 1);
    for (size_t i = 0; i < length; i++) {
        put_character(json, (unsigned char)at[i]);
    }
    put(json, "\"", 1);
    return at + length;
}

size_t umbs__log_json(const char *line, char *out, size_t capacity)
{
    struct json_line json = {.out = out, .capacity = capacity};
    size_t kept = 1;
    put(&json, "{", 1);
    while (*line != '\0') {
        size_t key = strcspn(line, "= ");
        if (line[key] != '=' || key == 0) { /* not a pair: skipped */
            line += key + (line[key] != '\0');
            continue;
        }
        put(&json, ",\"", kept > 1 ? 2 : 0);
        put(&json, "\"", kept > 1 ? 0 : 1);
        put(&json, line, key);
        put(&json, "\":", 2);
        line += key + 1;
        line = *line == '"' ? put_quoted(&json, line + 1) : put_bare(&json, line);
        kept = json.full ? kept : json.length;
    }
    out[kept] = '}';
    return kept + 1;
}
