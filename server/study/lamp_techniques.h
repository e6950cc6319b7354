/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_LAMP_TECHNIQUES_H
#define UMBRAGE_SERVER_STUDY_LAMP_TECHNIQUES_H
/*
 * Shadow maps of a point light on the points of a view: six faces of a cube, or two paraboloids
 * (Brabec, Annen, Seidel 2002), in nearly equal bytes, compared with rays to the lamp.
 */
#include "study/techniques.h"

/* A technique with its settings, on either projection. */
struct umbt_lamp_row {
    const char *name; /* "cube-vsm" */
    enum umbt_technique_truth truth;
    int paraboloid;                   /* 0: a cube's faces */
    struct umb_map_settings settings; /* With access BASE the filter's width is the blur */
    struct umb_map_filter filter;
};

extern const struct umbt_lamp_row umbt_lamp_rows[];
extern const size_t umbt_lamp_row_count;

#define UMBT_LAMP_FACES 6

/* The maps of one projection: depths of all faces, and rays over the filter's box in them. */
struct umbt_lamp_faces {
    uint32_t count, side; /* texels a side */
    struct umb_map_frustum frusta[UMBT_LAMP_FACES];
    float *depth; /* [count][side * side] */
    float *box;   /* [receivers] */
};

struct umbt_lamp_view {
    struct umbt_technique_view *view; /* setup, size, resolution, taps, threads and buffer */
    double position[3], size_m;       /* Position of the lamp; its diameter for penumbras */
    struct umbt_lamp_faces faces[2];  /* cube, paraboloids */
};

/*
 * Traces the view's points, the maps' depths and the truths of the lamp, which go to view->truth
 * too.
 *
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing).
 */
UMB_CHECKED enum umb_status umbt_lamp_view_make(struct umbt_lamp_view *lamp,
                                                struct umb_error *error);
void umbt_lamp_view_finish(struct umbt_lamp_view *lamp);

/* Builds, queries and compares one row. values: float[receivers], out. Differences are over points
 * that face the lamp. */
UMB_CHECKED enum umb_status umbt_lamp_run(const struct umbt_lamp_view *lamp,
                                          const struct umbt_lamp_row *row, float *values,
                                          struct umbt_technique_result *result,
                                          struct umb_error *error);

#endif
