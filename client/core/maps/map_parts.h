/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_PARTS_H
#define UMBRAGE_CORE_MAPS_MAP_PARTS_H
/*
 * Parts that the techniques of umbrage/maps.h share: the built map, the prepared query, the table
 * that a technique fills in, and small functions that several techniques use.
 *
 * There are two sorts of techniques. A depth map compares texels with the receiver itself. A
 * filterable technique turns a depth into a few channels; map_channels.c averages channels; then
 * the technique turns averaged channels and a receiver's depth into a visibility. All arithmetic is
 * in doubles; formats only store.
 */
#include <math.h>
#include "maps/map_receiver.h"
#include "umbrage/maps.h"

#define UMB__MAP_CHANNELS_MAX  32
#define UMB__LAYER_SAMPLES_MAX 16 /* Depths of a texel of a layer */

struct umb__technique;
struct umb__deep;

/* A layer of depths as stored: floats, or 24- or 16-bit steps of 1/(2^b - 1), rounded to nearest.
 * The greatest value means "no caster", so a caster that would be rounded to it is stored one step
 * nearer. */
struct umb__depths {
    enum umb_map_format format; /* F32, U24 or U16 */
    uint32_t width, height;
    void *texels; /* [height][width] */
    uint64_t bytes;
};

/* Averaged channels: one image, a chain of halved ones, or a summed-area table. */
struct umb__channels {
    enum umb_map_format format; /* F32, F16 or U16 */
    enum umb_map_access access;
    uint32_t width, height, count, level_count;
    double exponent[UMB__MAP_CHANNELS_MAX]; /* Exponent of a channel stored as a logarithm, else
                                               0 */
    void *levels[16];                       /* Level l: [height >> l][width >> l][count] */
    uint64_t *sums;                         /* SAT: [height + 1][width + 1][count] */
    uint64_t bytes;
};

/* A place where a texel absorbs light: its depth and the share. */
struct umb__taken {
    double depth; /* Depth, -1..1 */
    double share; /* Share of the absorption as the technique counts it, 0..1; the sum over a
                     texel's places is at most 1 */
};

/* Input of a map's texels: depths, or lists of absorption. */
struct umb__texels {
    const struct umb_map_layer *layer; /* NULL: lists */
    const uint64_t *first;             /* [width * height + 1] */
    const struct umb__taken *taken;    /* [first[width * height]] */
};

struct umb_map {
    const struct umb__technique *technique;
    struct umb_alloc own_alloc;
    const struct umb_alloc *alloc; /* &own_alloc; NULL: malloc */
    struct umb_map_frustum frustum;
    struct umb_map_settings settings;
    double nearest; /* Depth of the nearest caster, which has the widest penumbra */
    struct umb__depths depths;
    struct umb__channels channels;
    struct umb__deep *deep; /* Lists of a DEEP map, else NULL */
};

/* Content of struct umb_map_query. */
struct umb__map_query {
    const struct umb_map *map;
    struct umb_map_filter filter;          /* Filter, defaults filled in */
    uint32_t taps;                         /* Width in texels of a box on texels */
    double level;                          /* Mip level of a MIPS map */
    double kernel[UMB_MAP_SAMPLES_MAX][2]; /* POISSON: offsets in texels */
};

struct umb__technique {
    const char *name;
    enum umb_map_bound bound;
    int filterable;
    const char *plain; /* Name in messages of channels of -1..1, which are stored as F32 or U16;
                          NULL: `check` tests the format */
    /* Checks the settings of a map; format and access are known values already. NULL: nothing is
     * left to check. */
    enum umb_status (*check)(const struct umb_map_settings *settings, struct umb_error *error);
    /* For filterable techniques: number of channels of a texel, and number added for each of
     * settings.terms */
    uint32_t channel_count, channels_a_term;
    /* Returns the number of channels; NULL: the two numbers above give it. Out: exponents of the
     * channels that are stored as logarithms; all are 0 before the call. */
    uint32_t (*channels)(const struct umb_map_settings *settings, double *exponent);
    /* For filterable techniques: computes channel k of a depth (-1..1). In: gain: change of the
     * surface's depth from one texel to the next in x and in y. */
    double (*encode)(const struct umb_map_settings *settings, uint32_t k, double depth,
                     const double gain[2]);
    /* For filterable techniques of translucent casters, these two functions replace encode. `weigh`
     * turns fragments, sorted by depth, into places of absorption, and returns their number, at
     * most `count`. `encode_taken` computes channel k of such a list; an empty list absorbs
     * nothing. */
    size_t (*weigh)(const struct umb_map_fragment *sorted, size_t count, struct umb__taken *taken);
    double (*encode_taken)(uint32_t k, const struct umb__taken *taken, size_t count);
    /* Returns the visibility, 0..1; the setting `reduction` is applied to it later. In: at: the
     * averaged channels of a filterable map. */
    double (*answer)(const struct umb__map_query *query, const struct umb__receiver *receiver,
                     const double *at);
    /* Returns the stated error of an answer by storage and arithmetic; NULL: 0. */
    double (*slack)(const struct umb_map *map);
};

