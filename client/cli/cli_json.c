/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON writer, see cli_json.h. */
#include "cli_json.h"

#include <inttypes.h>
#include <math.h>

static void put_string(FILE *file, const char *text)
{
    (void)fputc('"', file);
    for (const unsigned char *p = (const unsigned char *)text; *p != '\0'; p++) {
        if (*p == '"' || *p == '\\') {
            (void)fputc('\\', file);
            (void)fputc(*p, file);
        } else if (*p == '\n') {
            (void)fputs("\\n", file);
        } else if (*p < 0x20 || *p == 0x7f) {
            (void)fprintf(file, "\\u%04x", (unsigned)*p);
        } else {
            (void)fputc(*p, file);
        }
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
}

void umbc_json_end(struct umbc_json *json, char bracket)
{
    (void)fputc(bracket, json->file);
    json->needs_comma = true;
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
