/* SPDX-License-Identifier: Apache-2.0 */
/* Which parts of a scene are closed outward solids: see oracle_scene_find_closed. */
#include "oracle_scene.h"

#include <stdlib.h>
#include <string.h>

struct corner {
    double at[3];
    uint32_t vertex;
};

/* An edge between two positions, low < high; way: +1 if its triangle runs from low to high. */
struct edge {
    uint32_t low, high, triangle;
    int32_t way;
};

struct work {
    const struct oracle_scene *scene;
    uint32_t *position; /* a vertex: number of its position */
    struct corner *corners;
    struct edge *edges;
    size_t edge_count;
    uint32_t *parent; /* union-find over triangles */
    uint8_t *open; /* a part, by its first triangle: it has an edge that no two triangles share */
    long double *volume; /* a part: six times */
};

static int compare_corners(const void *a, const void *b)
{
    const struct corner *x = a, *y = b;
    for (int k = 0; k < 3; k++) {
        if (x->at[k] != y->at[k]) {
            return x->at[k] < y->at[k] ? -1 : 1;
        }
    }
    return 0;
}

static int compare_edges(const void *a, const void *b)
{
    const struct edge *x = a, *y = b;
    if (x->low != y->low) {
        return x->low < y->low ? -1 : 1;
    }
    if (x->high != y->high) {
        return x->high < y->high ? -1 : 1;
    }
    return 0;
}

static void number_positions(const struct work *work)
{
    size_t count = work->scene->vertex_count;
    for (size_t i = 0; i < count; i++) {
        memcpy(work->corners[i].at, work->scene->vertices[i], sizeof work->corners[i].at);
        work->corners[i].vertex = (uint32_t)i;
    }
    qsort(work->corners, count, sizeof *work->corners, compare_corners);
    uint32_t number = 0;
    for (size_t i = 0; i < count; i++) {
        if (i > 0 && compare_corners(&work->corners[i - 1], &work->corners[i]) != 0) {
            number++;
        }
        work->position[work->corners[i].vertex] = number;
    }
}

/* 1 if the triangle has no area in doubles: it belongs to no part. */
static int is_degenerate(const struct oracle_scene *scene, size_t triangle)
{
    const uint32_t *v = scene->triangles[triangle];
    double a[3], b[3];
    for (int k = 0; k < 3; k++) {
        a[k] = scene->vertices[v[1]][k] - scene->vertices[v[0]][k];
        b[k] = scene->vertices[v[2]][k] - scene->vertices[v[0]][k];
    }
    return a[1] * b[2] == a[2] * b[1] && a[2] * b[0] == a[0] * b[2] && a[0] * b[1] == a[1] * b[0];
}

static void list_edges(struct work *work)
{
    for (size_t i = 0; i < work->scene->triangle_count; i++) {
        for (int k = 0; k < 3 && !is_degenerate(work->scene, i); k++) {
            uint32_t from = work->position[work->scene->triangles[i][k]];
            uint32_t to = work->position[work->scene->triangles[i][(k + 1) % 3]];
            work->edges[work->edge_count++] = (struct edge){.low = from < to ? from : to,
                                                            .high = from < to ? to : from,
                                                            .triangle = (uint32_t)i,
                                                            .way = from < to ? 1 : -1};
        }
    }
    qsort(work->edges, work->edge_count, sizeof *work->edges, compare_edges);
}

static uint32_t part_of(const struct work *work, uint32_t triangle)
{
    while (work->parent[triangle] != triangle) {
        work->parent[triangle] = work->parent[work->parent[triangle]];
        triangle = work->parent[triangle];
    }
    return triangle;
}

static void join_parts(const struct work *work)
{
    for (size_t i = 1; i < work->edge_count; i++) {
        if (compare_edges(&work->edges[i - 1], &work->edges[i]) == 0) {
            uint32_t a = part_of(work, work->edges[i - 1].triangle);
            uint32_t b = part_of(work, work->edges[i].triangle);
            work->parent[a > b ? a : b] = a > b ? b : a;
        }
    }
}

/* Marks the parts of which some edge is not used twice, once in each direction. */
static void find_open(const struct work *work)
{
    for (size_t i = 0; i < work->edge_count;) {
        const size_t start = i;
        int64_t balance = 0;
        while (i < work->edge_count && compare_edges(&work->edges[start], &work->edges[i]) == 0) {
            balance += work->edges[i++].way;
        }
        if (balance != 0 || i - start != 2) {
            work->open[part_of(work, work->edges[start].triangle)] = 1;
        }
    }
}

/* Volumes about the scene's first vertex, so that far coordinates do not cancel. */
static void add_volumes(const struct work *work)
{
    const struct oracle_scene *scene = work->scene;
    for (size_t i = 0; i < scene->triangle_count; i++) {
        long double p[3][3];
        for (int v = 0; v < 3; v++) {
            for (int k = 0; k < 3; k++) {
                p[v][k] = (long double)scene->vertices[scene->triangles[i][v]][k] -
                          (long double)scene->vertices[0][k];
            }
        }
        work->volume[part_of(work, (uint32_t)i)] +=
            p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
            p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
            p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
}

int oracle_scene_find_closed(struct oracle_scene *scene)
{
    size_t triangles = scene->triangle_count;
    struct work work = {
        .scene = scene,
        .position = calloc(scene->vertex_count + 1, sizeof *work.position),
        .corners = calloc(scene->vertex_count + 1, sizeof *work.corners),
        .edges = calloc(3 * triangles + 1, sizeof *work.edges),
        .parent = calloc(triangles + 1, sizeof *work.parent),
        .open = calloc(triangles + 1, 1),
        .volume = calloc(triangles + 1, sizeof *work.volume),
    };
    int good = work.position != NULL && work.corners != NULL && work.edges != NULL &&
               work.parent != NULL && work.open != NULL && work.volume != NULL;
    if (good) {
        for (size_t i = 0; i < triangles; i++) {
            work.parent[i] = (uint32_t)i;
        }
        number_positions(&work);
        list_edges(&work);
        join_parts(&work);
        find_open(&work);
        add_volumes(&work);
        for (size_t i = 0; i < triangles; i++) {
            uint32_t part = part_of(&work, (uint32_t)i);
            scene->closed[i] = !work.open[part] && work.volume[part] > 0.0L;
        }
    }
    free(work.position);
    free(work.corners);
    free(work.edges);
    free(work.parent);
    free(work.open);
    free(work.volume);
    return good;
}
