/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_GBUFFER_H
#define UMBRAGE_SERVER_STUDY_GBUFFER_H
/*
 * Visible points of a camera in a band of pixel rows: for each sub-sample the surface point, its
 * geometric normal turned towards the camera, and its triangle.
 *
 * Points are intersected again with the triangle's plane in doubles, so they lie on the surface to
 * rounding. Embree's float distance is off by more than a voxel far away. The points of all hits
 * lie without gaps at the start of the arrays (`receivers`), ready for a query; `slots` gives the
 * index of a sub-sample's point.
 */
#include "study/camera.h"
#include "study/study_scene.h"

#define UMBT_SKY UINT32_MAX

struct umbt_gbuffer {
    uint32_t width, aa; /* pixels a row; aa * aa sub-samples a pixel */
    uint32_t first_row, row_count;
    size_t capacity;        /* size of each array, in sub-samples */
    size_t receiver_count;  /* number of sub-samples of the band that hit the scene */
    uint32_t *slots;        /* [row_count * width * aa * aa] number of the receiver, or UMBT_SKY */
    double (*positions)[3]; /* [receiver_count], world space */
    float (*normals)[3];    /* [receiver_count], unit */
    uint32_t *triangles;    /* [receiver_count] */
};

/* Makes a buffer for bands of up to `rows` rows. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_gbuffer_init(struct umbt_gbuffer *buffer, uint32_t width,
                                              uint32_t aa, uint32_t rows, struct umb_error *error);
void umbt_gbuffer_finish(struct umbt_gbuffer *buffer); /* a zeroed struct is allowed */

/*
 * Fills rows first_row .. first_row + row_count - 1 of a picture of `height` rows.
 *
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbt_gbuffer_fill(struct umbt_gbuffer *buffer,
                                              const struct umbt_scene *scene,
                                              const struct umbt_camera *camera, uint32_t height,
                                              uint32_t first_row, uint32_t row_count,
                                              unsigned threads, struct umb_error *error);

/* Makes and fills a buffer for a picture of size[0] x size[1] pixels, with one sample a pixel.
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing). */
UMB_CHECKED enum umb_status umbt_gbuffer_view(struct umbt_gbuffer *buffer,
                                              const struct umbt_scene *scene,
                                              const struct umbt_camera *camera,
                                              const uint32_t size[2], unsigned threads,
                                              struct umb_error *error);

#endif
