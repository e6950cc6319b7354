/* SPDX-License-Identifier: Apache-2.0 */
/* Reads an asset's accuracy curve, and chooses settings from it; see umbrage/curve.h. */
#include "umbrage/curve.h"

#include <math.h>
#include <stdio.h>

#include "base/reserved.h"
#include "base/try.h"
#include "format/asset_parts.h"

static double light_bound_m(const struct umb__content *content,
                            const struct umb__curve_record *record)
{
    const struct umb_light_info *light = &content->lights[record->light];
    double bound = 0;
    for (uint32_t i = 0; i < light->frustum_count; i++) {
        const struct umb_frustum_info *frustum = &content->frusta[light->first_frustum + i];
        bound = fmax(bound, umb_frustum_bound_m(frustum, record->level, record->taps));
    }
    return bound;
}

/* Returns the first row of a light; if the light has no row, the first row of a later light. Rows
 * are sorted (content_check.c). */
static uint32_t first_row(const struct umb__content *content, uint32_t light)
{
    uint32_t low = 0, high = content->curve_count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (content->curve[middle].light < light) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

enum umb_status umb_asset_get_curve(const struct umb_asset *asset, uint32_t light,
                                    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX], size_t *count)
{
    const struct umb__content *content = &asset->canonical.content;
    *count = 0;
    for (uint32_t i = first_row(content, light);
         i < content->curve_count && *count < UMB_CURVE_ROWS_MAX; i++) {
        const struct umb__curve_record *record = &content->curve[i];
        const double points = record->points;
        if (record->light != light) {
            break;
        }
        rows[(*count)++] = (struct umb_curve_row){
            .level = record->level,
            .taps = record->taps,
            .bound_m = light_bound_m(content, record),
            .visibility_error = sqrt((double)record->squares / (points * UMB__CURVE_SQUARE)),
            .nodes = (double)record->nodes / points,
            .lines = (double)record->lines / points,
        };
    }
    return *count > 0 ? UMB_OK : UMB_E_NOT_FOUND;
}

struct choice {
    const struct umb_dial *dial;
    const struct umb_calibration *calibration;
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
};

static enum umb_status check_dial(const struct umb_dial *dial,
                                  const struct umb_query_settings *settings,
                                  struct umb_error *error)
{
    if (UMB__UNKNOWN(dial, "dial", error)) {
        return UMB_E_ARGUMENT;
    }
    const double wanted[3] = {dial->max_error_m, dial->max_visibility, dial->budget_ns};
    static const char *const names[3] = {"max_error", "max_visibility", "budget"};
    int any = 0;
    for (int i = 0; i < 3; i++) {
        if (!(wanted[i] >= 0) || !isfinite(wanted[i])) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: %g, must be finite and above 0", names[i],
                            wanted[i]);
        }
        any |= wanted[i] > 0;
    }
    if (!any) {
        return umb_fail(error, UMB_E_ARGUMENT, "max_error: give an error or a budget");
    }
    if (settings->taps != 0 || settings->level != 0 || settings->footprint_m != 0 ||
        !umb_filter_get_info(settings->filter)->has_curve) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "max_error, budget: taps %u, level %u and footprint %g must be 0, and the "
                        "filter must be box, because the dial chooses level and taps",
                        settings->taps, settings->level, settings->footprint_m);
    }
    return UMB_OK;
}

static double cost_ns(const struct choice *choice, size_t row)
{
    return choice->calibration && row < choice->calibration->count ? choice->calibration->ns[row]
                                                                   : INFINITY;
}

static int is_accurate(const struct choice *choice, size_t i)
{
    const struct umb_curve_row *row = &choice->rows[i];
    const struct umb_dial *dial = choice->dial;
    return (dial->max_error_m == 0 || row->bound_m <= dial->max_error_m) &&
           (dial->max_visibility == 0 || row->visibility_error <= dial->max_visibility);
}

static int is_affordable(const struct choice *choice, size_t i)
{
    return choice->dial->budget_ns == 0 || cost_ns(choice, i) <= choice->dial->budget_ns;
}

