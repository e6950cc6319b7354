/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Compares the light behind translucent casters in a real bake with products over all surfaces that
 * the light meets:
 *
 *     light_products SCENE ASSET [COLUMNS]
 *
 * ASSET is a bake of SCENE for a sun, open (--closed off), at a resolution that its transmittance
 * maps have, too (at most 2048). For random columns of voxels, rays of this program's own find, in
 * long double, all triangles over the column's middle. The asset is queried with one tap and no
 * bias at the middle of eight voxels of each column. An answer must be the product of what the
 * surfaces before the point let through, within 1e-6. Where less than 0.001 of the light is left,
 * lists end, and the answer may be too light by less than 0.001.
 *
 * Columns through edges, and voxels whose middle lies on a surface, are left out and counted.
 * Prints one JSON object. Exit 0: equal; 1: not; 65: a file cannot be used.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_alpha.h"
#include "umbrage/query.h"

enum {
    VOXELS = 8, /* of a column */
    HITS_MAX = 4096,
    EXIT_DATA = 65,
};

#define TOLERANCE 1e-6L
#define LEAST     0.001L /* lists end there */

struct hit {
    long double z, passes;
};

struct check {
    struct umbs_scene *scene;
    struct umbs_cuts cuts;
    double (*corners)[3][3];
    uint32_t *materials;
    size_t count;
    struct umb_asset *asset;
    struct umb_asset_info info;
    struct umb_frustum_info frustum;
    uint32_t size;
    long double (*voxel)[3][3]; /* [count] corners in voxels */
    size_t *first, *rows; /* triangles that reach a row of texels: [size + 1], [first[size]] */
    struct hit hits[HITS_MAX];
    uint64_t seed;
    /* found */
    size_t columns, unsure, compared, behind, opaque, ended, wrong;
    long double worst, worst_ended;
};

static double random_unit(struct check *c)
{
    c->seed ^= c->seed >> 12;
    c->seed ^= c->seed << 25;
    c->seed ^= c->seed >> 27;
    return (double)((c->seed * 0x2545f4914f6cdd1dU) >> 11) * 0x1p-53;
}

static int scene_open(struct check *c, const char *scene, const char *asset)
{
    struct umb_error error = {0};
    const struct umbs_import_options options = {0};
    if (umbs_scene_import(scene, &options, &c->scene, &error) != UMB_OK ||
        umbs_scene_flatten(&c->scene->view, &c->corners, &c->materials, &c->count, &error) !=
            UMB_OK ||
        umbs_cuts_find(&c->scene->view, &c->cuts, &error) != UMB_OK ||
        umb_asset_open_file(asset, NULL, &c->asset, &error) != UMB_OK) {
        (void)fprintf(stderr, "light_products: %s\n", error.message);
        return 0;
    }
    umb_asset_get_info(c->asset, &c->info);
    if (c->info.transmittance_bytes == 0) {
        (void)fprintf(stderr, "light_products: %s: nothing translucent\n", asset);
        return 0;
    }
    return 1;
}

static void corners_place(struct check *c)
{
    for (size_t i = 0; i < 9 * c->count; i++) {
        const size_t t = i / 9, k = i / 3 % 3, axis = i % 3;
        const double *m = c->frustum.world_to_voxel[axis];
        long double sum = (long double)m[3];
        for (int w = 0; w < 3; w++) {
            sum += (long double)m[w] *
                   ((long double)c->corners[t][k][w] - (long double)c->info.origin[w]);
        }
        c->voxel[t][k][axis] = sum;
    }
}

/* Finds the rows of texels that a triangle reaches, from low to high; there are none if low >
 * high. */
static void rows_reached(const struct check *c, size_t t, long *low, long *high)
{
    const long double a = c->voxel[t][0][1], b = c->voxel[t][1][1], d = c->voxel[t][2][1];
    *low = (long)floorl(fmaxl(fminl(fminl(a, b), d), 0.0L));
    *high = (long)floorl(fminl(fmaxl(fmaxl(a, b), d), (long double)c->size - 1.0L));
}

/* Lists the triangles that reach each row: first counts them, then fills each list from its end. */
static int rows_fill(struct check *c)
{
    long low, high;
    for (size_t t = 0; t < c->count; t++) {
        rows_reached(c, t, &low, &high);
        for (long y = low; y <= high; y++) {
            c->first[y]++;
        }
    }
    for (uint32_t y = 1; y <= c->size; y++) {
        c->first[y] += c->first[y - 1];
    }
    c->rows = calloc(c->first[c->size] + 1, sizeof *c->rows);
    for (size_t t = 0; t < c->count && c->rows != NULL; t++) {
        rows_reached(c, t, &low, &high);
        for (long y = low; y <= high; y++) {
            c->rows[--c->first[y]] = t;
        }
    }
    return c->rows != NULL;
}

