/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The samples of a study and their truth (study.h).
 *
 * The distance of a surface point to the true shadow boundary comes from rays that start in its
 * tangent plane, in 16 directions and ever farther out, until the truth of one differs from the
 * point's. Halving then narrows the distance. Where the surface bends away from its tangent plane
 * the distance is an estimate from below, because any other surface close by counts too.
 */
#include "study/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "study/point_sampler.h"
#include "study/study_math.h"
#include "study/study_probe.h"

#define DIRECTIONS   16
#define RINGS        12   /* rings from reach / 2^11 to reach */
#define HALVINGS     6    /* halvings: a boundary's distance to 1.6 % */
#define REACH_SHARE  0.02 /* share of the scene's diagonal */
#define SURFACE_LIFT 2e-6 /* share of the diagonal, as in traced_shadow.h */
#define BORDER_SHARE 0.1  /* share of the reach: points closer to a boundary form the border set */
#define BORDER_DRAWS 8    /* surface points drawn for each border point wanted */
#define BLOCK        256
#define VIEWS        3
#define PIXELS_WIDE  320 /* a small picture, whose pixels are wider than a window */
#define PIXELS_HIGH  180

const char *const umbt_study_set_names[UMBT_STUDY_SET_COUNT] = {"view", "border", "free"};

struct tracing {
    struct umbt_study *study;
    size_t first;
};

double umbt_study_towards(const struct umbt_study_points *points, const double point[3],
                          double towards[3])
{
    return umbt_towards_light(points->lamp, points->to_light, point, towards);
}

/* Returns 1 if no opaque caster hides the light. share: gets the share of light that translucent
 * casters let through, 0 if an opaque one hides the light; NULL: not wanted. */
static int sees_light(const struct umbt_study *study, const double from[3], float *share)
{
    double towards[3];
    const double far = fmin(umbt_study_towards(&study->points, from, towards),
                            2.0 * study->common.scene.diagonal_m);
    const int lit = !umbr_occluded(study->common.scene.rays, from, towards, 0.0, far);
    if (share != NULL) {
        *share = lit ? (float)umbr_layers_pass(study->common.scene.casts.layers, from, towards, far)
                     : 0.0F;
    }
    return lit;
}

void umbt_study_tangents(const double normal[3], double u[3], double v[3])
{
    const int least = fabs(normal[0]) < fabs(normal[1])
                          ? (fabs(normal[0]) < fabs(normal[2]) ? 0 : 2)
                          : (fabs(normal[1]) < fabs(normal[2]) ? 1 : 2);
    double axis[3] = {0.0, 0.0, 0.0};
    axis[least] = 1.0;
    umb__cross(normal, axis, u);
    (void)umbt_normalize(u);
    umb__cross(normal, u, v);
}

/* Returns the hard truth at a distance from a surface point, along a tangent direction. */
static int lit_at(const struct umbt_study *study, const double from[3], const double along[3],
                  double distance)
{
    double at[3];
    umbt_along(from, distance, along, at);
    return sees_light(study, at, NULL);
}

