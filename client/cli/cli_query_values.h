/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_QUERY_VALUES_H
#define UMBRAGE_CLI_CLI_QUERY_VALUES_H
/* Values of the options of `umbrage query` that are more than a number. */
#include <stdbool.h>
#include "umbrage/query.h"

/* X,Y,Z of an option. Returns -1, or the exit code after saying what is wrong. */
int umbc_take_vector(const char *option, const char *text, double vector[3]);

/* auto, none, 1.5vox or 0.02m. Returns likewise. */
int umbc_take_bias(const char *text, struct umb_query_settings *settings);

/* A number above 0 with one of two endings, or none; which: 0 none, 1 or 2. */
bool umbc_take_amount(const char *text, const char *const endings[2], double *value, int *which);

#endif