static int light_open(struct check *c)
{
    struct umb_light_info light;
    if (umb_asset_get_light(c->asset, 0, &light) != UMB_OK ||
        umb_asset_get_frustum(c->asset, light.first_frustum, &c->frustum) != UMB_OK) {
        return 0;
    }
    c->size = 1U << c->frustum.log2_size;
    c->voxel = calloc(c->count, sizeof *c->voxel);
    c->first = calloc((size_t)c->size + 1, sizeof *c->first);
    if (c->voxel == NULL || c->first == NULL) {
        return 0;
    }
    corners_place(c);
    return rows_fill(c);
}

static int hit_compare(const void *a, const void *b)
{
    const struct hit *x = a, *y = b;
    return (x->z > y->z) - (x->z < y->z);
}

/* Returns the share of light that a triangle lets through at a point. In: weights of the triangle's
 * corners at the point. */
static long double passes_at(const struct check *c, size_t triangle, const long double weight[3])
{
    const uint32_t number = c->cuts.of != NULL ? c->cuts.of[triangle] : UMBS_CUT_NONE;
    if (number == UMBS_CUT_NONE) {
        return 0.0L;
    }
    if (number == UMBS_CUT_GONE || number == UMBS_CUT_CLEAR) {
        return 1.0L;
    }
    const struct umbs_scene_view *view = &c->scene->view;
    const struct umbs_cut *cut = &c->cuts.cuts[number];
    const struct umbs_material *material = &view->materials[cut->material];
    long double uv[2] = {0.0L, 0.0L}, alpha = 1.0L;
    for (int k = 0; k < 3; k++) {
        uv[0] += weight[k] * (long double)cut->uv[k][0];
        uv[1] += weight[k] * (long double)cut->uv[k][1];
    }
    if (material->texture != UMBS_NO_INDEX) {
        alpha = (long double)umbs_alpha_at(view, &view->textures[material->texture], (double)uv[0],
                                           (double)uv[1]) /
                255.0L;
    }
    alpha *= (long double)material->base_alpha;
    if (material->alpha_mode == UMBS_ALPHA_MASK) {
        alpha = alpha >= (long double)material->alpha_cutoff ? 1.0L : 0.0L;
    } else if (material->alpha_mode == UMBS_ALPHA_OPAQUE) {
        alpha = 1.0L;
    }
    return 1.0L - alpha * (1.0L - (long double)material->transmission);
}

/* Finds all triangles that cover the middle of a column, nearest first. Returns their number, or -1
 * if the middle lies on an edge or a triangle lies along the light. */
static int column_hits(struct check *c, uint32_t x, uint32_t y)
{
    const long double at[2] = {x + 0.5L, y + 0.5L};
    const size_t end = c->first[y + 1];
    int count = 0;
    for (size_t i = c->first[y]; i < end && count < HITS_MAX; i++) {
        const long double(*p)[3] = (const long double(*)[3])c->voxel[c->rows[i]];
        long double edge[3], area = 0.0L, most = 0.0L, weight[3], z = 0.0L;
        if (fminl(fminl(p[0][0], p[1][0]), p[2][0]) > at[0] ||
            fmaxl(fmaxl(p[0][0], p[1][0]), p[2][0]) < at[0]) {
            continue;
        }
        for (int k = 0; k < 3; k++) {
            const long double *a = p[(k + 1) % 3], *b = p[(k + 2) % 3];
            edge[k] = (a[0] - at[0]) * (b[1] - at[1]) - (a[1] - at[1]) * (b[0] - at[0]);
            area += edge[k];
            most = fmaxl(most, fabsl(a[0] - b[0]) + fabsl(a[1] - b[1]));
        }
        int inside = 1, near = 1;
        for (int k = 0; k < 3; k++) {
            const long double side = area < 0.0L ? -edge[k] : edge[k];
            inside = inside && side > 0.0L;
            near = near && side > -1e-7L * most;
        }
        for (int k = 0; k < 3 && near; k++) {
            if (fabsl(edge[k]) < 1e-7L * most) {
                return -1;
            }
        }
        if (!inside) {
            continue;
        }
        for (int k = 0; k < 3; k++) {
            weight[k] = edge[k] / area;
            z += weight[k] * p[k][2];
        }
        c->hits[count++] = (struct hit){z, passes_at(c, c->rows[i], weight)};
    }
    qsort(c->hits, (size_t)count, sizeof c->hits[0], hit_compare);
    return count;
}

/* The answer at the middle of a voxel. */
static long double ask(const struct check *c, const struct umb_query *query, const uint32_t at[3])
{
    const double(*m)[4] = c->frustum.world_to_voxel;
    double world[3] = {0.0, 0.0, 0.0};
    /* Steps are the columns of the matrix's inverse. */
    for (int axis = 0; axis < 3; axis++) {
        const double along = (double)at[axis] + 0.5 - m[axis][3];
        for (int w = 0; w < 3; w++) {
            world[w] += along * c->frustum.voxel_step[axis][w];
        }
    }
    struct umb_points points = {.positions = world, .format = UMB_POINT_F64, .count = 1};
    memcpy(points.origin, c->info.origin, sizeof points.origin);
    float value = -1.0F;
    struct umb_answers answers = {.values = &value};
    umb_query_run(query, &points, 0, 1, &answers);
    return (long double)value;
}