/* Returns the least distance along a direction at which the truth is not `lit`, or infinity. */
static double distance_along(const struct umbt_study *study, const double from[3],
                             const double along[3], int lit, double nearest)
{
    double low = 0.0, high = study->points.reach_m / (double)(1 << (RINGS - 1));
    while (high < nearest && high <= study->points.reach_m &&
           lit_at(study, from, along, high) == lit) {
        low = high;
        high *= 2.0;
    }
    if (high >= nearest || high > study->points.reach_m) {
        return INFINITY;
    }
    for (int i = 0; i < HALVINGS; i++) {
        const double middle = 0.5 * (low + high);
        if (lit_at(study, from, along, middle) == lit) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return high;
}

static void trace_point(struct umbt_study *study, size_t i)
{
    struct umbt_study_points *points = &study->points;
    double normal[3], from[3], u[3], v[3], towards[3];
    umbt_widen(points->normals[i], normal);
    points->boundary_m[i] = INFINITY;
    if (!(umbt_normalize(normal) > 0.0)) {
        points->opaque[i] = (float)sees_light(study, points->positions[i], &points->sharp[i]);
        return;
    }
    (void)umbt_study_towards(points, points->positions[i], towards);
    if (!(umb__dot(normal, towards) > 0.0)) {
        points->opaque[i] = points->sharp[i] = 0.0F;
        return;
    }
    umbt_along(points->positions[i], SURFACE_LIFT * study->common.scene.diagonal_m, normal, from);
    const int lit = sees_light(study, from, &points->sharp[i]);
    points->opaque[i] = (float)lit;
    umbt_study_tangents(normal, u, v);
    double nearest = INFINITY;
    for (int d = 0; d < DIRECTIONS; d++) {
        const double angle = 6.283185307179586 * d / DIRECTIONS;
        double along[3] = {0.0, 0.0, 0.0};
        umbt_along(along, cos(angle), u, along);
        umbt_along(along, sin(angle), v, along);
        const double distance = distance_along(study, from, along, lit, nearest);
        nearest = distance < nearest ? distance : nearest;
    }
    points->boundary_m[i] = (float)nearest;
}

static void trace_item(void *user, size_t i)
{
    struct tracing *tracing = user;
    trace_point(tracing->study, tracing->first + i);
}

static enum umb_status trace_range(struct umbt_study *study, size_t first, size_t count,
                                   struct umb_error *error)
{
    struct tracing tracing = {study, first};
    return umbu_range_each(study->common.threads, count, BLOCK, trace_item, &tracing, error);
}

static enum umb_status room_make(struct umbt_study_points *points, size_t count,
                                 struct umb_error *error)
{
    points->positions = calloc(count, sizeof *points->positions);
    points->normals = calloc(count, sizeof *points->normals);
    points->opaque = calloc(count, sizeof *points->opaque);
    points->sharp = calloc(count, sizeof *points->sharp);
    points->boundary_m = calloc(count, sizeof *points->boundary_m);
    if (points->positions == NULL || points->normals == NULL || points->opaque == NULL ||
        points->sharp == NULL || points->boundary_m == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu samples do not fit in memory", count);
    }
    return UMB_OK;
}

static void append(struct umbt_study_points *points, const struct umbt_point_set *set, size_t count)
{
    memcpy(points->positions[points->count], set->positions, count * sizeof *set->positions);
    memcpy(points->normals[points->count], set->normals, count * sizeof *set->normals);
    points->count += count;
}

/* Returns a sum over a set's points: the side in metres of the square that a pixel of the view
 * covers there, as if the surface faced the eye. */
static double pixel_sides(const struct umbt_pixel_request *view, const struct umbt_point_set *set)
{
    struct umbt_camera camera;
    double sum = 0.0;
    if (umbt_camera_make(view->camera, view->subject, view->size[0], view->size[1], &camera,
                         NULL) != UMB_OK) {
        return 0.0;
    }
    for (size_t i = 0; i < set->count; i++) {
        sum += 2.0 * camera.tan_x / view->size[0] * umbt_camera_depth(&camera, set->positions[i]);
    }
    return sum;
}

/* Draws the points seen by three cameras around the scene; a camera that sees nothing is left
 * out. */
static enum umb_status views_draw(struct umbt_study *study, size_t wanted, struct umb_error *error)
{
    const struct umbt_camera_subject subject =
        umbt_subject(&study->common.scene, study->points.to_light, study->z_up);
    const double base = umbt_compass_azimuth(subject.to_light, subject.z_up, 0.0);
    enum umb_status status = UMB_E_BAD_SCENE;
    double sides = 0.0;
    for (int i = 0; i < VIEWS; i++) {
        const struct umbt_camera_request camera = {.has_azimuth = 1,
                                                   .azimuth_deg =
                                                       fmod(base + 80.0 + 120.0 * i, 360.0),
                                                   .has_elevation = 1,
                                                   .elevation_deg = 25.0 + 20.0 * i};
        const struct umbt_pixel_request view = {
            .scene = &study->common.scene,
            .camera = &camera,
            .subject = &subject,
            .size = {PIXELS_WIDE, PIXELS_HIGH},
            .count = wanted / VIEWS,
            .threads = study->common.threads,
        };
        struct umbt_point_set set = {0};
        const enum umb_status seen = umbt_points_of_pixels(&view, &set, error);
        if (seen == UMB_OK) {
            set.count = set.count < wanted / VIEWS ? set.count : wanted / VIEWS;
            append(&study->points, &set, set.count);
            sides += pixel_sides(&view, &set);
            status = UMB_OK;
        }
        umbt_point_set_finish(&set);
        if (seen == UMB_E_NO_MEMORY) {
            return seen;
        }
    }
    study->points.footprint_m = sides / (double)(study->points.count > 0 ? study->points.count : 1);
    return status;
}

static enum umb_status random_draw(struct umbt_study *study, enum umbt_point_kind kind,
                                   size_t wanted, struct umb_error *error)
{
    const struct umbt_point_request request = {
        .scene = &study->common.scene,
        .kind = kind,
        .count = wanted,
        .seed = study->common.seed + (uint64_t)kind,
        .threads = study->common.threads,
        .quiet = 1,
    };
    struct umbt_point_set set = {0};
    const enum umb_status status = umbt_points_sample(&request, &set, error);
    if (status == UMB_OK) {
        append(&study->points, &set, set.count < wanted ? set.count : wanted);
    }
    umbt_point_set_finish(&set);
    return status;
}

/* Keeps those surface points from `first` on that lie close to a boundary, at most `wanted`. */
static void border_keep(struct umbt_study_points *points, size_t first, size_t wanted)
{
    size_t kept = first;
    for (size_t i = first; i < points->count && kept < first + wanted; i++) {
        if ((double)points->boundary_m[i] <= BORDER_SHARE * points->reach_m) {
            memmove(points->positions[kept], points->positions[i], sizeof points->positions[i]);
            memmove(points->normals[kept], points->normals[i], sizeof points->normals[i]);
            points->opaque[kept] = points->opaque[i];
            points->sharp[kept] = points->sharp[i];
            points->boundary_m[kept] = points->boundary_m[i];
            kept++;
        }
    }
    points->count = kept;
}

static enum umb_status sets_draw(struct umbt_study *study, size_t wanted, struct umb_error *error)
{
    struct umbt_study_points *points = &study->points;
    UMB__TRY(views_draw(study, wanted, error));
    UMB__TRY(trace_range(study, 0, points->count, error));
    const size_t border = points->first[UMBT_STUDY_BORDER] = points->count;
    UMB__TRY(random_draw(study, UMBT_POINT_SURFACE, BORDER_DRAWS * wanted, error));
    UMB__TRY(trace_range(study, border, points->count - border, error));
    border_keep(points, border, wanted);
    const size_t free_first = points->first[UMBT_STUDY_FREE] = points->count;
    UMB__TRY(random_draw(study, UMBT_POINT_FREE, wanted, error));
    points->first[UMBT_STUDY_SET_COUNT] = points->count;
    return trace_range(study, free_first, points->count - free_first, error);
}

/* Sets the light: its direction, or the lamp. The way up stands for the direction of a point
 * light, for pictures. */
static void light_set(struct umbt_study *study)
{
    const struct umb_light_info *light = &study->bakes[0].light;
    struct umbt_study_points *points = &study->points;
    points->lamp = light->kind != UMB_LIGHT_DIRECTIONAL ? light : NULL;
    for (int k = 0; k < 3; k++) {
        points->to_light[k] = light->kind == UMB_LIGHT_POINT
                                  ? (k == (study->z_up ? 2 : 1) ? 1.0 : 0.0)
                                  : -light->direction[k];
    }
}

/* Returns the distance W of a point from a lamp along the axis of the frustum that contains the
 * point. That frustum gives the greatest W. */
static double lamp_w(const struct umbt_study_bake *bake, const double point[3])
{
    double place[3], greatest = 0.0;
    umb__subtract(point, bake->info.origin, place);
    for (uint32_t i = 0; i < bake->light.frustum_count; i++) {
        const double *row = bake->frusta[i].world_to_voxel[3];
        greatest = fmax(greatest, umb__dot(row, place) + row[3]);
    }
    return greatest;
}

/* Sets the edge of each asset's voxels; a lamp's grow with the distance, so the mean over the view
 * counts. */
static void voxels_measure(struct umbt_study *study)
{
    const size_t view = study->points.first[UMBT_STUDY_BORDER];
    for (uint32_t b = 0; b < study->bake_count; b++) {
        struct umbt_study_bake *bake = &study->bakes[b];
        const double(*step)[3] = umbt_study_frustum(bake)->voxel_step;
        double w = 0.0;
        for (size_t i = 0; study->points.lamp != NULL && i < view; i++) {
            w += lamp_w(bake, study->points.positions[i]) / (double)view;
        }
        bake->voxel_m = 0.5 * (umb__length(step[0]) + umb__length(step[1])) *
                        (study->points.lamp != NULL ? w : 1.0);
    }
}

enum umb_status umbt_study_points_make(struct umbt_study *study, struct umb_error *error)
{
    struct umbt_study_points *points = &study->points;
    const size_t wanted = (size_t)study->options.points;
    memset(points, 0, sizeof *points);
    points->reach_m = REACH_SHARE * study->common.scene.diagonal_m;
    light_set(study);
    UMB__TRY(room_make(points, (2 + BORDER_DRAWS) * wanted, error));
    UMB__TRY(sets_draw(study, wanted, error));
    voxels_measure(study);
    return UMB_OK;
}

void umbt_study_points_finish(struct umbt_study_points *points)
{
    free(points->positions);
    free(points->normals);
    free(points->opaque);
    free(points->sharp);
    free(points->boundary_m);
    memset(points, 0, sizeof *points);
}
