/* SPDX-License-Identifier: Apache-2.0 */
/* Depths by brute force: see oracle_depth.h. */
#include "oracle_depth.h"

#include <math.h>
#include <stdlib.h>

struct oracle_caster {
    long double at[3][3]; /* corner: X, Y, W */
    long double z[3];     /* of the corners, in voxels */
    long double line[3]
                    [3]; /* edge k, from corner k to k + 1: a x + b y + c, times W of both ends */
    int ends[3];         /* 1 if both corners of edge k lie before the light: a segment */
    uint32_t row_low, row_high, x_low, x_high; /* texels its box may touch; low > high: none */
    uint8_t closed, front;
};

/* The surfaces that the light meets at one texel; infinite where there is none. */
struct oracle_hits {
    long double first, front, back;
    int tie;
};

static long double determinant(const double *m)
{
    const long double a = m[0], b = m[1], c = m[2], d = m[4], e = m[5], f = m[6];
    const long double g = m[8], h = m[9], i = m[10];
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
}

static void to_voxels(const struct oracle_view *view, const double world[3], long double out[4])
{
    for (int r = 0; r < 4; r++) {
        out[r] = view->m[4 * r + 3];
        for (int k = 0; k < 3; k++) {
            out[r] += (long double)view->m[4 * r + k] *
                      ((long double)world[k] - (long double)view->origin[k]);
        }
    }
}

static void cross(const long double a[3], const long double b[3], long double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    }
}

/* Finds the texels whose centre lies in [low, high], widened by the tie distance. Returns 0 if
 * there is none. */
static int texel_range(long double low, long double high, uint32_t side, uint32_t range[2])
{
    long double first = ceill(low - 0.5L - ORACLE_TIE);
    long double last = floorl(high - 0.5L + ORACLE_TIE);
    first = first < 0.0L ? 0.0L : first;
    last = last > (long double)side - 1.0L ? (long double)side - 1.0L : last;
    if (!(first <= last)) {
        range[0] = 1;
        range[1] = 0;
        return 0;
    }
    range[0] = (uint32_t)first;
    range[1] = (uint32_t)last;
    return 1;
}

static long double least(long double a, long double b, long double c)
{
    return fminl(a, fminl(b, c));
}

static long double greatest(long double a, long double b, long double c)
{
    return fmaxl(a, fmaxl(b, c));
}

/* Fills in the texels inside the box of the projected corners: all texels if a corner lies behind
 * the light, none if all three do. */
static void find_box(const struct oracle_view *view, struct oracle_caster *caster)
{
    uint32_t x[2] = {0, view->side - 1}, y[2] = {0, view->side - 1};
    long double px[3], py[3];
    int before = 0;
    for (int v = 0; v < 3; v++) {
        before += caster->at[v][2] > 0.0L;
        px[v] = caster->at[v][0] / caster->at[v][2];
        py[v] = caster->at[v][1] / caster->at[v][2];
    }
    int touches = before > 0;
    if (before == 3) {
        touches =
            texel_range(least(px[0], px[1], px[2]), greatest(px[0], px[1], px[2]), view->side, x) &
            texel_range(least(py[0], py[1], py[2]), greatest(py[0], py[1], py[2]), view->side, y);
    }
    caster->x_low = x[0];
    caster->x_high = x[1];
    caster->row_low = touches ? y[0] : 1;
    caster->row_high = touches ? y[1] : 0;
}

/* Returns 1 if the light meets the triangle's front. The corners then run the other way round in
 * light space, if that is right handed. */
static int is_front(const struct oracle_view *view, const struct oracle_caster *caster)
{
    const double rows[12] = {view->m[0], view->m[1], view->m[2],  0,
                             view->m[4], view->m[5], view->m[6],  0,
                             view->m[8], view->m[9], view->m[10], 0};
    long double normal[3];
    cross(caster->at[0], caster->at[1], normal);
    long double volume = 0.0L;
    for (int k = 0; k < 3; k++) {
        volume += normal[k] * caster->at[2][k];
    }
    return (volume < 0.0L) == (determinant(rows) > 0.0L);
}