static void voxel_compare(struct check *c, const struct umb_query *query, int hits,
                          const uint32_t at[3])
{
    long double left = 1.0L;
    int met = 0;
    for (int i = 0; i < hits; i++) {
        if (fabsl(c->hits[i].z - (at[2] + 0.5L)) < 1e-6L) {
            c->unsure++;
            return;
        }
        left *= c->hits[i].z < at[2] + 0.5L ? c->hits[i].passes : 1.0L;
        met += c->hits[i].z < at[2] + 0.5L;
    }
    const long double off = ask(c, query, at) - left;
    const int ended = left < LEAST && left > 0.0L;
    c->compared++;
    c->behind += met > 0;
    c->ended += (size_t)ended;
    c->opaque += met > 0 && left == 0.0L;
    long double *const worst = ended ? &c->worst_ended : &c->worst;
    *worst = fmaxl(*worst, fabsl(off));
    if (ended ? off < -TOLERANCE || off > LEAST : fabsl(off) > TOLERANCE) {
        if (c->wrong++ < 10) {
            (void)fprintf(stderr, "voxel %u %u %u: off by %.3Lg of %.9Lg behind %d surfaces\n",
                          at[0], at[1], at[2], off, left, met);
        }
    }
}

/* Chooses the column of a random place on a translucent triangle; chooses none if the place lies
 * outside the frustum. */
static int column_pick(struct check *c, const size_t *some, size_t count, uint32_t at[2])
{
    const size_t t = some[(size_t)(random_unit(c) * (double)count)];
    double u = random_unit(c), v = random_unit(c);
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    for (int axis = 0; axis < 2; axis++) {
        const long double a = c->voxel[t][0][axis], b = c->voxel[t][1][axis];
        const long double place =
            a + (long double)u * (b - a) + (long double)v * (c->voxel[t][2][axis] - a);
        if (!(place >= 0.0L && place < c->size)) {
            return 0;
        }
        at[axis] = (uint32_t)place;
    }
    return 1;
}

static int run(struct check *c, size_t columns)
{
    struct umb_error error = {0};
    struct umb_query query;
    const struct umb_query_settings settings = {.bias_mode = UMB_BIAS_NONE};
    size_t *some = calloc(c->count + 1, sizeof *some), count = 0;
    if (some == NULL || umb_query_prepare(c->asset, &settings, &query, &error) != UMB_OK) {
        (void)fprintf(stderr, "light_products: %s\n", error.message);
        free(some);
        return 0;
    }
    for (size_t t = 0; t < c->count; t++) {
        if (c->cuts.of != NULL && umbs_cut_is_translucent(&c->cuts, c->cuts.of[t])) {
            some[count++] = t;
        }
    }
    for (size_t i = 0; i < columns && count > 0; i++) {
        uint32_t at[3];
        const int hits = column_pick(c, some, count, at) ? column_hits(c, at[0], at[1]) : -1;
        c->unsure += hits < 0;
        c->columns += hits >= 0;
        for (int k = 0; k < VOXELS && hits >= 0; k++) {
            /* Half of them close behind or before a surface. */
            const double any = random_unit(c), which = random_unit(c);
            const long double z = k % 2 == 0 && hits > 0 ? c->hits[(size_t)(which * hits)].z +
                                                               (long double)(4.0 * any - 2.0)
                                                         : (long double)(any * c->size);
            if (z >= 0.0L && z < c->size) {
                at[2] = (uint32_t)z;
                voxel_compare(c, &query, hits, at);
            }
        }
    }
    free(some);
    return 1;
}

int main(int argc, char **argv)
{
    static struct check c;
    const size_t columns = argc == 4 ? strtoul(argv[3], NULL, 10) : 20000;
    if (argc < 3 || argc > 4) {
        (void)fputs("usage: light_products SCENE ASSET [COLUMNS]\n", stderr);
        return 2;
    }
    c.seed = 2000;
    const int done = scene_open(&c, argv[1], argv[2]) && light_open(&c) && run(&c, columns);
    if (done) {
        (void)printf("{\"columns\":%zu,\"compared\":%zu,\"behind\":%zu,\"opaque\":%zu,"
                     "\"ended\":%zu,\"unsure\":%zu,\"wrong\":%zu,\"worst\":%.3Lg,"
                     "\"worst_ended\":%.3Lg}\n",
                     c.columns, c.compared, c.behind, c.opaque, c.ended, c.unsure, c.wrong, c.worst,
                     c.worst_ended);
    }
    umb_asset_close(c.asset);
    umbs_cuts_finish(&c.cuts);
    umbs_scene_destroy(c.scene);
    free(c.corners);
    free(c.materials);
    free(c.voxel);
    free(c.first);
    free(c.rows);
    return !done ? EXIT_DATA : c.wrong > 0 || c.compared == 0;
}
