/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TRACED_SHADOW_H
#define UMBRAGE_SERVER_STUDY_TRACED_SHADOW_H
/*
 * Shadows traced with rays, the reference for an asset's pictures. A ray that meets no opaque
 * caster carries the product of the shares of light that the translucent casters on its way let
 * through.
 *
 * Five references, each towards the light from points outside the surface, 0 where the normal faces
 * away:
 *
 * - UMBT_TRUTH_TEXELS, the default for an n-tap filter, n > 1. The point is moved as the query
 *   moves it (computed here from the documented formula, not by the query). n x n rays start at the
 *   centres of the n x n texels around the moved point's texel, all at the depth of the look-up.
 *   The footprint is the same, but each texel's answer is traced; the remaining difference is the
 *   quantisation of depth to voxels.
 * - UMBT_TRUTH_AREA: like TEXELS, with samples x samples rays spread evenly over the n texels wide
 *   square centred on the moved point itself. The remaining difference includes the texel grid.
 * - UMBT_TRUTH_SURFACE, the default for one tap: one ray from the surface. The remaining difference
 *   includes everything: resolution, bias and filter.
 * - UMBT_TRUTH_DISC, the default for penumbras: samples x samples rays from the surface, spread
 *   evenly over the light: its disc (the concentric map of Shirley and Chiu 1997), its rectangle,
 *   or, for a spot or point light, a disc perpendicular to the direction towards the light. The
 *   remaining difference includes everything.
 * - UMBT_TRUTH_FOOTPRINT: samples x samples rays from the surface that the pixel around the point
 *   covers, by settings.eye and settings.pixel_rad: where the eye's rays meet the scene. Surfaces
 *   more than a pixel's width before or behind the point's plane do not count. The remaining
 *   difference includes everything.
 *
 * Precision: for the last three, starts are moved 2e-6 of the scene's diagonal off the surface,
 * because Embree's floats are relative to the scene's centre (about 6e-8 of its extent).
 */
#include "study/study_scene.h"
#include "umbrage/query.h"

enum umbt_truth_kind {
    UMBT_TRUTH_TEXELS = 0,
    UMBT_TRUTH_AREA = 1,
    UMBT_TRUTH_SURFACE = 2,
    UMBT_TRUTH_DISC = 3,
    UMBT_TRUTH_FOOTPRINT = 4,
};

struct umbt_truth {
    const struct umbr_rays *rays;     /* borrowed */
    const struct umbr_layers *layers; /* translucent casters, borrowed; NULL: none */
    enum umbt_truth_kind kind;
    struct umb_query_settings settings;
    uint32_t samples;   /* AREA, DISC and FOOTPRINT: rays a side, 1..64 */
    double extent;      /* DISC: angular diameter of parallel light in radians; not for lamps, which
                           have extents of their own */
    double to_light[3]; /* unit; of parallel light */
    int by_normal; /* 1: the automatic bias moves along the normal, as that of shadow maps does */
    const struct umb_light_info *lamp; /* a spot or point light, borrowed; NULL: parallel light */
    const struct umb_frustum_info *frusta; /* frusta of the lamp, borrowed; TEXELS and AREA */
    uint32_t frustum_count;
    double diagonal_m;               /* diagonal of the scene */
    double origin[3];                /* origin of the asset; TEXELS and AREA */
    struct umb_frustum_info frustum; /* frustum of parallel light; TEXELS and AREA */
    const uint8_t *closed;           /* uint8[triangles], borrowed; NULL: no closed rule */
};

/* Makes a truth (a reference by rays) for parallel light and an asset's frustum or a similar one.
 * It traces one ray, for a filter of one tap; the caller changes the fields that shall differ. The
 * scene is borrowed. */
struct umbt_truth umbt_truth_of(const struct umbt_scene *scene, const double to_light[3],
                                const double origin[3], const struct umb_frustum_info *frustum);

/* Computes the unit direction from a point to the lamp, or to_light without a lamp. Returns the
 * light's distance in metres; infinite without a lamp. */
double umbt_towards_light(const struct umb_light_info *lamp, const double to_light[3],
                          const double point[3], double towards[3]);

/* Makes the frustum of a point, with the size of voxels there. A lamp's voxels grow with the
 * distance along the axis, and lie along the ray. */
void umbt_truth_frustum_at(const struct umbt_truth *truth, const double point[3],
                           struct umb_frustum_info *at);

/*
 * Returns the distance in metres along its unit normal that a point needs, as umbrage/query.h
 * documents for points with normals. Pure.
 * In: frustum: with the voxel_step at the point.
 */
double umbt_truth_bias(const struct umb_query_settings *settings,
                       const struct umb_frustum_info *frustum, const double normal[3]);

/*
 * Moves a point off its surface as queries do: the automatic bias of parallel light lifts it along
 * the light, all else moves it along its unit normal. Pure.
 * In: frustum: with the voxel_step at the point. truth: settings, lamp, to_light.
 */
void umbt_truth_move(const struct umbt_truth *truth, const struct umb_frustum_info *frustum,
                     const double point[3], const double normal[3], double moved[3]);

/* Computes the look-up of a query's window: the moved point at the depth of its window. In: as
 * umbt_truth_move, and origin. */
void umbt_truth_look_up(const struct umbt_truth *truth, const double point[3],
                        const double normal[3], double at[3]);

/*
 * Returns 1 if a texel of the point's filter window lies, at the moved point's depth, inside a
 * closed solid of an asset baked under the closed rule. The asset's answer there is unspecified, so
 * a difference is not an error. `truth` needs frustum and origin, whatever its kind.
 */
int umbt_truth_is_undefined(const struct umbt_truth *truth, const double point[3],
                            const double normal[3]);

/* Mean share of light that arrives along the reference's rays: 0 or 1 for each, or the product of
 * what the translucent casters on it let through. Threads: any. */
float umbt_truth_visibility(const struct umbt_truth *truth, const double point[3],
                            const double normal[3]);

#endif
