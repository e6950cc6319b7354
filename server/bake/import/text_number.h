/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_TEXT_NUMBER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_TEXT_NUMBER_H
/*
 * Words and numbers of scene files: exact, fast, independent of the locale.
 *
 * A cursor is a range of bytes that need not end in a NUL. Blanks are space, tab, CR, LF, and '\'
 * (which only joins lines in the formats read here).
 * Threads: pure functions. Trust: safe on hostile bytes.
 */
#include <stddef.h>
#include <stdint.h>
#include "base/bytes.h"

struct umbb_cursor {
    const char *at;
    const char *end;
};

static inline size_t umbb_length(struct umbb_cursor cursor)
{
    return (size_t)(cursor.end - cursor.at);
}

/* Moves to the next byte that is not a blank; returns 0 at the end. */
int umbb_skip_blanks(struct umbb_cursor *cursor);

/* Tells whether the cursor is at a blank or at the end. */
int umbb_at_blank(const struct umbb_cursor *cursor);

/* Takes the next run of bytes without blanks; returns 0, and an empty token, at the end. */
int umbb_take_token(struct umbb_cursor *cursor, struct umbb_cursor *token);

/* 1 if the token is this word. */
int umbb_is_word(struct umbb_cursor token, const char *word);

/* 1 if the text begins with `start`. */
int umbb_starts_with(struct umbb_cursor text, const char *start);

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

/* Loads a little-endian unsigned number of 32 bits, unaligned. */
static inline uint32_t umbb_load_u32(const char *bytes)
{
    return umb__load32((const uint8_t *)bytes);
}

/* Number in binary data. */
struct umbb_scalar {
    char kind;      /* i: signed integer, u: unsigned integer, f: floating point */
    uint32_t bytes; /* size: 1, 2, 4; also 8 for floating point */
};

/* Loads a number, unaligned. is_big: 1: its first byte is the most significant one. */
static inline double umbb_load_number(const char *bytes, struct umbb_scalar scalar, int is_big)
{
    const uint8_t *at = (const uint8_t *)bytes;
    const uint32_t width = 8 * scalar.bytes;
    uint64_t bits = width == 8    ? at[0]
                    : width == 16 ? umb__load16(at)
                    : width == 32 ? umb__load32(at)
                                  : umb__load64(at);
    bits = is_big ? __builtin_bswap64(bits) >> (64 - width) : bits;
    const uint64_t sign = UINT64_C(1) << (width - 1);
    const uint32_t low = (uint32_t)bits;
    float single;
    double value;
    memcpy(&single, &low, sizeof single);
    memcpy(&value, &bits, sizeof value);
    return scalar.kind == 'f'   ? (width == 32 ? (double)single : value)
           : scalar.kind == 'i' ? (double)(int64_t)((bits ^ sign) - sign)
                                : (double)bits;
}

#endif
