/* SPDX-License-Identifier: Apache-2.0 */
/* Filterable channels; see map_channels.h. */
#include "maps/map_channels.h"

#include <math.h>
#include <string.h>
#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "maps/map_half.h"

#define SUM_ONE  0x1p40 /* Units of summed-area tables for a channel of 1 */
#define BLUR_MAX 63

double umb__channel_mean(double exponent, const double *values, const double *weights, size_t count)
{
    double sum = 0.0;
    if (exponent == 0.0) {
        for (size_t i = 0; i < count; i++) {
            sum += weights[i] * values[i];
        }
        return sum;
    }
    double most = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        most = weights[i] > 0.0 && values[i] > most ? values[i] : most;
    }
    /* Computes the mean of logarithms without overflow. `most` is the greatest value: no
     * exponential is above 1, and the greatest value adds its full weight, so the argument of log
     * is not tiny. A value of weight 0 does not count in `most`, because the exponentials of all
     * others might be subnormal beside it. */
    for (size_t i = 0; i < count; i++) {
        sum += weights[i] > 0.0 ? weights[i] * exp(exponent * (values[i] - most)) : 0.0;
    }
    return most + log(sum) / exponent;
}

static size_t value_bytes(enum umb_map_format format)
{
    return format == UMB_MAP_F32 ? 4 : 2;
}

static void value_store(void *level, enum umb_map_format format, size_t index, double value)
{
    uint8_t *at = (uint8_t *)level + index * value_bytes(format);
    if (format == UMB_MAP_F32) {
        const float narrow = (float)value;
        uint32_t bits;
        memcpy(&bits, &narrow, sizeof bits);
        umb__store32(at, bits);
    } else if (format == UMB_MAP_F16) {
        umb__store16(at, umb__half_from(value));
    } else {
        const double steps = nearbyint(fmin(fmax(value, -1.0), 1.0) * 32767.0);
        umb__store16(at, (uint16_t)(int16_t)steps);
    }
}

static double value_load(const void *level, enum umb_map_format format, size_t index)
{
    const uint8_t *at = (const uint8_t *)level + index * value_bytes(format);
    if (format == UMB_MAP_F32) {
        return (double)umb__load_f32(at);
    }
    if (format == UMB_MAP_F16) {
        return umb__half_to(umb__load16(at));
    }
    return (double)(int16_t)umb__load16(at) / 32767.0;
}

/* One channel of the whole layer while it is built. */
struct plane {
    double *values, *scratch; /* [width * height] */
    uint32_t width, height;
    double exponent;
};

static void plane_swap(struct plane *plane)
{
    double *swap = plane->values;
    plane->values = plane->scratch;
    plane->scratch = swap;
}

/* Returns the slope of the surface in a texel: as the layer gives it, or the smaller of the
 * differences to the two neighbours along the axis. */
static double slope_along(const struct umb_map_layer *layer, const struct umb__channels *channels,
                          size_t index, int axis)
{
    if (layer->slope != NULL) {
        return (double)layer->slope[2 * index + (size_t)axis];
    }
    const size_t at = axis == 0 ? index % channels->width : index / channels->width;
    const size_t end = axis == 0 ? channels->width : channels->height;
    const size_t stride = axis == 0 ? 1 : channels->width;
    const double here = (double)layer->depth[index];
    double least = INFINITY;
    if (at > 0) {
        least = here - (double)layer->depth[index - stride];
    }
    if (at + 1 < end) {
        const double next = (double)layer->depth[index + stride] - here;
        least = fabs(next) < fabs(least) ? next : least;
    }
    return isfinite(least) ? least : 0.0;
}

/* Computes channel k of texel i, as the mean over the texel's samples. */
static double depth_encode(const struct umb_map *map, const struct umb__channels *channels,
                           const struct umb_map_layer *layer, size_t i, uint32_t k)
{
    double values[UMB__LAYER_SAMPLES_MAX], weights[UMB__LAYER_SAMPLES_MAX], gain[2] = {0.0, 0.0};
    const size_t samples = umb__layer_samples(layer);
    if (map->settings.depth_plane && layer->depth[i] < 1.0F) {
        gain[0] = 2.0 * slope_along(layer, channels, i, 0);
        gain[1] = 2.0 * slope_along(layer, channels, i, 1);
    }
    for (size_t s = 0; s < samples; s++) {
        const double depth = (double)layer->depth[i * samples + s];
        values[s] = map->technique->encode(&map->settings, k, 2.0 * depth - 1.0, gain);
        weights[s] = 1.0 / (double)samples;
    }
    return samples > 1 ? umb__channel_mean(channels->exponent[k], values, weights, samples)
                       : values[0];
}

