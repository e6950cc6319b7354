/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares a bake's answers for points before a lamp with brute force in long double:
 *
 *     lamp_check SCENE ASSET SEED POINTS
 *
 * SCENE is text: `light X Y Z` of a point light, or `light X Y Z DX DY DZ DEGREES` of a spot light
 * (half its cone), then a line `t CLOSED` and nine numbers for each triangle, CLOSED 1 where it
 * belongs to a solid baked under the closed rule. ASSET may be `-`: only distances are printed.
 *
 * Points are drawn next to surfaces (1e-9 of the scene's size and up, on both sides), in the air
 * and around the lamp, and queried with one tap and no bias. The truth comes from testing the
 * segment to the lamp against every triangle, by determinants. Parts of triangles that are nearer
 * to the lamp than 2^-27 of its reach cast nothing. A disagreement is in the band if the truth
 * differs at a voxel's centre or on a grid of quarter voxels within one voxel; a centre behind the
 * lamp is lit. A point outside all frusta has no band: it must be lit. Points in closed solids, and
 * outside of a spot's cone, are left out.
 *
 * Prints one JSON object. Exit 0: no wrong answer; 1: wrong answers; 65: a file cannot be used.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umbrage/query.h"

enum {
    BATCH = 256,
    STEPS = 9, /* of the band's grid, along each axis */
    EXIT_DATA = 65,
};

typedef long double real;

struct lamp_scene {
    double (*corners)[3][3]; /* world */
    int *closed;
    size_t count, capacity;
    double light[7]; /* position; of a spot light direction and half the cone's angle */
    int is_spot;
    double low[3], high[3];
    real reach, free_m;
};

struct frustum {
    real m[4][4];
    real size;
};

struct check {
    struct lamp_scene scene;
    struct umb_asset *asset;
    struct umb_query query;
    double origin[3];
    struct frustum frusta[6];
    uint32_t frustum_count;
    uint64_t random;
    uint64_t compared, band, skipped, outside, lit, wrong;
    double worst[3];
};

static double unit(struct check *check)
{
    uint64_t z = check->random += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static real dot(const real a[3], const real b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const real a[3], const real b[3], real out[3])
{
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = a[i] * b[j] - a[j] * b[i];
    }
}

/* Returns the place where the line from 0 along p meets a triangle, as a share of p; NAN if it does
 * not. */
static real meet(const real at[3][3], const real p[3])
{
    real normal[3], one[3], two[3];
    int below = 0, above = 0;
    for (int i = 0; i < 3; i++) {
        real across[3];
        cross(at[i], at[(i + 1) % 3], across);
        const real side = dot(p, across);
        below |= side < 0;
        above |= side > 0;
    }
    for (int k = 0; k < 3; k++) {
        one[k] = at[1][k] - at[0][k];
        two[k] = at[2][k] - at[0][k];
    }
    cross(one, two, normal);
    const real along = dot(normal, p);
    return below == above || along == 0 ? (real)NAN : dot(normal, at[0]) / along;
}

static void corners_from(const struct lamp_scene *scene, size_t number, const double base[3],
                         const real more[3], real at[3][3])
{
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            at[i][k] = (real)scene->corners[number][i][k] - (real)base[k] - more[k];
        }
    }
}

/* Returns 1 if nothing lies between the lamp and a place. In: local: the place relative to the
 * origin. */
static int is_lit(const struct check *check, const real local[3])
{
    static const real none[3] = {0, 0, 0};
    const struct lamp_scene *scene = &check->scene;
    real p[3];
    for (int k = 0; k < 3; k++) {
        p[k] = local[k] + ((real)check->origin[k] - (real)scene->light[k]);
    }
    const real least = scene->free_m / sqrtl(dot(p, p));
    for (size_t i = 0; i < scene->count; i++) {
        real at[3][3];
        corners_from(scene, i, scene->light, none, at);
        const real share = meet((const real(*)[3])at, p);
        if (share >= least && share <= 1) {
            return 0;
        }
    }
    return 1;
}

/* Returns 1 if the way leaves a solid through the triangle, by its winding; -1 if it enters one. */
static int side_of(const real at[3][3], const real way[3])
{
    real one[3], two[3], normal[3];
    for (int k = 0; k < 3; k++) {
        one[k] = at[1][k] - at[0][k];
        two[k] = at[2][k] - at[0][k];
    }
    cross(one, two, normal);
    return dot(normal, way) > 0 ? 1 : -1;
}

/* Returns 1 if a place lies in a closed solid, also one inside another: by the majority of three
 * directions. */
