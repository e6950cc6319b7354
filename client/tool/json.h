/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_JSON_H
#define UMBRAGE_TOOL_JSON_H
/*
 * A JSON writer over stdio, which also writes the commas. Write errors stay in the stream (ferror).
 *
 *     struct umbu_json json = umbu_json_open(stdout);
 *     umbu_json_text(&json, "asset", id);
 *     umbu_json_close(&json);
 *
 * `key` is NULL inside an array or at the top. On an error inside an open object or array, call
 * umbu_json_close: the output stays valid JSON.
 * Trust: texts may hold any bytes; the output is UTF-8 and holds no control characters.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define UMBU_JSON_DEPTH 16 /* most brackets open at once */

struct umbu_json {
    FILE *file;
    bool in_html;               /* true: inside a <script>; '<' becomes \u003c */
    bool needs_comma;           /* true: a comma stands before the next value. */
    unsigned depth;             /* Number of open brackets. */
    char open[UMBU_JSON_DEPTH]; /* [depth] Bracket that closes each. */
};

struct umbu_json umbu_json_open(FILE *file);                                 /* Begins an object */
void umbu_json_begin(struct umbu_json *json, const char *key, char bracket); /* '{' or '[' */
void umbu_json_end(struct umbu_json *json, char bracket);                    /* '}' or ']' */

/* Closes every open bracket and ends the line. Writes nothing if no bracket is open. */
void umbu_json_close(struct umbu_json *json);

/* Writes a string. Bytes that are not UTF-8 become U+FFFD. _bytes: char[length], may hold NULs. */
void umbu_json_text(struct umbu_json *json, const char *key, const char *text);
void umbu_json_bytes(struct umbu_json *json, const char *key, const char *text, size_t length);

void umbu_json_integer(struct umbu_json *json, const char *key, uint64_t value);
void umbu_json_signed(struct umbu_json *json, const char *key, int64_t value);

/* Writes a number in full, or in `digits` significant digits; null if it is not finite. */
void umbu_json_number(struct umbu_json *json, const char *key, double value);
void umbu_json_rounded(struct umbu_json *json, const char *key, double value, int digits);

/* A number with its key. */
struct umbu_json_value {
    const char *key;
    double value;
};
struct umbu_json_count {
    const char *key;
    uint64_t value;
};

/* Writes a list of numbers, as umbu_json_rounded and umbu_json_integer do:
 *
 *     UMBU_JSON_VALUES(&json, 6, {"load_s", load_s}, {"query_s", query_s});
 */
void umbu_json_values(struct umbu_json *json, int digits, const struct umbu_json_value *values,
                      size_t count);
void umbu_json_counts(struct umbu_json *json, const struct umbu_json_count *values, size_t count);
#define UMBU_JSON_LIST(type, ...)                                                                  \
    (const type[]){__VA_ARGS__}, sizeof((const type[]){__VA_ARGS__}) / sizeof(type)
#define UMBU_JSON_VALUES(json, digits, ...)                                                        \
    umbu_json_values(json, digits, UMBU_JSON_LIST(struct umbu_json_value, __VA_ARGS__))
#define UMBU_JSON_COUNTS(json, ...)                                                                \
    umbu_json_counts(json, UMBU_JSON_LIST(struct umbu_json_count, __VA_ARGS__))

void umbu_json_bool(struct umbu_json *json, const char *key, bool value);
void umbu_json_vector(struct umbu_json *json, const char *key, const double values[3]);

#endif
