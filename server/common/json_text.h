/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_JSON_TEXT_H
#define UMBRAGE_SERVER_COMMON_JSON_TEXT_H
/* Strings in JSON that a server program prints. File names and scenes may hold any bytes. */
#include <stddef.h>
#include <stdio.h>

/*
 * Writes text as a JSON string with its quotes, always valid UTF-8: bytes that are not valid become
 * U+FFFD.
 *
 * In:    text: char[length]; may hold NULs.
 * Trust: safe on hostile bytes. A failed write shows in ferror(to).
 */
void umbs_json_bytes(FILE *to, const char *text, size_t length);

/* umbs_json_bytes for a NUL-terminated text. */
void umbs_json_text(FILE *to, const char *text);

#endif
