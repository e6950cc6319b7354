/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_JSON_SCAN_H
#define UMBRAGE_SERVER_BAKE_IMPORT_JSON_SCAN_H
/*
 * A small scanner of JSON for members that libraries do not give access to: it finds members and
 * skips values. Every step takes at least one byte and nothing recurses, so it ends on any input.
 * Names written with escapes are not found.
 * Source: RFC 8259.
 */
#include <string.h>

#include "bake/import/import_job.h"
#include "bake/import/text_number.h"

/* A text inside the JSON, without its quotes, escapes as written. */
struct umbb_json_text {
    const char *at;
    size_t length;
};

static inline int umbb_json_is(struct umbb_json_text text, const char *word)
{
    return text.length == strlen(word) && memcmp(text.at, word, text.length) == 0;
}

/* Skips a string; the cursor is at its opening quote. */
static inline struct umbb_json_text umbb_json_string(struct umbb_cursor *json)
{
    struct umbb_json_text text = {++json->at, 0};
    while (json->at < json->end && *json->at != '"') {
        json->at += *json->at == '\\' && json->end - json->at > 1 ? 2 : 1;
    }
    text.length = (size_t)(json->at - text.at);
    json->at += json->at < json->end;
    return text;
}

/* Skips one value of any kind: up to the next ',' or closing bracket of this level. */
static inline void umbb_json_skip(struct umbb_cursor *json)
{
    size_t depth = 0;
    while (json->at < json->end) {
        char c = *json->at;
        if (c == '"') {
            (void)umbb_json_string(json);
            continue;
        }
        if (depth == 0 && (c == ',' || c == '}' || c == ']')) {
            return;
        }
        depth += c == '{' || c == '[';
        depth -= c == '}' || c == ']';
        json->at++;
    }
}

/* Enters an object or array; otherwise skips the value and returns 0. */
static inline int umbb_json_enter(struct umbb_cursor *json, char bracket)
{
    if (umbb_skip_blanks(json) && *json->at == bracket) {
        json->at++;
        return 1;
    }
    umbb_json_skip(json);
    return 0;
}

/* Moves to the next item of the array; 0 at its end. */
static inline int umbb_json_item(struct umbb_cursor *json)
{
    while (umbb_skip_blanks(json)) {
        if (*json->at != ',') {
            int more = *json->at != ']' && *json->at != '}';
            json->at += !more;
            return more;
        }
        json->at++;
    }
    return 0;
}

/* Moves to the value of the object's next member; 0 at its end. */
static inline int umbb_json_member(struct umbb_cursor *json, struct umbb_json_text *key)
{
    while (umbb_json_item(json)) {
        if (*json->at == '"') {
            *key = umbb_json_string(json);
            if (umbb_skip_blanks(json) && *json->at == ':') {
                json->at++;
                return 1;
            }
        } else {
            json->at++; /* not JSON: skips a byte and goes on */
        }
    }
    return 0;
}

static inline int64_t umbb_json_number(struct umbb_cursor *json, int64_t otherwise)
{
    int64_t number = otherwise;
    (void)umbb_skip_blanks(json);
    if (!umbb_take_integer(json, &number)) {
        number = otherwise;
    }
    umbb_json_skip(json); /* the rest of the value */
    return number;
}

static inline int umbb_json_starts(struct umbb_json_text text, const char *prefix)
{
    size_t length = strlen(prefix);
    return text.length >= length && memcmp(text.at, prefix, length) == 0;
}

/* Finds a glTF's JSON: the file, or the first chunk of a GLB. */
struct umbb_cursor umbb_gltf_json(const struct umbb_import *job, enum umbb_kind kind);

#endif
