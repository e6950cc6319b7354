/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUE_VIEW_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUE_VIEW_H
/*
 * One view of a scene that all techniques answer: a layer of depths traced from the light, the
 * points that the camera sees, and their traced visibility by each kind of truth.
 *
 * Truths use the same box in light space as a filter of `taps` texels, moved off the surface as
 * bias_normal = 1 does. The remaining difference comes from the technique and its map.
 */
#include "study/gbuffer.h"
#include "study/picture.h"
#include "study/setup.h"
#include "study/traced_shadow.h"
#include "umbrage/maps.h"

/* Kind of rays that a technique is compared with. */
enum umbt_technique_truth {
    UMBT_BOX = 0,  /* rays over the filter's box; with cascades, over that of the point's slice */
    UMBT_POINT,    /* one ray from the point */
    UMBT_PENUMBRA, /* rays to points of the light's disc */
    UMBT_TECHNIQUE_TRUTHS
};

struct umbt_technique_view {
    struct umbt_setup setup;
    uint32_t size[2];    /* pixels */
    uint32_t resolution; /* texels a side */
    uint32_t taps;       /* width of the filter, odd */
    double light_rad;    /* angular diameter */
    unsigned threads;
    struct umb_map_frustum frustum;
    float *depth; /* [resolution^2] */
    struct umbt_gbuffer buffer;
    float *truth[UMBT_TECHNIQUE_TRUTHS]; /* [receivers] */
};

/*
 * Traces layer, points and truths.
 *
 * In:    view: the fields from `setup` to `threads` are set; the rest is zero.
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing).
 */
UMB_CHECKED enum umb_status umbt_technique_view_make(struct umbt_technique_view *view,
                                                     struct umb_error *error);
void umbt_technique_view_finish(struct umbt_technique_view *view);

/* Traces a frustum's layer of depths. depth: float[frustum->width * frustum->height]. */
UMB_CHECKED enum umb_status umbt_technique_layer(const struct umbt_technique_view *view,
                                                 const struct umb_map_frustum *frustum,
                                                 float *depth, struct umb_error *error);

/* Makes the truth of the view's filter on an affine frustum: rays over the filter's box. The map's
 * texels are its voxels. */
void umbt_technique_truth(const struct umbt_technique_view *view,
                          const struct umb_map_frustum *frustum, struct umbt_truth *truth);

/* Visibility of receiver i by a truth. */
float umbt_technique_traced(const struct umbt_technique_view *view, const struct umbt_truth *truth,
                            size_t i);

#define UMBT_TECHNIQUE_STEADY 0.15 /* spread of runs that is good enough */

/* Result of one technique. Differences are over points that face the light. */
struct umbt_technique_result {
    struct umb_map_info info;
    double build_s;               /* CPU time */
    double ns;                    /* CPU time of a point on one thread, median of the runs */
    double spread;                /* spread of the runs (umbt_median) */
    double mean, lighter, darker; /* mean of |answer - truth|, and its two parts */
    double over_half;             /* share of points off by more than 0.5 */
};

/* Adds the differences of answers from a truth, over points that face the light, to a zeroed
 * result. truth, values: float[receivers]. */
void umbt_technique_compare(const struct umbt_technique_view *view, const float *truth,
                            const float *values, struct umbt_technique_result *result);

/* A picture with many drawings of one view, side by side. */
struct umbt_sheet {
    const char *path; /* NULL: nothing is drawn */
    struct umbt_picture picture;
};

/* Makes a sheet for a number of drawings; umbt_picture_finish frees it. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_sheet_begin(struct umbt_sheet *sheet, const char *path,
                                             const struct umbt_technique_view *view, size_t tiles,
                                             struct umb_error *error);

/* Draws the view as drawing number `tile`, with `values` as the visibilities of its points. */
void umbt_sheet_draw(struct umbt_sheet *sheet, size_t tile, const struct umbt_technique_view *view,
                     const float *values);

/* Writes the sheet. Fails: as umbt_picture_write. */
UMB_CHECKED enum umb_status umbt_sheet_write(const struct umbt_sheet *sheet,
                                             struct umb_error *error);

#endif
