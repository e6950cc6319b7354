/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_CLEAN_TEXT_H
#define UMBRAGE_SERVER_COMMON_CLEAN_TEXT_H
/*
 * Clean text: valid UTF-8 without control characters. Names from foreign files reach terminals,
 * logs and protobuf strings, which misbehave on other text. So the importer cleans such names and
 * the validator checks them.
 *
 * Threads: pure functions.
 */
#include <stddef.h>

/*
 * Copies text and makes it clean: each byte of a control character or of invalid UTF-8 becomes '?'.
 * The copy is cut at a character boundary so that it fits.
 *
 * In:    text: char[length], need not end in a NUL; stops at one. size: bytes of out, >= 1.
 * Out:   out: char[size], NUL-terminated, the tail filled with NULs.
 * Trust: safe on hostile bytes.
 */
void umbs_text_clean(char *out, size_t size, const char *text, size_t length);

/*
 * Returns 1 if text is clean.
 *
 * In:    newlines: 1 if '\n' is allowed.
 * Trust: safe on hostile bytes.
 */
int umbs_text_is_clean(const char *text, size_t length, int newlines);

#endif
