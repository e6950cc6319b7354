/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_VIEW_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_VIEW_H
/*
 * One view of a scene that all techniques answer: a layer of depths traced from the light, the
 * points that the camera sees, and their traced visibility by each kind of truth.
 *
 * Truths use the same box in light space as a filter of `width` texels, moved off the surface as
 * bias_normal = 1 does. So the remaining difference comes from the technique and its map.
 */
#include "study/gbuffer.h"
#include "study/picture.h"
#include "study/steady_time.h"
#include "study/technique_rows.h"
#include "study/traced_shadow.h"

struct umbt_technique_view {
    const struct umbt_scene *scene;
    struct umbt_camera camera;
    double to_light[3];
    int z_up;
    uint32_t width, height; /* pixels */
    uint32_t resolution;    /* texels a side */
    uint32_t taps;          /* width of the filter, odd */
    double light_rad;       /* angular diameter */
    unsigned threads;
    struct umb_map_frustum frustum;
    float *depth; /* [resolution^2] */
    struct umbt_gbuffer buffer;
    float *truth[UMBT_TECHNIQUE_TRUTHS]; /* [receivers] */
};

/*
 * Traces layer, points and truths.
 *
 * In:    scene .. threads are set, the rest zero.
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing).
 */
UMB_CHECKED enum umb_status umbt_technique_view_make(struct umbt_technique_view *view,
                                                     struct umb_error *error);
void umbt_technique_view_finish(struct umbt_technique_view *view);

/* Traces a frustum's layer of depths. depth: float[frustum->width * frustum->height]. */
UMB_CHECKED enum umb_status umbt_technique_layer(const struct umbt_technique_view *view,
                                                 const struct umb_map_frustum *frustum,
                                                 float *depth, struct umb_error *error);

/* The truth of the view's filter on an affine frustum: rays over its box. */
void umbt_technique_truth(const struct umbt_technique_view *view,
                          const struct umb_map_frustum *frustum, struct umbt_truth *truth);

/* Visibility of receiver i by a truth. */
float umbt_technique_traced(const struct umbt_technique_view *view, const struct umbt_truth *truth,
                            size_t i);

#define UMBT_TECHNIQUE_STEADY 0.15 /* spread of runs that is good enough */

/* Result of one technique. Differences are over points that face the light. */
struct umbt_technique_result {
    struct umb_map_info info;
    double build_s; /* CPU time */
    struct umbt_steady_time query;
    double mean, lighter, darker; /* mean of |answer - truth|, and its two parts */
    double over_half;             /* share of points off by more than 0.5 */
};

/* Adds the differences of answers from a truth, over points that face the light, to a zeroed
 * result. truth, values: float[receivers]. */
void umbt_technique_compare(const struct umbt_technique_view *view, const float *truth,
                            const float *values, struct umbt_technique_result *result);

/* The row's filter, completed with the view's values. */
struct umb_map_filter umbt_technique_filter(const struct umbt_technique_view *view,
                                            const struct umbt_technique_row *row);

/* The row's settings, completed with the view's values. */
struct umb_map_settings umbt_technique_settings(const struct umbt_technique_view *view,
                                                const struct umbt_technique_row *row);

/* Builds, queries and compares one row. values: float[receivers], out. */
UMB_CHECKED enum umb_status umbt_technique_run(const struct umbt_technique_view *view,
                                               const struct umbt_technique_row *row, float *values,
                                               struct umbt_technique_result *result,
                                               struct umb_error *error);

/* Draws the view into a picture at pixel (x0, y0), with the given visibilities of its points. */
void umbt_technique_draw(const struct umbt_technique_view *view, const float *values,
                         struct umbt_picture *picture, uint32_t x0, uint32_t y0);

#endif
