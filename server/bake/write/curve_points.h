/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_WRITE_CURVE_POINTS_H
#define UMBRAGE_SERVER_BAKE_WRITE_CURVE_POINTS_H
/*
 * The accuracy curve of a bake: points on the scene's surfaces, queried with every setting
 * (curve/curve_measure.h). Points are drawn by area, at fixed shares of it. So they depend on the
 * triangles alone, and equal scenes give equal curves.
 */
#include "bake/analysis/analysis.h"
#include "curve/curve_measure.h"

/*
 * Measures the curve of all lights.
 *
 * In:    analysis: with its corners in world space. octree: that of `content`. threads: 1..
 * Out:   content->curve, curve_count: the caller frees curve with free(). NULL and 0 on failure.
 * Fails: E_NO_MEMORY.
 * Cost:  about 0.1 s for one light, up to 25 us a light and point for many; two passes over the
 *        triangles.
 */
UMB_CHECKED enum umb_status umbb_curve_add(const struct umbb_analysis *analysis,
                                           const struct umb__octree *octree, unsigned threads,
                                           struct umb__content *content, struct umb_error *error);

#endif
