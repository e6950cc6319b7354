/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A study's verdict in words (study.h), a sentence a line. The first line says what the highest
 * resolution costs and buys beside a quarter of it, the second what half the error costs. Then, for
 * shares of wrong answers of 10, 5, 2, 1 % and so on, the fastest setting that stays below.
 *
 * Of several assets of a resolution, the first one counts: the one of the plan.
 */
#include "study/study.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define STEPS_MAX  12
#define RISE_SIGMA 2.0 /* a rise within so many deviations of the sample is chance */
#define WRONG_MIN  20  /* wrong answers that a step needs to count in a fit */

static double clamp_at(double value, double least)
{
    return value > least ? value : least;
}

/* ---- the resolutions, by one tap ---- */

/* A resolution's one tap. */
struct step {
    const struct umbt_study_bake *bake;
    const struct umbt_study_result *result;
};

/* A value of a step. */
typedef double (*step_value_fn)(const struct step *step);

static double wrong_of(const struct step *step)
{
    return step->result->wrong;
}
static double side_of(const struct step *step)
{
    return step->bake->resolution;
}
static double bytes_of(const struct step *step)
{
    return (double)step->bake->info.packed_bytes;
}
static double time_of(const struct step *step)
{
    return step->result->view.ns;
}
static double bake_of(const struct step *step)
{
    return step->bake->cpu_s;
}

/* Finds the asset of each resolution at one filter width. Returns their number. */
static uint32_t steps_find(const struct umbt_study *study, uint32_t taps,
                           struct step steps[STEPS_MAX])
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        const struct umbt_study_bake *bake = &study->bakes[result->bake];
        if (result->method == UMBT_STUDY_DAG && result->taps == taps && result->level == 0 &&
            count < STEPS_MAX &&
            (count == 0 || steps[count - 1].bake->resolution < bake->resolution)) {
            steps[count++] = (struct step){bake, result};
        }
    }
    return count;
}

/* Writes two digits of a number, or the whole number above 99. */
static void say_number(FILE *to, double number)
{
    fprintf(to, number < 99.5 ? "%.2g" : "%.0f", number);
}

/* Writes " (0.17 to 0.91 MB on disk)". */
static void say_range(FILE *to, double from, double until, const char *unit)
{
    fprintf(to, " (");
    say_number(to, from);
    fprintf(to, " to ");
    say_number(to, until);
    fprintf(to, " %s)", unit);
}

/* Writes "3.9 times the bytes", or "the same bytes". */
static void say_times(FILE *to, double from, double of, const char *what)
{
    const double times = of / clamp_at(from, 1e-12);
    if (times >= 0.995 && times < 1.005) {
        fprintf(to, "the same %s", what);
    } else {
        say_number(to, times);
        fprintf(to, " times the %s", what);
    }
}

/* Writes a share as per cent; no share at all as "none". */
static void say_share(FILE *to, double share)
{
    if (share > 0.0) {
        fprintf(to, "%.2g %%", 100.0 * share);
    } else {
        fprintf(to, "none");
    }
}

/* Writes what the share of wrong answers does between two steps. */
static void say_gain(FILE *to, const struct umbt_study_result *low,
                     const struct umbt_study_result *high)
{
    if (low->wrong_view > 0.0 && high->wrong_view < low->wrong_view) {
        if (high->wrong_view > 0.0) {
            fprintf(to, "They buy %.2g times fewer wrong answers: ",
                    low->wrong_view / high->wrong_view);
        } else {
            fprintf(to, "They remove every wrong answer: ");
        }
        say_share(to, high->wrong_view);
        fprintf(to, " instead of ");
        say_share(to, low->wrong_view);
        fprintf(to, " of what the cameras see is wrong.\n");
    } else {
        fprintf(to, "They buy nothing here: ");
        say_share(to, high->wrong_view);
        fprintf(to, " of what the cameras see is wrong at either.\n");
    }
}

