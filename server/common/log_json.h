/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_LOG_JSON_H
#define UMBRAGE_SERVER_COMMON_LOG_JSON_H
/* A log line as JSON. It is converted from the text line, so both forms have the same values. */
#include <stddef.h>

/*
 * Turns `key=value key="quoted \xNN"` into one JSON object. A bare value that is a plain decimal
 * number stays a number; every other value becomes a string. A pair that does not fit is left out,
 * with all pairs after it.
 *
 * In: line: NUL-terminated, as umbs_log_event makes it. capacity: of out, at least 3. Returns the
 * length; not terminated.
 */
size_t umbs__log_json(const char *line, char *out, size_t capacity);

#endif
