/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The study in words: for errors of 1, 5, 20 cm and so on, the cheapest setting that stays below.
 *
 * A setting stays below an error if, where its answers are on the wrong side, 95 % of the true
 * boundaries are nearer than that (and hardly any is out of reach).
 */
#include "study/trade.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define UNKNOWN_MAX 0.02 /* share of wrong answers without a boundary in reach */

struct writer {
    char *text;
    size_t size, used;
};

__attribute__((format(printf, 2, 3))) static void say(struct writer *writer, const char *format,
                                                      ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length =
        vsnprintf(writer->text + writer->used, writer->size - writer->used, format, arguments);
    va_end(arguments);
    if (length > 0) {
        const size_t room = writer->size - writer->used - 1;
        writer->used += (size_t)length < room ? (size_t)length : room;
    }
}

static int stays_below(const struct umbt_trade_result *result, double error_m)
{
    return result->off_p95_m <= error_m && result->off_unknown <= UNKNOWN_MAX;
}

/* Whether a's time is known and less than b's; of unknown ones the one that reads less. */
static int is_faster(const struct umbt_trade_result *a, const struct umbt_trade_result *b)
{
    const int a_known = a->spread <= UMBT_TRADE_SPREAD_MAX;
    const int b_known = b->spread <= UMBT_TRADE_SPREAD_MAX;
    return a_known && b_known ? a->ns_view < b->ns_view
                              : a_known > b_known || (a_known == b_known && a->nodes < b->nodes);
}

/* The fastest setting of a filter that stays below an error, or NULL. */
static const struct umbt_trade_result *fastest(const struct umbt_trade *trade, double error_m,
                                               uint32_t least_taps)
{
    const struct umbt_trade_result *best = NULL;
    for (uint32_t i = 0; i < trade->result_count; i++) {
        const struct umbt_trade_result *result = &trade->results[i];
        if (result->method == UMBT_TRADE_DAG && result->taps >= least_taps &&
            stays_below(result, error_m) && (best == NULL || is_faster(result, best))) {
            best = result;
        }
    }
    return best;
}

static void say_setting(struct writer *writer, const struct umbt_trade *trade,
                        const struct umbt_trade_result *result)
{
    const struct umbt_trade_bake *bake = &trade->bakes[result->bake];
    say(writer, "%u^3 voxels %s, ", bake->resolution, bake->frustum.closed ? "closed" : "open");
    if (result->level > 0) {
        say(writer, "level %u: ", result->level);
    } else {
        say(writer, "%u x %u taps: ", result->taps, result->taps);
    }
    if (result->spread <= UMBT_TRADE_SPREAD_MAX) {
        say(writer, "%.3g ns a point (runs within %.0f %%)", result->ns_view,
            100.0 * result->spread);
    } else {
        say(writer, "time too unsteady to tell");
    }
    say(writer, ", %.2f MB on disk, %.2f MB in memory, %.2g s to bake",
        1e-6 * (double)bake->packed_bytes, 1e-6 * (double)bake->info.memory_bytes, bake->wall_s);
}

/* The pair of settings that a sentence names. */
struct choice {
    const struct umbt_trade_result *hard, *soft; /* any filter; 9 taps and more, or NULL */
};

/* Says what stays below an error, unless the sentence before named the same. */
static void say_error(struct writer *writer, const struct umbt_trade *trade, double error_m,
                      struct choice *last)
{
    const struct choice choice = {fastest(trade, error_m, 1), fastest(trade, error_m, 9)};
    if (choice.hard == NULL || (choice.hard == last->hard && choice.soft == last->soft)) {
        return;
    }
    *last = choice;
    say(writer, "Edges within %.3g m: ", error_m);
    say_setting(writer, trade, choice.hard);
    if (choice.soft != NULL && choice.soft != choice.hard) {
        say(writer, "; with wide filters ");
        say_setting(writer, trade, choice.soft);
    }
    say(writer, ".\n");
}

/* The best that this ladder reached. */
static const struct umbt_trade_result *sharpest(const struct umbt_trade *trade)
{
    const struct umbt_trade_result *best = NULL;
    for (uint32_t i = 0; i < trade->result_count; i++) {
        const struct umbt_trade_result *result = &trade->results[i];
        if (result->method == UMBT_TRADE_DAG &&
            (best == NULL || result->off_p95_m < best->off_p95_m)) {
            best = result;
        }
    }
    return best;
}

static void say_rays(struct writer *writer, const struct umbt_trade *trade,
                     const struct umbt_trade_result *best)
{
    const struct umbt_trade_rays *rays = &trade->rays;
    const struct umbt_trade_result *one = fastest(trade, INFINITY, 1);
    if (rays->spread > UMBT_TRADE_SPREAD_MAX) {
        say(writer, "Shadow rays by Embree: time too unsteady to tell.\n");
        return;
    }
    say(writer,
        "A shadow ray by Embree, exact: %.4g ns a point on the same view, %.4g ns eight at a time",
        rays->ns_view, rays->ns_view8);
    const double least = fmin(rays->ns_view, rays->ns_view8);
    if (one != NULL && one->spread <= UMBT_TRADE_SPREAD_MAX &&
        best->spread <= UMBT_TRADE_SPREAD_MAX) {
        say(writer, ", %.2g times the fastest look-up here and %.2g times the sharpest",
            least / one->ns_view, least / best->ns_view);
    }
    say(writer, "; 81 rays a point: %.5g ns, %.5g ns eight at a time.\n", rays->ns_area,
        rays->ns_area8);
}