extern const struct umb__technique umb__map_pcf, umb__map_vsm, umb__map_lvsm, umb__map_convolution,
    umb__map_esm, umb__map_evsm, umb__map_msm, umb__map_deep, umb__map_moments, umb__map_absorbance;

/*
 * Returns the depth up to which texels light the receiver, for a filter of `width` texels: the
 * receiver's own plane rises by gain * width / 2 within the filter. Infinite gains (grazing
 * receivers) light everything.
 */
static inline double umb__biased_depth(const struct umb__map_query *query,
                                       const struct umb__receiver *receiver, double width)
{
    double depth = receiver->depth - query->filter.bias_m / query->map->frustum.depth_m;
    if (query->filter.bias_slope > 0.0 && width > 0.0) {
        depth -= query->filter.bias_slope * 0.5 * width *
                 (fabs(receiver->gain[0]) + fabs(receiver->gain[1]));
    }
    return depth;
}

/* Returns half of the least step of a format for numbers of -1..1: its rounding error. */
static inline double umb__format_error(enum umb_map_format format)
{
    switch (format) {
    case UMB_MAP_U16:
        return 0.5 / 32767.0;
    case UMB_MAP_U24:
        return 0.5 / 8388607.0;
    case UMB_MAP_F16:
        return 1.0 / 4096.0; /* 2^-11 of numbers in [0.5, 1], halved */
    case UMB_MAP_F32:
        break;
    }
    return 1.0 / 33554432.0; /* 2^-25 */
}

/* Returns the rounding error of a stored channel: summed-area tables keep units of 2^-40. */
static inline double umb__channel_error(const struct umb_map_settings *settings)
{
    return settings->access == UMB_MAP_SAT ? 0x1p-41 : umb__format_error(settings->format);
}

/* Checks that a number is in least..most. Fails: E_ARGUMENT, naming it. */
UMB_CHECKED static inline enum umb_status umb__check_number(const char *name, double value,
                                                            double least, double most,
                                                            struct umb_error *error)
{
    return value >= least && value <= most
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "%s is %g; it must be %g..%g", name, value, least,
                          most);
}

/*
 * Returns the greatest share of a distribution with the given variance that can lie at or beyond
 * its mean plus `distance`: the one-sided Chebyshev inequality, s2 / (s2 + d^2). Returns 1 (lit) if
 * distance is at most 0.
 *
 * In: variance: above 0. contrast: C of Fu and Liu 2013, s2 / (s2 + C d^2); 1 is the inequality
 *     itself.
 */
static inline double umb__chebyshev(double variance, double distance, double contrast)
{
    if (!(distance > 0.0)) {
        return 1.0;
    }
    /* The variance is finite, so an infinite distance gives x / inf = 0, the right limit. */
    return variance / (variance + contrast * distance * distance);
}

/* Returns the number of depths of each texel of a layer. */
static inline size_t umb__layer_samples(const struct umb_map_layer *layer)
{
    return layer->samples > 0 ? (size_t)layer->samples : 1;
}

/* Stores a layer of depths (map_pcf.c). Of several samples in a texel the nearest is stored. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umb__depths_init(struct umb__depths *depths, const struct umb_map *map,
                                             enum umb_map_format format,
                                             const struct umb_map_layer *layer,
                                             struct umb_error *error);
void umb__depths_finish(struct umb__depths *depths, const struct umb_map *map);

/*
 * Fills `count` points of a disc of radius 1 that keep apart from one another: each is the
 * candidate farthest from the points before it. The first n points are the same for every count,
 * with the same bits on every machine: they come from integers, products and sums only.
 * Source: Mitchell 1991 (best candidate).
 */
void umb__poisson_disc(double (*points)[2], uint32_t count);

/*
 * Returns the number of texels that the penumbra of a blocker at `blocker_depth` spans, clamped to
 * 1..filter.width: similar triangles between the light, the blocker and a plane through the
 * receiver across the light. A blocker at or behind the receiver gives 1; one at a point light's
 * own position gives filter.width.
 * Source: Fernando 2005 (percentage-closer soft shadows), w = size (d_receiver - d_blocker) /
 * d_blocker; for a directional light of angular diameter a, w = 2 tan(a/2) (d_receiver -
 * d_blocker).
 */
double umb__penumbra_texels(const struct umb__map_query *query,
                            const struct umb__receiver *receiver, double blocker_depth);

/* Returns the number of texels that the receiver's penumbra spans, by the mean of the depths that
 * block its light; 0 if none does. In: receiver: before its depth is biased. query: of a map with
 * depths. */
double umb__penumbra_search(const struct umb__map_query *query,
                            const struct umb__receiver *receiver);

#endif
