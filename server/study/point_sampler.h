/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_POINT_SAMPLER_H
#define UMBRAGE_SERVER_STUDY_POINT_SAMPLER_H
/*
 * Query points of a scene, for load tests, demonstrations and benchmarks.
 *
 *   surface  uniform over the area of all triangles, without what lies inside a closed part
 *            (invisible, and answers there are unspecified)
 *   near     off such a surface point along its normal by up to `reach_m`, outside closed parts
 *   free     uniform in the scene's box, outside closed parts
 *   view     points that the pixels of a camera see, in scan order
 *
 * Random points are made from numbered candidates, each with random numbers of its own (SplitMix64
 * of the seed and the number), and taken in the order of their numbers: the same seed gives the
 * same points for every number of threads.
 */
#include "study/camera.h"
#include "study/study_scene.h"

enum umbt_point_kind {
    UMBT_POINT_SURFACE = 0,
    UMBT_POINT_NEAR,
    UMBT_POINT_FREE,
    UMBT_POINT_VIEW, /* by umbt_points_of_pixels */
};

struct umbt_point_request {
    const struct umbt_scene *scene;
    enum umbt_point_kind kind;
    size_t count; /* number of points wanted, at least 1 */
    uint64_t seed;
    double reach_m;   /* near: > 0 */
    unsigned threads; /* 1..256 */
    int quiet;        /* no progress line */
};

struct umbt_point_set {
    size_t count;
    double (*positions)[3]; /* [count], world space, metres */
    float (*normals)[3];    /* [count], unit; zero for free points, the surface's for near ones */
    uint64_t candidates;    /* candidates tried: random points, or pixels */
};

/*
 * Makes random points.
 *
 * Out:   set: finish with umbt_point_set_finish.
 * Fails: E_NO_MEMORY; E_BAD_SCENE (no area, or hardly any candidate lies outside closed parts:
 *        fewer than one in 1000 of a million).
 */
UMB_CHECKED enum umb_status umbt_points_sample(const struct umbt_point_request *request,
                                               struct umbt_point_set *set, struct umb_error *error);

/* A picture whose visible pixels become points. */
struct umbt_pixel_request {
    const struct umbt_scene *scene;
    const struct umbt_camera_request *camera;
    const struct umbt_camera_subject *subject;
    uint32_t size[2]; /* width and height of the first picture; a larger one keeps its shape */
    size_t count;     /* number of points wanted; 0 = every pixel that sees the scene */
    unsigned threads;
};

/*
 * Makes the points that a camera sees, with normals towards the camera. With a count, the picture
 * grows until it has enough points, and every k-th in scan order is taken.
 *
 * Fails: E_NO_MEMORY; E_ARGUMENT (the camera sees nothing, stands inside a closed part, or sees so
 *        little that the picture would be above 16384 pixels a side).
 */
UMB_CHECKED enum umb_status umbt_points_of_pixels(const struct umbt_pixel_request *view,
                                                  struct umbt_point_set *set,
                                                  struct umb_error *error);

void umbt_point_set_finish(struct umbt_point_set *set); /* a zeroed struct is allowed */

/*
 * Returns 1 if a point lies inside a closed part, by the crossings of one ray. away: for a point on
 * a surface the normal, to whose side the ray points; else NULL.
 */
int umbt_point_is_inside(const struct umbt_scene *scene, const double point[3], const double *away);

/*
 * Point files for `umbrage query --points`: raw little-endian floats or doubles, three for a point
 * or six with the normal, or text with a point a line.
 */
enum umbt_point_file_format {
    UMBT_POINT_FILE_F32 = 0,
    UMBT_POINT_FILE_F64,
    UMBT_POINT_FILE_TEXT, /* %.17g, normals %.9g: reading gives the same bits */
};

struct umbt_point_file {
    const char *path; /* "-" is stdout */
    enum umbt_point_file_format format;
    int normals;      /* 1: write normals too */
    double origin[3]; /* subtracted from every position */
};

/*
 * Writes a set; the file is replaced as a whole or stays as it was.
 *
 * Out:   bytes: size of the file.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbt_point_file_write(const struct umbt_point_file *file,
                                                  const struct umbt_point_set *set, uint64_t *bytes,
                                                  struct umb_error *error);

#endif
