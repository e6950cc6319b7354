/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_STAGES_H
#define UMBRAGE_CORE_QUERY_STAGES_H
/*
 * The parts of a query: a filter, and the stages that answer a batch. filter.c lists the filters,
 * query.c the stages in their order.
 *
 * A stage answers a batch by calling the stage inside it; the innermost one is a kernel. Preparing
 * a query sets up the stages that apply, from the kernel outwards, so that a stage that does not
 * apply costs a query nothing.
 */
#include "format/asset_parts.h"
#include "query/query_parts.h"

/* What a query is prepared from: asset, light, settings and filter. */
struct umb__plan {
    const struct umb_asset *asset;
    const struct umb__content *content; /* Content of the asset */
    const struct umb_query_settings *settings;
    const struct umb__filter *filter;
    const struct umb_light_info *light;
    const struct umb_frustum_info *frustum; /* First frustum of the light */
};

/* A filter. */
struct umb__filter {
    struct umb_filter_info info;
    bool any_light;      /* True: spot and point lights take it, too */
    const char *partial; /* Reason for which partial assets refuse it; NULL: they take it */
    /* Checks the settings that only this filter takes; NULL: it takes no such settings */
    enum umb_status (*check)(const struct umb__plan *plan, struct umb_error *error);
    umb__kernel *kernel; /* Kernel; NULL: that of windows, or of tents */
    bool is_tent;        /* True: the kernel is that of tents */
    /* Stage that answers points under lamps; NULL: that of faces (perspective.c) */
    umb__kernel *lamp_run;
    uint32_t (*total)(int32_t taps); /* Sum of the weights of a window; NULL: taps * taps */
    /* Sets up the fields of this filter alone, after all stages; NULL: there are none */
    void (*set)(const struct umb__plan *plan, struct umb__query *query);
    size_t slice; /* Number of points of a slice; 0: the number depends on the taps (split_run.c) */
    /* Cost of a point without its window, in look-ups of one tap; cost added for each radian of a
     * sun's extent; and cost added for a lamp */
    double work, work_radian, work_lamp;
};

/* Returns a filter; one named "unknown" for any other number. */
const struct umb__filter *umb__filter_of(enum umb_filter filter);

extern const struct umb__filter umb__filter_tent, umb__filter_gaussian;
extern const struct umb__filter umb__filter_penumbra, umb__filter_footprint;

/* A stage. */
struct umb__stage {
    bool (*applies)(const struct umb__plan *plan);
    void (*set)(const struct umb__plan *plan, struct umb__query *query);
};

extern const struct umb__stage umb__faces_stage, umb__transmittance_stage, umb__receiver_mask_stage;

/* Checks the settings against the asset and the filter, and fills in the plan. */
UMB_CHECKED enum umb_status umb__plan_make(const struct umb_asset *asset,
                                           const struct umb_query_settings *settings,
                                           struct umb__plan *plan, struct umb_error *error);

/* Returns the bias towards the light, in metres, of points without a normal, for a window of `taps`
 * texels. In: q: the query with its bias, which is returned unless the mode is automatic. */
static inline double umb__no_normal_m(const struct umb__plan *plan, const struct umb__query *q,
                                      int32_t taps)
{
    if (plan->settings->bias_mode != UMB_BIAS_AUTO) {
        return q->no_normal_m;
    }
    /* In voxels, the normal (1,1,1)/sqrt(3) needs a bias of (2 taps + 1) / (2 sqrt(3)). */
    return UMB__BIAS_SLACK * (2.0 * taps + 1.0) / (2.0 * sqrt(3.0)) *
           umb__length(plan->frustum->voxel_step[2]);
}

/* Returns the mean edge of a texel of parallel light, in voxels of depth. */
static inline double umb__lift_texel(const struct umb_frustum_info *frustum)
{
    const double(*step)[3] = frustum->voxel_step;
    return (umb__length(step[0]) + umb__length(step[1])) / 2 / umb__length(step[2]);
}

/* Returns the width in voxels of the widest texel of a light's transmittance maps; 0 if no caster
 * of the light is translucent. */
int32_t umb__transmittance_texel(const struct umb_asset *asset, const struct umb_light_info *light);

/* Returns the transmittance of translucent casters for point i, 0..1. */
double umb__transmittance_at(const struct umb__query *query, const struct umb_points *points,
                             size_t i);

/* Makes the query that moves points as the boxes of translucent casters need it. */
void umb__transmittance_widen(const struct umb__query *query, struct umb__query *wide);

/* Does what umb__transmittance_at does, for a query of umb__transmittance_widen. */
double umb__transmittance_left(const struct umb__query *wide, const struct umb_points *points,
                               size_t i);

/* Returns whether translucent casters surely take no light from point i and from points of the same
 * normal that lie within `reach` voxels of it on x and y. Parallel light only. In: wide: as above.
 */
bool umb__transmittance_is_clear_at(const struct umb__query *wide, const struct umb_points *points,
                                    size_t i, const double reach[2]);

/* Returns whether point i is undefined under the static rule. In: query: one with the stage of the
 * receiver mask. */
bool umb__receiver_mask_is_undefined(const struct umb__query *query,
                                     const struct umb_points *points, size_t i);

/* Returns the footprint of point i in metres; 0 if it has none above 0. */
double umb__footprint_of(const struct umb__query *query, const struct umb_points *points, size_t i);

#endif
