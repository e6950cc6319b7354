/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures false light and false shadow of several biases for a window of 9 x 9 texels. The points
 * are those that a camera sees and that face the sun with a cosine above UMBT_JUDGED_FACING. The
 * rejected biases are computed here texel by texel from the asset's voxels; the others are answers
 * of queries.
 *
 *     bias_race SCENE ASSET WIDTH HEIGHT y|z
 *
 * prints a line for each bias: its name, and four shares in percent. Against one ray from the
 * surface: false light, false shadow. Against 8 x 8 rays over the part of the receiver's plane that
 * the window covers: the same two. The asset must be open (--closed off).
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/asset_parts.h"
#include "query/query_parts.h"
#include "study/gbuffer.h"
#include "study/setup.h"
#include "study/study_math.h"
#include "study/study_picture.h"
#include "study/traced_shadow.h"

enum {
    TAPS = 9,
    HALF = TAPS / 2,
    RAYS = 8 /* a side of the plane's patch */
};

struct race {
    struct umbt_scene scene;
    struct umbt_setup setup;
    struct umbt_gbuffer view;
    struct umb_asset *asset;
    struct umb__query q; /* one tap: its frame and voxels */
    struct umb__tree tree;
};

/* A receiver in voxel space. */
struct receiver {
    double p[3], n[3]; /* position relative to the asset's origin, unit normal */
    double v[3];       /* voxel space */
    double along[3];   /* n . e for a voxel's edges e */
    double slope[2];   /* voxels of depth by which the plane falls a texel */
};

static double steepness(const struct receiver *r)
{
    return fabs(r->slope[0]) + fabs(r->slope[1]);
}

static int voxel_lit(const struct race *race, int64_t x, int64_t y, int64_t z)
{
    const int64_t size = (int64_t)1 << race->q.log2_size;
    struct umb_volume_stats stats = {0};
    if (x < 0 || y < 0 || x >= size || y >= size || z < 0) {
        return 1;
    }
    const uint32_t at[3] = {(uint32_t)x, (uint32_t)y, (uint32_t)(z < size ? z : size - 1)};
    const struct umb__place place = umb__tree_locate(&race->tree, at[0], at[1], at[2], &stats);
    return place.brick ? umb__brick_voxel(place.brick, at[0], at[1], at[2]) : place.lit;
}

/* Returns the share of lit texels of the window around v, where texel (i, j) is read at depth
 * z[j][i]. */
static double window_share(const struct race *race, const double v[3], int64_t z[TAPS][TAPS])
{
    int lit = 0;
    for (int j = 0; j < TAPS; j++) {
        for (int i = 0; i < TAPS; i++) {
            lit += voxel_lit(race, (int64_t)floor(v[0]) + i - HALF, (int64_t)floor(v[1]) + j - HALF,
                             z[j][i]);
        }
    }
    return (double)lit / (TAPS * TAPS);
}

static double flat_share(const struct race *race, const double v[3])
{
    int64_t z[TAPS][TAPS];
    for (int i = 0; i < TAPS * TAPS; i++) {
        z[i / TAPS][i % TAPS] = (int64_t)floor(v[2]);
    }
    return window_share(race, v, z);
}

/* The former bias: along the normal. */
static double by_normal(const struct race *race, const struct receiver *r)
{
    const double length = 0.5 * UMB__BIAS_SLACK *
                          (TAPS * (fabs(r->along[0]) + fabs(r->along[1])) + fabs(r->along[2]));
    double moved[3], v[3];
    umbt_along(r->p, length, r->n, moved);
    umb__to_voxel(&race->q, moved, v);
    return flat_share(race, v);
}

/* Along the light, however far. */
static double by_light(const struct race *race, const struct receiver *r)
{
    const double v[3] = {r->v[0], r->v[1],
                         r->v[2] - 0.5 * UMB__BIAS_SLACK * (TAPS * steepness(r) + 1)};
    return flat_share(race, v);
}

