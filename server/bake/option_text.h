/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_OPTION_TEXT_H
#define UMBRAGE_SERVER_BAKE_OPTION_TEXT_H
/* Numbers and refusals as every option of the command line reads and words them. */
#include <stdint.h>
#include "umbrage/status.h"

/* Says that an option's value is not what it may be. Returns E_ARGUMENT. */
enum umb_status umbb_option_refuse(struct umb_error *error, const char *option, const char *value,
                                   const char *limit);

/* Decimal digits only, no sign, no blanks; 1 if there are some and they fit. Out: rest: behind
 * them. */
int umbb_option_count(const char *text, const char **rest, uint64_t *value);

/* A finite decimal number; 1 if text starts with one. Out: rest: behind it. */
int umbb_option_number(const char *text, const char **rest, double *value);

#endif
