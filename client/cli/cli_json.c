/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON writer, see cli_json.h. */
#include "cli_json.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include "tool/base.h"

static void put_string(FILE *file, const char *text)
{
    const uint8_t *p = (const uint8_t *)text;
    size_t left = strlen(text);
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
        } else if (*p < 0x20 || *p == 0x7f) {
            (void)fprintf(file, "\\u%04x", (unsigned)*p);
        } else {
            (void)fwrite(p, 1, length, file);
        }
        p += length == 0 ? 1 : length;
        left -= length == 0 ? 1 : length;
    }
    (void)fputc('"', file);
}

static void begin_value(struct umbc_json *json, const char *key)
{
    if (json->needs_comma) {
        (void)fputc(',', json->file);
    }
    json->needs_comma = true;
    if (key != NULL) {
        put_string(json->file, key);
        (void)fputc(':', json->file);
    }
}

void umbc_json_begin(struct umbc_json *json, const char *key, char bracket)
{
    begin_value(json, key);
    (void)fputc(bracket, json->file);
    json->needs_comma = false;
    assert(json->depth < UMBC_JSON_DEPTH);
    json->open[json->depth++] = bracket == '{' ? '}' : ']';
}

void umbc_json_end(struct umbc_json *json, char bracket)
{
    assert(json->depth > 0 && json->open[json->depth - 1] == bracket);
    json->depth--;
    (void)fputc(bracket, json->file);
    json->needs_comma = true;
}

void umbc_json_abandon(struct umbc_json *json)
{
    const bool began = json->depth > 0;
    while (json->depth > 0) {
        umbc_json_end(json, json->open[json->depth - 1]);
    }
    if (began) {
        (void)fputc('\n', json->file);
    }
}

void umbc_json_text(struct umbc_json *json, const char *key, const char *text)
{
    begin_value(json, key);
    put_string(json->file, text);
}

void umbc_json_integer(struct umbc_json *json, const char *key, uint64_t value)
{
    begin_value(json, key);
    (void)fprintf(json->file, "%" PRIu64, value);
}

void umbc_json_signed(struct umbc_json *json, const char *key, int64_t value)
{
    begin_value(json, key);
    (void)fprintf(json->file, "%" PRId64, value);
}

void umbc_json_number(struct umbc_json *json, const char *key, double value)
{
    begin_value(json, key);
    if (isfinite(value)) {
        (void)fprintf(json->file, "%.17g", value);
    } else {
        (void)fputs("null", json->file);
    }
}

void umbc_json_bool(struct umbc_json *json, const char *key, bool value)
{
    begin_value(json, key);
    (void)fputs(value ? "true" : "false", json->file);
}

void umbc_json_vector(struct umbc_json *json, const char *key, const double values[3])
{
    umbc_json_begin(json, key, '[');
    for (int axis = 0; axis < 3; axis++) {
        umbc_json_number(json, NULL, values[axis]);
    }
    umbc_json_end(json, ']');
}
