/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shadow map, percentage closer filtering, percentage closer soft shadows.
 *
 * The answer of a box of n x n texels is an integer count, so it has the same bits everywhere. A
 * penumbra's box has a real width: texels at its border count by the share of them that is covered,
 * so that the answer changes smoothly with the width.
 * Sources: Williams 1978; Reeves, Salesin, Cook 1987; Fernando 2005.
 */
#include <string.h>
#include "base/bytes.h"
#include "base/memory.h"
#include "maps/map_parts.h"

static unsigned format_bytes(enum umb_map_format format)
{
    return format == UMB_MAP_U16 ? 2 : format == UMB_MAP_U24 ? 3 : 4;
}

/* Returns the greatest value of an integer format; 0 for floats. */
static uint32_t format_top(enum umb_map_format format)
{
    return format == UMB_MAP_U16 ? 0xffffU : format == UMB_MAP_U24 ? 0xffffffU : 0;
}

static void texel_store(uint8_t *at, enum umb_map_format format, float depth)
{
    const uint32_t top = format_top(format);
    if (top == 0) {
        uint32_t bits;
        memcpy(&bits, &depth, sizeof bits);
        umb__store32(at, bits);
        return;
    }
    uint32_t value = (uint32_t)((double)depth * (double)top + 0.5);
    value = depth < 1.0F && value == top ? top - 1 : value;
    umb__store_narrow(at, value, format_bytes(format));
}

enum umb_status umb__depths_init(struct umb__depths *depths, const struct umb_map *map,
                                 enum umb_map_format format, const struct umb_map_layer *layer,
                                 struct umb_error *error)
{
    const size_t count = (size_t)map->frustum.width * map->frustum.height;
    const size_t samples = umb__layer_samples(layer);
    const unsigned width = format_bytes(format);
    *depths = (struct umb__depths){.format = format,
                                   .width = map->frustum.width,
                                   .height = map->frustum.height,
                                   .bytes = (uint64_t)count * width};
    depths->texels = umb__alloc(map->alloc, count, width);
    if (depths->texels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a map of %zu texels does not fit in memory",
                        count);
    }
    for (size_t i = 0; i < count; i++) {
        float nearest = 1.0F;
        for (size_t s = 0; s < samples; s++) {
            nearest = fminf(nearest, layer->depth[i * samples + s]);
        }
        texel_store((uint8_t *)depths->texels + width * i, format, nearest);
    }
    return UMB_OK;
}

void umb__depths_finish(struct umb__depths *depths, const struct umb_map *map)
{
    umb__free(map->alloc, depths->texels);
    depths->texels = NULL;
}

/* Returns the depth of a texel; INFINITY if it has no caster or lies beyond the border. */
static double depth_at(const struct umb__depths *depths, int64_t x, int64_t y)
{
    if (x < 0 || y < 0 || x >= (int64_t)depths->width || y >= (int64_t)depths->height) {
        return INFINITY;
    }
    const size_t index = (size_t)y * depths->width + (size_t)x;
    const uint8_t *texels = depths->texels;
    const uint32_t top = format_top(depths->format);
    if (top == 0) {
        const double depth = (double)umb__load_f32(texels + 4 * index);
        return depth < 1.0 ? depth : INFINITY;
    }
    const unsigned width = format_bytes(depths->format);
    const uint32_t value = umb__load_narrow(texels + width * index, width);
    return value < top ? (double)value / (double)top : INFINITY;
}