/* Writes what the highest resolution costs and buys beside a quarter of it, or the next lower. */
static void say_step(FILE *to, const struct step *steps, uint32_t count)
{
    if (count < 2) {
        return;
    }
    const struct step *high = &steps[count - 1], *low = &steps[count > 2 ? count - 3 : count - 2];
    fprintf(to, "%u voxels a side instead of %u: ", high->bake->resolution, low->bake->resolution);
    say_times(to, bytes_of(low), bytes_of(high), "bytes");
    say_range(to, 1e-6 * bytes_of(low), 1e-6 * bytes_of(high), "MB on disk");
    fprintf(to, ", ");
    say_times(to, time_of(low), time_of(high), "time of a look-up");
    say_range(to, time_of(low), time_of(high), "ns");
    fprintf(to, " and ");
    say_times(to, bake_of(low), bake_of(high), "bake");
    say_range(to, bake_of(low), bake_of(high), "s of processor time");
    fprintf(to, ". ");
    say_gain(to, low->result, high->result);
}

/* Returns 1 if a step has enough wrong answers to tell their share. */
static int is_told(const struct step *step)
{
    return wrong_of(step) * (double)step->result->judged >= WRONG_MIN;
}

/* Returns the exponent p with which a value grows as resolution^p: the slope of a least-squares
 * line through logarithms, over the steps whose error is known. */
static double power_of(const struct step *steps, uint32_t count, step_value_fn value)
{
    double n = 0.0, sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        if (is_told(&steps[i]) && value(&steps[i]) > 0.0) {
            const double x = log2(side_of(&steps[i])), y = log2(value(&steps[i]));
            n += 1.0;
            sx += x;
            sy += y;
            sxx += x * x;
            sxy += x * y;
        }
    }
    const double spread = n * sxx - sx * sx;
    return spread > 0.0 ? (n * sxy - sx * sy) / spread : 0.0;
}

/* Writes what a halving of the share of wrong answers costs. */
static void say_halving(FILE *to, const struct step *steps, uint32_t count)
{
    const double fall = -power_of(steps, count, wrong_of);
    uint32_t first = count, last = count;
    for (uint32_t i = 0; i < count; i++) {
        first = is_told(&steps[i]) && first == count ? i : first;
        last = is_told(&steps[i]) ? i : last;
    }
    if (first == last || !(fall > 0.05)) {
        fprintf(to, "Half the error costs: not told, because %s.\n",
                first == last ? "too few answers are wrong"
                              : "the error does not fall with the resolution");
        return;
    }
    fprintf(to,
            "Half the error costs: %.2g times the voxels a side, and with them %.2g times the "
            "bytes, %.2g times the time of a look-up and %.2g times the bake (a fit over %u to %u "
            "voxels; the error is the share of wrong answers at all samples).\n",
            exp2(1.0 / fall), exp2(power_of(steps, count, bytes_of) / fall),
            exp2(power_of(steps, count, time_of) / fall),
            exp2(power_of(steps, count, bake_of) / fall), steps[first].bake->resolution,
            steps[last].bake->resolution);
}

/* ---- the fastest setting for an error ---- */

static void say_setting(FILE *to, const struct umbt_study *study,
                        const struct umbt_study_result *result)
{
    const struct umbt_study_bake *bake = &study->bakes[result->bake];
    fprintf(to, "%u voxels a side%s, ", bake->resolution,
            umbt_study_is_closed(bake) ? " (closed)" : "");
    if (result->level > 0) {
        fprintf(to, "level %u: ", result->level);
    } else {
        fprintf(to, "%u x %u taps: ", result->taps, result->taps);
    }
    fprintf(to, "%.3g ns a point, %.3g MB on disk", result->view.ns,
            1e-6 * (double)bake->info.packed_bytes);
}

/* Returns the fastest setting with at least `least_taps` taps whose share of wrong answers is at
 * most `wrong`; NULL if there is none. */
static const struct umbt_study_result *fastest(const struct umbt_study *study, double wrong,
                                               uint32_t least_taps)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG && result->taps >= least_taps &&
            result->wrong_view <= wrong && (best == NULL || result->view.ns < best->view.ns)) {
            best = result;
        }
    }
    return best;
}

/* The pair of settings in a sentence. */
struct choice {
    const struct umbt_study_result *any, *soft; /* any filter; 9 taps and more, or NULL */
};

