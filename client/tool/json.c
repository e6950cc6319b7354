/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON writer, see json.h. Source of the escapes: RFC 8259, section 7. */
#include "tool/json.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include "tool/base.h"

static void put_string(const struct umbu_json *json, const char *text, size_t left)
{
    FILE *file = json->file;
    const uint8_t *p = (const uint8_t *)text;
    (void)fputc('"', file);
    while (left > 0) {
        size_t length = umb__utf8_length(p, left);
        if (length == 0) {
            (void)fputs("\\ufffd", file); /* a file's name may be anything; JSON is UTF-8 */
        } else if (*p == '"' || *p == '\\') {
            (void)fputc('\\', file);
            (void)fputc(*p, file);
        } else if (*p == '\n') {
            (void)fputs("\\n", file);
        } else if (*p < 0x20 || *p == 0x7f || (*p == '<' && json->in_html)) {
            (void)fprintf(file, "\\u%04x", (unsigned)*p);
        } else {
            (void)fwrite(p, 1, length, file);
        }
        p += length == 0 ? 1 : length;
        left -= length == 0 ? 1 : length;
    }
    (void)fputc('"', file);
}

static void begin_value(struct umbu_json *json, const char *key)
{
    if (json->needs_comma) {
        (void)fputc(',', json->file);
    }
    json->needs_comma = true;
    if (key != NULL) {
        put_string(json, key, strlen(key));
        (void)fputc(':', json->file);
    }
}

void umbu_json_begin(struct umbu_json *json, const char *key, char bracket)
{
    begin_value(json, key);
    (void)fputc(bracket, json->file);
    json->needs_comma = false;
    assert(json->depth < UMBU_JSON_DEPTH);
    json->open[json->depth++] = bracket == '{' ? '}' : ']';
}

struct umbu_json umbu_json_open(FILE *file)
{
    struct umbu_json json = {.file = file};
    umbu_json_begin(&json, NULL, '{');
    return json;
}

void umbu_json_end(struct umbu_json *json, char bracket)
{
    assert(json->depth > 0 && json->open[json->depth - 1] == bracket);
    json->depth--;
    (void)fputc(bracket, json->file);
    json->needs_comma = true;
}

void umbu_json_close(struct umbu_json *json)
{
    const bool began = json->depth > 0;
    while (json->depth > 0) {
        umbu_json_end(json, json->open[json->depth - 1]);
    }
    if (began) {
        (void)fputc('\n', json->file);
    }
}

void umbu_json_bytes(struct umbu_json *json, const char *key, const char *text, size_t length)
{
    begin_value(json, key);
    put_string(json, text, length);
}

void umbu_json_text(struct umbu_json *json, const char *key, const char *text)
{
    umbu_json_bytes(json, key, text, strlen(text));
}

void umbu_json_integer(struct umbu_json *json, const char *key, uint64_t value)
{
    begin_value(json, key);
    (void)fprintf(json->file, "%" PRIu64, value);
}

void umbu_json_signed(struct umbu_json *json, const char *key, int64_t value)
{
    begin_value(json, key);
    (void)fprintf(json->file, "%" PRId64, value);
}

void umbu_json_rounded(struct umbu_json *json, const char *key, double value, int digits)
{
    begin_value(json, key);
    if (isfinite(value)) {
        (void)fprintf(json->file, "%.*g", digits, value);
    } else {
        (void)fputs("null", json->file);
    }
}

void umbu_json_number(struct umbu_json *json, const char *key, double value)
{
    umbu_json_rounded(json, key, value, 17);
}

void umbu_json_values(struct umbu_json *json, int digits, const struct umbu_json_value *values,
                      size_t count)
{
    for (size_t i = 0; i < count; i++) {
        umbu_json_rounded(json, values[i].key, values[i].value, digits);
    }
}

void umbu_json_counts(struct umbu_json *json, const struct umbu_json_count *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        umbu_json_integer(json, values[i].key, values[i].value);
    }
}

void umbu_json_bool(struct umbu_json *json, const char *key, bool value)
{
    begin_value(json, key);
    (void)fputs(value ? "true" : "false", json->file);
}

void umbu_json_vector(struct umbu_json *json, const char *key, const double values[3])
{
    umbu_json_begin(json, key, '[');
    for (int axis = 0; axis < 3; axis++) {
        umbu_json_number(json, NULL, values[axis]);
    }
    umbu_json_end(json, ']');
}