static int is_inside(const struct check *check, const real local[3])
{
    static const real ways[3][3] = {
        {0.31L, 0.77L, 0.55L}, {-0.83L, 0.21L, 0.52L}, {0.11L, -0.64L, -0.76L}};
    const struct lamp_scene *scene = &check->scene;
    int votes = 0;
    for (int d = 0; d < 3; d++) {
        int winding = 0;
        for (size_t i = 0; i < scene->count; i++) {
            real at[3][3];
            if (scene->closed[i]) {
                corners_from(scene, i, check->origin, local, at);
                winding += meet((const real(*)[3])at, ways[d]) > 0
                               ? side_of((const real(*)[3])at, ways[d])
                               : 0;
            }
        }
        votes += winding > 0;
    }
    return votes >= 2;
}

static real row(const struct frustum *f, int i, const real local[3])
{
    return f->m[i][3] + dot(f->m[i], local);
}

/* Finds the frustum that answers for a place, and the place in its voxels; NULL: no frustum
 * does. */
static const struct frustum *find_frustum(const struct check *check, const real local[3],
                                          real voxel[3])
{
    const struct frustum *found = NULL;
    real most = 0;
    for (uint32_t i = 0; i < check->frustum_count; i++) {
        const real w = row(&check->frusta[i], 3, local);
        if (w > most) {
            most = w;
            found = &check->frusta[i];
        }
    }
    for (int k = 0; found != NULL && k < 3; k++) {
        voxel[k] = row(found, k, local) / (k < 2 ? most : 1);
    }
    return found;
}

/* Computes the place of a point in voxels, by Cramer's rule; returns 0 if it is behind the lamp. */
static int place(const struct frustum *f, const real voxel[3], real local[3])
{
    real rows[3][3], value[3], minors[3][3];
    for (int i = 0; i < 3; i++) {
        const real w = i < 2 ? voxel[i] : 0;
        for (int k = 0; k < 3; k++) {
            rows[i][k] = f->m[i][k] - w * f->m[3][k];
        }
        value[i] = (i < 2 ? w * f->m[3][3] : voxel[2]) - f->m[i][3];
    }
    for (int i = 0; i < 3; i++) {
        cross(rows[(i + 1) % 3], rows[(i + 2) % 3], minors[i]);
    }
    const real all = dot(rows[0], minors[0]);
    for (int k = 0; k < 3; k++) {
        local[k] =
            (value[0] * minors[0][k] + value[1] * minors[1][k] + value[2] * minors[2][k]) / all;
    }
    return row(f, 3, local) > 0;
}

/* Returns 1 if the truth changes within a voxel of a place. Out: centre: the truth at the centre of
 * the place's voxel. */
static int in_band(const struct check *check, const struct frustum *f, const real voxel[3],
                   int truth, real centre[3])
{
    real middle[3], local[3];
    for (int k = 0; k < 3; k++) {
        middle[k] = floorl(fminl(voxel[k], f->size - 1)) + 0.5L;
    }
    /* A centre that lies behind the lamp lies before all occluders. */
    if ((!place(f, middle, centre) || is_lit(check, centre)) != truth) {
        return 1;
    }
    for (int i = 0; i < STEPS * STEPS * STEPS; i++) {
        const int n = i * 182 % (STEPS * STEPS * STEPS); /* prime to it: opposite corners first */
        const real at[3] = {voxel[0] + 0.25L * (n % STEPS - 4),
                            voxel[1] + 0.25L * (n / STEPS % STEPS - 4),
                            voxel[2] + 0.25L * (n / (STEPS * STEPS) - 4)};
        if (place(f, at, local) && is_lit(check, local) != truth) {
            return 1;
        }
    }
    return 0;
}

static void note_wrong(struct check *check, const real local[3])
{
    for (int k = 0; k < 3 && check->wrong == 0; k++) {
        check->worst[k] = (double)((real)check->origin[k] + local[k]);
    }
    check->wrong++;
}

static void judge(struct check *check, const double point[3], int lit)
{
    const real local[3] = {point[0], point[1], point[2]};
    const int truth = is_lit(check, local);
    real voxel[3] = {0, 0, 0}, centre[3];
    const struct frustum *f = find_frustum(check, local, voxel);
    const int outside =
        f == NULL || !(voxel[0] >= 0 && voxel[0] < f->size && voxel[1] >= 0 && voxel[1] < f->size);
    check->compared++;
    check->outside += (uint64_t)outside;
    check->lit += (uint64_t)truth;
    if (lit == truth) {
        return;
    }
    if (outside) {
        note_wrong(check, local);
    } else if (in_band(check, f, voxel, truth, centre)) {
        check->band++;
    } else if (is_inside(check, local) || is_inside(check, centre)) {
        check->skipped++;
    } else {
        note_wrong(check, local);
    }
}

