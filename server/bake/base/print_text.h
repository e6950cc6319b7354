/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_BASE_PRINT_TEXT_H
#define UMBRAGE_SERVER_BAKE_BASE_PRINT_TEXT_H
/* Foreign text made safe to print: names in plans and on terminals. */
#include <stddef.h>
#include "umbrage/asset.h"

#define UMBB_ESCAPED_NAME_SIZE (4 * UMB_NAME_SIZE)

/*
 * Copies text with control bytes, quotes, backslashes and bytes that are not UTF-8 as \xNN. The
 * copy is cut at the end of `out`, between characters.
 *
 * In: size: at least 1. Out: out: NUL-terminated, valid UTF-8, no control bytes.
 */
void umbb_escape(const char *text, char *out, size_t size);

#endif
