/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The study in words: for errors of 1, 5, 20 cm and so on, the cheapest setting that stays below.
 *
 * A setting stays below an error if 95 % of its wrong answers have a true boundary nearer than the
 * error, and hardly any has no boundary within reach.
 */
#include "study/study.h"

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

static int stays_below(const struct umbt_study_result *result, double error_m)
{
    return result->off_p95_m <= error_m && result->off_unknown <= UNKNOWN_MAX;
}

/* Returns 1 if the time of a is known and shorter than that of b. If both times are unknown,
 * returns 1 if a reads fewer nodes. */
static int is_faster(const struct umbt_study_result *a, const struct umbt_study_result *b)
{
    const int a_known = a->spread <= UMBT_STUDY_SPREAD_MAX;
    const int b_known = b->spread <= UMBT_STUDY_SPREAD_MAX;
    return a_known && b_known ? a->ns_view < b->ns_view
                              : a_known > b_known || (a_known == b_known && a->nodes < b->nodes);
}

/* The fastest setting of a filter that stays below an error, or NULL. */
static const struct umbt_study_result *fastest(const struct umbt_study *study, double error_m,
                                               uint32_t least_taps)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG && result->taps >= least_taps &&
            stays_below(result, error_m) && (best == NULL || is_faster(result, best))) {
            best = result;
        }
    }
    return best;
}

static void say_setting(struct writer *writer, const struct umbt_study *study,
                        const struct umbt_study_result *result)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    say(writer, "%u^3 voxels %s, ", bake->resolution, bake->frustum.closed ? "closed" : "open");
    if (result->level > 0) {
        say(writer, "level %u: ", result->level);
    } else {
        say(writer, "%u x %u taps: ", result->taps, result->taps);
    }
    if (result->spread <= UMBT_STUDY_SPREAD_MAX) {
        say(writer, "%.3g ns a point (runs within %.0f %%)", result->ns_view,
            100.0 * result->spread);
    } else {
        say(writer, "time too unsteady to tell");
    }
    say(writer, ", %.2f MB on disk, %.2f MB in memory, %.2g s to bake",
        1e-6 * (double)bake->packed_bytes, 1e-6 * (double)bake->info.memory_bytes, bake->wall_s);
}

/* The pair of settings in a sentence. */
struct choice {
    const struct umbt_study_result *hard, *soft; /* any filter; 9 taps and more, or NULL */
};

/* Writes the settings that stay below an error, unless they are those of the sentence before. */
static void say_error(struct writer *writer, const struct umbt_study *study, double error_m,
                      struct choice *last)
{
    const struct choice choice = {fastest(study, error_m, 1), fastest(study, error_m, 9)};
    if (choice.hard == NULL || (choice.hard == last->hard && choice.soft == last->soft)) {
        return;
    }
    *last = choice;
    say(writer, "Edges within %.3g m: ", error_m);
    say_setting(writer, study, choice.hard);
    if (choice.soft != NULL && choice.soft != choice.hard) {
        say(writer, "; with wide filters ");
        say_setting(writer, study, choice.soft);
    }
    say(writer, ".\n");
}

/* The sharpest result of all resolutions. */
static const struct umbt_study_result *sharpest(const struct umbt_study *study)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG &&
            (best == NULL || result->off_p95_m < best->off_p95_m)) {
            best = result;
        }
    }
    return best;
}

static void say_rays(struct writer *writer, const struct umbt_study *study,
                     const struct umbt_study_result *best)
{
    const struct umbt_study_rays *rays = &study->rays;
    const struct umbt_study_result *one = fastest(study, INFINITY, 1);
    if (rays->spread > UMBT_STUDY_SPREAD_MAX) {
        say(writer, "Shadow rays by Embree: time too unsteady to tell.\n");
        return;
    }
    say(writer,
        "A shadow ray by Embree, exact: %.4g ns a point on the same view, %.4g ns eight at a time",
        rays->ns_view, rays->ns_view8);
    const double least = fmin(rays->ns_view, rays->ns_view8);
    if (one != NULL && one->spread <= UMBT_STUDY_SPREAD_MAX &&
        best->spread <= UMBT_STUDY_SPREAD_MAX) {
        say(writer, ", %.2g times the fastest look-up here and %.2g times the sharpest",
            least / one->ns_view, least / best->ns_view);
    }
    say(writer, "; 81 rays a point: %.5g ns, %.5g ns eight at a time.\n", rays->ns_area,
        rays->ns_area8);
}