/* 1 if a place lies in the light's cone. */
static int in_cone(const struct check *check, const double local[3])
{
    const struct lamp_scene *scene = &check->scene;
    double along = 0, square = 0, unit_square = 0;
    for (int k = 0; k < 3; k++) {
        const double way = local[k] + (check->origin[k] - scene->light[k]);
        along += way * scene->light[3 + k];
        square += way * way;
        unit_square += scene->light[3 + k] * scene->light[3 + k];
    }
    const double most = cos(scene->light[6] * (acos(-1.0) / 180));
    return !scene->is_spot || along > (most + 1e-6) * sqrt(square * unit_square);
}

static double extent_of(const struct lamp_scene *scene)
{
    double most = 0;
    for (int k = 0; k < 3; k++) {
        most = fmax(most, scene->high[k] - scene->low[k]);
    }
    return most;
}

static void draw(struct check *check, double local[3])
{
    const struct lamp_scene *scene = &check->scene;
    const double size = extent_of(scene), kind = unit(check);
    const double off = size * pow(10, -9 + 9 * unit(check));
    double way[3];
    for (int k = 0; k < 3; k++) {
        way[k] = 2 * unit(check) - 1;
    }
    if (kind < 0.4) { /* next to a surface */
        double(*v)[3] = scene->corners[(size_t)(unit(check) * (double)scene->count)];
        const double b = unit(check), c = unit(check) * (1 - b);
        for (int k = 0; k < 3; k++) {
            local[k] = (v[0][k] - check->origin[k]) + b * (v[1][k] - v[0][k]) +
                       c * (v[2][k] - v[0][k]) + off * way[k];
        }
    } else if (kind < 0.7) { /* around the lamp */
        for (int k = 0; k < 3; k++) {
            local[k] = (scene->light[k] - check->origin[k]) + off * way[k];
        }
    } else {
        for (int k = 0; k < 3; k++) {
            const double half = 0.5 * (scene->high[k] - scene->low[k]) + 0.05 * size;
            local[k] =
                (0.5 * scene->low[k] + 0.5 * scene->high[k] - check->origin[k]) + half * way[k];
        }
    }
}

static void compare(struct check *check, uint64_t wanted)
{
    uint64_t tries = 50 * wanted;
    while (check->compared < wanted && tries > 0) {
        double local[BATCH][3];
        uint8_t answers[BATCH];
        size_t count = 0;
        for (; count < BATCH && tries > 0; tries--) {
            draw(check, local[count]);
            count += (size_t)in_cone(check, local[count]);
        }
        const double *o = check->origin;
        const struct umb_points points = {.positions = local,
                                          .format = UMB_POINT_F64,
                                          .origin = {o[0], o[1], o[2]},
                                          .count = count};
        struct umb_answers out = {.values = answers};
        umb_query_run(&check->query, &points, 0, count, &out);
        for (size_t i = 0; i < count; i++) {
            judge(check, local[i], answers[i] >= 128);
        }
    }
}

static int add_triangle(struct lamp_scene *scene, const char *text)
{
    char *end;
    if (scene->count == scene->capacity) {
        scene->capacity = scene->capacity == 0 ? 256 : 2 * scene->capacity;
        double(*corners)[3][3] = realloc(scene->corners, scene->capacity * sizeof *corners);
        int *closed = realloc(scene->closed, scene->capacity * sizeof *closed);
        scene->corners = corners != NULL ? corners : scene->corners;
        scene->closed = closed != NULL ? closed : scene->closed;
        if (corners == NULL || closed == NULL) {
            return 0;
        }
    }
    scene->closed[scene->count] = strtol(text, &end, 10) != 0;
    for (int i = 0; i < 9; i++) {
        const double value = strtod(end, &end);
        scene->corners[scene->count][i / 3][i % 3] = value;
        scene->low[i % 3] = fmin(scene->low[i % 3], value);
        scene->high[i % 3] = fmax(scene->high[i % 3], value);
    }
    scene->count++;
    return 1;
}

