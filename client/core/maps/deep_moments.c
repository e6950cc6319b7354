/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Moments of translucent casters: a fixed number of channels a texel in place of a deep map's list,
 * filterable, and asked through the bounds of moment_bound.h. Two ways to count what is taken:
 *
 * MOMENTS: by light. A fragment takes a share of all light, what is left before it times its alpha;
 * what passes everything is taken at the far end, where no receiver lies behind it. So a texel is a
 * distribution of depth, an opaque one that of a shadow map, and means over texels are those of a
 * filter. An answer is 1 less the least share taken before the receiver: an upper bound.
 *
 * ABSORBANCE: by -log of what is left, which adds up, whatever the order. The sum itself is a
 * channel, so that behind everything the answer is nearly that of the products. Fragments take at
 * most what is left of DARKEST, 2^-10 of the light: an opaque one would take infinitely much. Means
 * over texels are those of logarithms: a filter over unlike texels answers too darkly.
 *
 * Error: MOMENTS: `bias` (moment_bound.h). ABSORBANCE: channels are off by e; a mean of the
 * normalised distribution by 2 e over its sum s, which `bias` follows; so the absorbance before a
 * receiver is off by s * bias and e more, times DARKEST, and the answer by no more than that, and
 * 2^-10. A `moment_bias` of the caller's that is below what errors want bounds nothing: the slack
 * says so.
 */
#include <math.h>
#include "base/memory.h"
#include "maps/deep_parts.h"
#include "maps/map_channels.h"
#include "maps/moment_bound.h"

/* -log(2^-10): what a texel takes at most. */
static const double darkest = 6.93147180559945309417;

static double channel_error(const struct umb_map_settings *settings)
{
    return settings->access == UMB_MAP_SAT ? 0x1p-41 : umb__format_error(settings->format);
}

static enum umb_status moments_check(const struct umb_map_settings *settings,
                                     struct umb_error *error)
{
    if (settings->format != UMB_MAP_F32 && settings->format != UMB_MAP_U16) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "settings.format: moments are F32 or U16");
    }
    if (settings->terms != 4 && settings->terms != 6 && settings->terms != 8) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.terms is %u; it must be 4, 6 or 8 moments",
                        settings->terms);
    }
    if (!(settings->moment_bias >= 0.0 && settings->moment_bias <= 1.0)) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.moment_bias is %g; it must be 0..1",
                        settings->moment_bias);
    }
    if (!(settings->overestimate >= 0.0 && settings->overestimate <= 1.0)) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.overestimate is %g; it must be 0..1",
                        settings->overestimate);
    }
    return UMB_OK;
}

/* Chebyshev's polynomial of degree k. */
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

/* Least share before a receiver, with what is overestimated at its own depth. */
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

/* T1.. of where light is taken; at the far end all of them are 1. */
static double light_encode(uint32_t k, const struct umb__taken *taken, size_t count)
{
    double sum = 1.0;
    for (size_t i = 0; i < count; i++) {
        sum += taken[i].share * (chebyshev(k + 1, taken[i].depth) - 1.0);
    }
    return sum;
}

static uint32_t light_channels(const struct umb_map_settings *settings, double *exponent)
{
    for (uint32_t k = 0; k < settings->terms; k++) {
        exponent[k] = 0.0;
    }
    return settings->terms;
}

static double light_bias(const struct umb_map_settings *settings)
{
    return settings->moment_bias > 0.0 ? settings->moment_bias
                                       : umb__moment_bias(settings->terms, channel_error(settings));
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
    return bias < umb__moment_bias(settings->terms, channel_error(settings)) ? 1.0 : bias;
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

/* The sum, then T1.. times it. */
static double absorbance_encode(uint32_t k, const struct umb__taken *taken, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += taken[i].share * chebyshev(k, taken[i].depth);
    }
    return sum;
}

static uint32_t absorbance_channels(const struct umb_map_settings *settings, double *exponent)
{
    const uint32_t count = light_channels(settings, exponent);
    exponent[count] = 0.0;
    return count + 1;
}

static double absorbance_answer(const struct umb__map_query *query,
                                const struct umb__receiver *receiver, const double *at)
{
    const struct umb_map_settings *settings = &query->map->settings;
    const double sum = at[0], e = channel_error(settings);
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
    const double e = channel_error(settings), own = settings->moment_bias;
    double share = umb__moment_bias(settings->terms, 2.0 * e);
    if (own > 0.0) {
        /* It suffices for sums above least_sum; of one below no more than all can be wrong. */
        const double least_sum = 4.0 * (double)settings->terms * 2.0 * e / own;
        share = own < umb__moment_bias(settings->terms, 0.0) ? 1.0 : fmax(own, least_sum);
    }
    return fmin(darkest * (share + e) + 0x1p-10, 1.0);
}

/* What every texel's fragments take, one list after another: fills in first and *taken. */
static enum umb_status texels_weigh(const struct umb_map *map, const struct umb_map_fragments *in,
                                    uint64_t *first, struct umb__taken *taken,
                                    struct umb_error *error)
{
    const size_t texels = (size_t)map->frustum.width * map->frustum.height;
    const uint64_t longest = umb__fragments_longest(in, texels);
    uint64_t used = 0;
    struct umb_map_fragment *sorted = umb__alloc(umb__map_alloc(map), longest, sizeof *sorted);
    if (sorted == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%llu fragments do not fit in memory",
                        (unsigned long long)longest);
    }
    for (size_t i = 0; i < texels; i++) {
        const size_t count = umb__fragments_sort(in, i, sorted);
        first[i] = used;
        used += map->technique->weigh(sorted, count, taken + used);
    }
    first[texels] = used;
    umb__free(umb__map_alloc(map), sorted);
    return UMB_OK;
}

enum umb_status umb__translucent_init(struct umb__channels *channels, const struct umb_map *map,
                                      const struct umb_map_fragments *in, struct umb_error *error)
{
    const size_t texels = (size_t)map->frustum.width * map->frustum.height;
    enum umb_status status = umb__fragments_check(in, texels, error);
    if (status != UMB_OK) {
        return status;
    }
    const struct umb_alloc *alloc = umb__map_alloc(map);
    const uint64_t total = in->first[texels] - in->first[0];
    uint64_t *first = umb__alloc(alloc, texels + 1, sizeof *first);
    struct umb__taken *taken = umb__alloc(alloc, total, sizeof *taken);
    if (first == NULL || taken == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%llu fragments do not fit in memory",
                          (unsigned long long)total);
    } else {
        status = texels_weigh(map, in, first, taken, error);
    }
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
    .check = moments_check,
    .channels = light_channels,
    .weigh = light_weigh,
    .encode_taken = light_encode,
    .answer = light_answer,
    .slack = light_slack,
};

const struct umb__technique umb__map_absorbance = {
    .name = "absorbance",
    .bound = UMB_MAP_ESTIMATE,
    .filterable = 1,
    .check = moments_check,
    .channels = absorbance_channels,
    .weigh = absorbance_weigh,
    .encode_taken = absorbance_encode,
    .answer = absorbance_answer,
    .slack = absorbance_slack,
};
