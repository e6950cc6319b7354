/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the settings of a query: first each one alone, then the rules between settings. */
#include <math.h>

#include "base/query_settings.h"
#include "base/reserved.h"
#include "base/try.h"
#include "query/stages.h"
#include "umbrage/curve.h"

static bool is_taken(const struct umb__setting *row, enum umb_filter filter)
{
    int flag;
    memcpy(&flag, (const uint8_t *)umb_filter_get_info(filter) + row->taken_by, sizeof flag);
    return flag != 0;
}

static enum umb_status check_whole(const struct umb__setting *row, uint32_t value,
                                   struct umb_error *error)
{
    const bool is_odd = row->kind == UMB__SETTING_ODD;
    if (value <= row->most && (!is_odd || value == 0 || value % 2 == 1)) {
        return UMB_OK;
    }
    return row->kind == UMB__SETTING_CHOICE
               ? umb_fail(error, UMB_E_ARGUMENT, "%s: %d, unknown", row->name, (int)value)
               : umb_fail(error, UMB_E_ARGUMENT, "%s: %u, must be %sat most %g", row->name, value,
                          is_odd ? "odd and " : "", row->most);
}

/* Checks that a number is in range and, if it is given, that the filter takes it. */
static enum umb_status check_number(const struct umb__setting *row, double value,
                                    enum umb_filter filter, struct umb_error *error)
{
    const char *unit = row->unit != NULL ? row->unit : "";
    if (!(value >= 0 && value <= row->most)) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: %g%s, must be 0 to %g", row->name, value, unit,
                        row->most);
    }
    if (row->taken_by == 0 || value == 0 || is_taken(row, filter)) {
        return UMB_OK;
    }
    enum umb_filter owner = UMB_FILTER_BOX;
    while (owner < UMB_FILTERS - 1 && !is_taken(row, owner)) {
        owner++;
    }
    return umb_fail(error, UMB_E_ARGUMENT, "%s: %g%s belongs to the %s filter", row->name, value,
                    unit, umb_filter_name(owner));
}

static enum umb_status check_setting(const struct umb_query_settings *settings,
                                     const struct umb__setting *row, struct umb_error *error)
{
    const uint8_t *at = (const uint8_t *)settings + row->at;
    uint32_t whole;
    double number;
    switch (row->most > 0 ? row->kind : UMB__SETTING_NUMBERS) {
    case UMB__SETTING_NUMBER:
        memcpy(&number, at, sizeof number);
        return check_number(row, number, settings->filter, error);
    case UMB__SETTING_FLAG: /* any value but 0 is true */
    case UMB__SETTING_NUMBERS:
        return UMB_OK;
    default:
        memcpy(&whole, at, sizeof whole);
        return check_whole(row, whole, error);
    }
}

/* Checks that the light takes the filter. */
static enum umb_status check_light(const struct umb__plan *plan, struct umb_error *error)
{
    const struct umb_query_settings *settings = plan->settings;
    const bool metres = settings->footprint_m != 0 && !plan->filter->info.has_footprints;
    if (metres && settings->taps != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "footprint_m: %g beside %u taps; give one of both",
                        settings->footprint_m, settings->taps);
    }
    const bool can_have_metres = plan->filter->info.is_window;
    if (plan->light->kind == UMB_LIGHT_DIRECTIONAL ||
        (plan->filter->any_light && (!metres || can_have_metres))) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_UNSUPPORTED, "%s: light %u is not directional; it takes %s",
                    plan->filter->any_light ? "footprint_m" : "filter", settings->light,
                    plan->filter->any_light
                        ? "taps as the least width of this filter"
                        : "the filters box, tent, gaussian, penumbra and footprint");
}

/* Returns the highest level of coarse look-ups that all frusta of the light have. */
static uint32_t highest_level(const struct umb__plan *plan)
{
    uint32_t highest = UINT32_MAX;
    for (uint32_t i = 0; i < plan->light->frustum_count; i++) {
        const uint32_t level = umb_level_max(plan->frustum[i].log2_size);
        highest = level < highest ? level : highest;
    }
    return highest;
}

/* Checks coarse look-ups: one tap, and a level that every layout has. */
static enum umb_status check_level(const struct umb__plan *plan, struct umb_error *error)
{
    const struct umb_query_settings *settings = plan->settings;
    if (settings->level == 0) {
        return UMB_OK;
    }
    const uint32_t highest = highest_level(plan);
    if (settings->level % 2 == 0 || settings->level < UMB_LEVEL_BRICK ||
        settings->level > highest) {
        return umb_fail(error, UMB_E_ARGUMENT, "level: %u, must be 0 or odd and %d to %u",
                        settings->level, UMB_LEVEL_BRICK, highest);
    }
    const char *beside = settings->taps > 1                   ? "taps"
                         : settings->footprint_m != 0         ? "footprint_m"
                         : settings->filter != UMB_FILTER_BOX ? "filter"
                                                              : NULL;
    return beside == NULL ? UMB_OK
                          : umb_fail(error, UMB_E_ARGUMENT,
                                     "level: %u beside %s; coarse look-ups take one tap",
                                     settings->level, beside);
}

/* For an asset baked under the static rule: refuses filters and levels that read outside a point's
 * window. Only voxels in windows of points on surfaces are defined there. */
static enum umb_status check_static(const struct umb__plan *plan, struct umb_error *error)
{
    const int is_window = plan->filter->info.is_window;
    if (plan->content->receiver_mask_cells == NULL || (is_window && plan->settings->level == 0)) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_UNSUPPORTED,
                    "%s: the asset was baked under the static rule, which leaves out what lies "
                    "off the surfaces; it takes level 0 and filters that read the window alone",
                    is_window ? "level" : "filter");
}

enum umb_status umb__plan_make(const struct umb_asset *asset,
                               const struct umb_query_settings *settings, struct umb__plan *plan,
                               struct umb_error *error)
{
    const struct umb__content *content = &asset->canonical.content;
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    if (settings->light >= content->light_count) {
        return umb_fail(error, UMB_E_NOT_FOUND, UMB__NO_LIGHT, settings->light,
                        content->light_count - 1);
    }
    for (size_t i = 0; i < umb__setting_count; i++) {
        UMB__TRY(check_setting(settings, &umb__settings[i], error));
    }
    const struct umb_light_info *light = &content->lights[settings->light];
    *plan = (struct umb__plan){.asset = asset,
                               .content = content,
                               .settings = settings,
                               .filter = umb__filter_of(settings->filter),
                               .light = light,
                               .frustum = &content->frusta[light->first_frustum]};
    UMB__TRY(check_light(plan, error));
    UMB__TRY(check_level(plan, error));
    if (plan->filter->check != NULL) {
        UMB__TRY(plan->filter->check(plan, error));
    }
    return check_static(plan, error);
}
