/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The up axis from the shape of a scene: map coordinates, a ground, the largest flat faces, a flat
 * extent, a base on zero, an open underside. Each test speaks for y, for z, or not at all. The
 * first two decide alone. Otherwise the axis is known if some test speaks for it and none for the
 * other.
 */
#include <math.h>

#include "bake/import/up_axis.h"

#define FLAT_COSINE 0.9998 /* least cosine between a flat face's normal and the axis: 1.1 degrees */
#define LAYERS      256U   /* parts of the extent in which flat faces count as one plane */

/* Sums over the triangles, by axis. */
struct shape {
    double low[3], extent[3];
    double area;              /* of all triangles */
    double signed_area[3];    /* of the projections along the axis, by the side that is seen */
    double projected[3];      /* of the projections, of both sides */
    double flat[3];           /* of the faces across the axis */
    double layers[3][LAYERS]; /* the same by their place along the axis */
};

static const double *corner_of(const struct umbs_scene_builder *scene, size_t triangle, size_t k)
{
    const uint32_t(*triangles)[3] = scene->triangles.data;
    const double(*positions)[3] = scene->positions.data;
    return positions[triangles[triangle][k]];
}

static void measure_bounds(const struct umbs_scene_builder *scene, struct shape *shape)
{
    double high[3];
    for (int axis = 0; axis < 3; axis++) {
        shape->low[axis] = INFINITY;
        high[axis] = -INFINITY;
    }
    for (size_t i = 0; i < 3 * scene->triangles.count; i++) {
        const double *corner = corner_of(scene, i / 3, i % 3);
        for (int axis = 0; axis < 3; axis++) {
            shape->low[axis] = fmin(shape->low[axis], corner[axis]);
            high[axis] = fmax(high[axis], corner[axis]);
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        shape->extent[axis] = high[axis] - shape->low[axis];
    }
}

/* Adds a face across an axis to its layer. */
static void add_flat(struct shape *shape, int axis, double at, double area)
{
    const double extent = shape->extent[axis];
    const double share = extent > 0.0 ? (at - shape->low[axis]) / extent : 1.0;
    const double layer = share * LAYERS;
    shape->flat[axis] += area;
    shape->layers[axis][layer < LAYERS - 1U ? (size_t)layer : LAYERS - 1U] += area; /* NaN: last */
}

static void measure_areas(const struct umbs_scene_builder *scene, struct shape *shape)
{
    for (size_t i = 0; i < scene->triangles.count; i++) {
        const double *a = corner_of(scene, i, 0), *b = corner_of(scene, i, 1);
        const double *c = corner_of(scene, i, 2);
        double cross[3];
        for (int axis = 0; axis < 3; axis++) {
            const int y = (axis + 1) % 3, z = (axis + 2) % 3;
            cross[axis] = 0.5 * ((b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y]));
        }
        const double area = sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]);
        shape->area += area;
        for (int axis = 0; axis < 3; axis++) {
            shape->signed_area[axis] += cross[axis];
            shape->projected[axis] += fabs(cross[axis]);
            if (area > 0.0 && fabs(cross[axis]) >= FLAT_COSINE * area) {
                add_flat(shape, axis, (a[axis] + b[axis] + c[axis]) / 3.0, area);
            }
        }
    }
}

/* The other axis of y and z. */
static int other_of(int axis)
{
    return 3 - axis;
}

/* Coordinates of a map: two large ones that hardly change, and heights. */
static int has_map_coordinates(const struct shape *shape, int axis)
{
    const int other = other_of(axis);
    const double across = fmax(shape->extent[0], shape->extent[other]);
    return fabs(shape->low[0]) > fmax(20.0 * across, 1e4) &&
           fabs(shape->low[other]) > fmax(20.0 * across, 1e4) && fabs(shape->low[axis]) < 9000.0 &&
           shape->extent[axis] < 9000.0;
}

/* The lesser of the extents across an axis. */
static double width_of(const struct shape *shape, int axis)
{
    return fmin(shape->extent[0], shape->extent[other_of(axis)]);
}