/* Writes the settings for a share of wrong answers, unless they are those of the line before. */
static void say_error(FILE *to, const struct umbt_study *study, double wrong, struct choice *last)
{
    const struct umbt_study_result *last_soft = last->soft;
    const struct choice choice = {fastest(study, wrong, 1), fastest(study, wrong, 9)};
    if (choice.any == NULL || (choice.any == last->any && choice.soft == last->soft)) {
        return;
    }
    *last = choice;
    fprintf(to, "At most %.2g %% wrong: ", 100.0 * wrong);
    say_setting(to, study, choice.any);
    if (choice.soft != NULL && choice.soft != choice.any) {
        fprintf(to, "; with wide filters ");
        if (choice.soft == last_soft) {
            fprintf(to, "as in the line above");
        } else {
            say_setting(to, study, choice.soft);
        }
    }
    fprintf(to, ".\n");
}

static const struct umbt_study_result *sharpest(const struct umbt_study *study)
{
    const struct umbt_study_result *best = NULL;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        if (result->method == UMBT_STUDY_DAG && (best == NULL || result->wrong < best->wrong)) {
            best = result;
        }
    }
    return best;
}

static void say_errors(FILE *to, const struct umbt_study *study,
                       const struct umbt_study_result *best)
{
    static const double shares[] = {0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001};
    struct choice last = {NULL, NULL};
    for (size_t i = 0; i < sizeof shares / sizeof shares[0]; i++) {
        if (shares[i] >= best->wrong_view) {
            say_error(to, study, shares[i], &last);
        }
    }
    fprintf(to, "Sharpest of these: ");
    say_setting(to, study, best);
    fprintf(to, "; wrong are ");
    say_share(to, best->wrong_view);
    fprintf(to, " of what the cameras see; all samples are off by %.2g mm in the mean.\n",
            1e3 * best->off_mean_m);
}

/* ---- beside others ---- */

static void say_rays(FILE *to, const struct umbt_study *study, const struct umbt_study_result *best)
{
    const struct umbt_time *rays = study->rays;
    const struct umbt_study_result *one = fastest(study, INFINITY, 1);
    double least = rays[UMBT_RAYS_VIEW].ns;
    fprintf(to, "A shadow ray by Embree, exact: %.4g ns a point on the same view",
            rays[UMBT_RAYS_VIEW].ns);
    if (rays[UMBT_RAYS_VIEW8].ns > 0.0) {
        fprintf(to, ", %.4g ns eight at a time", rays[UMBT_RAYS_VIEW8].ns);
        least = fmin(least, rays[UMBT_RAYS_VIEW8].ns);
    }
    fprintf(to, ", %.2g times the fastest look-up here and %.2g times the sharpest",
            least / one->view.ns, least / best->view.ns);
    if (rays[UMBT_RAYS_AREA8].ns > 0.0) {
        fprintf(to, "; 81 rays a point: %.5g ns, %.5g ns eight at a time", rays[UMBT_RAYS_AREA].ns,
                rays[UMBT_RAYS_AREA8].ns);
    }
    fprintf(to, ".\n");
}

/* Returns the setting of a method and filter width on the open asset of a resolution, or NULL. */
static const struct umbt_study_result *find(const struct umbt_study *study,
                                            enum umbt_study_method method, uint32_t resolution,
                                            uint32_t taps)
{
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        const struct umbt_study_bake *bake = &study->bakes[result->bake];
        if (result->method == method && result->taps == taps && result->level == 0 &&
            !umbt_study_is_closed(bake) && bake->resolution == resolution) {
            return result;
        }
    }
    return NULL;
}

/* Writes the cost of another method (a depth map, NanoVDB) at its finest resolution, beside that of
 * the asset with the same voxels. */
static void say_peer(FILE *to, const struct umbt_study *study, enum umbt_study_method method,
                     const char *name)
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
            fprintf(to,
                    "%s of the same %u voxels a side: %.3g MB in memory, the open asset %.3g "
                    "MB; ",
                    name, finest, 1e-6 * (double)peer->bytes, 1e-6 * (double)ours->bytes);
        }
        fprintf(to, "%s%u x %u taps %.3g ns against %.3g ns", between, widths[i], widths[i],
                peer->view.ns, ours->view.ns);
        between = ", ";
    }
    if (between[0] != '\0') {
        fprintf(to, ".\n");
    }
}

/* ---- caveats ---- */

/* A share of wrong answers, and the samples that it is of. */
struct wrong_share {
    const char *of;
    double low, high; /* at a step and at the next */
    double samples;
};