/* The setting of a method and width on the open asset of a resolution, or NULL. */
static const struct umbt_trade_result *find(const struct umbt_trade *trade,
                                            enum umbt_trade_method method, uint32_t resolution,
                                            uint32_t taps)
{
    for (uint32_t i = 0; i < trade->result_count; i++) {
        const struct umbt_trade_result *result = &trade->results[i];
        if (result->method == method && result->taps == taps && result->level == 0 &&
            !trade->bakes[result->bake].frustum.closed &&
            trade->bakes[result->bake].resolution == resolution) {
            return result;
        }
    }
    return NULL;
}

static void say_time(struct writer *writer, const struct umbt_trade_result *result)
{
    if (result->spread <= UMBT_TRADE_SPREAD_MAX) {
        say(writer, "%.3g ns", result->ns_view);
    } else {
        say(writer, "an unsteady time");
    }
}

/* What a peer of the finest resolution that it has costs beside the asset it was made of. */
static void say_peer(struct writer *writer, const struct umbt_trade *trade,
                     enum umbt_trade_method method, const char *name)
{
    static const uint32_t widths[2] = {1, 9};
    uint32_t finest = 0;
    for (uint32_t i = 0; i < trade->result_count; i++) {
        const struct umbt_trade_result *result = &trade->results[i];
        if (result->method == method && trade->bakes[result->bake].resolution > finest) {
            finest = trade->bakes[result->bake].resolution;
        }
    }
    const char *between = "";
    for (int i = 0; finest > 0 && i < 2; i++) {
        const struct umbt_trade_result *peer = find(trade, method, finest, widths[i]);
        const struct umbt_trade_result *ours = find(trade, UMBT_TRADE_DAG, finest, widths[i]);
        if (peer == NULL || ours == NULL) {
            continue;
        }
        if (between[0] == '\0') {
            say(writer, "%s of the same %u^3 voxels: %.3g MB in memory, the open asset %.3g MB; ",
                name, finest, 1e-6 * (double)peer->bytes, 1e-6 * (double)ours->bytes);
        }
        say(writer, "%s%u x %u taps ", between, widths[i], widths[i]);
        say_time(writer, peer);
        say(writer, " against ");
        say_time(writer, ours);
        between = ", ";
    }
    if (between[0] != '\0') {
        say(writer, ".\n");
    }
}

/* Times that are not told; of all threads only: nothing above depends on those. */
static void say_unsteady(struct writer *writer, const struct umbt_trade *trade)
{
    uint32_t one = 0, all = 0;
    for (uint32_t i = 0; i < trade->result_count; i++) {
        const struct umbt_trade_result *r = &trade->results[i];
        one += fmax(r->spread, r->spread_free) > UMBT_TRADE_SPREAD_MAX;
        all += r->spread_all > UMBT_TRADE_SPREAD_MAX;
    }
    if (one > 0 || all > 0) {
        say(writer,
            "Not told: times of %u of %u settings on one thread and of %u on all threads, since "
            "their runs differ by more than %.0f %% after all attempts; run again on a quieter "
            "machine.\n",
            one, trade->result_count, all, 100.0 * UMBT_TRADE_SPREAD_MAX);
    }
}

static void say_caveats(struct writer *writer, const struct umbt_trade *trade)
{
    say_unsteady(writer, trade);
    for (uint32_t i = 0; i < trade->bake_count; i++) {
        if (trade->bakes[i].asset == NULL) {
            say(writer, "Not reached: %s: %s.\n", trade->bakes[i].name, trade->bakes[i].reason);
        }
    }
}

void umbt_trade_verdict(const struct umbt_trade *trade, char *text, size_t size)
{
    struct writer writer = {text, size, 0};
    text[0] = '\0';
    const struct umbt_trade_result *best = sharpest(trade);
    if (best == NULL) {
        return;
    }
    say(&writer, "Sharpest of this ladder: edges within %.3g m: ", best->off_p95_m);
    say_setting(&writer, trade, best);
    say(&writer, ".\n");
    /* 1, 2, 5 a decade, from what was reached on. */
    const double decade = pow(10.0, floor(log10(fmax(best->off_p95_m, 1e-6))));
    struct choice last = {best, NULL};
    for (double scale = decade; scale <= trade->points.reach_m; scale *= 10.0) {
        for (int step = 0; step < 3; step++) {
            const double error_m = scale * (step == 0 ? 1.0 : step == 1 ? 2.0 : 5.0);
            if (error_m > best->off_p95_m && error_m <= trade->points.reach_m) {
                say_error(&writer, trade, error_m, &last);
            }
        }
    }
    say_rays(&writer, trade, best);
    say_peer(&writer, trade, UMBT_TRADE_DEPTH_MAP, "A plain depth map (AVX2)");
    say_peer(&writer, trade, UMBT_TRADE_NANOVDB, "A NanoVDB mask grid");
    if (trade->missing != NULL && trade->missing[0] != '\0') {
        say(&writer, "%s\n", trade->missing);
    }
    say_caveats(&writer, trade);
}