/* Returns 1 if the scene is a ground with this axis up: nearly all its faces show one side along
 * the axis, and it is flat. */
static int is_ground(const struct shape *shape, int axis)
{
    return fabs(shape->signed_area[axis]) > 0.9 * shape->projected[axis] &&
           shape->extent[axis] <= 0.4 * width_of(shape, axis);
}

/* Returns 1 if the scene has floors and roofs across this axis: far more flat faces than across the
 * other axis, or a plane that is larger by half than any there. */
static int has_largest_flats(const struct shape *shape, int axis)
{
    double largest[3] = {0.0, 0.0, 0.0};
    for (int k = 1; k < 3; k++) {
        for (size_t i = 0; i < LAYERS; i++) {
            largest[k] = fmax(largest[k], shape->layers[k][i]);
        }
    }
    const int other = other_of(axis);
    return (shape->flat[axis] > 0.1 * shape->area &&
            shape->flat[axis] > 3.0 * shape->flat[other]) ||
           (largest[axis] > 0.05 * shape->area && largest[axis] > 1.5 * largest[other]);
}

static int is_flat(const struct shape *shape, int axis)
{
    return shape->extent[axis] <= 0.2 * width_of(shape, axis);
}

/* Returns 1 if the scene's lowest place on this axis is at zero, while it reaches to both sides of
 * zero on the other axis. */
static int stands_on_zero(const struct shape *shape, int axis)
{
    const int other = other_of(axis);
    const double share = shape->low[other] / shape->extent[other];
    return shape->extent[axis] > 0.0 && fabs(shape->low[axis]) <= 0.01 * shape->extent[axis] &&
           share > -0.8 && share < -0.2;
}

/* Returns 1 for a curved body with an opening at its lower end: the sum of its faces' normals, each
 * times its area, points up. */
static int is_open_below(const struct shape *shape, int axis)
{
    const double *sum = shape->signed_area;
    const int other = other_of(axis);
    const double across = shape->extent[0] * shape->extent[other];
    const double flat = shape->flat[0] + shape->flat[1] + shape->flat[2];
    return sum[axis] > 0.25 * across && sum[axis] < 0.6 * shape->projected[axis] &&
           fabs(sum[0]) < 0.1 * sum[axis] && fabs(sum[other]) < 0.1 * sum[axis] &&
           flat < 0.05 * shape->area;
}

/* The tests, the strongest first. */
static const struct {
    int (*speaks_for)(const struct shape *shape, int axis);
    enum umbs_up_evidence evidence;
    int decides; /* 1: later tests are not asked */
} tests[] = {
    {has_map_coordinates, UMBS_UP_MAP, 1}, {is_ground, UMBS_UP_GROUND, 1},
    {has_largest_flats, UMBS_UP_FLATS, 0}, {is_flat, UMBS_UP_EXTENT, 0},
    {stands_on_zero, UMBS_UP_BASE, 0},     {is_open_below, UMBS_UP_OPENING, 0},
};

enum umbb_up umbb_up_of_shape(const struct umbs_scene_builder *scene, uint32_t *evidence)
{
    struct shape shape = {.area = 0.0};
    int votes[3] = {0, 0, 0};
    measure_bounds(scene, &shape);
    measure_areas(scene, &shape);
    for (size_t i = 0; i < sizeof tests / sizeof tests[0]; i++) {
        const int y = tests[i].speaks_for(&shape, 1), z = tests[i].speaks_for(&shape, 2);
        if (y == z) {
            continue;
        }
        if (votes[1] + votes[2] == 0) {
            *evidence = tests[i].evidence;
        }
        votes[1] += y;
        votes[2] += z;
        if (tests[i].decides) {
            break;
        }
    }
    if ((votes[1] > 0) == (votes[2] > 0)) {
        return UMBB_UP_UNKNOWN;
    }
    return votes[2] > 0 ? UMBB_UP_IS_Z : UMBB_UP_IS_Y;
}
