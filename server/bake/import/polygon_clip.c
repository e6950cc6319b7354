/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ear clipping (polygon_clip.h) in the plane of the polygon's Newell normal, by dropping the axis
 * that the normal is nearest to. Coordinates are taken relative to the first corner, so that
 * national grids cost no digits.
 *
 * It ends on any input: when a whole round finds no ear, the rule is relaxed by one step, and the
 * last rule takes any corner. Each ear shortens the ring by one.
 */
#include "bake/import/polygon_clip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What counts as an ear; later rules are for polygons that are not simple. */
enum ear_rule {
    EAR_CLEAR = 0, /* strictly convex, no other corner in or on the triangle */
    EAR_OPEN,      /* strictly convex, no other corner strictly inside */
    EAR_CONVEX,    /* strictly convex */
    EAR_ANY,
};

enum umb_status umbb_polygon_reserve(struct umbb_polygon *polygon, size_t corners,
                                     struct umb_error *error)
{
    if (corners <= polygon->capacity) {
        return UMB_OK;
    }
    if (corners > UMBB_POLYGON_CORNERS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "a face has %zu corners, limit %u", corners,
                        UMBB_POLYGON_CORNERS_MAX);
    }
    umbb_polygon_finish(polygon);
    size_t capacity = corners + corners / 2 + 8;
    polygon->points = malloc(capacity * sizeof(*polygon->points));
    polygon->flat = malloc(capacity * sizeof(*polygon->flat));
    polygon->previous = malloc(capacity * sizeof(*polygon->previous));
    polygon->next = malloc(capacity * sizeof(*polygon->next));
    polygon->reflex = malloc(capacity);
    polygon->triangles = malloc(capacity * sizeof(*polygon->triangles));
    if (polygon->points == NULL || polygon->flat == NULL || polygon->previous == NULL ||
        polygon->next == NULL || polygon->reflex == NULL || polygon->triangles == NULL) {
        umbb_polygon_finish(polygon);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a face of %zu corners", corners);
    }
    polygon->capacity = capacity;
    return UMB_OK;
}

void umbb_polygon_finish(struct umbb_polygon *polygon)
{
    free(polygon->points);
    free(polygon->flat);
    free(polygon->previous);
    free(polygon->next);
    free(polygon->reflex);
    free(polygon->triangles);
    memset(polygon, 0, sizeof(*polygon));
}

/* Newell's normal: twice the area of the polygon's shadow on each coordinate plane. */
static void newell_normal(double (*points)[3], uint32_t count, double normal[3])
{
    const double *origin = points[0];
    normal[0] = normal[1] = normal[2] = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        const double *a = points[i];
        const double *b = points[i + 1 < count ? i + 1 : 0];
        for (int k = 0; k < 3; k++) {
            int u = (k + 1) % 3;
            int v = (k + 2) % 3;
            normal[k] += (a[u] - origin[u]) * (b[v] - origin[v]) -
                         (a[v] - origin[v]) * (b[u] - origin[u]);
        }
    }
}

/* Flattens so that the polygon runs counter-clockwise. Returns 0 if it has no area. */
static int flatten(struct umbb_polygon *polygon, uint32_t count)
{
    double normal[3];
    newell_normal(polygon->points, count, normal);
    int axis = 0;
    for (int k = 1; k < 3; k++) {
        if (fabs(normal[k]) > fabs(normal[axis])) {
            axis = k;
        }
    }
    if (!(fabs(normal[axis]) > 0.0)) {
        return 0;
    }
    int u = normal[axis] > 0.0 ? (axis + 1) % 3 : (axis + 2) % 3;
    int v = normal[axis] > 0.0 ? (axis + 2) % 3 : (axis + 1) % 3;
    for (uint32_t i = 0; i < count; i++) {
        polygon->flat[i][0] = polygon->points[i][u] - polygon->points[0][u];
        polygon->flat[i][1] = polygon->points[i][v] - polygon->points[0][v];
    }
    return 1;
}

/* Twice the signed area of a, b, c: positive if they turn left. */
static double turn(const double a[2], const double b[2], const double c[2])
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static double corner_turn(const struct umbb_polygon *polygon, uint32_t corner)
{
    return turn(polygon->flat[polygon->previous[corner]], polygon->flat[corner],
                polygon->flat[polygon->next[corner]]);
}

