/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_PERSPECTIVE_H
#define UMBRAGE_CORE_QUERY_PERSPECTIVE_H
/*
 * Spot and point lights: points are moved off their surface, given to the face that looks at them
 * and brought into its voxel space; there the kernels of parallel light answer, as if voxel space
 * were the world. So the look-up exists once, and its kernels serve every kind of light.
 *
 * A point belongs to the face along whose axis it is farthest from the light. Faces overlap by a
 * guard band (bake/analysis/perspective_frame.h), so that no window is cut at a face's edge.
 */
#include "query/query_parts.h"

/* A point in front of a spot or point light. */
struct umb__sighting {
    int has_normal;
    double cosine;   /* of the angle between normal and the way to the light; 0 without a normal */
    int facing_away; /* its normal says that it is in shadow; nothing below is set */
    uint32_t face;   /* of the query's, 0 if none sees it */
    double moved[3]; /* metres, relative to the asset's origin */
    double voxel[3]; /* in the face's voxel space; far outside if no face sees the point */
    double bias_m;   /* how far it was moved */
};

/* Maps point i of a batch. */
void umb__perspective_map(const struct umb__query *query, const struct umb_points *points, size_t i,
                          struct umb__sighting *sighting);

/* The query that answers points given in the voxel space of a face. */
void umb__perspective_face(const struct umb__query *query, uint32_t face,
                           struct umb__query *face_query);

/* Mean edge of a texel across the light at p, metres relative to the asset's origin; 0 or below
 * where no face looks. */
double umb__perspective_texel_m(const struct umb__query *query, const double p[3]);

/* As umb_query_run and umb_query_explain promise. */
void umb__perspective_run(const struct umb__query *query, const struct umb_points *points,
                          size_t first, size_t count, struct umb_answers *answers);
void umb__perspective_explain(const struct umb__query *query, const struct umb_points *points,
                              size_t index, struct umb_explanation *explanation);

#endif