/* Returns the next number of SplitMix64 (Steele, Lea, Flood 2014). */
static uint64_t next(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

/* Returns a number that is uniform in [-1, 1). */
static double signed_unit(uint64_t *state)
{
    return (double)(next(state) >> 11) * 0x1p-52 - 1.0;
}

/* Returns the squared distance to the nearest of the points so far. */
static double nearest_square(double (*points)[2], uint32_t count, const double at[2])
{
    double least = 8.0;
    for (uint32_t i = 0; i < count; i++) {
        const double dx = points[i][0] - at[0], dy = points[i][1] - at[1];
        const double square = dx * dx + dy * dy;
        least = square < least ? square : least;
    }
    return least;
}

void umb__poisson_disc(double (*points)[2], uint32_t count)
{
    uint64_t state = 20140704;
    for (uint32_t i = 0; i < count; i++) {
        double best = -1.0;
        for (uint32_t candidates = 0; candidates < 8 * i + 8;) {
            double at[2];
            at[0] = signed_unit(&state);
            at[1] = signed_unit(&state);
            if (at[0] * at[0] + at[1] * at[1] > 1.0) {
                continue; /* Ends: pi/4 of all candidates lie inside */
            }
            const double distance = nearest_square(points, i, at);
            if (distance > best) {
                best = distance;
                points[i][0] = at[0];
                points[i][1] = at[1];
            }
            candidates++;
        }
    }
}

static double box_answer(const struct umb__map_query *query, const struct umb__receiver *receiver)
{
    const int64_t taps = (int64_t)query->taps;
    const int64_t x0 = (int64_t)floor(receiver->x) - taps / 2;
    const int64_t y0 = (int64_t)floor(receiver->y) - taps / 2;
    const double depth = umb__biased_depth(query, receiver, (double)taps);
    uint32_t lit = 0;
    for (int64_t y = y0; y < y0 + taps; y++) {
        for (int64_t x = x0; x < x0 + taps; x++) {
            lit += depth_at(&query->map->depths, x, y) >= depth;
        }
    }
    return (double)lit / (double)(taps * taps);
}

static double poisson_answer(const struct umb__map_query *query,
                             const struct umb__receiver *receiver)
{
    const double depth = umb__biased_depth(query, receiver, query->filter.width);
    uint32_t lit = 0;
    for (uint32_t i = 0; i < query->filter.samples; i++) {
        const int64_t x = (int64_t)floor(receiver->x + query->kernel[i][0]);
        const int64_t y = (int64_t)floor(receiver->y + query->kernel[i][1]);
        lit += depth_at(&query->map->depths, x, y) >= depth;
    }
    return (double)lit / (double)query->filter.samples;
}

/* An interval on one axis with real ends, and the texels [first, last] that it touches. */
struct span {
    double low, high;
    int64_t first, last;
};

static struct span span_make(double centre, double width)
{
    const double low = centre - 0.5 * width, high = centre + 0.5 * width;
    return (struct span){low, high, (int64_t)floor(low), (int64_t)ceil(high) - 1};
}

static double span_share(const struct span *span, int64_t texel)
{
    return fmin(span->high, (double)(texel + 1)) - fmax(span->low, (double)texel);
}

double umb__penumbra_texels(const struct umb__map_query *query,
                            const struct umb__receiver *receiver, double blocker_depth)
{
    const struct umb_map_frustum *frustum = &query->map->frustum;
    const double limit = query->filter.width;
    const double behind_m = (receiver->depth - blocker_depth) * frustum->depth_m;
    double width_m = query->filter.light_size * behind_m;
    if (frustum->directional) {
        width_m = 2.0 * tan(0.5 * query->filter.light_size) * behind_m;
    } else {
        const double distance_m = frustum->near_m + blocker_depth * frustum->depth_m;
        if (!(distance_m > 0.0)) {
            return limit;
        }
        width_m /= distance_m;
    }
    const double texels = width_m * receiver->texels_per_m;
    if (!(texels > 1.0)) {
        return 1.0;
    }
    return texels < limit ? texels : limit;
}

/*
 * Returns the depth up to which a texel of a penumbra lights the receiver. Where the receiver's
 * plane rises towards the light, the limit is the plane's depth at the texel. Elsewhere the limit
 * is the receiver's own depth, since space behind the receiver cannot block its light.
 */
static double plane_depth(const struct umb__map_query *query, const struct umb__receiver *receiver,
                          int64_t x, int64_t y)
{
    const double rise = receiver->gain[0] * ((double)x + 0.5 - receiver->x) +
                        receiver->gain[1] * ((double)y + 0.5 - receiver->y);
    if (query->filter.bias_slope == 0.0) {
        return umb__biased_depth(query, receiver, 0.0);
    }
    if (!isfinite(rise)) {
        return -INFINITY; /* The light grazes the plane */
    }
    return umb__biased_depth(query, receiver, 0.0) + fmin(query->filter.bias_slope * rise, 0.0);
}

/* Computes the mean depth of the texels that shadow the receiver within the widest penumbra.
 * Returns 0 if there are none. */
static int blockers_find(const struct umb__map_query *query, const struct umb__receiver *receiver,
                         double *mean)
{
    /* The nearest caster has the widest penumbra of all. */
    const double width = umb__penumbra_texels(query, receiver, query->map->nearest);
    const struct span xs = span_make(receiver->x, width), ys = span_make(receiver->y, width);
    double sum = 0.0;
    int64_t count = 0;
    for (int64_t y = ys.first; y <= ys.last; y++) {
        for (int64_t x = xs.first; x <= xs.last; x++) {
            const double at = depth_at(&query->map->depths, x, y);
            if (at < plane_depth(query, receiver, x, y)) {
                sum += at;
                count++;
            }
        }
    }
    *mean = count > 0 ? sum / (double)count : 0.0;
    return count > 0;
}

double umb__penumbra_search(const struct umb__map_query *query,
                            const struct umb__receiver *receiver)
{
    double blocker = 0.0;
    return blockers_find(query, receiver, &blocker) ? umb__penumbra_texels(query, receiver, blocker)
                                                    : 0.0;
}

static double penumbra_answer(const struct umb__map_query *query,
                              const struct umb__receiver *receiver)
{
    double lit = 0.0;
    const double width = umb__penumbra_search(query, receiver);
    if (width == 0.0) {
        return 1.0;
    }
    const struct span xs = span_make(receiver->x, width), ys = span_make(receiver->y, width);
    for (int64_t y = ys.first; y <= ys.last; y++) {
        for (int64_t x = xs.first; x <= xs.last; x++) {
            if (depth_at(&query->map->depths, x, y) >= plane_depth(query, receiver, x, y)) {
                lit += span_share(&xs, x) * span_share(&ys, y);
            }
        }
    }
    return lit / (width * width);
}

/* Computes the area of the lit texels in a box of real width around the receiver. Texels reach half
 * a texel beyond the box, which the bias takes into account. */
static double bilinear_answer(const struct umb__map_query *query,
                              const struct umb__receiver *receiver)
{
    const double width = query->filter.width;
    const struct span xs = span_make(receiver->x, width), ys = span_make(receiver->y, width);
    const double depth = umb__biased_depth(query, receiver, width + 1.0);
    double lit = 0.0;
    for (int64_t y = ys.first; y <= ys.last; y++) {
        for (int64_t x = xs.first; x <= xs.last; x++) {
            if (depth_at(&query->map->depths, x, y) >= depth) {
                lit += span_share(&xs, x) * span_share(&ys, y);
            }
        }
    }
    return fmin(lit / (width * width), 1.0);
}

static double pcf_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                         const double *at)
{
    (void)at;
    if (query->filter.light_size > 0.0) {
        return penumbra_answer(query, receiver);
    }
    switch (query->filter.kernel) {
    case UMB_MAP_POISSON:
        return poisson_answer(query, receiver);
    case UMB_MAP_BILINEAR:
        return bilinear_answer(query, receiver);
    case UMB_MAP_BOX:
        break;
    }
    return box_answer(query, receiver);
}

static enum umb_status pcf_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    if (settings->format == UMB_MAP_F16) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "settings.format: depth maps are F32, U24 or U16");
    }
    return UMB_OK;
}

/* No slack: counting is exact. Rounding of depths only moves a shadow's boundary. */
const struct umb__technique umb__map_pcf = {
    .name = "pcf",
    .bound = UMB_MAP_EXACT,
    .check = pcf_check,
    .answer = pcf_answer,
};