static void project(const struct oracle_view *view, const struct oracle_scene *scene, size_t number,
                    struct oracle_caster *caster)
{
    for (int v = 0; v < 3; v++) {
        long double out[4];
        to_voxels(view, scene->vertices[scene->triangles[number][v]], out);
        caster->at[v][0] = out[0];
        caster->at[v][1] = out[1];
        caster->at[v][2] = out[3];
        caster->z[v] = out[2];
    }
    for (int k = 0; k < 3; k++) {
        const long double *from = caster->at[k], *to = caster->at[(k + 1) % 3];
        cross(from, to, caster->line[k]);
        caster->ends[k] = from[2] > 0.0L && to[2] > 0.0L;
    }
    caster->closed = scene->closed[number];
    caster->front = (uint8_t)is_front(view, caster);
    find_box(view, caster);
}

/* Lists the casters of each row: first counts them, then fills the lists. */
static int fill_rows(struct oracle_depth *depth, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        for (uint32_t y = depth->casters[i].row_low; y <= depth->casters[i].row_high; y++) {
            depth->row_first[y + 1]++;
        }
    }
    for (uint32_t y = 0; y < depth->side; y++) {
        depth->row_first[y + 1] += depth->row_first[y];
    }
    depth->row_items = calloc(depth->row_first[depth->side] + 1, sizeof *depth->row_items);
    size_t *next = calloc((size_t)depth->side + 1, sizeof *next);
    int good = depth->row_items != NULL && next != NULL;
    for (size_t i = 0; good && i < count; i++) {
        for (uint32_t y = depth->casters[i].row_low; y <= depth->casters[i].row_high; y++) {
            depth->row_items[depth->row_first[y] + next[y]++] = (uint32_t)i;
        }
    }
    free(next);
    return good;
}

int oracle_depth_init(struct oracle_depth *depth, const struct oracle_scene *scene,
                      const struct oracle_view *view)
{
    *depth = (struct oracle_depth){.side = view->side, .closed = view->closed};
    long double det = determinant(view->m);
    if (det == 0.0L || isnan(det)) {
        return 0;
    }
    depth->casters = calloc(scene->triangle_count + 1, sizeof *depth->casters);
    depth->row_first = calloc((size_t)view->side + 2, sizeof *depth->row_first);
    depth->hits = calloc(view->side, sizeof *depth->hits);
    if (depth->casters == NULL || depth->row_first == NULL || depth->hits == NULL) {
        return 0;
    }
    for (size_t i = 0; i < scene->triangle_count; i++) {
        project(view, scene, i, &depth->casters[i]);
    }
    return fill_rows(depth, scene->triangle_count);
}

/* Returns 1 if the centre lies within the tie distance of edge k. In: a centre that is that near to
 * the edge's line. */
static int is_beside(const struct oracle_caster *caster, int k, long double x, long double y)
{
    const long double *from = caster->at[k], *to = caster->at[(k + 1) % 3];
    if (!caster->ends[k]) {
        return from[2] > 0.0L ||
               to[2] > 0.0L; /* a half line: anywhere on its line is near enough */
    }
    long double x0 = from[0] / from[2], y0 = from[1] / from[2];
    long double dx = to[0] / to[2] - x0, dy = to[1] / to[2] - y0;
    long double length = hypotl(dx, dy);
    if (length <= ORACLE_TIE) {
        return hypotl(x - x0, y - y0) <= 2.0L * ORACLE_TIE;
    }
    long double along = dx * (x - x0) + dy * (y - y0); /* times length */
    return along >= -ORACLE_TIE * length && along <= (length + ORACLE_TIE) * length;
}

/*
 * The determinants of each edge and the texel's ray (x, y, 1): with (X, Y, W) = d (x, y, 1) inside
 * the triangle they have the sign of the triangle's own determinant, and are the weights of the
 * opposite corners. Returns 1 if the centre lies within the tie distance of an edge.
 */
