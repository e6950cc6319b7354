/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_PERSPECTIVE_H
#define UMBRAGE_CORE_QUERY_PERSPECTIVE_H
/*
 * Spot and point lights. Points are moved off their surface, assigned to the face that covers them,
 * and transformed to its voxel space. There the kernels of parallel light answer, as if voxel space
 * were the world. So the same kernels serve every kind of light.
 *
 * A point belongs to the face along whose axis it is farthest from the light. Faces overlap by a
 * guard band (bake/analysis/perspective_frame.h), so that no window is cut at a face's edge.
 */
#include "query/query_parts.h"

/* A point under a spot or point light. */
struct umb__sighting {
    int has_normal;
    double cosine;   /* Cosine between the normal and the direction to the light; 0 without a
                        normal */
    int facing_away; /* 1: its normal faces away, or it lies behind an area light's plane, so it is
                        in shadow; the fields below are 0 */
    uint32_t face;   /* Face of the query; 0 if none covers the point */
    double moved[3]; /* Position of the look-up in metres, relative to the asset's origin */
    double voxel[3]; /* Position in the face's voxel space; far outside if no face covers the
                        point */
    double bias_m;   /* Length of the move in metres */
};

/* Returns whether the query's lamp is an area light, which shines to one side. */
static inline bool umb__is_one_sided(const struct umb__query *query)
{
    return query->lamp->kind == UMB_LIGHT_RECTANGLE || query->lamp->kind == UMB_LIGHT_DISC;
}

/* Returns whether a point lies behind the plane of an area light. In: from_light: from the light to
 * the point. */
static inline bool umb__is_behind_light(const struct umb__query *query, const double from_light[3])
{
    return umb__is_one_sided(query) && !(umb__dot(from_light, query->direction) > 0);
}

/* Maps point i of a batch. */
void umb__perspective_map(const struct umb__query *query, const struct umb_points *points, size_t i,
                          struct umb__sighting *sighting);

/* Returns the length in metres by which a surface's points are moved along its unit normal n in a
 * face. In: from_light: from the light to the point. w: W there, above 0. */
double umb__perspective_bias(const struct umb__query *query, uint32_t face,
                             const double from_light[3], const double n[3], double w);

/* Makes the query that answers points given in the voxel space of a face. */
void umb__perspective_face(const struct umb__query *query, uint32_t face,
                           struct umb__query *face_query);

/* Computes the position in voxel space at which point i is looked up, under a light of any kind.
 * Out: frustum: number of the frustum. Returns false if the point's normal faces away; voxel may
 * then not be set. */
bool umb__look_up_at(const struct umb__query *query, const struct umb_points *points, size_t i,
                     double voxel[3], uint32_t *frustum);

/* Returns the mean edge in metres of a face's voxels at p, relative to the asset's origin. */
double umb__perspective_edge_m(const struct umb__query *query, uint32_t face, const double p[3]);

/* Returns the mean edge in metres of a texel across the light at p; 0 or below if no face covers p.
 * In: p: metres relative to the asset's origin. */
double umb__perspective_texel_m(const struct umb__query *query, const double p[3]);

#endif