static double smallest(const struct race *race, const struct receiver *r)
{
    return fmin(by_normal(race, r), by_light(race, r));
}

/* Returns the voxels of depth from the plane's depth at a texel's centre to the voxel before the
 * plane. */
static double margin(const struct receiver *r)
{
    return 0.5 + (0.5 * steepness(r) + 0.5) / 64;
}

/* Returns the plane's depth at the centre of the window's middle texel. */
static double middle_depth(const struct receiver *r)
{
    double depth = r->v[2];
    for (int k = 0; k < 2; k++) {
        depth += r->slope[k] * (floor(r->v[k]) + 0.5 - r->v[k]);
    }
    return depth;
}

/* Each texel lies on the plane. */
static double by_plane(const struct race *race, const struct receiver *r)
{
    int64_t z[TAPS][TAPS];
    for (int i = 0; i < TAPS * TAPS; i++) {
        const double x = i % TAPS - HALF, y = i / TAPS - HALF;
        z[i / TAPS][i % TAPS] =
            (int64_t)floor(middle_depth(r) + r->slope[0] * x + r->slope[1] * y - margin(r));
    }
    return window_share(race, r->v, z);
}

/* Each row, or each column, lies on the plane: the axis along which the plane is steeper. A lift
 * clears the other axis. */
static double by_rows(const struct race *race, const struct receiver *r)
{
    int64_t z[TAPS][TAPS];
    const int axis = fabs(r->slope[0]) > fabs(r->slope[1]) ? 0 : 1;
    const double lift = HALF * fabs(r->slope[1 - axis]) + margin(r);
    for (int i = 0; i < TAPS * TAPS; i++) {
        const double at = (axis == 0 ? i % TAPS : i / TAPS) - HALF;
        z[i / TAPS][i % TAPS] = (int64_t)floor(middle_depth(r) + r->slope[axis] * at - lift);
    }
    return window_share(race, r->v, z);
}

/* Nine windows of 3 x 3 texels, each with its own lift. None is read behind the bricks in which the
 * foremost window lies. */
static double by_thirds(const struct race *race, const struct receiver *r)
{
    int64_t z[TAPS][TAPS], first = INT64_MAX;
    for (int i = 0; i < TAPS * TAPS; i++) {
        const double x = i % TAPS / 3 * 3 - 3, y = i / TAPS / 3 * 3 - 3;
        const double depth = middle_depth(r) + r->slope[0] * x + r->slope[1] * y;
        z[i / TAPS][i % TAPS] = (int64_t)floor(depth - steepness(r) - margin(r));
        first = z[i / TAPS][i % TAPS] < first ? z[i / TAPS][i % TAPS] : first;
    }
    for (int i = 0; i < TAPS * TAPS; i++) {
        int64_t *at = &z[i / TAPS][i % TAPS];
        *at = *at > (first | 7) ? first | 7 : *at;
    }
    return window_share(race, r->v, z);
}

/* Variants of the lift that queries have (docs/decisions/0002-automatic-bias.md). */
struct lift {
    double most;   /* Longest lift in texels; a move along the normal does the rest */
    double fading; /* Power of most / need by which lifts that do not suffice are shortened */
    double longer; /* Factor of lifts that suffice */
};

static double by_lift(const struct race *race, const struct receiver *r, const struct lift *lift)
{
    const double depth = fabs(r->along[2]), most = lift->most * race->q.lift_texel;
    const double need = 0.5 * UMB__BIAS_SLACK * (TAPS * steepness(r) + 1);
    double moved[3], v[3] = {r->v[0], r->v[1], middle_depth(r)};
    if (need <= most) {
        v[2] -= lift->longer * 0.5 * UMB__BIAS_SLACK * ((TAPS - 1) * steepness(r) + 1);
    } else {
        const double along = most * pow(most / need, lift->fading);
        umbt_along(r->p, (need - along) * depth, r->n, moved);
        umb__to_voxel(&race->q, moved, v);
        v[2] -= along;
    }
    return flat_share(race, v);
}

