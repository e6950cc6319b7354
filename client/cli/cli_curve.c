/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_curve.h. */
#include "cli_curve.h"

#include <inttypes.h>
#include <stdio.h>

void umbc_curve_print(const struct umb_curve_row *rows, const double *const ns[UMBC_CURVE_COSTS],
                      size_t count)
{
    if (count == 0) {
        return;
    }
    (void)printf("  level taps     bound, m  visibility error  nodes  cache lines");
    for (int k = 0; k < UMBC_CURVE_COSTS && ns != NULL; k++) {
        (void)printf("%s", ns[k] == NULL ? "" : k == 0 ? "  ns, scattered" : "  ns, coherent");
    }
    (void)putchar('\n');
    for (size_t i = 0; i < count; i++) {
        const struct umb_curve_row *row = &rows[i];
        (void)printf("  %5" PRIu32 " %4" PRIu32 " %12.4g %17.4f %6.2f %12.2f", row->level,
                     row->taps, row->bound_m, row->visibility_error, row->nodes, row->lines);
        for (int k = 0; k < UMBC_CURVE_COSTS && ns != NULL; k++) {
            if (ns[k] != NULL) {
                (void)printf(" %*.1f", k == 0 ? 14 : 13, ns[k][i]);
            }
        }
        (void)putchar('\n');
    }
}

void umbc_curve_json(struct umbu_json *json, const struct umb_curve_row *rows,
                     const double *const ns[UMBC_CURVE_COSTS], size_t count)
{
    umbu_json_begin(json, "curve", '[');
    for (size_t i = 0; i < count; i++) {
        umbu_json_begin(json, NULL, '{');
        umbu_json_integer(json, "level", rows[i].level);
        umbu_json_integer(json, "taps", rows[i].taps);
        umbu_json_number(json, "bound_m", rows[i].bound_m);
        umbu_json_number(json, "visibility_error", rows[i].visibility_error);
        umbu_json_number(json, "nodes", rows[i].nodes);
        umbu_json_number(json, "lines", rows[i].lines);
        for (int k = 0; k < UMBC_CURVE_COSTS && ns != NULL; k++) {
            if (ns[k] != NULL) {
                umbu_json_number(json, k == 0 ? "scattered_ns" : "coherent_ns", ns[k][i]);
            }
        }
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}
