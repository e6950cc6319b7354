/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_OPTION_TEXT_H
#define UMBRAGE_SERVER_BAKE_OPTION_TEXT_H
/* Numbers and refusals in the common form of all options. */
#include <stdint.h>
#include "umbrage/status.h"

/* Makes the message that an option's value is invalid. Returns E_ARGUMENT. */
enum umb_status umbb_option_refuse(struct umb_error *error, const char *option, const char *value,
                                   const char *limit);

/* Reads decimal digits only, no sign, no blanks; 1 if there are some and they fit. Out: rest: the
 * text after them. */
int umbb_option_count(const char *text, const char **rest, uint64_t *value);

/* Reads a finite decimal number; 1 if text starts with one. Out: rest: the text after it. */
int umbb_option_number(const char *text, const char **rest, double *value);

#endif