static void plane_encode(struct plane *plane, const struct umb_map *map,
                         const struct umb__channels *channels, const struct umb__texels *texels,
                         uint32_t k)
{
    plane->exponent = channels->exponent[k];
    for (size_t i = 0; i < (size_t)plane->width * plane->height; i++) {
        plane->values[i] =
            texels->layer != NULL
                ? depth_encode(map, channels, texels->layer, i, k)
                : map->technique->encode_taken(k, texels->taken + texels->first[i],
                                               (size_t)(texels->first[i + 1] - texels->first[i]));
    }
}

/* Averages boxes of `width` texels along one axis of a plane. Texels outside the plane have the
 * value `beyond`. */
static void plane_blur(struct plane *plane, uint32_t width, int axis, double beyond)
{
    double values[BLUR_MAX], weights[BLUR_MAX];
    const int64_t half = (int64_t)width / 2;
    const int64_t end = axis == 0 ? plane->width : plane->height;
    const size_t stride = axis == 0 ? 1 : plane->width;
    for (uint32_t i = 0; i < width; i++) {
        weights[i] = 1.0 / (double)width;
    }
    for (size_t i = 0; i < (size_t)plane->width * plane->height; i++) {
        const int64_t at = (int64_t)(axis == 0 ? i % plane->width : i / plane->width);
        for (int64_t d = -half; d <= half; d++) {
            const int64_t step = d * (int64_t)stride;
            values[d + half] =
                at + d >= 0 && at + d < end ? plane->values[(size_t)((int64_t)i + step)] : beyond;
        }
        plane->scratch[i] = umb__channel_mean(plane->exponent, values, weights, width);
    }
    plane_swap(plane);
}

/* Halves both sides of an image. Each texel of the result is the mean of the 2 x 2 (or 2 x 1)
 * texels below it. */
static void plane_halve(struct plane *plane)
{
    const uint32_t w = plane->width, h = plane->height;
    const uint32_t nw = umb__level_side(w, 1), nh = umb__level_side(h, 1);
    static const double quarters[4] = {0.25, 0.25, 0.25, 0.25};
    for (uint32_t y = 0; y < nh; y++) {
        for (uint32_t x = 0; x < nw; x++) {
            double values[4];
            for (uint32_t k = 0; k < 4; k++) {
                const uint32_t sx = w > 1 ? 2 * x + (k & 1) : 0;
                const uint32_t sy = h > 1 ? 2 * y + (k >> 1) : 0;
                values[k] = plane->values[(size_t)sy * w + sx];
            }
            plane->scratch[(size_t)y * nw + x] =
                umb__channel_mean(plane->exponent, values, quarters, 4);
        }
    }
    plane_swap(plane);
    plane->width = nw;
    plane->height = nh;
}

static void plane_sum(const struct plane *plane, struct umb__channels *channels, uint32_t k)
{
    const size_t row = (size_t)(plane->width + 1) * channels->count;
    for (uint32_t y = 0; y < plane->height; y++) {
        uint64_t along = 0;
        for (uint32_t x = 0; x < plane->width; x++) {
            const double value = plane->values[(size_t)y * plane->width + x];
            along += (uint64_t)(int64_t)nearbyint(value * SUM_ONE);
            const size_t at = (size_t)(y + 1) * row + (size_t)(x + 1) * channels->count + k;
            channels->sums[at] = channels->sums[at - row] + along;
        }
    }
}

static void plane_store(struct plane *plane, struct umb__channels *channels, uint32_t k)
{
    if (channels->access == UMB_MAP_SAT) {
        plane_sum(plane, channels, k);
        return;
    }
    for (uint32_t level = 0;; level++) {
        for (size_t i = 0; i < (size_t)plane->width * plane->height; i++) {
            value_store(channels->levels[level], channels->format, i * channels->count + k,
                        plane->values[i]);
        }
        if (level + 1 == channels->level_count) {
            return;
        }
        plane_halve(plane);
    }
}

static int is_power_of_two(uint32_t value)
{
    return (value & (value - 1)) == 0;
}

