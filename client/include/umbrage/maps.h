/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_MAPS_H
#define UMBRAGE_MAPS_H
/*
 * Shadow maps of the literature behind one interface: depth layers in, visibility out.
 *
 *     struct umb_map_frustum frustum;  // where the texels lie
 *     if (umb_map_frustum_fit(to_light, &box, 64, 64, &frustum, &error)) {
 *         return error.status;
 *     }
 *     // ... fill layer.depth[y * 64 + x] along umb_map_frustum_point(&frustum, ...)
 *     struct umb_map *map;
 *     struct umb_map_query query;
 *     if (umb_map_build(&frustum, &layer, &settings, NULL, &map, &error) ||
 *         umb_map_prepare(map, &filter, &query, &error)) {  // checks, once
 *         return error.status;
 *     }
 *     umb_map_run(&query, &points, 0, points.count, values);  // cannot fail
 *     umb_map_destroy(map);
 *
 * They are what umbrage's own voxel DAG is measured against, and what a thin client's GPU samples.
 * Which technique promises what stands in docs/explained/techniques.md, the numerical argument of
 * each in docs/explained/numerics-maps.md.
 *
 * Map space: x and y in texels, texel i covers [i, i + 1) and is sampled at its centre; depth 0..1
 * along the light, linear in metres for every projection. Depth 1 in a layer means "no caster".
 * Outside: points beyond the map in x or y, or before depth 0, are lit; texels beyond the border
 * count as "no caster" (tables and bilinear filters keep to the map instead). Receivers whose
 * normal faces away from the light are shadowed.
 *
 * Ownership: a map copies what it needs; destroy it with umb_map_destroy.
 * Threads: a built map and a prepared query are immutable; any number of threads may run a query.
 * Trust: sizes, settings and every depth of a layer are checked; points as umb_points_check wants.
 * Stability: experimental; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/alloc.h"
#include "umbrage/geom.h"
#include "umbrage/query.h"
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_MAP_SIDE_MAX     16384 /* texels a side */
#define UMB_MAP_WIDTH_MAX    64    /* widest filter, in texels */
#define UMB_MAP_SAMPLES_MAX  64    /* of a Poisson kernel */
#define UMB_MAP_TERMS_MAX    16    /* Fourier terms, or variance layers */
#define UMB_MAP_EXPONENT_MAX 1000  /* in log space; less where a number format bounds it */

/* How a layer is stored and asked. A PCF map asked with light_size > 0 is PCSS. */
enum umb_map_technique {
    UMB_MAP_PCF = 0,     /* depth, compared texel by texel (Williams 1978, Reeves 1987) */
    UMB_MAP_VSM,         /* two moments (Donnelly, Lauritzen 2006) */
    UMB_MAP_LVSM,        /* two moments of each of `terms` depth layers (Lauritzen, McCool 2008) */
    UMB_MAP_CONVOLUTION, /* `terms` Fourier terms (Annen et al. 2007) */
    UMB_MAP_ESM,         /* mean exponential (Annen et al. 2008, Salvi 2008) */
    UMB_MAP_EVSM,        /* two moments of an exponential warp, or of two (Lauritzen 2008) */
    UMB_MAP_MSM,         /* four moments (Peters, Klein 2015) */
    UMB_MAP_DEEP,        /* transmittance lists; see umb_map_build_deep */
    UMB_MAP_MOMENTS,    /* `terms` moments of where light is taken; see umb_map_build_translucent */
    UMB_MAP_ABSORBANCE, /* the same of absorbance, -log of transmittance, and its sum */
};

#define UMB_MAP_TECHNIQUES 10 /* Number of values of enum umb_map_technique in this version */

enum umb_map_format {
    UMB_MAP_F32 = 0, /* IEEE single */
    UMB_MAP_F16,     /* IEEE half: ESM and EVSM in linear space */
    UMB_MAP_U24,     /* three bytes, depth only */
    UMB_MAP_U16,     /* two bytes: depth, or a channel of -1..1 */
};

/* How the channels of a filterable map (all but PCF and DEEP) are filtered when asked. */
enum umb_map_access {
    UMB_MAP_BASE = 0, /* bilinear over texels that were blurred when built */
    UMB_MAP_MIPS,     /* trilinear over a chain of halved maps; sides must be powers of two */
    UMB_MAP_SAT,      /* summed-area tables, 64-bit integers: any box of real width, exact sums */
};