/* Half the limit. */
static double by_half(const struct race *race, const struct receiver *r)
{
    return by_lift(race, r, &(struct lift){0.5 * UMB__LIFT_TEXELS(TAPS), 0, 1});
}

/* A move along the normal alone where the limit does not suffice. */
static double by_either(const struct race *race, const struct receiver *r)
{
    return by_lift(race, r, &(struct lift){UMB__LIFT_TEXELS(TAPS), INFINITY, 1});
}

/* Room for relief above the plane: an eighth, a quarter of the lift. */
static double by_eighth(const struct race *race, const struct receiver *r)
{
    return by_lift(race, r, &(struct lift){UMB__LIFT_TEXELS(TAPS), 0, 1.125});
}

static double by_quarter(const struct race *race, const struct receiver *r)
{
    return by_lift(race, r, &(struct lift){UMB__LIFT_TEXELS(TAPS), 0, 1.25});
}

static const struct candidate {
    const char *name;
    double (*share)(const struct race *race, const struct receiver *r);
} candidates[] = {{"normal", by_normal},
                  {"light", by_light},
                  {"smallest", smallest},
                  {"rows", by_rows},
                  {"thirds", by_thirds},
                  {"plane", by_plane},
                  {"half", by_half},
                  {"either", by_either},
                  {"an eighth longer", by_eighth},
                  {"a quarter longer", by_quarter}};

static const struct asked {
    const char *name;
    struct umb_query_settings settings;
} asked[] = {
    {"query, one tap", {.taps = 1}},
    {"query, 9 taps", {.taps = 9}},
    {"query, 17 taps", {.taps = 17}},
};

enum {
    CANDIDATES = sizeof candidates / sizeof candidates[0],
    ASKED = sizeof asked / sizeof asked[0],
    ALL = CANDIDATES + ASKED
};

struct counts {
    uint64_t judged, wrong[ALL][4];
};

static void require(enum umb_status status, const struct umb_error *error)
{
    if (status != UMB_OK) {
        (void)fprintf(stderr, "bias_race: %s\n", error->message);
        exit(1);
    }
}

static void receiver_make(const struct race *race, size_t i, struct receiver *r)
{
    umb__subtract(race->view.positions[i], race->q.origin, r->p);
    umbt_widen(race->view.normals[i], r->n);
    (void)umbt_normalize(r->n);
    umb__to_voxel(&race->q, r->p, r->v);
    for (int k = 0; k < 3; k++) {
        r->along[k] = umb__dot(r->n, race->q.voxel_step[k]);
    }
    for (int k = 0; k < 2; k++) {
        r->slope[k] = -r->along[k] / r->along[2];
    }
}

static int sees_light(const struct race *race, const double from[3])
{
    return !umbr_occluded(race->scene.rays, from, race->setup.to_light, 0,
                          2 * race->scene.diagonal_m);
}

/* Returns the share of lit rays over the part of the plane that the window covers. In: start: a
 * point on the plane. */
static double patch_share(const struct race *race, const struct receiver *r, const double start[3])
{
    int lit = 0;
    for (int i = 0; i < RAYS * RAYS; i++) {
        const double x = ((i % RAYS + 0.5) / RAYS - 0.5) * TAPS;
        const double y = ((i / RAYS + 0.5) / RAYS - 0.5) * TAPS;
        double at[3];
        umbt_along(start, x, race->q.voxel_step[0], at);
        umbt_along(at, y, race->q.voxel_step[1], at);
        umbt_along(at, r->slope[0] * x + r->slope[1] * y, race->q.voxel_step[2], at);
        lit += sees_light(race, at);
    }
    return (double)lit / (RAYS * RAYS);
}

