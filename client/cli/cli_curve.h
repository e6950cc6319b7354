/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CURVE_H
#define UMBRAGE_CLI_CURVE_H
/* Accuracy curves as people and programs read them. */
#include <stddef.h>
#include "tool/json.h"
#include "umbrage/curve.h"

/* Kinds of costs: nanoseconds a point for points all over the scene, and next to each other. */
#define UMBC_CURVE_COSTS 2

/* Prints a light's curve as an indented table; nothing without rows. ns: NULL, or of each kind
 * [count] or NULL. */
void umbc_curve_print(const struct umb_curve_row *rows, const double *const ns[UMBC_CURVE_COSTS],
                      size_t count);

/* The same under "curve", an array of objects; empty without rows. */
void umbc_curve_json(struct umbu_json *json, const struct umb_curve_row *rows,
                     const double *const ns[UMBC_CURVE_COSTS], size_t count);

#endif