/* Allocates the levels, or the summed-area table. */
static enum umb_status storage_make(struct umb__channels *channels, const struct umb_map *map,
                                    struct umb_error *error)
{
    const struct umb_alloc *alloc = map->alloc;
    if (channels->access == UMB_MAP_SAT) {
        const size_t count = ((size_t)channels->width + 1) * ((size_t)channels->height + 1);
        channels->sums = umb__alloc_zeroed(alloc, count, channels->count * sizeof(uint64_t));
        channels->bytes = (uint64_t)count * channels->count * sizeof(uint64_t);
        return channels->sums != NULL
                   ? UMB_OK
                   : umb_fail(error, UMB_E_NO_MEMORY,
                              "summed-area tables of %zu texels do not fit in memory", count);
    }
    const uint32_t longer = channels->width > channels->height ? channels->width : channels->height;
    channels->level_count = 1;
    while (channels->access == UMB_MAP_MIPS && longer >> channels->level_count > 0) {
        channels->level_count++; /* At most 15, since sides are at most 2^14 */
    }
    for (uint32_t level = 0; level < channels->level_count; level++) {
        const size_t count = (size_t)umb__level_side(channels->width, level) *
                             umb__level_side(channels->height, level) * channels->count;
        const size_t bytes = value_bytes(channels->format);
        channels->levels[level] = umb__alloc(alloc, count, bytes);
        channels->bytes += count * bytes;
        if (channels->levels[level] == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "%zu channels do not fit in memory", count);
        }
    }
    return UMB_OK;
}

static void channel_make(struct plane *plane, struct umb__channels *channels,
                         const struct umb_map *map, const struct umb__texels *texels, uint32_t k)
{
    static const double flat[2] = {0.0, 0.0};
    plane->width = channels->width;
    plane->height = channels->height;
    plane_encode(plane, map, channels, texels, k);
    if (map->settings.blur > 1) {
        const double beyond = texels->layer != NULL
                                  ? map->technique->encode(&map->settings, k, 1.0, flat)
                                  : map->technique->encode_taken(k, NULL, 0);
        plane_blur(plane, map->settings.blur, 0, beyond);
        plane_blur(plane, map->settings.blur, 1, beyond);
    }
    plane_store(plane, channels, k);
}

enum umb_status umb__channels_init(struct umb__channels *channels, const struct umb_map *map,
                                   const struct umb__texels *texels, struct umb_error *error)
{
    const struct umb_alloc *alloc = map->alloc;
    const struct umb_map_settings *settings = &map->settings;
    *channels = (struct umb__channels){.format = settings->format,
                                       .access = settings->access,
                                       .width = map->frustum.width,
                                       .height = map->frustum.height};
    channels->count =
        map->technique->channels != NULL
            ? map->technique->channels(settings, channels->exponent)
            : map->technique->channel_count + map->technique->channels_a_term * settings->terms;
    if (channels->access == UMB_MAP_MIPS &&
        !(is_power_of_two(channels->width) && is_power_of_two(channels->height))) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "settings.access: MIPS needs sides that are powers of two, not %u x %u",
                        channels->width, channels->height);
    }
    UMB__TRY(storage_make(channels, map, error));
    enum umb_status status = UMB_OK;
    const size_t count = (size_t)channels->width * channels->height;
    struct plane plane = {.values = umb__alloc(alloc, count, sizeof(double)),
                          .scratch = umb__alloc(alloc, count, sizeof(double))};
    if (plane.values == NULL || plane.scratch == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", count);
    }
    for (uint32_t k = 0; k < channels->count && status == UMB_OK; k++) {
        channel_make(&plane, channels, map, texels, k);
    }
    umb__free(alloc, plane.values);
    umb__free(alloc, plane.scratch);
    return status;
}

void umb__channels_finish(struct umb__channels *channels, const struct umb_map *map)
{
    const struct umb_alloc *alloc = map->alloc;
    for (uint32_t level = 0; level < channels->level_count; level++) {
        umb__free(alloc, channels->levels[level]);
    }
    umb__free(alloc, channels->sums);
    memset(channels, 0, sizeof *channels);
}

/* Finds the two texels between whose centres a coordinate lies; whole numbers are texel centres.
 * The coordinate is clamped to 0..end-1. Returns the first texel.
 * Out: share: weight of the next texel. next: index of the next texel. */
static size_t split(double at, size_t end, double *share, size_t *next)
{
    at = fmin(fmax(at, 0.0), (double)(end - 1));
    const size_t texel = (size_t)at;
    *share = at - (double)texel;
    *next = texel + 1 < end ? texel + 1 : texel;
    return texel;
}