static int same_point(const double a[2], const double b[2])
{
    return a[0] == b[0] && a[1] == b[1];
}

/* Whether another corner of the ring stops this one from being an ear. */
static int is_blocked(const struct umbb_polygon *polygon, uint32_t corner, enum ear_rule rule)
{
    uint32_t before = polygon->previous[corner];
    uint32_t after = polygon->next[corner];
    const double *a = polygon->flat[before];
    const double *b = polygon->flat[corner];
    const double *c = polygon->flat[after];
    double low_x = fmin(fmin(a[0], b[0]), c[0]);
    double high_x = fmax(fmax(a[0], b[0]), c[0]);
    double low_y = fmin(fmin(a[1], b[1]), c[1]);
    double high_y = fmax(fmax(a[1], b[1]), c[1]);
    for (uint32_t i = polygon->next[after]; i != before; i = polygon->next[i]) {
        const double *p = polygon->flat[i];
        /* Only a corner that is not strictly convex can be the first inside. */
        if (!polygon->reflex[i] || p[0] < low_x || p[0] > high_x || p[1] < low_y ||
            p[1] > high_y || same_point(p, a) || same_point(p, b) || same_point(p, c)) {
            continue;
        }
        double ab = turn(a, b, p);
        double bc = turn(b, c, p);
        double ca = turn(c, a, p);
        if (rule == EAR_CLEAR ? ab >= 0 && bc >= 0 && ca >= 0 : ab > 0 && bc > 0 && ca > 0) {
            return 1;
        }
    }
    return 0;
}

static int is_ear(const struct umbb_polygon *polygon, uint32_t corner, enum ear_rule rule)
{
    if (rule == EAR_ANY) {
        return 1;
    }
    if (polygon->reflex[corner]) {
        return 0;
    }
    return rule == EAR_CONVEX || !is_blocked(polygon, corner, rule);
}

static void emit(struct umbb_polygon *polygon, uint32_t at, uint32_t a, uint32_t b, uint32_t c)
{
    polygon->triangles[at][0] = a;
    polygon->triangles[at][1] = b;
    polygon->triangles[at][2] = c;
}

static void fan(struct umbb_polygon *polygon, uint32_t count)
{
    for (uint32_t i = 0; i + 2 < count; i++) {
        emit(polygon, i, 0, i + 1, i + 2);
    }
}

static void clip_ears(struct umbb_polygon *polygon, uint32_t count)
{
    uint32_t left = count;
    uint32_t corner = 0;
    uint32_t misses = 0;
    int rule = EAR_CLEAR;
    uint32_t made = 0;
    while (left > 3) {
        if (!is_ear(polygon, corner, (enum ear_rule)rule)) {
            corner = polygon->next[corner];
            if (++misses >= left) {
                misses = 0;
                rule++;
            }
            continue;
        }
        uint32_t before = polygon->previous[corner];
        uint32_t after = polygon->next[corner];
        emit(polygon, made++, before, corner, after);
        polygon->next[before] = after;
        polygon->previous[after] = before;
        polygon->reflex[before] = !(corner_turn(polygon, before) > 0.0);
        polygon->reflex[after] = !(corner_turn(polygon, after) > 0.0);
        left--;
        misses = 0;
        rule = EAR_CLEAR;
        /* Going on behind the next corner spreads the cuts: fewer needles than a fan. */
        corner = polygon->next[after];
    }
    emit(polygon, made, polygon->previous[corner], corner, polygon->next[corner]);
}

void umbb_polygon_triangulate(struct umbb_polygon *polygon, uint32_t count)
{
    if (count == 3 || !flatten(polygon, count)) {
        fan(polygon, count);
        return;
    }
    uint32_t reflex_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        polygon->previous[i] = i > 0 ? i - 1 : count - 1;
        polygon->next[i] = i + 1 < count ? i + 1 : 0;
    }
    for (uint32_t i = 0; i < count; i++) {
        polygon->reflex[i] = !(corner_turn(polygon, i) > 0.0);
        reflex_count += polygon->reflex[i];
    }
    if (count == 4 && reflex_count == 0) {
        fan(polygon, count);
        return;
    }
    clip_ears(polygon, count);
}