/* Returns the reason for a rise of a share from one step to the next, as far as it is known. */
static const char *rise_reason(const struct wrong_share *share, const struct umbt_study_result *low,
                               const struct umbt_study_result *high)
{
    const double rise = share->high - share->low, samples = clamp_at(share->samples, 1.0);
    if (rise * samples <= (double)low->undefined - (double)high->undefined) {
        return "fewer samples are left out, because fewer windows reach into solids";
    }
    return rise <= RISE_SIGMA * sqrt((share->high + share->low) / samples)
               ? "within the chance of the sample"
               : "more than the chance of the sample";
}

/* Writes where one filter's shares of wrong answers rise from a step to the next, and why. */
static void say_rise(FILE *to, const struct umbt_study *study, const struct step steps[2])
{
    const struct umbt_study_result *low = steps[0].result, *high = steps[1].result;
    const struct wrong_share shares[2] = {
        {"all samples", low->wrong, high->wrong, (double)high->judged},
        {"what the cameras see", low->wrong_view, high->wrong_view,
         (double)study->points.first[UMBT_STUDY_BORDER]},
    };
    for (int i = 0; i < 2; i++) {
        if (shares[i].high > shares[i].low) {
            fprintf(to,
                    "Not monotone: with %u x %u taps, %u voxels a side have %.2g %% of %s wrong, "
                    "%u have %.2g %%: %s.\n",
                    low->taps, low->taps, steps[0].bake->resolution, 100.0 * shares[i].low,
                    shares[i].of, steps[1].bake->resolution, 100.0 * shares[i].high,
                    rise_reason(&shares[i], low, high));
        }
    }
}

static void say_rises(FILE *to, const struct umbt_study *study)
{
    struct step steps[STEPS_MAX];
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        const uint32_t count = steps_find(study, taps, steps);
        for (uint32_t i = 1; i < count; i++) {
            say_rise(to, study, &steps[i - 1]);
        }
    }
}

static void say_caveats(FILE *to, const struct umbt_study *study)
{
    uint32_t unsteady = 0, unsteady_all = 0;
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *r = &study->results[i];
        unsteady += fmax(r->view.spread, r->free.spread) > UMBT_SPREAD_MAX;
        unsteady_all += r->all.spread > UMBT_SPREAD_MAX;
    }
    say_rises(to, study);
    if (study->missing != NULL && study->missing[0] != '\0') {
        fprintf(to, "%s\n", study->missing);
    }
    if (study->translucent) {
        fprintf(to, "Translucent casters let light through here, in the assets and in the rays; "
                    "shadow maps, grids and techniques are compared by opaque casters alone.\n");
    }
    if (study->light_count > 1) {
        fprintf(to,
                "The first of the file's %u lights is studied, but the file gives it no name to "
                "choose it by: bytes and bake times are those of all.\n",
                study->light_count);
    }
    if (unsteady > 0 || unsteady_all > 0) {
        fprintf(to,
                "Unsteady times: of %u settings, %u on one thread and %u on all threads have least "
                "runs that differ by more than %.0f %%; the page marks them.\n",
                study->result_count, unsteady, unsteady_all, 100.0 * UMBT_SPREAD_MAX);
    }
    for (uint32_t i = 0; i < study->bake_count; i++) {
        if (study->bakes[i].reason[0] != '\0') {
            fprintf(to, "Not reached: %s: %s.\n", study->bakes[i].name, study->bakes[i].reason);
        }
    }
}

void umbt_study_summary(const struct umbt_study *study, char *text, size_t size)
{
    struct step steps[STEPS_MAX];
    text[0] = '\0';
    const struct umbt_study_result *best = sharpest(study);
    FILE *to = best != NULL ? fmemopen(text, size, "w") : NULL;
    if (to == NULL) { /* nothing to say, or no memory */
        return;
    }
    const uint32_t count = steps_find(study, 1, steps);
    say_step(to, steps, count);
    say_halving(to, steps, count);
    say_errors(to, study, best);
    say_rays(to, study, best);
    say_peer(to, study, UMBT_STUDY_DEPTH_MAP, "A plain depth map (AVX2)");
    say_peer(to, study, UMBT_STUDY_NANOVDB, "A NanoVDB mask grid");
    say_caveats(to, study);
    (void)fclose(to);
}
