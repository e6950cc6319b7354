/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_UTF8_H
#define UMBRAGE_CORE_BASE_UTF8_H
/*
 * Checks of untrusted UTF-8 (from files and peers), and its conversion for display. Pure functions.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * Returns the length (1 to 4) of the well-formed character that starts at bytes, or 0.
 *
 * In:     bytes: uint8[size]. Overlong forms, surrogates and values above U+10FFFF are refused.
 * Source: The Unicode Standard, table 3-7.
 */
size_t umb__utf8_length(const uint8_t *bytes, size_t size);

/* True if all of bytes is well-formed UTF-8 without a NUL. */
bool umb__utf8_valid(const uint8_t *bytes, size_t size);

/*
 * Copies text for display. Malformed bytes become '?', and control characters become blanks: C0,
 * DEL, and C1, which terminals obey too. Every other byte keeps its place. The copy is cut between
 * two characters if it is too long, and always NUL-terminated. Returns the length written.
 *
 * In: capacity: bytes at out, at least 1. out: may be bytes itself.
 */
size_t umb__utf8_printable(const uint8_t *bytes, size_t size, char *out, size_t capacity);

#endif
