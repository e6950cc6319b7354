/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_GBUFFER_H
#define UMBRAGE_SERVER_STUDY_GBUFFER_H
/*
 * Visible points of a camera in a band of pixel rows: for each sub-sample the surface point, its
 * geometric normal turned towards the camera, and its triangle. Before an opaque surface, or the
 * sky, a sub-sample also sees the translucent surfaces on its ray (umbt_scene.seen): each is a
 * point of its own, chained from the nearest to the farthest.
 *
 * Points are intersected again with the triangle's plane in doubles, so they lie on the surface to
 * rounding. Embree's float distance is off by more than a voxel far away. The points of all hits
 * lie without gaps at the start of the arrays (`receivers`), ready for a query; `slots` gives the
 * index of a sub-sample's point.
 */
#include "study/camera.h"
#include "study/study_scene.h"

#define UMBT_SKY    UINT32_MAX        /* no receiver */
#define UMBT_GROUND (UINT32_MAX - 1U) /* in place of a triangle: the plane of struct umbt_ground */

/* A level opaque plane below a scene, which cameras see and which casts nothing. */
struct umbt_ground {
    int wanted;      /* 0: there is none */
    int axis;        /* the up axis: 1 or 2 */
    double height;   /* Coordinate of the ground along the axis, metres */
    double extent_m; /* greatest distance of its points from the eye */
};

struct umbt_gbuffer {
    uint32_t width, aa; /* pixels a row; aa * aa sub-samples a pixel */
    uint32_t first_row, row_count;
    struct umbt_ground ground; /* set by the caller between init and fill */
    size_t samples_max;        /* size of slots */
    size_t capacity;           /* size of the receivers' arrays, which grow */
    size_t seen_count;         /* number of sub-samples of the band that see a receiver */
    size_t receiver_count;     /* number of receivers of the band: opaque ones, then translucent */
    /* [row_count * width * aa * aa] number of the nearest receiver, or UMBT_SKY */
    uint32_t *slots;
    double (*positions)[3]; /* [receiver_count], world space */
    float (*normals)[3];    /* [receiver_count], unit */
    uint32_t *triangles;    /* [receiver_count] number of the triangle, or UMBT_GROUND */
    /* Translucent receivers of the band: all from number `first_layer` on. */
    size_t first_layer;
    float *opacities; /* [receiver_count - first_layer] share of the light from behind that the
                         receiver hides */
    uint32_t *behind; /* [receiver_count - first_layer] number of the next receiver, or UMBT_SKY */
    size_t layer_capacity;
};

/* Returns the share that a receiver hides of what lies behind it; 1: it is opaque. */
static inline double umbt_gbuffer_opacity(const struct umbt_gbuffer *buffer, uint32_t receiver)
{
    return receiver < buffer->first_layer
               ? 1.0
               : (double)buffer->opacities[receiver - buffer->first_layer];
}

/* Returns the receiver behind one, or UMBT_SKY. */
static inline uint32_t umbt_gbuffer_behind(const struct umbt_gbuffer *buffer, uint32_t receiver)
{
    return receiver < buffer->first_layer ? UMBT_SKY
                                          : buffer->behind[receiver - buffer->first_layer];
}

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

/*
 * Adds the translucent surfaces before the opaque receivers of a filled band, as receivers.
 * umbt_gbuffer_fill calls it.
 *
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbt_gbuffer_add_layers(struct umbt_gbuffer *buffer,
                                                    const struct umbt_scene *scene,
                                                    const struct umbt_camera *camera,
                                                    uint32_t height, double far_m, unsigned threads,
                                                    struct umb_error *error);

/* Computes the direction of a sub-sample of the band, by its index in slots. */
void umbt_gbuffer_direction(const struct umbt_gbuffer *buffer, const struct umbt_camera *camera,
                            uint32_t height, size_t index, double direction[3]);

/* Makes and fills a buffer for a picture of size[0] x size[1] pixels, with one sample a pixel.
 * Fails: E_NO_MEMORY, E_ARGUMENT (the camera sees nothing). */
UMB_CHECKED enum umb_status umbt_gbuffer_view(struct umbt_gbuffer *buffer,
                                              const struct umbt_scene *scene,
                                              const struct umbt_camera *camera,
                                              const uint32_t size[2], unsigned threads,
                                              struct umb_error *error);

#endif