static int read_scene(struct lamp_scene *scene, const char *path)
{
    char line[1024];
    FILE *file = fopen(path, "r");
    int good = file != NULL;
    for (int k = 0; k < 3; k++) {
        scene->low[k] = INFINITY;
        scene->high[k] = -INFINITY;
    }
    while (good && fgets(line, sizeof line, file) != NULL) {
        if (line[0] == 't') {
            good = add_triangle(scene, line + 1);
        } else if (strncmp(line, "light ", 6) == 0) {
            char *end = line + 6, *before = NULL;
            int i = 0;
            for (; i < 7 && end != before; i++) {
                before = end;
                scene->light[i] = strtod(end, &end);
            }
            scene->is_spot = i == 7 && end != before;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    real square = 0;
    for (int k = 0; k < 3; k++) {
        const real at = scene->light[k];
        const real far = fmaxl(fabsl((real)scene->low[k] - at), fabsl((real)scene->high[k] - at));
        square += far * far;
    }
    scene->reach = sqrtl(square);
    scene->free_m = scene->reach * 0x1p-27L;
    return good && scene->count > 0;
}

/* Returns the distance of the lamp from a triangle: to the foot of the perpendicular if it lies
 * inside, else to the nearest edge. */
static real distance_to(const struct lamp_scene *scene, size_t number)
{
    static const real none[3] = {0, 0, 0};
    real at[3][3], one[3], two[3], normal[3], least = INFINITY;
    corners_from(scene, number, scene->light, none, at);
    for (int k = 0; k < 3; k++) {
        one[k] = at[1][k] - at[0][k];
        two[k] = at[2][k] - at[0][k];
    }
    cross(one, two, normal);
    if (!isnan(meet((const real(*)[3])at, normal))) {
        return fabsl(dot(normal, at[0])) / sqrtl(dot(normal, normal));
    }
    for (int i = 0; i < 3; i++) {
        real way[3], off[3];
        for (int k = 0; k < 3; k++) {
            way[k] = at[(i + 1) % 3][k] - at[i][k];
        }
        const real share = fminl(fmaxl(-dot(at[i], way) / dot(way, way), 0), 1);
        for (int k = 0; k < 3; k++) {
            off[k] = at[i][k] + share * way[k];
        }
        least = fminl(least, sqrtl(dot(off, off)));
    }
    return least;
}

static int open_asset(struct check *check, const char *path)
{
    struct umb_error error = {0};
    struct umb_light_info light;
    struct umb_asset_info info;
    const struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    if (umb_asset_open_file(path, NULL, &check->asset, &error) != UMB_OK ||
        umb_query_prepare(check->asset, &settings, &check->query, &error) != UMB_OK ||
        umb_asset_get_light(check->asset, 0, &light) != UMB_OK || light.frustum_count > 6) {
        fprintf(stderr, "lamp_check: %s: %s\n", path, error.message);
        return 0;
    }
    umb_asset_get_info(check->asset, &info);
    memcpy(check->origin, info.origin, sizeof check->origin);
    check->frustum_count = light.frustum_count;
    for (uint32_t i = 0; i < light.frustum_count; i++) {
        struct umb_frustum_info frustum;
        if (umb_asset_get_frustum(check->asset, light.first_frustum + i, &frustum) != UMB_OK) {
            return 0;
        }
        for (int k = 0; k < 16; k++) {
            check->frusta[i].m[k / 4][k % 4] = frustum.world_to_voxel[k / 4][k % 4];
        }
        check->frusta[i].size = (real)(UINT64_C(1) << frustum.log2_size);
    }
    return 1;
}

int main(int argc, char **argv)
{
    struct check check = {.random = 1};
    int good = argc == 5 && read_scene(&check.scene, argv[1]);
    const int asks = good && strcmp(argv[2], "-") != 0;
    real distance = INFINITY;
    if (asks) {
        good = open_asset(&check, argv[2]);
    }
    if (!good) {
        fprintf(stderr, "lamp_check SCENE ASSET SEED POINTS: a file cannot be used\n");
        return EXIT_DATA;
    }
    check.random = strtoull(argv[3], NULL, 10);
    for (size_t i = 0; i < check.scene.count; i++) {
        distance = fminl(distance, distance_to(&check.scene, i));
    }
    if (asks) {
        compare(&check, strtoull(argv[4], NULL, 10));
    }
    printf("{\"compared\":%llu,\"lit\":%llu,\"outside\":%llu,\"band\":%llu,\"skipped\":%llu,"
           "\"wrong\":%llu,\"worst\":[%.17g,%.17g,%.17g],\"distance\":%.6Lg,\"reach\":%.6Lg}\n",
           (unsigned long long)check.compared, (unsigned long long)check.lit,
           (unsigned long long)check.outside, (unsigned long long)check.band,
           (unsigned long long)check.skipped, (unsigned long long)check.wrong, check.worst[0],
           check.worst[1], check.worst[2], distance, check.scene.reach);
    umb_asset_close(check.asset);
    free(check.scene.corners);
    free(check.scene.closed);
    return check.wrong > 0;
}
