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
 * umbrage's own voxel DAG is compared with these maps, and a thin client's GPU samples them.
 * docs/explained/techniques.md has the guarantees of each technique,
 * docs/explained/numerics-maps.md the numerical argument.
 *
 * Map space: x and y in texels, texel i covers [i, i + 1) and is sampled at its centre; depth 0..1
 * along the light, linear in metres for every projection. Depth 1 in a layer means "no caster".
 * Outside: points beyond the map in x or y, or before depth 0, are lit. Texels beyond the border
 * count as "no caster"; tables and bilinear filters clamp to the map instead. Receivers whose
 * normal faces away from the light are shadowed.
 *
 * Ownership: a map copies its inputs; destroy it with umb_map_destroy.
 * Threads: a built map and a prepared query are immutable; any number of threads may run a query.
 * Trust: sizes, settings and every depth of a layer are checked. Check points with
 * umb_points_check.
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

#define UMB_MAP_SIDE_MAX     16384 /* Texels a side */
#define UMB_MAP_WIDTH_MAX    64    /* Widest filter, in texels */
#define UMB_MAP_SAMPLES_MAX  64    /* Samples of a Poisson kernel */
#define UMB_MAP_TERMS_MAX    16    /* Fourier terms, or variance layers */
#define UMB_MAP_EXPONENT_MAX 1000  /* Largest exponent in log space; number formats bound it, too */

/* Content of a texel, and how it is filtered. A PCF map with light_size > 0 is PCSS. */
enum umb_map_technique {
    UMB_MAP_PCF = 0,     /* Depth, compared texel by texel (Williams 1978, Reeves 1987) */
    UMB_MAP_VSM,         /* Two moments (Donnelly, Lauritzen 2006) */
    UMB_MAP_LVSM,        /* Two moments of each of `terms` depth layers (Lauritzen, McCool 2008) */
    UMB_MAP_CONVOLUTION, /* `terms` Fourier terms (Annen et al. 2007) */
    UMB_MAP_ESM,         /* Mean exponential (Annen et al. 2008, Salvi 2008) */
    UMB_MAP_EVSM,        /* Two moments of an exponential warp, or of two (Lauritzen 2008) */
    UMB_MAP_MSM,         /* Four moments (Peters, Klein 2015) */
    UMB_MAP_DEEP,        /* Transmittance lists; see umb_map_build_deep */
    UMB_MAP_MOMENTS,     /* `terms` moments of the depth where light is absorbed; see
                            umb_map_build_translucent */
    UMB_MAP_ABSORBANCE,  /* `terms` moments of absorbance, -log of transmittance, and its sum */
};

#define UMB_MAP_TECHNIQUES 10 /* Number of values of enum umb_map_technique in this version */

enum umb_map_format {
    UMB_MAP_F32 = 0, /* IEEE single */
    UMB_MAP_F16,     /* IEEE half: ESM and EVSM in linear space */
    UMB_MAP_U24,     /* Three bytes, depth only */
    UMB_MAP_U16,     /* Two bytes: depth, or a channel of -1..1 */
};

/* Filtering of the channels of a filterable map (any but PCF and DEEP) by a query. */
enum umb_map_access {
    UMB_MAP_BASE = 0, /* Bilinear over texels that were blurred when built */
    UMB_MAP_MIPS,     /* Trilinear over a chain of halved maps; sides must be powers of two */
    UMB_MAP_SAT,      /* Summed-area tables, 64-bit integers: any box of real width, exact sums */
};

/* Relation of an answer to the true share of the filter's texels that let light through. */
enum umb_map_bound {
    UMB_MAP_EXACT = 0,   /* Equal to that share */
    UMB_MAP_UPPER_BOUND, /* Answers are not below that share by more than `slack` (light may bleed),
                            with a contrast of at most 1 */
    UMB_MAP_ESTIMATE,    /* Neither: may be above or below */
};

enum umb_map_projection {
    UMB_MAP_AFFINE = 0,  /* Directional light */
    UMB_MAP_PERSPECTIVE, /* Spot light, face of a cube, or a warped directional light (LiSPSM) */
    UMB_MAP_PARABOLOID,  /* Half of a point light's sphere (Brabec et al. 2002) */
};