static void bilinear(const struct umb__channels *channels, uint32_t level, double x, double y,
                     double *out)
{
    const size_t w = umb__level_side(channels->width, level);
    const size_t h = umb__level_side(channels->height, level);
    const double sx = (double)w / (double)channels->width;
    const double sy = (double)h / (double)channels->height;
    double fx, fy;
    size_t x1, y1;
    const size_t x0 = split(x * sx - 0.5, w, &fx, &x1), y0 = split(y * sy - 0.5, h, &fy, &y1);
    const size_t texels[4] = {y0 * w + x0, y0 * w + x1, y1 * w + x0, y1 * w + x1};
    const double weights[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
    for (uint32_t k = 0; k < channels->count; k++) {
        double values[4];
        for (size_t i = 0; i < 4; i++) {
            values[i] = value_load(channels->levels[level], channels->format,
                                   texels[i] * channels->count + k);
        }
        out[k] = umb__channel_mean(channels->exponent[k], values, weights, 4);
    }
}

static void trilinear(const struct umb__channels *channels, double x, double y, double level,
                      double *out)
{
    const double top = (double)(channels->level_count - 1);
    level = fmin(fmax(level, 0.0), top);
    const uint32_t fine = (uint32_t)level;
    const double share = level - (double)fine;
    bilinear(channels, fine, x, y, out);
    if (share > 0.0) {
        double coarse[UMB__MAP_CHANNELS_MAX];
        const double weights[2] = {1.0 - share, share};
        bilinear(channels, fine + 1, x, y, coarse);
        for (uint32_t k = 0; k < channels->count; k++) {
            const double values[2] = {out[k], coarse[k]};
            out[k] = umb__channel_mean(channels->exponent[k], values, weights, 2);
        }
    }
}

/* The rows of a summed-area table next to the two ends of a box on one axis, and the weight of each
 * row. */
struct side {
    size_t low[2], high[2];
    double low_weight[2], high_weight[2];
};

static struct side side_make(double centre, double width, uint32_t end)
{
    const double low = fmin(fmax(centre - 0.5 * width, 0.0), (double)end);
    const double high = fmin(fmax(centre + 0.5 * width, 0.0), (double)end);
    struct side s;
    s.low[0] = (size_t)low;
    s.high[0] = (size_t)high;
    s.low[1] = s.low[0] < end ? s.low[0] + 1 : s.low[0];
    s.high[1] = s.high[0] < end ? s.high[0] + 1 : s.high[0];
    s.low_weight[1] = low - (double)s.low[0];
    s.high_weight[1] = high - (double)s.high[0];
    s.low_weight[0] = 1.0 - s.low_weight[1];
    s.high_weight[0] = 1.0 - s.high_weight[1];
    return s;
}

/* Returns the exact sum of channel k over the texels [x0, x1) x [y0, y1). Table entries wrap
 * around, but their difference is right again. */
static double box_sum(const struct umb__channels *channels, const size_t x[2], const size_t y[2],
                      uint32_t k)
{
    const size_t row = (size_t)channels->width + 1;
    const uint64_t *sums = channels->sums;
    const uint64_t sum = sums[(y[1] * row + x[1]) * channels->count + k] -
                         sums[(y[0] * row + x[1]) * channels->count + k] -
                         sums[(y[1] * row + x[0]) * channels->count + k] +
                         sums[(y[0] * row + x[0]) * channels->count + k];
    return (double)(int64_t)sum;
}

/* Averages a box whose borders lie inside texels: the weighted mean of the 16 boxes with borders at
 * the nearest texel borders. */
static void summed(const struct umb__channels *channels, double x, double y, double width,
                   double *out)
{
    const struct side sx = side_make(x, width, channels->width);
    const struct side sy = side_make(y, width, channels->height);
    for (uint32_t k = 0; k < channels->count; k++) {
        out[k] = 0.0;
    }
    double area = 0.0;
    for (int corner = 0; corner < 16; corner++) {
        const int a = corner & 1, b = (corner >> 1) & 1, c = (corner >> 2) & 1, d = corner >> 3;
        const size_t xs[2] = {sx.low[a], sx.high[b]}, ys[2] = {sy.low[c], sy.high[d]};
        const double weight =
            sx.low_weight[a] * sx.high_weight[b] * sy.low_weight[c] * sy.high_weight[d];
        if (weight == 0.0) {
            continue;
        }
        area += weight * ((double)xs[1] - (double)xs[0]) * ((double)ys[1] - (double)ys[0]);
        for (uint32_t k = 0; k < channels->count; k++) {
            out[k] += weight * box_sum(channels, xs, ys, k);
        }
    }
    for (uint32_t k = 0; k < channels->count; k++) {
        out[k] /= area * SUM_ONE; /* The centre lies on the map, so area >= 1/4 */
    }
}

void umb__channels_fetch(const struct umb__channels *channels, double x, double y, double level,
                         double width, double *out)
{
    if (channels->access == UMB_MAP_SAT) {
        summed(channels, x, y, width, out);
    } else if (channels->access == UMB_MAP_MIPS) {
        trilinear(channels, x, y, level, out);
    } else {
        bilinear(channels, 0, x, y, out);
    }
}
