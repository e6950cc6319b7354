/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_BOUND_CHECK_H
#define UMBRAGE_SERVER_STUDY_BOUND_CHECK_H
/*
 * Test of the stated bound. Each point on the scene's surfaces is answered by a query and by a ray.
 * Where the two differ, another ray must find the other truth within the bound. These rays start at
 * places around the point and at the centres of the voxels of the answer.
 *
 * A window that reaches into a closed solid is undefined; the bound promises nothing there.
 */
#include "study/point_sampler.h"
#include "umbrage/curve.h"

struct umbt_bound_result {
    uint64_t points;    /* number of points compared: all that face the light */
    uint64_t differ;    /* number of answers that differ from the ray */
    uint64_t undefined; /* number of differing answers with an undefined window and no boundary */
    /* Number of differing answers without a true boundary within the bound; must be 0. */
    uint64_t beyond;
    double worst_point[3]; /* an example of the points counted in `beyond` */
};

struct umbt_bound_job {
    const struct umbt_scene *scene;
    const struct umb_asset *asset;
    const struct umbt_point_set *points; /* points on surfaces, with normals */
    struct umb_query_settings settings;  /* settings with automatic bias and the box filter */
    double bound_m;
    unsigned threads;
};

/* Checks the bound. Fails: E_NO_MEMORY, and the errors of umb_query_prepare. Cost: about a ray a
 * point, and a few hundred where answers differ. */
UMB_CHECKED enum umb_status umbt_bound_check(const struct umbt_bound_job *job,
                                             struct umbt_bound_result *result,
                                             struct umb_error *error);

#endif
