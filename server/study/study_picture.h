/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PICTURE_H
#define UMBRAGE_SERVER_STUDY_STUDY_PICTURE_H
/*
 * A picture of a scene with its shadows, from an asset, from rays, or from both for comparison.
 *
 * It works in bands of rows, so memory does not grow with the picture. Sub-samples are shaded,
 * compressed in their highlights, averaged over the pixel and encoded. Results do not depend on the
 * number of threads.
 *
 * Translucent surfaces on the way to an opaque one are blended over it, the nearest last. Each is
 * lit and shadowed as an opaque surface at its place would be.
 *
 * Several lights add up: on each receiver the light that each one sends there, times its
 * visibility. The sum is what the look of picture.h shades and compresses.
 *
 * Differences are taken over receivers that face the light: elsewhere both answers are 0 by the
 * normal, and counting them would flatter the mean. Each light counts by itself, and so does each
 * translucent receiver.
 */
#include "study/picture.h"
#include "study/picture_light.h"
#include "umbrage/volume.h"

/*
 * Sunlit fog between the eye and the surface: light shafts. The lit intervals of each view ray come
 * from a segment query of the asset. So the integral over them is exact for a fog of constant
 * density: nothing is sampled along the ray.
 */
struct umbt_fog {
    struct umb_volume volume;
    double density; /* extinction, 1/m */
};

/* Makes fog of an asset's light. Fails: the errors of umb_volume_prepare and
 * umb_volume_check_parallel. */
UMB_CHECKED enum umb_status umbt_fog_make(const struct umb_asset *asset, uint32_t light,
                                          double density, struct umbt_fog *fog,
                                          struct umb_error *error);

/*
 * Looks through the fog.
 *
 * In:  eye, end: world space, metres, finite.
 * Out: through: share of the light from `end` that reaches the eye. lit: share of the fog's own
 *      light that is sunlit and reaches it: the integral of density * exp(-density s) over the lit
 *      intervals; lit + through <= 1.
 * Threads: any.
 */
void umbt_fog_look(const struct umbt_fog *fog, const double eye[3], const double end[3],
                   double *through, double *lit);

/* Cosine between normal and light below which receivers are not judged. There a texel's edge
 * reaches so far along the surface that shadows cannot be right; such receivers are also hardly
 * lit. */
#define UMBT_JUDGED_FACING 0.2

struct umbt_picture_request {
    const struct umbt_setup *setup;
    uint32_t size[2];                        /* pixels */
    const struct umbt_picture_light *lights; /* [light_count], at least 1, borrowed */
    uint32_t light_count;
    const struct umbt_fog *fog; /* of the first light; NULL: clear air. Seen in `asset` only */
    struct umbt_ground ground;  /* a plane below the scene; zeroed: none */
    uint32_t aa;                /* sub-samples a side of a pixel, 1..3 */
    unsigned threads;
    int difference; /* 1: draws the difference; needs sources and truths */
    int quiet;
};

struct umbt_pictures {
    struct umbt_picture asset, traced; /* empty without source, without truth */
    struct umbt_picture difference;    /* red where the asset is lighter, blue where darker */
};

struct umbt_picture_result {
    uint64_t samples, seen; /* Numbers of sub-samples: all, and those that see a surface */
    /* Numbers of receivers: all, translucent ones, and for each light those that face it. */
    uint64_t receivers, translucent, facing;
    struct umb_query_stats stats;
    double gbuffer_s, query_s, trace_s, compare_s; /* wall seconds of the stages */
    /* With source and truth, over receivers that face the light: */
    double mean_difference;           /* mean of |asset - traced| */
    double mean_lighter, mean_darker; /* parts of the mean: asset lighter (leaks), darker (acne) */
    double over_half;                 /* share of receivers with |asset - traced| > 0.5 */
    /* Number of differing receivers whose window reaches into closed solids, where answers are
     * unspecified. The mean and the share leave these receivers out. */
    uint64_t undefined;
    double mean_defined, over_half_defined;
    /* Number of receivers with a cosine above UMBT_JUDGED_FACING and no window into closed solids.
     * False shadow: share where the asset is below 0.5 and the truth above 0.5 by more than its own
     * error; false light: the reverse. */
    uint64_t judged;
    double false_shadow, false_light;
    double picture_difference; /* mean over all pixels and channels, of 0..1 sRGB */
};

/* Renders into zeroed pictures. Fails: E_NO_MEMORY, or as umbt_shadow_source_answer. */
UMB_CHECKED enum umb_status umbt_picture_render(const struct umbt_picture_request *request,
                                                struct umbt_pictures *pictures,
                                                struct umbt_picture_result *result,
                                                struct umb_error *error);
void umbt_pictures_finish(struct umbt_pictures *pictures); /* a zeroed struct is allowed */

#endif
