/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_JSON_H
#define UMBRAGE_SERVER_STUDY_STUDY_JSON_H
/* Strings in JSON output. */
#include <stdio.h>

/* Writes text as a JSON string with its quotes; bytes that are not UTF-8 become U+FFFD. */
void umbt_json_text(FILE *out, const char *text);

#endif