/*
 * Projection of a map. Let p = (world - origin, 1), and mi row i of world_to_map.
 * AFFINE and PERSPECTIVE: x = (m0.p)/(m3.p), y = (m1.p)/(m3.p), depth = m2.p, where m3.p > 0.
 * PARABOLOID: (X, Y, Z) = m0..2.p in metres, r = |XYZ|; x = (1 + X/(r+Z)) width/2, y from Y and
 * height in the same way; depth = (r - near_m) / depth_m; only where Z >= 0.
 */
struct umb_map_frustum {
    enum umb_map_projection projection;
    uint32_t width, height; /* Texels */
    double origin[3];       /* Origin of p, metres, world space */
    double world_to_map[4][4];
    double depth_m; /* Metres of the depth range 0..1 along the light (perspective: along the axis),
                       above 0 */
    double near_m;  /* Metres from a point or spot light to depth 0 */
    int directional; /* 1: `light` is the unit vector towards the light, else its position */
    double light[3];
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* A layer: the depth of the first caster that the light meets through the centre of each texel. */
struct umb_map_layer {
    const float *depth;   /* float[height][width][samples], 0..1, 1 = no caster */
    const float *slope;   /* float[height][width][2]: change of the surface's depth from texel to
                             texel in x and in y, finite. NULL: each change is the smaller
                             difference to the two neighbours */
    uint64_t samples;     /* Number of depths a texel, 1..16; 0 = 1. A filterable map averages them,
                             as a multisampled target is resolved. Not for PCF or `depth_plane` */
    uint64_t reserved[1]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_map_settings {
    enum umb_map_technique technique;
    enum umb_map_format format;
    enum umb_map_access access; /* Not for PCF */
    uint32_t blur;              /* Width of a separable box over the texels, odd, 1..63; 0 = 1 */
    double min_variance;        /* VSM, LVSM, EVSM: least variance, 0..1, in squared depth; raised
                                   to the least that the format's rounding needs */
    int depth_plane;            /* VSM, LVSM: 1 adds the second moment of the slope in a texel */
    double exponent;            /* ESM, EVSM: c > 0 of exp(c depth) */
    double negative_exponent;   /* EVSM: c of -exp(-c depth), 0 = one warp only */
    int linear;                 /* ESM, EVSM: 1 stores exponentials, as a GPU does, which bounds the
                                   exponent; 0 stores logarithms */
    double moment_bias;         /* MSM, MOMENTS, ABSORBANCE: bias of the moments, 0..1; 0 = the
                                   least that the format needs. With a smaller bias answers are no
                                   bounds, and `slack` is 1 or near it */
    uint32_t terms;             /* CONVOLUTION: Fourier terms; LVSM: layers; 1..16. MOMENTS and
                                   ABSORBANCE: moments, 4, 6 or 8 */
    double overestimate;        /* MOMENTS, ABSORBANCE: of the light that may be absorbed at the
                                   receiver's own depth, the share, 0..1, that counts as absorbed.
                                   0: answers are upper bounds of the light */
    double damping;             /* CONVOLUTION: term k of M is weighted by exp(-damping (k/M)^2) */
    int keep_depth;       /* 1: a filterable map with MIPS or SAT keeps its depths too, 4 bytes
                                   a texel, in which `light_size` searches for blockers (PCSS) */
    uint64_t reserved[3]; /* Zero: room for later versions (umbrage/version.h) */
};

enum umb_map_kernel {
    UMB_MAP_BOX = 0,  /* n x n texels around the point's texel */
    UMB_MAP_POISSON,  /* PCF: `samples` points of a disc of diameter `width` */
    UMB_MAP_BILINEAR, /* PCF: box of real width around the point itself; texels at its border count
                         by the covered share. Width 1 is the 2 x 2 comparison of GPUs */
};

struct umb_map_filter {
    enum umb_map_kernel kernel;
    double width;     /* Width in texels, 1..64; 0 = 1. For boxes on PCF and DEEP an odd integer.
                         With BASE access only the biases use the width */
    uint32_t samples; /* Number of POISSON samples, 1..64 */
    double bias_m;    /* Metres towards the light, 0..1e6 */
    /* Slope bias, 0..100, as a multiple of the depth that the receiver's plane gains over half the
     * filter (its width in texels in x and in y); 1 is exactly enough for a plane not to shadow
     * itself. A penumbra follows the plane from texel to texel instead, and needs 1. */
    double bias_slope;
    /* Normal bias, 0..100, in the same unit as bias_slope; the point is moved along its normal. */
    double bias_normal;
    /* Size of the light: diameter in radians if directional, else in metres. Above 0 the filter is
     * as wide as the penumbra, at least 1 texel and at most `width`. For PCF with a box, for VSM
     * with SAT, and for any map with keep_depth. */
    double light_size;
    double reduction; /* 0..0.99: visibilities up to it become 0, the rest is stretched to 0..1 */
    double contrast;  /* VSM, LVSM, EVSM: contrast C in sigma^2 / (sigma^2 + C (t - mu)^2), at most
                         1e6; 0 stands for 1. Above 1 answers are darker, and are no upper bounds
                         any more */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

struct umb_map; /* opaque */

struct umb_map_info {
    enum umb_map_technique technique;
    const char *name; /* "pcf", "vsm", ... */
    uint32_t width, height;
    uint32_t channels;        /* Numbers a texel; 0 for DEEP */
    uint64_t bytes;           /* Bytes that queries read */
    uint64_t fragments;       /* DEEP: fragments kept in all lists */
    enum umb_map_bound bound; /* Kind of an answer without `reduction` and with a contrast of at
                                 most 1, in exact arithmetic */
    double slack;             /* Stated error of visibility by storage and arithmetic
                                 (docs/explained/numerics-maps.md) */
    uint64_t reserved[4];     /* Zero: room for later versions (umbrage/version.h) */
};

/* One surface or hair that light meets on its way through a texel. */
struct umb_map_fragment {
    float depth; /* 0..1 */
    float alpha; /* Share of the light that it absorbs, 0..1 */
};

/* All fragments of each texel's ray, for translucent casters. */
struct umb_map_fragments {
    const uint64_t *first; /* [width * height + 1]: texel i has first[i] .. first[i+1] - 1 */
    const struct umb_map_fragment *fragments; /* [first[width * height]], any order in a texel */
};

/* Search in the lists under a filter's window. Every way gives the same bits. */
enum umb_map_deep_way {
    UMB_MAP_DEEP_AUTO = 0,   /* STREAM where lists are short on average, else LINKS */
    UMB_MAP_DEEP_SEARCH = 1, /* Binary search of each list: 8 bytes a node */
    UMB_MAP_DEEP_LINKS = 2,  /* Binary search of the first list, links to the others: 16 bytes */
    UMB_MAP_DEEP_STREAM = 3, /* Adds up all nodes of a window's row, which are contiguous, without a
                                branch. A node has 8 bytes. Not with an exponent */
};

struct umb_map_deep_settings {
    /* Transmittance below which a list ends, 0..1; 0 keeps all fragments. The effect of 0.001
     * cannot be seen. */
    double epsilon;
    double exponent; /* Exponent c, 0..1e6, that lets the last step before a receiver take effect
                        gradually: at depth d behind the step, the share exp(-c d) of its effect is
                        missing. 0: the step acts at once */
    enum umb_map_deep_way way;
    uint64_t reserved[2]; /* Zero: room for later versions (umbrage/version.h) */
};

/* A checked query, filled by umb_map_prepare. The caller's storage; it may be copied. */
struct umb_map_query {
    uint64_t opaque[192];
};

/*
 * Fits an affine frustum of a directional light to a box of world space, with one texel to spare on
 * each side.
 *
 * In:    to_light: any length above 0. width, height: texels, 1..16384.
 * Fails: E_ARGUMENT (sizes, not finite, empty box, no direction).
 */
UMB_API UMB_CHECKED enum umb_status
umb_map_frustum_fit(const double to_light[3], const struct umb_box *box, uint32_t width,
                    uint32_t height, struct umb_map_frustum *frustum, struct umb_error *error);

/* One face of a point or spot light. */
struct umb_map_spot {
    double position[3], forward[3], up[3]; /* metres; up: not along forward */
    double tangent;                        /* Tangent of half the field of view, > 0 */
    double near_m, far_m;                  /* Metres along forward, 0 <= near < far */
    enum umb_map_projection projection;    /* PERSPECTIVE, or PARABOLOID (tangent not used) */
    uint64_t reserved[2];                  /* Zero: room for later versions (umbrage/version.h) */
};

/* Makes the frustum of a spot light, a cube's face (tangent 1) or half a sphere. Fails: E_ARGUMENT
 * (the field is named). */
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
 * Owns:  the caller frees it with umb_map_destroy.
 * Fails: E_ARGUMENT (frustum, a depth or slope out of range, settings), E_UNSUPPORTED (a format or
 *        access that the technique does not support), E_TOO_LARGE (an exponent beyond the format, a
 *        side above 16384), E_NO_MEMORY.
 * Cost:  O(texels * channels * blur).
 */
UMB_API UMB_CHECKED enum umb_status umb_map_build(const struct umb_map_frustum *frustum,
                                                  const struct umb_map_layer *layer,
                                                  const struct umb_map_settings *settings,
                                                  const struct umb_alloc *alloc,
                                                  struct umb_map **out, struct umb_error *error);

/*
 * Builds a deep shadow map from fragments. The parameters and failures of umb_map_build apply.
 *
 * Fails also: E_ARGUMENT (`first` that falls; depth, alpha or a setting out of range; STREAM with
 *        an exponent).
 * Sources: Lokovic, Veach 2000 (deep shadow maps); Fuerst, Mattausch, Scherzer 2013 (links).
 */
UMB_API UMB_CHECKED enum umb_status
umb_map_build_deep(const struct umb_map_frustum *frustum, const struct umb_map_fragments *fragments,
                   const struct umb_map_deep_settings *settings, const struct umb_alloc *alloc,
                   struct umb_map **out, struct umb_error *error);

/*
 * Builds a filterable map of translucent casters, MOMENTS or ABSORBANCE. The parameters and
 * failures of umb_map_build apply.
 *
 * MOMENTS averages linearly, as light does, so that any filter is right; opaque casters stay
 * opaque. ABSORBANCE is more accurate behind all casters, but its filters average logarithms, and
 * casters that leave less than 2^-10 of the light, as opaque casters do, count as leaving 2^-10.
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

/* The texels of one level as they are stored, for upload to a GPU. */
struct umb_map_level {
    const void *texels; /* Rows of [width][channels], little-endian; borrowed from the map */
    uint32_t width, height, channels;
    enum umb_map_format format; /* U16: depth in steps of 1/65535, other channels as signed steps of
                                   1/32767; U24: three bytes a texel */
    size_t bytes;               /* Length of `texels` in bytes */
    uint64_t reserved[2];       /* Zero: room for later versions (umbrage/version.h) */
};

/* Fills in level 0, or a mip level. Fails: E_NOT_FOUND (no such level; or a map of tables or lists,
 * which has no texels); out is then zeroed. Cost: O(1). */
UMB_API enum umb_status umb_map_get_level(const struct umb_map *map, uint32_t level,
                                          struct umb_map_level *out);

/* Returns the name of a technique: "pcf", "vsm", ...; "unknown" for any other number. */
UMB_API const char *umb_map_technique_name(enum umb_map_technique technique);

/* Returns the largest exponent that a format can hold in linear space, for ESM (moments 1) or EVSM
 * (moments 2, depth warped from -1 to 1); 0 for integer formats. */
UMB_API double umb_map_exponent_limit(enum umb_map_format format, int moments);

/*
 * Checks a filter against a map and prepares it for runs.
 *
 * In:    map: borrowed as long as the query is used.
 * Out:   query: zeroed on failure, and then must not be run.
 * Fails: E_ARGUMENT (the field, its value and its limit are named), E_UNSUPPORTED (light_size or a
 *        kernel that the map does not support).
 */
UMB_API UMB_CHECKED enum umb_status umb_map_prepare(const struct umb_map *map,
                                                    const struct umb_map_filter *filter,
                                                    struct umb_map_query *query,
                                                    struct umb_error *error);

/*
 * Answers points first .. first + count - 1: values[i] in 0..1, the share of light.
 *
 * Not guaranteed: points that umb_points_check refuses are answered safely, but their answers are
 *        meaningless.
 * Threads: any, on disjoint ranges of values.
 * Cost:  no allocation, no failure.
 */
UMB_API void umb_map_run(const struct umb_map_query *query, const struct umb_points *points,
                         size_t first, size_t count, float *values);

#ifdef __cplusplus
}
#endif
#endif
