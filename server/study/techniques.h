/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TECHNIQUES_H
#define UMBRAGE_SERVER_STUDY_TECHNIQUES_H
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
#include "study/study_math.h"
#include "study/traced_shadow.h"
#include "umbrage/cascades.h"

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
    uint32_t resolution; /* texels a side, of a map without cascades */
    uint32_t taps;       /* width of the filter, odd */
    double light_rad;    /* angular diameter */
    const double *lamp;  /* [3], borrowed: position of a lamp; NULL: the light is the setup's sun */
    unsigned threads;
    int quick; /* 1: times that do not agree are not measured again */
    struct umb_map_frustum frustum;
    float *depth; /* [resolution^2] */
    struct umbt_gbuffer buffer;
    float *truth[UMBT_TECHNIQUE_TRUTHS]; /* [receivers] */
    /* [receivers], borrowed: gets the truth that a technique was compared with, of its own filter;
     * NULL: not wanted. */
    float *compared;
};

/*
 * Traces layer, points and truths.
 *
 * In:    view: the fields from `setup` to `quick` are set; the rest is zero.
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing).
 */
UMB_CHECKED enum umb_status umbt_technique_view_make(struct umbt_technique_view *view,
                                                     struct umb_error *error);
void umbt_technique_view_finish(struct umbt_technique_view *view);

/* Makes the points that the camera sees and room for their truths. Fails: as
 * umbt_technique_view_make. */
UMB_CHECKED enum umb_status umbt_technique_points_make(struct umbt_technique_view *view,
                                                       struct umb_error *error);

/* Traces the depths of side * side samples of each texel. depth: [height][width][side * side]. */
UMB_CHECKED enum umb_status umbt_layer_trace(const struct umbt_technique_view *view,
                                             const struct umb_map_frustum *frustum, uint32_t side,
                                             float *depth, struct umb_error *error);

/* Returns whether a point of the view faces the light. Out: direction: to the light, unit.
 * distance: to a lamp, metres. */
int umbt_faces_light(const struct umbt_technique_view *view, size_t point, double direction[3],
                     double *distance);

/*
 * Computes the ray of the light through a texel's centre, from depth 0 to depth 1.
 *
 * In:  texel: number in rows. Out: start, direction (unit).
 * Returns the ray's length in metres; 0 for a texel outside of the frustum.
 */
double umbt_texel_ray(const struct umb_map_frustum *frustum, size_t texel, double start[3],
                      double direction[3]);

/* A seam between two cascades. */
struct umbt_seam {
    double distance_m; /* of the split along the view */
    size_t points;     /* number of visible points on the seam */
    double contrast;   /* contrast C of the layer behind the seam */
    /* Root mean square of the jump of the answers from one layer to the next: with contrast C = 1
     * for all layers, and with the contrasts that were found. */
    double before, after;
};

/* Result of one technique. Differences are over points that face the light. */
struct umbt_technique_result {
    struct umb_map_info info;
    double build_s;               /* CPU time */
    struct umbt_time time;        /* CPU time of a point on one thread */
    struct umbt_time scalar;      /* the same without vector instructions; assets only */
    double mean, lighter, darker; /* mean of |answer - truth|, and its two parts */
    double over_half;             /* share of points off by more than 0.5 */
    uint32_t seam_count;          /* 0: no cascades */
    struct umbt_seam seams[UMB_CASCADES_MAX];
};

/* Sets a result's errors: the differences of answers from a truth, over points that face the light.
 * truth, values: float[receivers]. The truth is copied if the view wants it. */
void umbt_technique_compare(const struct umbt_technique_view *view, const float *truth,
                            const float *values, struct umbt_technique_result *result);

/* Returns a row's filter, completed with the view's width and biases. In: own: the row's. depth_m:
 * depth of the map's frustum. light_size: diameter of the light, if the filter has one. */
struct umb_map_filter umbt_technique_filter(const struct umbt_technique_view *view,
                                            const struct umb_map_filter *own,
                                            enum umbt_technique_truth truth, double depth_m,
                                            double light_size);

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

/* Writes a name into the upper left corner of a drawing. */
void umbt_sheet_label(struct umbt_sheet *sheet, size_t tile, const struct umbt_technique_view *view,
                      const char *name);

/* Writes the sheet. Fails: as umbt_picture_write. */
UMB_CHECKED enum umb_status umbt_sheet_write(const struct umbt_sheet *sheet,
                                             struct umb_error *error);

/* A row of `umbrage-study techniques`: a technique with its settings. */
struct umbt_technique_row {
    const char *name; /* "vsm-sat" */
    enum umbt_technique_truth truth;
    struct umb_map_settings
        settings;                 /* Settings; with access BASE the filter's width is the blur */
    struct umb_map_filter filter; /* Filter; the view sets width, light_size and biases */
    /* Number of slices of the view with a map each, of half the view's texels a side: four slices
     * take the bytes of one map. 0: one map for all points. */
    uint32_t cascades;
    enum umb_cascade_fit fit; /* Fit of the slices; not LISPSM with truth BOX */
    int match;                /* 1: contrasts of the slices by umb_cascades_match */
    double blend;             /* Share of a slice that fades into the next */
    uint32_t samples;         /* Depths along each side of a texel; 0 = 1 */
};

/* All rows, in the order of the table. */
extern const struct umbt_technique_row umbt_technique_rows[];
extern const size_t umbt_technique_row_count;

/* Builds, queries and compares one row. values: float[receivers], out. */
UMB_CHECKED enum umb_status umbt_technique_run(const struct umbt_technique_view *view,
                                               const struct umbt_technique_row *row, float *values,
                                               struct umbt_technique_result *result,
                                               struct umb_error *error);

/*
 * Opens an asset for a view.
 *
 * Fails: the errors of umb_asset_open_file; E_ARGUMENT (its first light is not the view's sun).
 */
UMB_CHECKED enum umb_status umbt_dag_open(const struct umbt_technique_view *view, const char *path,
                                          struct umb_asset **asset, struct umb_error *error);

/* Queries and compares an asset. truth: POINT: one tap against one ray; BOX: the view's filter, in
 * voxels, against rays over its box; PENUMBRA: the penumbra filter against the light's disc. In
 * result->info only `bytes` is set. Fails: the errors of umb_query_prepare; E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_dag_run(const struct umbt_technique_view *view,
                                         const struct umb_asset *asset,
                                         enum umbt_technique_truth truth, float *values,
                                         struct umbt_technique_result *result,
                                         struct umb_error *error);

#endif
