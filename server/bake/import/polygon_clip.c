/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ear clipping (polygon_clip.h) in a coordinate plane: the axis nearest to the polygon's Newell
 * normal is dropped. Coordinates are relative to the first corner, so large offsets, as of national
 * grids, cost no precision.
 *
 * Ears wait in a queue. Cutting one off re-examines only its two neighbours, because in a simple
 * polygon no other corner can become an ear by it. The queue also spreads the cuts over the
 * polygon, which makes fewer needles than a fan.
 *
 * Only a corner that is not strictly convex can be the first inside an ear, so only such corners
 * are in the grid. An ear is tested against the cells under its bounding box. A corner that has
 * become convex or was cut off leaves its cell at the next visit to the cell.
 *
 * The clipping ends on any input: each ear shortens the ring by one corner. When no ear is left,
 * the rule is relaxed step by step, and the last rule takes any corner. Polygons that are not
 * simple need many such searches. When the budget of tests is used up, the rest becomes a fan.
 */
#include "bake/import/polygon_clip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Rules for an ear; the later ones are for polygons that are not simple. */
enum ear_rule {
    EAR_CLEAR = 0, /* strictly convex, no other corner in or on the triangle */
    EAR_OPEN,      /* strictly convex, no other corner strictly inside */
    EAR_CONVEX,    /* strictly convex */
};

enum corner_flag {
    CORNER_REFLEX = 1, /* or straight: not strictly convex */
    CORNER_EAR = 2,
    CORNER_QUEUED = 4,
    /* A neighbour was cut off since the corner was queued: the corner goes to the queue's end. */
    CORNER_AGAIN = 8,
    CORNER_IN_CELL = 16,
};

#define ALLOWANCE 128U         /* number of tests for each corner; a rough coast needs 67 */
#define POOL      (1ULL << 26) /* number of further tests for all polygons together */
#define NO_CORNER UINT32_MAX

enum umb_status umbb_polygon_reserve(struct umbb_polygon *polygon, size_t corners,
                                     struct umb_error *error)
{
    struct umbb_polygon *p = polygon;
    if (corners <= p->capacity) {
        return UMB_OK;
    }
    if (corners > UMBB_POLYGON_CORNERS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "a face has %zu corners, limit %u", corners,
                        UMBB_POLYGON_CORNERS_MAX);
    }
    const size_t n = corners + corners / 2 + 8;
    free(p->points);
    p->capacity = 0;
    /* One block: the widest items first, so that each array is aligned. */
    p->points = malloc(n * (sizeof *p->points + sizeof *p->flat + sizeof *p->triangles +
                            5 * sizeof *p->next + sizeof *p->flags));
    if (p->points == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a face of %zu corners", corners);
    }
    p->flat = (void *)(p->points + n);
    p->triangles = (void *)(p->flat + n);
    p->previous = (void *)(p->triangles + n);
    p->next = p->previous + n;
    p->queue = p->next + n;
    p->cells = p->queue + n;
    p->cell_next = p->cells + n;
    p->flags = (void *)(p->cell_next + n);
    p->capacity = n;
    return UMB_OK;
}

void umbb_polygon_finish(struct umbb_polygon *polygon)
{
    free(polygon->points);
    memset(polygon, 0, sizeof(*polygon));
}

/* Computes Newell's normal: twice the area of the polygon's projection on each coordinate plane. */
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

/* Projects so that the polygon runs counter-clockwise. Returns 0 if it has no area. */
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

/* The row or column of cells that contains a coordinate. */
static uint32_t cell_at(const struct umbb_polygon *polygon, double value, int axis)
{
    double at = (value - polygon->low[axis]) / polygon->extent[axis] * polygon->side;
    return at >= polygon->side ? polygon->side - 1 : (uint32_t)at;
}

/* Puts a corner into its cell, unless it is still there. */
static void put_in_cell(struct umbb_polygon *polygon, uint32_t corner)
{
    if (!(polygon->flags[corner] & CORNER_IN_CELL)) {
        const double *at = polygon->flat[corner];
        uint32_t *cell = &polygon->cells[(size_t)cell_at(polygon, at[1], 1) * polygon->side +
                                         cell_at(polygon, at[0], 0)];
        polygon->cell_next[corner] = *cell;
        *cell = corner;
        polygon->flags[corner] |= CORNER_IN_CELL;
    }
}

