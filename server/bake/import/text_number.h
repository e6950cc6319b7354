/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_TEXT_NUMBER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_TEXT_NUMBER_H
/*
 * Numbers in the text of scene files: exact, fast, independent of the locale.
 *
 * A cursor is a range of bytes that need not end in a NUL. Blanks are space, tab, CR, LF, and '\'
 * (which only joins lines in the formats read here).
 * Threads: pure functions. Trust: safe on hostile bytes.
 */
#include <stddef.h>
#include <stdint.h>

struct umbb_cursor {
    const char *at;
    const char *end;
};

/* Moves to the next byte that is not a blank; returns 0 at the end. */
int umbb_skip_blanks(struct umbb_cursor *cursor);

/* Tells whether the cursor is at a blank or at the end. */
int umbb_at_blank(const struct umbb_cursor *cursor);

/* Takes the next run of bytes without blanks; length 0 at the end. */
size_t umbb_take_token(struct umbb_cursor *cursor, const char **token);

/* 1 if the token is this word. */
int umbb_is_word(const char *token, size_t length, const char *word);

/* Takes one line off the cursor, without its end; returns 0 at the end of the text. */
int umbb_take_line(struct umbb_cursor *text, struct umbb_cursor *line);

/* The rest of a line without blanks around it; names may contain blanks. */
struct umbb_cursor umbb_trim(struct umbb_cursor line);

/*
 * Takes the next token as a number, correctly rounded as by strtod in the C locale, with its "inf"
 * and "nan".
 *
 * Out:   value. Returns 1, or 0 if there is no token or the token is not a number. The token is
 *        taken in either case.
 */
int umbb_take_double(struct umbb_cursor *cursor, double *value);

/*
 * Reads an optional sign and decimal digits at the cursor (no blanks before).
 *
 * Out:   value: clamped to +-2^62. Returns 0 and moves nothing if there is no digit.
 */
int umbb_take_integer(struct umbb_cursor *cursor, int64_t *value);

/* Little-endian unsigned 32 bits, unaligned. */
uint32_t umbb_load_u32(const char *bytes);

#endif
