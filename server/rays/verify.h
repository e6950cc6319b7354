/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_RAYS_VERIFY_H
#define UMBRAGE_SERVER_RAYS_VERIFY_H
/*
 * Comparing an asset with traced rays. The asset must agree with the rays except within one voxel
 * of a shadow boundary.
 *
 * Half of the points are uniform in the frustum's box, half within 4 voxels of a shadow boundary.
 * Of those, half lie at a lit surface found by a ray, the others at a change that a walk along the
 * asset's voxels finds. Each point is looked up without bias and traced towards the light. A
 * disagreement is inside the band if the traced truth differs among the samples of a 5x5x5 grid of
 * offsets within one voxel of the point (with the voxel's own centre and rings around it, for rods
 * thinner than the grid). A disagreement outside the band must not happen.
 *
 * For lamps, places are also drawn anywhere in the casters' box, a quarter as many as points. A
 * place that no face covers must be lit, and counts only if it is not.
 *
 * Floats and doubles: a frustum needs doubles (exact_rays.h) for all its rays if its voxels are
 * smaller than the error of float rays (umbr_rays_error_m), or if it has casters near its lamp. In
 * other frusta, a point that float rays judge wrong is judged again in doubles. The band is
 * therefore one voxel everywhere.
 *
 * Assets baked under the static rule are valid for points on surfaces only, so all their points lie
 * on surfaces. They are found by rays along the light from anywhere in the box, and moved to the
 * light's side by the automatic bias of one tap.
 *
 * Where translucent casters are given, points that are lit past all opaque casters are looked up
 * once more with the translucent ones. The answer must be the product of what they let through, or
 * lie between those at the middles of the texels that it reads and within a voxel
 * (verify_layers.c).
 *
 * Points inside closed parts of assets baked under the closed rule are counted and left out,
 * because answers there are unspecified. A point in shadow that agrees is left out if its ray first
 * meets the inner side of a closed part. A point that disagrees is left out only if five of six
 * rays in opposite directions find it inside a solid, so an open surface cannot excuse a wrong
 * voxel. Other points are drawn instead, up to four times as many: a frustum that is nearly all
 * solid gets fewer points than requested.
 */
#include "rays/layers.h"
#include "umbrage/query.h"

/* Kind of query (umbrage/volume.h), and how its answers are compared with rays. */
enum umbr_verify_kind {
    /* Points, as above. */
    UMBR_VERIFY_POINTS = 0,
    /* Segments of all lengths, half of them through a boundary. Each is tested at four parameters,
     * two of them next to the end of an interval. Lit or shadowed there is judged like a point's
     * answer. */
    UMBR_VERIFY_SEGMENTS,
    /* Columns: the first occluder is compared with the nearest hit of the light ray through the
     * texel's centre. An answer inside the band names another voxel, but one within a voxel of
     * those that the rays of a 5x5 grid within one texel find. */
    UMBR_VERIFY_COLUMNS,
    /* Boxes of up to five voxels a side: the number of lit voxels is compared with rays from all
     * centres inside. An answer inside the band differs by no more than the number of voxels in the
     * band or in a closed solid. */
    UMBR_VERIFY_BOXES,
};

struct umbr_verify_options {
    uint64_t points; /* Number of points or volume queries; 0 = 1 million */
    enum umbr_verify_kind kind;
    uint64_t seed;
    const uint8_t *closed; /* [triangle count] not 0: of a closed part; NULL = no closed parts */
    /* Translucent casters for points of assets with the effect transmittance; NULL: none */
    const struct umbr_layers *layers;
    unsigned threads;       /* 0 = all */
    int (*cancelled)(void); /* called now and then from any thread; may be NULL */
    /* Called with the number of compared points, by any thread, one at a time; may be NULL. */
    void (*progress)(void *user, uint64_t points);
    void *progress_user;
};

struct umbr_verify_result {
    uint64_t records;                   /* number of segments, columns, boxes queried */
    uint64_t points, near_boundary;     /* points compared; part of them drawn near a boundary */
    uint64_t skipped_inside;            /* points inside closed parts */
    uint64_t translucent;               /* points behind translucent casters alone */
    uint64_t inside_band, outside_band; /* disagreements */
    double worst_point[3];              /* a point outside the band, world */
    int has_worst;
};

/* Adds the counts of a result to a sum. */
static inline void umbr_verify_result_add(struct umbr_verify_result *sum,
                                          const struct umbr_verify_result *one)
{
    sum->records += one->records;
    sum->points += one->points;
    sum->near_boundary += one->near_boundary;
    sum->skipped_inside += one->skipped_inside;
    sum->translucent += one->translucent;
    sum->inside_band += one->inside_band;
    sum->outside_band += one->outside_band;
}

/*
 * Verifies one light of an asset.
 *
 * In:    options: may be NULL.
 * Out:   result: zeroed on failure. The same for any number of threads.
 * Fails: E_ARGUMENT, E_NO_MEMORY, E_CANCELLED; E_UNSUPPORTED (a light that cannot be queried). A
 *        disagreement is not a failure: see the result.
 * Cost:  2 to 5 us a point on one processor; more if closed solids fill more of the box.
 */
UMB_CHECKED enum umb_status umbr_verify(const struct umb_asset *asset, uint32_t light,
                                        const struct umbr_rays *rays,
                                        const struct umbr_verify_options *options,
                                        struct umbr_verify_result *result, struct umb_error *error);

#endif
