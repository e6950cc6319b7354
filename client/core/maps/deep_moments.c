/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Moments of translucent casters: a fixed number of filterable channels a texel instead of a deep
 * map's list. The bounds of moment_bound.h turn the channels into answers. Absorption is counted in
 * one of two ways:
 *
 * MOMENTS counts light. A fragment absorbs its alpha times the light that reaches it. Light that
 * passes all fragments counts as absorbed at the far end, behind all receivers. So each texel is a
 * distribution of depth, an opaque texel is that of a shadow map, and means over texels are those
 * of a filter. The answer is 1 minus the least share absorbed before the receiver: an upper bound.
 *
 * ABSORBANCE counts -log of transmittance, which adds up in any order. The sum itself is a channel,
 * so that answers behind all casters are nearly exact. Transmittance is limited to at least 2^-10,
 * since the absorbance of an opaque fragment would be infinite. Means over texels are means of
 * logarithms, so a filter over unlike texels answers too dark.
 *
 * The error of MOMENTS is `bias` (moment_bound.h). The error of ABSORBANCE, if channels are off by
 * e and the shares add up to s: each mean of the normalised distribution is off by 2 e / s, and
 * `bias` is chosen for that. The share before a receiver is then off by s * bias + e, and the
 * absorbance by `darkest` times that. The answer is off by no more than the absorbance is, plus the
 * limit of 2^-10. With a smaller `moment_bias` than these errors need, answers are no bounds, and
 * the slack is 1 or near it.
 */
#include "base/memory.h"
#include "base/try.h"
#include "maps/deep_parts.h"
#include "maps/map_channels.h"
#include "maps/moment_bound.h"

/* Largest absorbance of a texel: -log(2^-10). */
static const double darkest = 6.93147180559945309417;

static enum umb_status moments_check(const struct umb_map_settings *settings,
                                     struct umb_error *error)
{
    if (settings->terms != 4 && settings->terms != 6 && settings->terms != 8) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.terms is %u; it must be 4, 6 or 8 moments",
                        settings->terms);
    }
    UMB__TRY(umb__check_number("settings.moment_bias", settings->moment_bias, 0.0, 1.0, error));
    return umb__check_number("settings.overestimate", settings->overestimate, 0.0, 1.0, error);
}

/* Returns the value at d of Chebyshev's polynomial of degree k. */
static double chebyshev(uint32_t k, double d)
{
    double before = 1.0, here = k > 0 ? d : 1.0;
    for (uint32_t i = 1; i < k; i++) {
        const double next = 2.0 * d * here - before;
        before = here;
        here = next;
    }
    return here;
}

/* Returns the least share absorbed before a receiver, plus `overestimate` times the share that may
 * be absorbed at the receiver's own depth. */
static double share_before(const struct umb_map_settings *settings, const double *means,
                           double bias, double depth)
{
    const struct umb__moment_bound bound =
        umb__moment_bound(means, settings->terms, bias, 2.0 * depth - 1.0);
    return bound.before + settings->overestimate * bound.at;
}

static size_t light_weigh(const struct umb_map_fragment *sorted, size_t count,
                          struct umb__taken *taken)
{
    double left = 1.0;
    size_t used = 0;
    for (size_t i = 0; i < count && left > 0.0; i++) {
        const double share = left * (double)sorted[i].alpha;
        taken[used++] = (struct umb__taken){2.0 * (double)sorted[i].depth - 1.0, share};
        left *= 1.0 - (double)sorted[i].alpha;
    }
    return used;
}

/* Computes the mean of T(k+1) over the depths where light is absorbed. At the far end, where the
 * rest of the light counts as absorbed, every polynomial is 1. */
static double light_encode(uint32_t k, const struct umb__taken *taken, size_t count)
{
    double sum = 1.0;
    for (size_t i = 0; i < count; i++) {
        sum += taken[i].share * (chebyshev(k + 1, taken[i].depth) - 1.0);
    }
    return sum;
}

static double light_bias(const struct umb_map_settings *settings)
{
    return settings->moment_bias > 0.0
               ? settings->moment_bias
               : umb__moment_bias(settings->terms, umb__channel_error(settings));
}

static double light_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                           const double *at)
{
    const struct umb_map_settings *settings = &query->map->settings;
    return 1.0 - share_before(settings, at, light_bias(settings), receiver->depth);
}

static double light_slack(const struct umb_map *map)
{
    const struct umb_map_settings *settings = &map->settings;
    const double bias = light_bias(settings);
    return bias < umb__moment_bias(settings->terms, umb__channel_error(settings)) ? 1.0 : bias;
}