/* Builds the grid: about two corners a cell; never more cells than corners. The polygon has an
 * area, so neither extent is 0. */
static void build_grid(struct umbb_polygon *polygon, uint32_t count)
{
    polygon->side = 1;
    while (2 * (polygon->side + 1) * (polygon->side + 1) <= count) {
        polygon->side++;
    }
    for (uint32_t i = 0; i < polygon->side * polygon->side; i++) {
        polygon->cells[i] = NO_CORNER;
    }
    for (int axis = 0; axis < 2; axis++) {
        double low = polygon->flat[0][axis];
        double high = low;
        for (uint32_t i = 1; i < count; i++) {
            low = fmin(low, polygon->flat[i][axis]);
            high = fmax(high, polygon->flat[i][axis]);
        }
        polygon->low[axis] = low;
        polygon->extent[axis] = high - low;
    }
}

static void spend(struct umbb_polygon *polygon)
{
    polygon->budget -= polygon->budget > 0;
}

/* Returns 1 if point p keeps a triangle, whose corners turn left, from being an ear. */
static int is_inside(const double *const triangle[3], const double *p, enum ear_rule rule)
{
    if (same_point(p, triangle[0]) || same_point(p, triangle[1]) || same_point(p, triangle[2])) {
        return 0;
    }
    double ab = turn(triangle[0], triangle[1], p);
    double bc = turn(triangle[1], triangle[2], p);
    double ca = turn(triangle[2], triangle[0], p);
    return rule == EAR_CLEAR ? ab >= 0 && bc >= 0 && ca >= 0 : ab > 0 && bc > 0 && ca > 0;
}

/* Tests the corners of one cell against a triangle, and takes convex corners out of the cell. */
static int is_blocked_in_cell(struct umbb_polygon *polygon, uint32_t *cell,
                              const double *const triangle[3], enum ear_rule rule)
{
    spend(polygon);
    while (*cell != NO_CORNER) {
        uint32_t corner = *cell;
        spend(polygon);
        if (!(polygon->flags[corner] & CORNER_REFLEX)) {
            polygon->flags[corner] &= (uint8_t)~CORNER_IN_CELL;
            *cell = polygon->cell_next[corner];
            continue;
        }
        if (is_inside(triangle, polygon->flat[corner], rule)) {
            return 1;
        }
        cell = &polygon->cell_next[corner];
    }
    return 0;
}