/* Returns the setting of a method and filter width on the open asset of a resolution, or NULL. */
static const struct umbt_study_result *find(const struct umbt_study *study,
                                            enum umbt_study_method method, uint32_t resolution,
                                            uint32_t taps)
{
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == method && result->taps == taps && result->level == 0 &&
            !study->bakes[result->bake].frustum.closed &&
            study->bakes[result->bake].resolution == resolution) {
            return result;
        }
    }
    return NULL;
}

static void say_time(struct writer *writer, const struct umbt_study_result *result)
{
    if (result->spread <= UMBT_STUDY_SPREAD_MAX) {
        say(writer, "%.3g ns", result->ns_view);
    } else {
        say(writer, "an unsteady time");
    }
}

/* Writes the cost of a peer, at its finest resolution, beside that of its asset. */
static void say_peer(struct writer *writer, const struct umbt_study *study,
                     enum umbt_study_method method, const char *name)
{
    static const uint32_t widths[2] = {1, 9};
    uint32_t finest = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == method && study->bakes[result->bake].resolution > finest) {
            finest = study->bakes[result->bake].resolution;
        }
    }
    const char *between = "";
    for (int i = 0; finest > 0 && i < 2; i++) {
        const struct umbt_study_result *peer = find(study, method, finest, widths[i]);
        const struct umbt_study_result *ours = find(study, UMBT_STUDY_DAG, finest, widths[i]);
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

/* Writes the numbers of times that are left out because their runs differ too much. */
static void say_unsteady(struct writer *writer, const struct umbt_study *study)
{
    uint32_t one = 0, all = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *r = &study->results[i];
        one += fmax(r->spread, r->spread_free) > UMBT_STUDY_SPREAD_MAX;
        all += r->spread_all > UMBT_STUDY_SPREAD_MAX;
    }
    if (one > 0 || all > 0) {
        say(writer,
            "Not told: times of %u of %u settings on one thread and of %u on all threads, since "
            "their runs differ by more than %.0f %% after all attempts; run again on a quieter "
            "machine.\n",
            one, study->result_count, all, 100.0 * UMBT_STUDY_SPREAD_MAX);
    }
}

static void say_caveats(struct writer *writer, const struct umbt_study *study)
{
    say_unsteady(writer, study);
    for (uint32_t i = 0; i < study->bake_count; i++) {
        if (study->bakes[i].asset == NULL) {
            say(writer, "Not reached: %s: %s.\n", study->bakes[i].name, study->bakes[i].reason);
        }
    }
}

void umbt_study_summary(const struct umbt_study *study, char *text, size_t size)
{
    struct writer writer = {text, size, 0};
    text[0] = '\0';
    const struct umbt_study_result *best = sharpest(study);
    if (best == NULL) {
        return;
    }
    say(&writer, "Sharpest of these resolutions: edges within %.3g m: ", best->off_p95_m);
    say_setting(&writer, study, best);
    say(&writer, ".\n");
    /* Errors of 1, 2, 5 a decade, from the best reached one on. */
    const double decade = pow(10.0, floor(log10(fmax(best->off_p95_m, 1e-6))));
    struct choice last = {best, NULL};
    for (double scale = decade; scale <= study->points.reach_m; scale *= 10.0) {
        for (int step = 0; step < 3; step++) {
            const double error_m = scale * (step == 0 ? 1.0 : step == 1 ? 2.0 : 5.0);
            if (error_m > best->off_p95_m && error_m <= study->points.reach_m) {
                say_error(&writer, study, error_m, &last);
            }
        }
    }
    say_rays(&writer, study, best);
    say_peer(&writer, study, UMBT_STUDY_DEPTH_MAP, "A plain depth map (AVX2)");
    say_peer(&writer, study, UMBT_STUDY_NANOVDB, "A NanoVDB mask grid");
    if (study->missing != NULL && study->missing[0] != '\0') {
        say(&writer, "%s\n", study->missing);
    }
    say_caveats(&writer, study);
}
