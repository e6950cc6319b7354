/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_JSON_H
#define UMBRAGE_CLI_CLI_JSON_H
/*
 * A JSON writer over stdio: it puts the commas. Write errors stay in the stream (ferror).
 *
 *     umbc_json_begin(&json, NULL, '{');
 *     umbc_json_text(&json, "asset", id);
 *     umbc_json_end(&json, '}');
 *
 * Whoever fails between a begin and its end calls umbc_json_abandon, so that what stands there is
 * JSON still. In every function `key` is NULL inside an array or at the top.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#define UMBC_JSON_DEPTH 16 /* brackets open at once, at most */

struct umbc_json {
    FILE *file;
    bool needs_comma;
    unsigned depth;
    char open[UMBC_JSON_DEPTH]; /* [depth], what will close each */
};

void umbc_json_begin(struct umbc_json *json, const char *key, char bracket); /* '{' or '[' */
void umbc_json_end(struct umbc_json *json, char bracket);                    /* '}' or ']' */
void umbc_json_abandon(struct umbc_json *json); /* closes all that is open, and the line */
/* UTF-8; bytes that are not become U+FFFD. */
void umbc_json_text(struct umbc_json *json, const char *key, const char *text);
void umbc_json_integer(struct umbc_json *json, const char *key, uint64_t value);
void umbc_json_signed(struct umbc_json *json, const char *key, int64_t value);
void umbc_json_number(struct umbc_json *json, const char *key, double value); /* not finite: null */
void umbc_json_bool(struct umbc_json *json, const char *key, bool value);
void umbc_json_vector(struct umbc_json *json, const char *key, const double values[3]);

#endif
