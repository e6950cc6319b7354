/* SPDX-License-Identifier: Apache-2.0 */
/* See query_check.h. */
#include "wire/query_check.h"

#include <math.h>

enum umb_status umbw_query_check_taps(uint32_t taps, struct umb_error *error)
{
    if (taps % 2 == 0 || taps > UMB_TAPS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "taps: %lu is not odd and within 1..%d",
                        (unsigned long)taps, UMB_TAPS_MAX);
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_dial(const struct umb_dial *dial, uint32_t taps, uint32_t level,
                                      struct umb_error *error)
{
    const double wanted[3] = {dial->max_error_m, dial->max_visibility, dial->budget_ns};
    static const char *const names[3] = {"max_error_m", "max_visibility", "budget_ns"};
    for (int i = 0; i < 3; i++) {
        if (!isfinite(wanted[i]) || wanted[i] < 0) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: %.9g, must be finite and not below 0",
                            names[i], wanted[i]);
        }
        if (wanted[i] > 0 && (taps != 0 || level != 0)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "%s: %.9g beside taps %lu and level %lu, which it chooses", names[i],
                            wanted[i], (unsigned long)taps, (unsigned long)level);
        }
    }
    return UMB_OK;
}

int umbw_query_is_dialled(const struct umb_dial *dial)
{
    return dial->max_error_m > 0 || dial->max_visibility > 0 || dial->budget_ns > 0;
}

enum umb_status umbw_query_check_bias(double bias, struct umb_error *error)
{
    if (!isfinite(bias) || bias < 0 || bias > UMB_BIAS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "bias: %.9g is not within 0..%.9g", bias,
                        UMB_BIAS_MAX);
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_origin(const double origin[3], struct umb_error *error)
{
    for (int axis = 0; axis < 3; axis++) {
        if (!isfinite(origin[axis])) {
            return umb_fail(error, UMB_E_ARGUMENT, "origin: number %d is %g, must be finite", axis,
                            origin[axis]);
        }
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_filter(int64_t filter, double light_extent,
                                        struct umb_error *error)
{
    if (filter < 0 || filter >= UMB_FILTERS) {
        return umb_fail(error, UMB_E_ARGUMENT, "filter: %lld is not one of 0..%d (%s)",
                        (long long)filter, UMB_FILTERS - 1, UMB_FILTER_NAMES);
    }
    if (!(light_extent >= 0 && light_extent <= UMB_EXTENT_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "light_extent: %.9g is not within 0..%.9g",
                        light_extent, UMB_EXTENT_MAX);
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_footprint(const struct umb_query_settings *settings, bool own,
                                           struct umb_error *error)
{
    const bool asked = own || settings->footprint_m != 0 || settings->pixel_rad != 0;
    if (asked && !umb_filter_get_info(settings->filter)->has_footprints) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: belongs to the filter 3 (FOOTPRINT), this is %d",
                        own                          ? "footprints"
                        : settings->footprint_m != 0 ? "footprint_m"
                                                     : "pixel_rad",
                        (int)settings->filter);
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_eye(const struct umb_query_settings *settings, bool has_eye,
                                     struct umb_error *error)
{
    if (has_eye && settings->pixel_rad == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "eye: without pixel_rad; give the angle of a pixel");
    }
    return UMB_OK;
}

enum umb_status umbw_query_check_has_footprint(const struct umbw_query_request *request,
                                               struct umb_error *error)
{
    const struct umb_query_settings *settings = &request->settings;
    if (umb_filter_get_info(settings->filter)->has_footprints && settings->footprint_m == 0 &&
        settings->pixel_rad == 0 && request->points.footprints == NULL &&
        request->points.count > 0 && !request->has_picture) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "filter: 3 (FOOTPRINT) without one; give footprints, footprint_m, or eye "
                        "with pixel_rad");
    }
    return UMB_OK;
}