static int edge_weights(const struct oracle_caster *caster, long double x, long double y,
                        long double weights[3])
{
    int tie = 0;
    for (int k = 0; k < 3; k++) {
        const long double *line = caster->line[k];
        weights[k] = line[0] * x + line[1] * y + line[2];
        if (fabsl(weights[k]) <= ORACLE_TIE * hypotl(line[0], line[1])) {
            tie |= is_beside(caster, k, x, y);
        }
    }
    return tie;
}

static void hit_texel(const struct oracle_caster *caster, uint32_t x, uint32_t y,
                      struct oracle_hits *hits)
{
    long double weights[3];
    if (edge_weights(caster, (long double)x + 0.5L, (long double)y + 0.5L, weights)) {
        hits->tie = 1;
        return;
    }
    int positive = weights[0] > 0.0L && weights[1] > 0.0L && weights[2] > 0.0L;
    int negative = weights[0] < 0.0L && weights[1] < 0.0L && weights[2] < 0.0L;
    if (!positive && !negative) {
        return;
    }
    /* Edge k faces corner k + 2. */
    const long double sum = weights[0] + weights[1] + weights[2];
    long double z = 0.0L, w = 0.0L;
    for (int k = 0; k < 3; k++) {
        z += weights[k] / sum * caster->z[(k + 2) % 3];
        w += weights[k] / sum * caster->at[(k + 2) % 3][2];
    }
    if (!(w > 0.0L)) {
        return; /* behind the light */
    }
    hits->first = fminl(hits->first, z);
    if (caster->closed && caster->front) {
        hits->front = fminl(hits->front, z);
    } else if (caster->closed) {
        hits->back = fminl(hits->back, z);
    }
}

/* Returns how many voxel centres of 0..side-1 lie before the depth; notes a tie. */
static uint32_t centres_before(long double z, uint32_t side, int *tie)
{
    if (isinf(z)) {
        return side;
    }
    long double from_centre = z - 0.5L;
    if (fabsl(from_centre - roundl(from_centre)) <= ORACLE_TIE) {
        *tie = 1;
    }
    long double count = ceill(from_centre);
    if (count <= 0.0L) {
        return 0;
    }
    return count >= (long double)side ? side : (uint32_t)count;
}

static struct oracle_texel texel_of(const struct oracle_hits *hits, uint32_t side, int closed)
{
    struct oracle_texel texel = {.tie = hits->tie};
    texel.lit = centres_before(hits->first, side, &texel.tie);
    texel.end = texel.lit;
    if (closed && !isinf(hits->front) && !isinf(hits->back) &&
        centres_before(hits->front, side, &texel.tie) == texel.lit) {
        uint32_t end = centres_before(hits->back, side, &texel.tie);
        texel.end = end > texel.lit ? end : texel.lit;
    }
    return texel;
}

void oracle_depth_row(struct oracle_depth *depth, uint32_t y, uint32_t step,
                      struct oracle_texel *row)
{
    for (uint32_t x = 0; x < depth->side; x += step) {
        depth->hits[x] =
            (struct oracle_hits){.first = INFINITY, .front = INFINITY, .back = INFINITY};
    }
    for (size_t i = depth->row_first[y]; i < depth->row_first[y + 1]; i++) {
        const struct oracle_caster *caster = &depth->casters[depth->row_items[i]];
        uint32_t start = (caster->x_low + step - 1) / step * step;
        for (uint32_t x = start; x <= caster->x_high; x += step) {
            hit_texel(caster, x, y, &depth->hits[x]);
        }
    }
    for (uint32_t x = 0; x < depth->side; x += step) {
        row[x] = texel_of(&depth->hits[x], depth->side, depth->closed);
    }
}

void oracle_depth_finish(struct oracle_depth *depth)
{
    free(depth->casters);
    free(depth->row_first);
    free(depth->row_items);
    free(depth->hits);
    *depth = (struct oracle_depth){0};
}
