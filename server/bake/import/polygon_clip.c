/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ear clipping (polygon_clip.h) in the plane of the polygon's Newell normal, by dropping the axis
 * that the normal is nearest to. Coordinates are taken relative to the first corner, so that
 * national grids cost no digits.
 *
 * Ears wait in a queue; cutting one off re-examines its two neighbours and nobody else, because in
 * a simple polygon no other corner can become an ear by it. The queue also spreads the cuts over
 * the polygon, which makes fewer needles than a fan.
 *
 * It ends on any input: when no ear is left, the rule is relaxed step by step, and the last rule
 * takes any corner. Each ear shortens the ring by one. Polygons that are not simple would need many
 * such searches; a budget of tests, which simple polygons never use up, keeps them quadratic.
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
};

enum corner_flag {
    CORNER_REFLEX = 1, /* or straight: not strictly convex */
    CORNER_EAR = 2,
    CORNER_QUEUED = 4,
    CORNER_AGAIN = 8, /* a neighbour was cut off since it was queued: to the end of the queue */
};

/* Tests a simple polygon of n corners needs at most: n^2 to find the first ears, and for each of n
 * cuts two times the n / 2 corners that the ring has on average. */
#define BUDGET_FACTOR 2U

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
    polygon->queue = malloc(capacity * sizeof(*polygon->queue));
    polygon->flags = malloc(capacity);
    polygon->triangles = malloc(capacity * sizeof(*polygon->triangles));
    if (polygon->points == NULL || polygon->flat == NULL || polygon->previous == NULL ||
        polygon->next == NULL || polygon->queue == NULL || polygon->flags == NULL ||
        polygon->triangles == NULL) {
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
    free(polygon->queue);
    free(polygon->flags);
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
            normal[k] +=
                (a[u] - origin[u]) * (b[v] - origin[v]) - (a[v] - origin[v]) * (b[u] - origin[u]);
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
static int is_blocked(struct umbb_polygon *polygon, uint32_t corner, enum ear_rule rule)
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
        polygon->budget -= polygon->budget > 0;
        /* Only a corner that is not strictly convex can be the first inside. */
        if (!(polygon->flags[i] & CORNER_REFLEX) || p[0] < low_x || p[0] > high_x || p[1] < low_y ||
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

static int is_ear(struct umbb_polygon *polygon, uint32_t corner, enum ear_rule rule)
{
    if (polygon->flags[corner] & CORNER_REFLEX) {
        return 0;
    }
    return rule == EAR_CONVEX || !is_blocked(polygon, corner, rule);
}

/* Each corner is in the queue at most once, so `capacity` slots are enough. */
static void enqueue(struct umbb_polygon *polygon, uint32_t corner)
{
    size_t at = polygon->queue_first + polygon->queue_count++;
    polygon->queue[at < polygon->capacity ? at : at - polygon->capacity] = corner;
    polygon->flags[corner] |= CORNER_QUEUED;
}

static uint32_t dequeue(struct umbb_polygon *polygon)
{
    uint32_t corner = polygon->queue[polygon->queue_first];
    polygon->queue_first =
        polygon->queue_first + 1 < polygon->capacity ? polygon->queue_first + 1 : 0;
    polygon->queue_count--;
    polygon->flags[corner] &= (uint8_t)~CORNER_QUEUED;
    return corner;
}

/* Finds out again what a corner is. */
static void examine(struct umbb_polygon *polygon, uint32_t corner)
{
    int reflex = !(corner_turn(polygon, corner) > 0.0);
    uint8_t *flags = &polygon->flags[corner];
    *flags = (uint8_t)((*flags & CORNER_QUEUED) | (reflex ? CORNER_REFLEX : 0) | CORNER_AGAIN);
    if (polygon->budget > 0 && is_ear(polygon, corner, EAR_CLEAR)) {
        *flags |= CORNER_EAR;
        if (!(*flags & CORNER_QUEUED)) {
            enqueue(polygon, corner);
        }
    }
}

/* The next corner to cut off, any at all if there is no ear; `start` is in the ring, which has
 * `left` corners. */
static uint32_t choose_ear(struct umbb_polygon *polygon, uint32_t start, uint32_t left)
{
    while (polygon->queue_count > 0) {
        uint32_t corner = dequeue(polygon);
        if (!(polygon->flags[corner] & CORNER_EAR)) {
            continue; /* no longer an ear, or cut off */
        }
        if (!(polygon->flags[corner] & CORNER_AGAIN)) {
            return corner;
        }
        polygon->flags[corner] &= (uint8_t)~CORNER_AGAIN;
        enqueue(polygon, corner);
    }
    for (int rule = EAR_OPEN; rule <= EAR_CONVEX; rule++) {
        for (uint32_t i = 0; i < left; i++, start = polygon->next[start]) {
            if ((polygon->budget > 0 || rule == EAR_CONVEX) &&
                is_ear(polygon, start, (enum ear_rule)rule)) {
                return start;
            }
        }
    }
    return start;
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
    uint32_t start = 0;
    uint32_t made = 0;
    polygon->budget = (uint64_t)BUDGET_FACTOR * count * count;
    polygon->queue_first = polygon->queue_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        examine(polygon, i);
        polygon->flags[i] &= (uint8_t)~CORNER_AGAIN;
    }
    for (uint32_t left = count; left > 3; left--) {
        uint32_t corner = choose_ear(polygon, start, left);
        uint32_t before = polygon->previous[corner];
        uint32_t after = polygon->next[corner];
        emit(polygon, made++, before, corner, after);
        polygon->flags[corner] &= (uint8_t)~CORNER_EAR;
        polygon->next[before] = after;
        polygon->previous[after] = before;
        examine(polygon, before);
        examine(polygon, after);
        start = after;
    }
    emit(polygon, made, polygon->previous[start], start, polygon->next[start]);
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
        polygon->flags[i] = corner_turn(polygon, i) > 0.0 ? 0 : CORNER_REFLEX;
        reflex_count += polygon->flags[i] != 0;
    }
    if (count == 4 && reflex_count == 0) {
        fan(polygon, count);
        return;
    }
    clip_ears(polygon, count);
}
