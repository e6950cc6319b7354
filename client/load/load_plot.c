/* SPDX-License-Identifier: Apache-2.0 */
/* Plots as SVG, see load_plot.h. Sizes are the viewBox's: a phone shows it one to one. */
#include "load/load_plot.h"

#include <math.h>

#define WIDTH  420.0
#define HEIGHT 250.0
#define LEFT   52.0
#define RIGHT  12.0
#define TOP    12.0
#define BOTTOM 40.0
#define TICKS  5 /* about, of a linear axis */

static double share(double value, double low, double high, bool is_log)
{
    return is_log ? log(value / low) / log(high / low) : (value - low) / (high - low);
}

static double place_x(const struct umbc_plot *plot, double x)
{
    return LEFT + (WIDTH - LEFT - RIGHT) * share(x, plot->x_low, plot->x_high, plot->x_log);
}

static double place_y(const struct umbc_plot *plot, double y)
{
    return HEIGHT - BOTTOM -
           (HEIGHT - TOP - BOTTOM) * share(y, plot->y_low, plot->y_high, plot->y_log);
}

static bool fits(const struct umbc_plot *plot, double x, double y)
{
    return isfinite(x) && isfinite(y) && (!plot->x_log || x > 0) && (!plot->y_log || y > 0);
}

void umbc_plot_hold_y(struct umbc_plot *plot, double value)
{
    if (!isfinite(value) || (plot->y_log && value <= 0)) {
        return;
    }
    if (plot->y_log && plot->y_low <= 0) {
        plot->y_low = plot->y_high = value;
    }
    plot->y_low = value < plot->y_low ? value : plot->y_low;
    plot->y_high = value > plot->y_high ? value : plot->y_high;
}

/* "0.5", "20", "3k", "1.2M". */
static void format_number(double value, char text[24])
{
    if (fabs(value) >= 1e6) {
        (void)snprintf(text, 24, "%.3gM", value / 1e6);
    } else if (fabs(value) >= 1e4) {
        (void)snprintf(text, 24, "%.3gk", value / 1e3);
    } else {
        (void)snprintf(text, 24, "%.4g", value);
    }
}

static void tick_x(const struct umbc_plot *plot, double x, const char *label)
{
    double at = place_x(plot, x);
    (void)fprintf(plot->file,
                  "<line class=\"grid\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>"
                  "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">%s</text>\n",
                  at, TOP, at, HEIGHT - BOTTOM, at, HEIGHT - BOTTOM + 15, label);
}

static void tick_y(const struct umbc_plot *plot, double y, const char *label)
{
    double at = place_y(plot, y);
    (void)fprintf(plot->file,
                  "<line class=\"grid\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>"
                  "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"end\">%s</text>\n",
                  LEFT, at, WIDTH - RIGHT, at, LEFT - 5, at + 4, label);
}

/* The round step that gives about so many ticks. */
static double round_step(double range)
{
    double step = pow(10, floor(log10(range / TICKS)));
    double times = range / TICKS / step;
    return step * (times > 5 ? 10 : times > 2 ? 5 : times > 1 ? 2 : 1);
}

typedef void (*tick_fn)(const struct umbc_plot *plot, double value, const char *label);

static void ticks(const struct umbc_plot *plot, double low, double high, bool is_log, tick_fn tick)
{
    static const double within[] = {1, 2, 5};
    char label[24];
    if (!is_log) {
        double step = round_step(high - low);
        for (double value = ceil(low / step) * step; value <= high + 1e-9 * step; value += step) {
            format_number(fabs(value) < 1e-9 * step ? 0 : value, label); /* never "-0" */
            tick(plot, value, label);
        }
        return;
    }
    size_t each = high / low < 300 ? 3 : 1; /* 1, 2, 5 of a decade, or 1 alone */
    for (double decade = pow(10, floor(log10(low))); decade <= high; decade *= 10) {
        for (size_t i = 0; i < each; i++) {
            double value = decade * within[i];
            if (value >= low * 0.999 && value <= high * 1.001) {
                format_number(value, label);
                tick(plot, value, label);
            }
        }
    }
}