/* Returns 1 if another corner of the ring keeps this one from being an ear. */
static int is_blocked(struct umbb_polygon *polygon, uint32_t corner, enum ear_rule rule)
{
    const double *const ear[3] = {polygon->flat[polygon->previous[corner]], polygon->flat[corner],
                                  polygon->flat[polygon->next[corner]]};
    uint32_t first[2], last[2];
    for (int axis = 0; axis < 2; axis++) {
        const double a = ear[0][axis], b = ear[1][axis], c = ear[2][axis];
        first[axis] = cell_at(polygon, fmin(fmin(a, b), c), axis);
        last[axis] = cell_at(polygon, fmax(fmax(a, b), c), axis);
    }
    for (uint32_t row = first[1]; row <= last[1]; row++) {
        for (uint32_t column = first[0]; column <= last[0]; column++) {
            uint32_t *cell = &polygon->cells[(size_t)row * polygon->side + column];
            if (is_blocked_in_cell(polygon, cell, ear, rule)) {
                return 1;
            }
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

/* Appends a corner to the queue. Each corner is there at most once, so `capacity` slots are
 * enough. */
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

/* Finds out anew whether a corner is reflex or an ear. */
static void examine(struct umbb_polygon *polygon, uint32_t corner)
{
    uint8_t *flags = &polygon->flags[corner];
    *flags = (uint8_t)((*flags & (CORNER_QUEUED | CORNER_IN_CELL)) | CORNER_AGAIN);
    if (!(corner_turn(polygon, corner) > 0.0)) {
        *flags |= CORNER_REFLEX;
        put_in_cell(polygon, corner);
    } else if (polygon->budget > 0 && is_ear(polygon, corner, EAR_CLEAR)) {
        *flags |= CORNER_EAR;
        if (!(*flags & CORNER_QUEUED)) {
            enqueue(polygon, corner);
        }
    }
}

/* The next ear in the queue, or NO_CORNER. */
static uint32_t next_queued_ear(struct umbb_polygon *polygon)
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
    return NO_CORNER;
}

/* Returns the next corner to cut off; any corner if there is no ear; NO_CORNER if the budget is
 * used up. `start` is in the ring, which has `left` corners. */
static uint32_t choose_ear(struct umbb_polygon *polygon, uint32_t start, uint32_t left)
{
    uint32_t corner = next_queued_ear(polygon);
    if (corner != NO_CORNER) {
        return corner;
    }
    for (int rule = EAR_OPEN; rule <= EAR_CONVEX; rule++) {
        for (uint32_t i = 0; i < left; i++, start = polygon->next[start]) {
            spend(polygon);
            if (polygon->budget == 0) {
                return NO_CORNER;
            }
            if (is_ear(polygon, start, (enum ear_rule)rule)) {
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

/* Cuts the ring of `left` corners from `start` on into a fan. */
static void fan_ring(struct umbb_polygon *polygon, uint32_t at, uint32_t start, uint32_t left)
{
    uint32_t corner = polygon->next[start];
    for (; left > 2; left--, corner = polygon->next[corner]) {
        emit(polygon, at++, start, corner, polygon->next[corner]);
    }
}

static void clip_ears(struct umbb_polygon *polygon, uint32_t count)
{
    uint32_t start = 0;
    uint32_t made = 0;
    uint32_t left = count;
    polygon->queue_first = polygon->queue_count = 0;
    build_grid(polygon, count);
    for (uint32_t i = 0; i < count; i++) {
        if (polygon->flags[i] & CORNER_REFLEX) {
            put_in_cell(polygon, i);
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        examine(polygon, i);
        polygon->flags[i] &= (uint8_t)~CORNER_AGAIN;
    }
    for (; left > 3; left--) {
        uint32_t corner = choose_ear(polygon, start, left);
        if (corner == NO_CORNER) {
            polygon->rough += polygon->rough < UINT32_MAX;
            break;
        }
        uint32_t before = polygon->previous[corner];
        uint32_t after = polygon->next[corner];
        emit(polygon, made++, before, corner, after);
        polygon->flags[corner] &= (uint8_t) ~(CORNER_EAR | CORNER_REFLEX);
        polygon->next[before] = after;
        polygon->previous[after] = before;
        examine(polygon, before);
        examine(polygon, after);
        start = after;
    }
    fan_ring(polygon, made, polygon->previous[start], left);
}

/* Clips within a budget: the polygon's own allowance, and the rest of the pool that all polygons
 * share. Steps beyond the allowance are subtracted from the pool. */
static void clip_within_budget(struct umbb_polygon *polygon, uint32_t count)
{
    uint64_t allowance = (uint64_t)ALLOWANCE * count;
    uint64_t pool = polygon->overdrawn < POOL ? POOL - polygon->overdrawn : 0;
    polygon->budget = allowance + pool;
    clip_ears(polygon, count);
    uint64_t used = allowance + pool - polygon->budget;
    polygon->overdrawn += used > allowance ? used - allowance : 0;
}

void umbb_polygon_triangulate(struct umbb_polygon *polygon, uint32_t count)
{
    uint32_t reflex_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        polygon->previous[i] = i > 0 ? i - 1 : count - 1;
        polygon->next[i] = i + 1 < count ? i + 1 : 0;
    }
    const int has_area = count > 3 && flatten(polygon, count);
    for (uint32_t i = 0; has_area && i < count; i++) {
        polygon->flags[i] = corner_turn(polygon, i) > 0.0 ? 0 : CORNER_REFLEX;
        reflex_count += polygon->flags[i] != 0;
    }
    if (!has_area || (count == 4 && reflex_count == 0)) {
        fan_ring(polygon, 0, 0, count);
        return;
    }
    clip_within_budget(polygon, count);
}
