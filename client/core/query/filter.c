/* SPDX-License-Identifier: Apache-2.0 */
/* The filters of queries, and the names of settings. The compiler option -DUMB_WITHOUT_ followed by
 * a filter's name leaves the filter out (query.c). */
#include "query/stages.h"

static const struct umb__filter box = {.info = {.name = "box", .is_window = 1, .has_curve = 1},
                                       .any_light = true};

static const struct umb__filter *const FILTERS[UMB_FILTERS] = {
    [UMB_FILTER_BOX] = &box,
    [UMB_FILTER_TENT] = &umb__filter_tent,
    [UMB_FILTER_GAUSSIAN] = &umb__filter_gaussian,
#ifndef UMB_WITHOUT_PENUMBRA
    [UMB_FILTER_PENUMBRA] = &umb__filter_penumbra,
#endif
#ifndef UMB_WITHOUT_FOOTPRINTS
    [UMB_FILTER_FOOTPRINT] = &umb__filter_footprint,
#endif
};

const struct umb__filter *umb__filter_of(enum umb_filter filter)
{
    static const struct umb__filter unknown = {.info.name = "unknown"};
    const bool known = (unsigned)filter < UMB_FILTERS && FILTERS[filter] != NULL;
    return known ? FILTERS[filter] : &unknown;
}

const struct umb_filter_info *umb_filter_get_info(enum umb_filter filter)
{
    return &umb__filter_of(filter)->info;
}

const char *umb_filter_name(enum umb_filter filter)
{
    return umb_filter_get_info(filter)->name;
}

const char *umb_bias_mode_name(enum umb_bias_mode mode)
{
    static const char *const names[] = {"auto", "voxels", "metres", "none"};
    return (unsigned)mode < sizeof names / sizeof names[0] ? names[mode] : "unknown";
}