/* What an answer is to the share of the filter's texels that let light through. */
enum umb_map_bound {
    UMB_MAP_EXACT = 0,   /* equal to it */
    UMB_MAP_UPPER_BOUND, /* not below it by more than `slack` (light may bleed) */
    UMB_MAP_ESTIMATE,    /* neither */
};

enum umb_map_projection {
    UMB_MAP_AFFINE = 0,  /* directional light */
    UMB_MAP_PERSPECTIVE, /* spot light, face of a cube, or a warped directional light (LiSPSM) */
    UMB_MAP_PARABOLOID,  /* half of a point light's sphere (Brabec et al. 2002) */
};

/*
 * Where the texels of a map lie. With p = (world - origin, 1):
 * AFFINE and PERSPECTIVE: x = (m0.p)/(m3.p), y = (m1.p)/(m3.p), depth = m2.p, where m3.p > 0.
 * PARABOLOID: (X, Y, Z) = m0..2.p in metres, r = |XYZ|; x = (1 + X/(r+Z)) width/2, likewise y;
 * depth = (r - near_m) / depth_m; only Z >= 0.
 */
struct umb_map_frustum {
    enum umb_map_projection projection;
    uint32_t width, height; /* texels */
    double origin[3];       /* metres, world space */
    double world_to_map[4][4];
    double depth_m;  /* metres along the light (along the axis) of depth 0..1, > 0 */
    double near_m;   /* metres from a point or spot light to depth 0 */
    int directional; /* 1: `light` is the unit vector towards the light, else its position */
    double light[3];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* What the light sees through the centre of each texel. */
struct umb_map_layer {
    const float *depth; /* float[height][width], 0..1, 1 = no caster */
    const float *slope; /* float[height][width][2]: depth the hit surface gains per texel in x and
                           in y, finite; NULL: the smaller of the differences to both neighbours */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_map_settings {
    enum umb_map_technique technique;
    enum umb_map_format format;
    enum umb_map_access access; /* not PCF */
    uint32_t blur;              /* width of a separable box over the texels, odd, 1..63; 0 = 1 */
    double min_variance;        /* VSM, LVSM, EVSM: least variance, depth squared, 0..1; never less
                                   than rounding of the format needs */
    int depth_plane;            /* VSM, LVSM: 1 adds the second moment of the slope in a texel */
    double exponent;            /* ESM, EVSM: c > 0 of exp(c depth) */
    double negative_exponent;   /* EVSM: of -exp(-c depth), 0 = one warp only */
    int linear;                 /* ESM, EVSM: 1 stores exponentials, which bounds the exponent, as a
                                   GPU does; 0 stores logarithms */
    double moment_bias;         /* MSM, MOMENTS, ABSORBANCE: 0..1, 0 = what the format needs; less
                                   bounds nothing, and `slack` is then 1 or near it */
    uint32_t terms;             /* CONVOLUTION: Fourier terms; LVSM: layers; 1..16. MOMENTS and
                                   ABSORBANCE: moments, 4, 6 or 8 */
    double overestimate;        /* MOMENTS, ABSORBANCE: share, 0..1, of what may be taken at the
                                   receiver's own depth that counts; 0: an upper bound of light */
    double damping;             /* CONVOLUTION: term k of M is weighted by exp(-damping (k/M)^2) */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

enum umb_map_kernel {
    UMB_MAP_BOX = 0,
    UMB_MAP_POISSON, /* PCF: `samples` points of a disc of diameter `width` */
};

struct umb_map_filter {
    enum umb_map_kernel kernel;
    double width; /* texels, 1..64; 0 = 1. Boxes on PCF and DEEP: odd and whole. BASE: not used but
                     by the biases */
    uint32_t samples; /* POISSON: 1..64 */
    double bias_m;    /* metres towards the light, 0..1e6 */
    /* Share, 0..100, of the depth that the receiver's plane gains over half the filter (its
     * width in texels in x and in y); 1 clears a plane of its own shadow exactly. A penumbra
     * follows the plane from texel to texel instead, and wants 1. */
    double bias_slope;
    double bias_normal; /* the same by moving the point along its normal, 0..100 */
    /* > 0: the filter's width is the penumbra's, at least 1 and at most `width`: radians of the
     * light's diameter if directional, else metres. PCF of a box, and VSM with SAT. */
    double light_size;
    double reduction; /* 0..0.99: visibilities up to it become 0, the rest is stretched to 0..1 */
    double contrast;  /* VSM, LVSM, EVSM: C in sigma^2 / (sigma^2 + C (t - mu)^2); 0 = 1; to 1e6 */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_map; /* opaque */

struct umb_map_info {
    enum umb_map_technique technique;
    const char *name; /* "pcf", "vsm", ... */
    uint32_t width, height;
    uint32_t channels;        /* numbers a texel; 0 for DEEP */
    uint64_t bytes;           /* that queries read */
    uint64_t fragments;       /* DEEP: kept in all lists */
    enum umb_map_bound bound; /* of an answer without `reduction`, in exact arithmetic */
    double slack;             /* rounding, of visibility: the stated error of storage and arithmetic
                                 (docs/explained/numerics-maps.md) */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* One surface or hair that light meets on its way through a texel. */
struct umb_map_fragment {
    float depth; /* 0..1 */
    float alpha; /* share of the light it takes, 0..1 */
};

/* All fragments of a texel's ray, for translucent casters. */
struct umb_map_fragments {
    const uint64_t *first; /* [width * height + 1]: texel i has first[i] .. first[i+1] - 1 */
    const struct umb_map_fragment *fragments; /* [first[width * height]], any order in a texel */
};

/* How a filter finds its way in the lists under its window. Every way gives the same bits. */
enum umb_map_deep_way {
    UMB_MAP_DEEP_AUTO = 0,   /* STREAM where lists are short on average, else LINKS */
    UMB_MAP_DEEP_SEARCH = 1, /* halves each list: 8 bytes a node */
    UMB_MAP_DEEP_LINKS = 2,  /* halves the first and follows links to the others: 16 bytes */
    UMB_MAP_DEEP_STREAM = 3, /* adds up all nodes of a window's row, which lie one after another,
                                without a branch: 8 bytes; not with an exponent */
};

struct umb_map_deep_settings {
    double epsilon;  /* a list ends when less transmittance is left, 0..1; 0 keeps all; 0.001 cannot
                        be seen */
    double exponent; /* 0: steps; to 1e6: the last step fades in by exp(-c d), d of depth behind it
                      */
    enum umb_map_deep_way way;
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* A checked query: caller's storage, no pointer into itself, may be copied. */
struct umb_map_query {
    uint64_t opaque[192];
};

/*
 * Fits an affine frustum of a directional light to a box of world space, a texel to spare.
 *
 * In:    to_light: any length above 0. width, height: texels, 1..16384.
 * Fails: E_ARGUMENT (sizes, not finite, empty box, no direction).
 */
UMB_API UMB_CHECKED enum umb_status
umb_map_frustum_fit(const double to_light[3], const struct umb_box *box, uint32_t width,
                    uint32_t height, struct umb_map_frustum *frustum, struct umb_error *error);

/* A point or spot light: one face. */
struct umb_map_spot {
    double position[3], forward[3], up[3]; /* metres; up: not along forward */
    double tangent;                        /* of half the field of view, > 0 */
    double near_m, far_m;                  /* metres along forward, 0 <= near < far */
    enum umb_map_projection projection;    /* PERSPECTIVE, or PARABOLOID (tangent not used) */
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Makes the frustum of a spot light, a cube's face (tangent 1) or half a sphere. Fails: E_ARGUMENT.
 */
UMB_API UMB_CHECKED enum umb_status umb_map_frustum_spot(const struct umb_map_spot *spot,
                                                         uint32_t width, uint32_t height,
                                                         struct umb_map_frustum *frustum,
                                                         struct umb_error *error);

/*
 * Finds the world position of a point of map space. A texel's light ray runs from depth 0 to depth
 * 1, and depth grows linearly along it.
 *
 * Fails: E_NOT_FOUND (a matrix without inverse, or a corner of a paraboloid map).
 */
UMB_API UMB_CHECKED enum umb_status umb_map_frustum_point(const struct umb_map_frustum *frustum,
                                                          double x, double y, double depth,
                                                          double world[3]);

/*
 * Builds a map.
 *
 * In:    alloc: NULL = malloc; must outlive the map.
 * Out:   out: NULL on failure.
 * Fails: E_ARGUMENT (frustum, a depth or slope out of range, settings), E_UNSUPPORTED (a format or
 *        access that the technique has no use for), E_TOO_LARGE (an exponent beyond the format, a
 *        side above 16384), E_NO_MEMORY.
 * Cost:  O(texels * channels * blur).
 */
UMB_API UMB_CHECKED enum umb_status umb_map_build(const struct umb_map_frustum *frustum,
                                                  const struct umb_map_layer *layer,
                                                  const struct umb_map_settings *settings,
                                                  const struct umb_alloc *alloc,
                                                  struct umb_map **out, struct umb_error *error);

/* Builds a deep shadow map; same rules. Fails also: E_ARGUMENT (`first`
 * not rising, depth, alpha or a setting out of range, STREAM with an exponent). Source: Lokovic,
 * Veach 2000; seed 003. */
UMB_API UMB_CHECKED enum umb_status
umb_map_build_deep(const struct umb_map_frustum *frustum, const struct umb_map_fragments *fragments,
                   const struct umb_map_deep_settings *settings, const struct umb_alloc *alloc,
                   struct umb_map **out, struct umb_error *error);

/*
 * Builds a filterable map of translucent casters: MOMENTS or ABSORBANCE. Same rules.
 *
 * MOMENTS averages as light does, so that any filter is right, and takes opaque casters as they
 * are. ABSORBANCE is nearer behind everything, but its mean over a filter is that of logarithms,
 * and what leaves less than 2^-10 of the light, as opaque casters do, counts as 2^-10.
 *
 * In:    settings: technique, format (F32 or U16), access, blur, terms, moment_bias, overestimate.
 * Fails also: as umb_map_build_deep for fragments; E_UNSUPPORTED (another technique or format).
 * Source: Peters et al. 2017 (MOMENTS); Muenstermann et al. 2018, Sharpe 2018 (ABSORBANCE).
 */
UMB_API UMB_CHECKED enum umb_status
umb_map_build_translucent(const struct umb_map_frustum *frustum,
                          const struct umb_map_fragments *fragments,
                          const struct umb_map_settings *settings, const struct umb_alloc *alloc,
                          struct umb_map **out, struct umb_error *error);

/* Frees a map. NULL is allowed. */
UMB_API void umb_map_destroy(struct umb_map *map);

/* Fills info. Never fails. Cost: O(1). */
UMB_API void umb_map_get_info(const struct umb_map *map, struct umb_map_info *info);

/* The texels of one level as they are stored: what a GPU is given. */
struct umb_map_level {
    const void *texels; /* rows of [width][channels], little-endian; borrowed */
    uint32_t width, height, channels;
    enum umb_map_format format; /* U16: depth in steps of 1/65535, other channels as signed steps of
                                   1/32767; U24: three bytes a texel */
    size_t bytes;
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Fills in level 0, or a mip level. Fails: E_NOT_FOUND (beyond the last, or the map is not stored
 * as texels: tables, DEEP); out is then zeroed. Cost: O(1). */
UMB_API enum umb_status umb_map_get_level(const struct umb_map *map, uint32_t level,
                                          struct umb_map_level *out);

/* Name of a technique: "pcf", "vsm", ...; "unknown" for any other number. */
UMB_API const char *umb_map_technique_name(enum umb_map_technique technique);

/* The largest exponent that a format can hold in linear space, for ESM (moments 1) or EVSM
 * (moments 2, depth warped from -1 to 1); 0 for formats without range. */
UMB_API double umb_map_exponent_limit(enum umb_map_format format, int moments);

/*
 * Checks a filter against a map.
 *
 * Fails: E_ARGUMENT naming field, value and limit; E_UNSUPPORTED (light_size or a kernel that the
 *        map cannot do). query is zeroed on failure, and then must not be run.
 */
UMB_API UMB_CHECKED enum umb_status umb_map_prepare(const struct umb_map *map,
                                                    const struct umb_map_filter *filter,
                                                    struct umb_map_query *query,
                                                    struct umb_error *error);

/*
 * Answers points first .. first + count - 1: values[i] in 0..1, the share of light.
 *
 * Not guaranteed: points that umb_points_check refuses are answered without harm, meaninglessly.
 * Threads: any, on disjoint ranges of values.
 * Cost: no allocation, no failure.
 */
UMB_API void umb_map_run(const struct umb_map_query *query, const struct umb_points *points,
                         size_t first, size_t count, float *values);

#ifdef __cplusplus
}
#endif
#endif
