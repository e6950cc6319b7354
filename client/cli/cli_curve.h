/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CURVE_H
#define UMBRAGE_CLI_CURVE_H
/* Accuracy curves as people and programs read them. */
#include <stddef.h>
#include "cli_json.h"
#include "umbrage/curve.h"

/* Prints a light's curve as an indented table; nothing without rows. ns: [count] or NULL. */
void umbc_curve_print(const struct umb_curve_row *rows, const double *ns, size_t count);

/* The same under "curve", an array of objects; empty without rows. */
void umbc_curve_json(struct umbc_json *json, const struct umb_curve_row *rows, const double *ns,
                     size_t count);

#endif
