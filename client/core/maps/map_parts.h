/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_MAP_PARTS_H
#define UMBRAGE_CORE_MAPS_MAP_PARTS_H
/*
 * Parts that the techniques of umbrage/maps.h share: the built map, the prepared query, the
 * receiver, and the table that a technique fills in.
 *
 * A technique is either a depth map (compares texels itself) or filterable: it turns a depth into
 * a few channels, channels are averaged by map_channels.c, and it turns averaged channels and a
 * receiver's depth into a visibility. All arithmetic is in doubles; formats only store.
 */
#include <math.h>
#include "maps/map_receiver.h"
#include "umbrage/maps.h"

#define UMB__MAP_CHANNELS_MAX 32

struct umb__technique;
struct umb__deep;

/* A layer of depths, as stored. */
struct umb__depths {
    enum umb_map_format format; /* F32, U24 or U16 */
    uint32_t width, height;
    void *texels; /* rows */
    uint64_t bytes;
};

/* Averaged channels: one image, a chain of halved ones, or a summed-area table. */
struct umb__channels {
    enum umb_map_format format; /* F32, F16 or U16 */
    enum umb_map_access access;
    uint32_t width, height, count, level_count;
    double exponent[UMB__MAP_CHANNELS_MAX]; /* Exponent of a channel stored as a logarithm, else
                                               0 */
    void *levels[16];                       /* level l: [height >> l][width >> l][count] */
    uint64_t *sums;                         /* SAT: [height + 1][width + 1][count] */
    uint64_t bytes;
};

/* A place where a texel absorbs light: its depth and the share. */
struct umb__taken {
    double depth; /* -1..1 */
    double share; /* Share of the absorption as the technique counts it, 0..1; a texel's add up to
                     at most 1 */
};

/* Input of a map's texels: depths, or lists of absorption. */
struct umb__texels {
    const struct umb_map_layer *layer; /* NULL: lists */
    const uint64_t *first;             /* [width * height + 1] */
    const struct umb__taken *taken;    /* [first[width * height]] */
};

struct umb_map {
    const struct umb__technique *technique;
    struct umb_alloc alloc;
    int own_alloc; /* 1: `alloc` holds, 0: malloc */
    struct umb_map_frustum frustum;
    struct umb_map_settings settings;
    double nearest; /* Depth of the nearest caster, which has the widest penumbra */
    struct umb__depths depths;
    struct umb__channels channels;
    struct umb__deep *deep; /* DEEP */
};

/* Content of struct umb_map_query. */
struct umb__map_query {
    const struct umb_map *map;
    struct umb_map_filter filter;          /* with its defaults filled in */
    uint32_t taps;                         /* of a box on texels */
    double level;                          /* of MIPS */
    double kernel[UMB_MAP_SAMPLES_MAX][2]; /* POISSON: offsets in texels */
};

struct umb__technique {
    const char *name;
    enum umb_map_bound bound;
    int filterable;
    /* Checks settings (format and access are known enums); NULL if there is nothing to check. */
    enum umb_status (*check)(const struct umb_map_settings *settings, struct umb_error *error);
    /* Filterable: returns the channels a texel, and fills in the exponents of logarithmic ones. */
    uint32_t (*channels)(const struct umb_map_settings *settings, double *exponent);
    /* Filterable: computes channel k of a depth (-1..1), whose surface gains gain[] of depth a
     * texel. */
    double (*encode)(const struct umb_map_settings *settings, uint32_t k, double depth,
                     const double gain[2]);
    /* Filterable maps of translucent casters, instead of encode. `weigh` turns fragments, sorted by
     * depth, into places of absorption, and returns their number, at most `count`. `encode_taken`
     * computes channel k of such a list; an empty list absorbs nothing. */
    size_t (*weigh)(const struct umb_map_fragment *sorted, size_t count, struct umb__taken *taken);
    double (*encode_taken)(uint32_t k, const struct umb__taken *taken, size_t count);
    /* Returns the visibility, 0..1, before `reduction`. Filterable: `at` are the averaged
     * channels. */
    double (*answer)(const struct umb__map_query *query, const struct umb__receiver *receiver,
                     const double *at);
    /* Returns the stated error of an answer by storage and arithmetic. */
    double (*slack)(const struct umb_map *map);
};

extern const struct umb__technique umb__map_pcf, umb__map_vsm, umb__map_lvsm, umb__map_convolution,
    umb__map_esm, umb__map_evsm, umb__map_msm, umb__map_deep, umb__map_moments, umb__map_absorbance;

/*
 * Returns the depth up to which texels light the receiver, for a filter of `width` texels: its own
 * plane rises by gain * width / 2 within the filter. Infinite gains (grazing receivers) light
 * everything.
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

/* Returns the allocator of a map, for umb__alloc. */
static inline const struct umb_alloc *umb__map_alloc(const struct umb_map *map)
{
    return map->own_alloc ? &map->alloc : NULL;
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

#endif