static void ticks_nines(const struct umbc_plot *plot)
{
    static const struct {
        double share;
        const char *label;
    } nines[] = {{0, "0"},     {0.5, "50"},     {0.9, "90"},
                 {0.99, "99"}, {0.999, "99.9"}, {0.9999, "99.99"}};
    for (size_t i = 0; i < sizeof nines / sizeof nines[0]; i++) {
        tick_x(plot, -log10(1 - nines[i].share), nines[i].label);
    }
}

void umbc_plot_begin(struct umbc_plot *plot)
{
    if (!(plot->y_high > plot->y_low)) {
        plot->y_high = plot->y_high > 0 ? plot->y_high * 1.5 : 1;
        plot->y_low = plot->y_log ? plot->y_high / 3 : 0;
    }
    if (!(plot->x_high > plot->x_low)) {
        plot->x_high = plot->x_low + (plot->x_low > 0 ? plot->x_low : 1);
    }
    plot->y_high *= plot->y_log ? 1.15 : 1.05;
    plot->y_low /= plot->y_log ? 1.15 : 1;
    (void)fprintf(plot->file,
                  "<figure><svg viewBox=\"0 0 %.0f %.0f\" role=\"img\" aria-label=\"%s\">\n", WIDTH,
                  HEIGHT, plot->title);
    if (plot->x_nines) {
        ticks_nines(plot);
    } else {
        ticks(plot, plot->x_low, plot->x_high, plot->x_log, tick_x);
    }
    ticks(plot, plot->y_low, plot->y_high, plot->y_log, tick_y);
    (void)fprintf(plot->file,
                  "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">%s</text>"
                  "<text x=\"12\" y=\"%.1f\" text-anchor=\"middle\" "
                  "transform=\"rotate(-90 12 %.1f)\">%s</text>\n",
                  (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, plot->x_name, (TOP + HEIGHT - BOTTOM) / 2,
                  (TOP + HEIGHT - BOTTOM) / 2, plot->y_name);
}

void umbc_plot_line(const struct umbc_plot *plot, const char *style, const double *x,
                    const double *y, size_t count)
{
    bool drawing = false;
    (void)fprintf(plot->file, "<path class=\"line %s\" d=\"", style);
    for (size_t i = 0; i < count; i++) {
        if (!fits(plot, x[i], y[i])) {
            drawing = false;
            continue;
        }
        (void)fprintf(plot->file, "%c%.1f %.1f", drawing ? 'L' : 'M', place_x(plot, x[i]),
                      place_y(plot, y[i]));
        drawing = true;
    }
    (void)fputs("\"/>\n", plot->file);
}

void umbc_plot_dot(const struct umbc_plot *plot, const char *style, double x, double y)
{
    if (fits(plot, x, y)) {
        (void)fprintf(plot->file, "<circle class=\"dot %s\" cx=\"%.1f\" cy=\"%.1f\" r=\"4\"/>\n",
                      style, place_x(plot, x), place_y(plot, y));
    }
}

void umbc_plot_level(const struct umbc_plot *plot, const char *style, double y)
{
    const double x[] = {plot->x_low, plot->x_high};
    const double ys[] = {y, y};
    umbc_plot_line(plot, style, x, ys, 2);
}

void umbc_plot_mark(const struct umbc_plot *plot, const char *style, double x)
{
    const double xs[] = {x, x};
    const double y[] = {plot->y_low, plot->y_high};
    umbc_plot_line(plot, style, xs, y, 2);
}

void umbc_plot_end(const struct umbc_plot *plot, const char *caption)
{
    (void)fprintf(plot->file, "</svg><figcaption><b>%s.</b> %s</figcaption></figure>\n",
                  plot->title, caption);
}