/* Returns 1 if row a is better than row b. In: two rows that meet the requirements. */
static int is_better(const struct choice *choice, size_t a, size_t b)
{
    const struct umb_curve_row *x = &choice->rows[a], *y = &choice->rows[b];
    const int cheapest = choice->dial->max_error_m > 0 || choice->dial->max_visibility > 0;
    if (cheapest && x->lines != y->lines) {
        return x->lines < y->lines;
    }
    if (!cheapest && x->visibility_error != y->visibility_error) {
        return x->visibility_error < y->visibility_error;
    }
    return x->bound_m < y->bound_m;
}

/* Fails because no row meets the requirements. The message names the best that the asset offers. */
static enum umb_status fail_choice(const struct choice *choice, struct umb_error *error)
{
    const struct umb_curve_row *finest = &choice->rows[0], *softest = &choice->rows[0];
    size_t least = 0, accurate = choice->count;
    for (size_t i = 0; i < choice->count; i++) {
        const struct umb_curve_row *row = &choice->rows[i];
        finest = row->bound_m < finest->bound_m ? row : finest;
        softest = row->visibility_error < softest->visibility_error ? row : softest;
        least = cost_ns(choice, i) < cost_ns(choice, least) ? i : least;
        if (is_accurate(choice, i) &&
            (accurate == choice->count || cost_ns(choice, i) < cost_ns(choice, accurate))) {
            accurate = i;
        }
    }
    if (accurate < choice->count) {
        return accurate == least
                   ? umb_fail(error, UMB_E_ARGUMENT,
                              "budget: %g ns a point; the cheapest setting costs %.3g ns",
                              choice->dial->budget_ns, cost_ns(choice, least))
                   : umb_fail(error, UMB_E_ARGUMENT,
                              "budget: %g ns a point; the cheapest setting within the error limits "
                              "costs %.3g ns, the cheapest of all %.3g ns",
                              choice->dial->budget_ns, cost_ns(choice, accurate),
                              cost_ns(choice, least));
    }
    const double metres = choice->dial->max_error_m, visibility = choice->dial->max_visibility;
    char wanted[64] = "";
    int length = metres > 0 ? snprintf(wanted, sizeof wanted, " %g m", metres) : 0;
    if (visibility > 0) {
        (void)snprintf(wanted + length, sizeof wanted - (size_t)length, "%s visibility %g",
                       length > 0 ? "," : "", visibility);
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "max_error:%s: this light's asset reaches %.4g m (level %u, %u taps), or "
                    "visibility %.3g (level %u, %u taps)",
                    wanted, finest->bound_m, finest->level, finest->taps, softest->visibility_error,
                    softest->level, softest->taps);
}

enum umb_status umb_dial_choose(const struct umb_asset *asset, const struct umb_dial *dial,
                                const struct umb_calibration *calibration,
                                struct umb_query_settings *settings, struct umb_curve_row *row,
                                struct umb_error *error)
{
    struct choice choice = {.dial = dial, .calibration = calibration};
    UMB__TRY(check_dial(dial, settings, error));
    if (settings->light >= asset->canonical.content.light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, UMB__NO_LIGHT, settings->light,
                        asset->canonical.content.light_count - 1);
    }
    (void)umb_asset_get_curve(asset, settings->light, choice.rows, &choice.count);
    if (choice.count == 0 || (dial->budget_ns > 0 && !calibration)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        choice.count == 0
                            ? "max_error, budget: the asset carries no accuracy curve for light %u"
                            : "budget: light %u is not calibrated",
                        settings->light);
    }
    size_t best = choice.count;
    for (size_t i = 0; i < choice.count; i++) {
        if (is_accurate(&choice, i) && is_affordable(&choice, i) &&
            (best == choice.count || is_better(&choice, i, best))) {
            best = i;
        }
    }
    if (best == choice.count) {
        return fail_choice(&choice, error);
    }
    settings->level = choice.rows[best].level;
    settings->taps = choice.rows[best].taps;
    if (row) {
        *row = choice.rows[best];
    }
    return UMB_OK;
}
