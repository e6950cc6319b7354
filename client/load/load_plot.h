/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_PLOT_H
#define UMBRAGE_LOAD_LOAD_PLOT_H
/*
 * Plots as SVG inside a page: axes with round numbers, lines, dots. Colours come from the page's
 * classes k0, k1 ... and follow light and dark.
 *
 *     umbc_plot_begin(&plot, file), umbc_plot_line..., umbc_plot_end(&plot);
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct umbc_plot {
    FILE *file;
    const char *title, *x_name, *y_name;
    double x_low, x_high, y_low, y_high; /* on logarithmic axes above 0 */
    bool x_log, y_log;
    bool x_nines; /* x is -log10(1 - share), and labelled by the share */
};

/* Widens the y range so that it holds `value`. */
void umbc_plot_hold_y(struct umbc_plot *plot, double value);

/* Frame and axes; ranges are widened where they are empty. */
void umbc_plot_begin(struct umbc_plot *plot);

/* A line through points; those that are not finite, or not above 0 on a logarithmic axis, break it.
 */
void umbc_plot_line(const struct umbc_plot *plot, const char *style, const double *x,
                    const double *y, size_t count);
void umbc_plot_dot(const struct umbc_plot *plot, const char *style, double x, double y);
void umbc_plot_level(const struct umbc_plot *plot, const char *style, double y); /* across */
void umbc_plot_mark(const struct umbc_plot *plot, const char *style, double x);  /* upright */
void umbc_plot_end(const struct umbc_plot *plot, const char *caption);           /* caption: HTML */

#endif