/* Judges receiver i. In: answers: of the queries. */
static void judge(const struct race *race, size_t i, float *const answers[ASKED],
                  struct counts *counts)
{
    struct receiver r;
    double start[3];
    receiver_make(race, i, &r);
    if (!(umb__dot(r.n, race->setup.to_light) > UMBT_JUDGED_FACING)) {
        return;
    }
    umbt_along(race->view.positions[i], 2e-6 * race->scene.diagonal_m, r.n, start);
    const int lit = sees_light(race, start);
    const double patch = patch_share(race, &r, start);
    counts->judged++;
    for (int c = 0; c < ALL; c++) {
        const double share =
            c < CANDIDATES ? candidates[c].share(race, &r) : (double)answers[c - CANDIDATES][i];
        counts->wrong[c][0] += share > 0.5 && !lit;
        counts->wrong[c][1] += share < 0.5 && lit;
        counts->wrong[c][2] += share > 0.5 && patch < 0.5 - 1.0 / RAYS;
        counts->wrong[c][3] += share < 0.5 && patch > 0.5 + 1.0 / RAYS;
    }
}

static void race_open(struct race *race, char **argv)
{
    struct umb_error error;
    struct umb_query query;
    const struct umb_query_settings bare = {.taps = 1};
    const struct umbt_camera_request fitted = {0};
    const uint32_t size[2] = {(uint32_t)strtoul(argv[3], NULL, 10),
                              (uint32_t)strtoul(argv[4], NULL, 10)};
    require(umb_asset_open_file(argv[2], NULL, &race->asset, &error), &error);
    require(umb_query_prepare(race->asset, &bare, &query, &error), &error);
    memcpy(&race->q, query.opaque, sizeof race->q);
    race->tree = umb__tree_of(&race->q);
    require(umbt_scene_init(&race->scene, argv[1], 0, &error), &error);
    race->setup.scene = &race->scene;
    race->setup.z_up = argv[5][0] == 'z';
    for (int k = 0; k < 3; k++) {
        race->setup.to_light[k] = -race->q.direction[k];
    }
    require(umbt_setup_camera(&race->setup, &fitted, size, &error), &error);
    require(umbt_gbuffer_view(&race->view, &race->scene, &race->setup.camera, size, 2, &error),
            &error);
}

static float *ask(const struct race *race, const struct asked *asked_for)
{
    struct umb_error error;
    struct umb_query query;
    struct umb_query_settings settings = asked_for->settings;
    const struct umb_points points =
        umbt_points_at(race->view.positions[0], race->view.normals[0], race->view.receiver_count);
    struct umb_answers answers = {.values = calloc(points.count + 1, sizeof(float))};
    settings.format = UMB_ANSWER_F32;
    require(umb_query_prepare(race->asset, &settings, &query, &error), &error);
    if (answers.values == NULL) {
        exit(1);
    }
    umb_query_run(&query, &points, 0, points.count, &answers);
    return answers.values;
}

int main(int argc, char **argv)
{
    static struct race race;
    static struct counts counts;
    float *answers[ASKED];
    if (argc != 6) {
        (void)fprintf(stderr, "usage: bias_race SCENE ASSET WIDTH HEIGHT y|z\n");
        return 2;
    }
    race_open(&race, argv);
    for (int k = 0; k < ASKED; k++) {
        answers[k] = ask(&race, &asked[k]);
    }
    for (size_t i = 0; i < race.view.receiver_count; i++) {
        judge(&race, i, answers, &counts);
    }
    for (int c = 0; c < ALL; c++) {
        const uint64_t *wrong = counts.wrong[c];
        printf("%s", c < CANDIDATES ? candidates[c].name : asked[c - CANDIDATES].name);
        for (int k = 0; k < 4; k++) {
            printf("\t%.3f", 100.0 * (double)wrong[k] / (double)counts.judged);
        }
        printf("\t%" PRIu64 "\n", counts.judged);
    }
    for (int k = 0; k < ASKED; k++) {
        free(answers[k]);
    }
    umbt_gbuffer_finish(&race.view);
    umbt_scene_finish(&race.scene);
    umb_asset_close(race.asset);
    return 0;
}