static size_t absorbance_weigh(const struct umb_map_fragment *sorted, size_t count,
                               struct umb__taken *taken)
{
    double left = 1.0;
    size_t used = 0;
    for (size_t i = 0; i < count && left > 0.0; i++) {
        const double alpha = (double)sorted[i].alpha;
        const double whole = alpha < 1.0 ? -log1p(-alpha) / darkest : 1.0;
        const double share = fmin(whole, left);
        taken[used++] = (struct umb__taken){2.0 * (double)sorted[i].depth - 1.0, share};
        left -= share;
    }
    return used;
}

/* Computes channel k of a texel: the sum, over its layers, of the share of light that a layer takes
 * times the Chebyshev polynomial T_k of the layer's depth. T_0 is 1. */
static double absorbance_encode(uint32_t k, const struct umb__taken *taken, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += taken[i].share * chebyshev(k, taken[i].depth);
    }
    return sum;
}

static double absorbance_answer(const struct umb__map_query *query,
                                const struct umb__receiver *receiver, const double *at)
{
    const struct umb_map_settings *settings = &query->map->settings;
    const double sum = at[0], e = umb__channel_error(settings);
    double means[UMB__MOMENTS_MAX];
    if (!(sum > e)) {
        return 1.0;
    }
    for (uint32_t k = 0; k < settings->terms; k++) {
        means[k] = fmin(fmax(at[k + 1] / sum, -1.0), 1.0);
    }
    const double bias = settings->moment_bias > 0.0
                            ? settings->moment_bias
                            : umb__moment_bias(settings->terms, 2.0 * e / sum);
    return exp(-darkest * sum * share_before(settings, means, bias, receiver->depth));
}

static double absorbance_slack(const struct umb_map *map)
{
    const struct umb_map_settings *settings = &map->settings;
    const double e = umb__channel_error(settings), own = settings->moment_bias;
    double share = umb__moment_bias(settings->terms, 2.0 * e);
    if (own > 0.0) {
        /* The bias suffices for texels whose shares add up to least_sum or more. A smaller sum may
         * be wrong as a whole. */
        const double least_sum = 4.0 * (double)settings->terms * 2.0 * e / own;
        share = own < umb__moment_bias(settings->terms, 0.0) ? 1.0 : fmax(own, least_sum);
    }
    return fmin(darkest * (share + e) + 0x1p-10, 1.0);
}

/* Lists of absorption while they are written. */
struct weighing {
    const struct umb__technique *technique;
    struct umb__taken *taken;
};

static size_t list_weigh(void *user, const struct umb_map_fragment *sorted, size_t count,
                         uint64_t used)
{
    const struct weighing *to = user;
    return to->technique->weigh(sorted, count, to->taken + used);
}

enum umb_status umb__translucent_init(struct umb__channels *channels, const struct umb_map *map,
                                      const struct umb_map_fragments *in, struct umb_error *error)
{
    const size_t texels = (size_t)map->frustum.width * map->frustum.height;
    UMB__TRY(umb__fragments_check(in, texels, error));
    const struct umb_alloc *alloc = map->alloc;
    const uint64_t total = in->first[texels] - in->first[0];
    uint64_t *first = umb__alloc(alloc, texels + 1, sizeof *first);
    struct umb__taken *taken = umb__alloc(alloc, total, sizeof *taken);
    struct weighing to = {map->technique, taken};
    enum umb_status status =
        first != NULL && taken != NULL
            ? umb__lists_write(in, texels, alloc, list_weigh, &to, first, error)
            : umb__fragments_no_memory(total, error);
    if (status == UMB_OK) {
        const struct umb__texels lists = {.first = first, .taken = taken};
        status = umb__channels_init(channels, map, &lists, error);
    }
    umb__free(alloc, first);
    umb__free(alloc, taken);
    return status;
}

const struct umb__technique umb__map_moments = {
    .name = "moments",
    .bound = UMB_MAP_UPPER_BOUND,
    .filterable = 1,
    .plain = "moments",
    .check = moments_check,
    .channels_a_term = 1,
    .weigh = light_weigh,
    .encode_taken = light_encode,
    .answer = light_answer,
    .slack = light_slack,
};

const struct umb__technique umb__map_absorbance = {
    .name = "absorbance",
    .bound = UMB_MAP_ESTIMATE,
    .filterable = 1,
    .plain = "moments",
    .check = moments_check,
    .channel_count = 1,
    .channels_a_term = 1,
    .weigh = absorbance_weigh,
    .encode_taken = absorbance_encode,
    .answer = absorbance_answer,
    .slack = absorbance_slack,
};
