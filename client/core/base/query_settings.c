/* SPDX-License-Identifier: Apache-2.0 */
/* See query_settings.h. The order is that of the checks. */
#include "base/query_settings.h"

#include "umbrage/query.h"

#define AT(member)  .name = #member, .at = offsetof(struct umb_query_settings, member)
#define TAKES(flag) offsetof(struct umb_filter_info, flag)

const struct umb__setting umb__settings[] = {
    {AT(light), UMB__SETTING_COUNT, 0, "number of the asset's light"},
    {AT(taps), UMB__SETTING_ODD, UMB_TAPS_MAX, "width of the filter in texels"},
    {AT(bias_mode), UMB__SETTING_CHOICE, UMB_BIAS_NONE, "unit of the bias",
     .words = "auto|voxels|metres|none"},
    {AT(format), UMB__SETTING_CHOICE, UMB_ANSWER_BIT, "format of the answers",
     .words = "f32|u8|bit"},
    {AT(bias), UMB__SETTING_NUMBER, UMB_BIAS_MAX,
     "distance that points move off their surface, in the unit of bias_mode"},
    {AT(filter), UMB__SETTING_CHOICE, UMB_FILTERS - 1,
     "filter of the shadows: box, tent, gaussian, penumbra (half shadows of a light with an "
     "extent) or footprint (the surface that a pixel covers); for the last two, taps is the least "
     "width",
     .words = UMB_FILTER_NAMES},
    {AT(light_extent), UMB__SETTING_NUMBER, UMB_EXTENT_MAX,
     "angular diameter of the light in radians in place of the asset's", " rad", TAKES(has_extent)},
    {AT(pixel_rad), UMB__SETTING_NUMBER, 1, "angle of a pixel seen from the eye in radians",
     .taken_by = TAKES(has_footprints)},
    {AT(eye), UMB__SETTING_NUMBERS, 0, "position of the camera in metres"},
    {AT(footprint_m), UMB__SETTING_NUMBER, 0,
     "width of the filter in metres in place of taps; of the footprint filter: side of the square "
     "of surface around each point"},
    {AT(level), UMB__SETTING_COUNT, 0,
     "stops at cells of 2^N voxels a side, N = 3, 5, 7 ...: cheaper and coarser"},
    {AT(opaque_only), UMB__SETTING_FLAG, 1, "ignores translucent casters"},
};

const size_t umb__setting_count = sizeof umb__settings / sizeof umb__settings[0];
