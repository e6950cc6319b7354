/* SPDX-License-Identifier: Apache-2.0 */
/* Framing on what casts; see frame_casters.h. */
#include "study/frame_casters.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

enum {
    WIDTH = 96, /* pixels of the coarse picture */
    HEIGHT = 54,
    LEVELS = 14,        /* squares of 1/2 to 1/2^14 of the plan's side */
    CANDIDATES = 65536, /* triangles that are asked whether they cast */
};

#define ENOUGH     0.04  /* share of shadow at which the whole scene is shown */
#define FEW_TIMES  3.0   /* a part must show so many times the whole scene's share */
#define BEST_SHARE 0.6   /* a part must show at least this share of what the best one shows */
#define LONG_SHARE 0.125 /* share of the plan's side from which on an edge is long */
#define MOST       0.5   /* share of the casters that a part by shadow must hold */
#define CASTERS    100   /* least number of casters in such a part */
#define LIFT       1e-5  /* start of rays off their surface, in diagonals of the scene */

/* Measure of a picture: share of shadow, or of things. */
enum measure {
    SHADOW,
    THINGS,
};

/* Shares at which no narrower part is tried. */
static const double good_share[] = {[SHADOW] = 0.12, [THINGS] = 0.03};

/* Middle of a triangle that counts, on the two axes of the plan. */
struct caster {
    double at[2];
};

struct framing {
    const struct umbt_scene *scene;
    const struct umbt_camera_subject *whole;
    const struct umbt_camera_request *request;
    const uint32_t *size;
    enum measure measure;
    int axes[2]; /* axes of the plan */
    struct caster *casters;
    size_t count;
    double corner[2], side; /* square that holds the plan, metres */
};

/* Moves a place off its surface, to the side where the unit vector `side` points. */
static void lift(const struct umbt_scene *scene, const double at[3], const double normal[3],
                 const double side[3], double start[3])
{
    const double way = LIFT * scene->diagonal_m;
    umbt_along(at, umb__dot(normal, side) < 0.0 ? -way : way, normal, start);
}

/* Returns 1 if the light that a surface stops would meet another surface, one that faces the light.
 * The inner side of the same solid does not count. */
static int casts(const struct umbt_scene *scene, const double at[3], const double normal[3],
                 const double to_light[3])
{
    double away[3], start[3];
    struct umbr_hit hit;
    for (int k = 0; k < 3; k++) {
        away[k] = -to_light[k];
    }
    lift(scene, at, normal, away, start);
    umbr_nearest(scene->rays, start, away, 0.0, INFINITY, &hit);
    if (!(hit.distance >= 0.0)) {
        return 0;
    }
    return !scene->parts.closed[hit.triangle] || umb__dot(hit.normal, to_light) > 0.0;
}

static int is_shadowed(const struct umbt_scene *scene, const double at[3], const double normal[3],
                       const double to_eye[3], const double to_light[3])
{
    double start[3];
    lift(scene, at, normal, to_eye, start);
    return umbr_occluded(scene->rays, start, to_light, 0.0, INFINITY);
}

/* Returns 1 if all edges of a triangle are short compared with the side of the ground plan. */
static int is_thing(const struct framing *f, uint32_t triangle)
{
    const double(*corners)[3] = (const double(*)[3])f->scene->corners[triangle];
    double longest = 0.0;
    for (int k = 0; k < 3; k++) {
        double edge[3];
        umb__subtract(corners[k], corners[(k + 1) % 3], edge);
        longest = fmax(longest, umb__length(edge));
    }
    return longest <= LONG_SHARE * f->side;
}

static void casters_find(struct framing *f)
{
    const struct umbt_scene *scene = f->scene;
    const size_t step = scene->count / CANDIDATES + 1;
    f->count = 0;
    for (size_t i = 0; i < scene->count; i += step) {
        const double(*corners)[3] = (const double(*)[3])scene->corners[i];
        double middle[3], normal[3];
        for (int k = 0; k < 3; k++) {
            middle[k] = (corners[0][k] + corners[1][k] + corners[2][k]) / 3.0;
        }
        umb__triangle_cross(corners, normal);
        (void)umbt_normalize(normal);
        if (f->measure == THINGS ? is_thing(f, (uint32_t)i)
                                 : casts(scene, middle, normal, f->whole->to_light)) {
            f->casters[f->count++] = (struct caster){{middle[f->axes[0]], middle[f->axes[1]]}};
        }
    }
}

/* Share of a picture's pixels that count. */
static double share_of(const struct framing *f, const struct umbt_camera *camera)
{
    const double *to_light = f->whole->to_light;
    size_t found = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double direction[3], at[3], to_eye[3];
        struct umbr_hit hit;
        umbt_camera_ray(camera, (i % WIDTH + 0.5) / WIDTH, (i / WIDTH + 0.5) / HEIGHT, direction);
        umbr_nearest(f->scene->rays, camera->eye, direction, 0.0, INFINITY, &hit);
        if (!(hit.distance >= 0.0)) {
            continue;
        }
        umbt_along(camera->eye, hit.distance, direction, at);
        for (int k = 0; k < 3; k++) {
            to_eye[k] = -direction[k];
        }
        found += (size_t)(f->measure == THINGS
                              ? is_thing(f, hit.triangle)
                              : is_shadowed(f->scene, at, hit.normal, to_eye, to_light) ||
                                    casts(f->scene, at, hit.normal, to_light));
    }
    return (double)found / (WIDTH * HEIGHT);
}

/* Number of casters in a cell of a grid. The grid has 4^14 cells, so the cells are in a hash
 * table. */
struct cell {
    uint64_t key;   /* 0: unused; else 1 + the cell's number */
    uint32_t count; /* number of casters */
};

static struct cell *cell_find(struct cell *cells, size_t mask, uint64_t key)
{
    size_t at = (size_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> 20) & mask;
    while (cells[at].key != 0 && cells[at].key != key) {
        at = (at + 1) & mask;
    }
    return &cells[at];
}

/* Key of a cell; 0 outside of the grid. */
static uint64_t cell_key(int64_t x, int64_t y)
{
    return x < 0 || y < 0 ? 0 : 1 + ((uint64_t)x << 32 | (uint64_t)y);
}

/* Counts casters in cells of 1 / 2^level of the plan's side, and returns the square of 2 x 2 cells
 * with the most. */
static uint32_t square_find(const struct framing *f, int level, struct cell *cells, size_t mask,
                            double corner[2])
{
    const double cell_m = ldexp(f->side, -level);
    uint32_t most = 0;
    memset(cells, 0, (mask + 1) * sizeof *cells);
    for (size_t i = 0; i < f->count; i++) {
        const int64_t x = (int64_t)((f->casters[i].at[0] - f->corner[0]) / cell_m);
        const int64_t y = (int64_t)((f->casters[i].at[1] - f->corner[1]) / cell_m);
        struct cell *cell = cell_find(cells, mask, cell_key(x, y));
        cell->key = cell_key(x, y);
        cell->count++;
    }
    for (size_t i = 0; i <= mask; i++) {
        const int64_t x = (int64_t)((cells[i].key - 1) >> 32),
                      y = (int64_t)(uint32_t)(cells[i].key - 1);
        for (int k = 0; k < 4 && cells[i].key != 0; k++) {
            const int64_t left = x - (k & 1), low = y - (k >> 1);
            uint32_t sum = 0;
            for (int n = 0; n < 4; n++) {
                const uint64_t key = cell_key(left + (n & 1), low + (n >> 1));
                sum += key != 0 ? cell_find(cells, mask, key)->count : 0;
            }
            if (sum > most) {
                most = sum;
                corner[0] = f->corner[0] + (double)left * cell_m;
                corner[1] = f->corner[1] + (double)low * cell_m;
            }
        }
    }
    return most;
}

/* Collects the corners of all triangles that lie in a square; returns their number. */
static size_t square_points(const struct framing *f, const double corner[2], double side,
                            double (*points)[3])
{
    size_t count = 0;
    for (size_t i = 0; i < 3 * f->scene->count; i++) {
        const double *p = f->scene->corners[i / 3][i % 3];
        const double x = p[f->axes[0]] - corner[0], y = p[f->axes[1]] - corner[1];
        if (x >= 0.0 && x <= side && y >= 0.0 && y <= side) {
            memcpy(points[count++], p, sizeof *points);
        }
    }
    return count;
}

static void box_of(const double (*points)[3], size_t count, struct umb_box *box)
{
    for (int k = 0; k < 3; k++) {
        box->min[k] = INFINITY;
        box->max[k] = -INFINITY;
        for (size_t i = 0; i < count; i++) {
            box->min[k] = fmin(box->min[k], points[i][k]);
            box->max[k] = fmax(box->max[k], points[i][k]);
        }
    }
}

struct part {
    double corner[2], side, share;
    uint32_t inside; /* number of casters */
};

static enum umb_status part_measure(const struct framing *f, struct part *part, double (*points)[3],
                                    struct umb_error *error)
{
    struct umbt_camera_subject subject = *f->whole;
    struct umbt_camera camera;
    subject.points = (const double(*)[3])points;
    subject.count = square_points(f, part->corner, part->side, points);
    if (subject.count < 3) {
        return UMB_OK;
    }
    box_of((const double(*)[3])points, subject.count, &subject.box);
    UMB__TRY(umbt_camera_make(f->request, &subject, f->size[0], f->size[1], &camera, error));
    part->share = share_of(f, &camera);
    return UMB_OK;
}

/* 1 if a part is worth showing instead of the whole. */
static int is_better(const struct framing *f, const struct part *part, double whole_share,
                     double best)
{
    const double enough = fmin(BEST_SHARE * best, good_share[f->measure]);
    return part->share > 0.0 && part->share >= enough && part->share >= FEW_TIMES * whole_share &&
           (f->measure == THINGS || (best >= good_share[SHADOW] && part->inside >= CASTERS &&
                                     part->inside >= MOST * (double)f->count));
}

/* Measures the parts, the widest first. Out: chosen: the one to show; share 0: none. */
static enum umb_status parts_measure(const struct framing *f, double whole_share,
                                     struct cell *cells, size_t mask, double (*points)[3],
                                     struct part *chosen, struct umb_error *error)
{
    struct part parts[LEVELS + 1];
    double best = 0.0;
    int last = 0;
    memset(parts, 0, sizeof parts);
    for (int level = 1; level <= LEVELS && best < good_share[f->measure]; level++) {
        struct part *part = &parts[level];
        part->inside = square_find(f, level, cells, mask, part->corner);
        if (part->inside < 2) {
            break;
        }
        part->side = ldexp(f->side, 1 - level);
        UMB__TRY(part_measure(f, part, points, error));
        best = fmax(best, part->share);
        last = level;
    }
    for (int level = 1; level <= last && !(chosen->share > 0.0); level++) {
        if (is_better(f, &parts[level], whole_share, best)) {
            *chosen = parts[level];
        }
    }
    return UMB_OK;
}

static void plan_measure(struct framing *f)
{
    const struct umb_box *box = &f->whole->box;
    f->side = 0.0;
    for (int k = 0; k < 2; k++) {
        f->corner[k] = box->min[f->axes[k]];
        f->side = fmax(f->side, box->max[f->axes[k]] - box->min[f->axes[k]]);
    }
    f->side = nextafter(f->side, INFINITY) * (1.0 + 1e-12);
}

/* Chooses a part by a measure. Out: chosen: share 0: none. */
static enum umb_status part_choose(struct framing *f, double whole_share, double (*points)[3],
                                   struct part *chosen, struct umb_error *error)
{
    size_t mask = 1;
    casters_find(f);
    while (mask < 4 * f->count + 16) {
        mask = 2 * mask + 1;
    }
    struct cell *cells = calloc(mask + 1, sizeof *cells);
    if (cells == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu casters do not fit in memory", f->count);
    }
    const enum umb_status status =
        f->count > 0 && f->side > 0.0
            ? parts_measure(f, whole_share, cells, mask, points, chosen, error)
            : UMB_OK;
    free(cells);
    return status;
}

/* Chooses a part by things if the camera of the whole scene shows few, else by shadow. */
static enum umb_status framing_choose(struct framing *f, const struct umbt_camera *camera,
                                      double (*points)[3], struct part *chosen,
                                      struct umb_error *error)
{
    const double shadow = share_of(f, camera);
    if (shadow >= ENOUGH) {
        return UMB_OK;
    }
    f->measure = THINGS;
    const double things = share_of(f, camera);
    if (things < good_share[THINGS]) {
        return part_choose(f, things, points, chosen, error);
    }
    f->measure = SHADOW;
    return part_choose(f, shadow, points, chosen, error);
}

/* Adds the places on a plane at the foot of a subject where the corners of its box cast their
 * shadows, at most a diagonal of the box away. Returns the number of points. */
static size_t add_shadows(const struct umbt_camera_subject *subject, double (*points)[3])
{
    const int up = subject->z_up ? 2 : 1;
    const struct umb_box *box = &subject->box;
    const double high = box->max[up] - box->min[up], *to_light = subject->to_light;
    double across[3] = {0.0, 0.0, 0.0}, size[3];
    umb__subtract(box->max, box->min, size);
    if (!(to_light[up] > 0.0)) {
        return subject->count; /* light from below casts nothing on the ground */
    }
    umbt_along(across, -high / to_light[up], to_light, across);
    across[up] = 0.0;
    const double far = umb__length(across), most = umb__length(size);
    for (size_t i = 0; i < 4; i++) {
        double *corner = points[subject->count + i];
        for (int k = 0, bit = 0; k < 3; k++) {
            corner[k] = k == up ? box->min[k] : (i >> bit++ & 1) ? box->max[k] : box->min[k];
        }
        umbt_along(corner, far > most ? most / far : 1.0, across, corner);
    }
    return subject->count + 4;
}

enum umb_status umbt_frame_casters(const struct umbt_scene *scene,
                                   const struct umbt_camera_request *request,
                                   const struct umbt_camera_subject *whole, const uint32_t size[2],
                                   int with_ground, struct umbt_camera_subject *subject,
                                   double (**points)[3], struct umb_error *error)
{
    struct framing f = {.scene = scene, .whole = whole, .request = request, .size = size};
    struct part chosen = {.share = 0.0};
    struct umbt_camera camera;
    f.axes[0] = 0;
    f.axes[1] = whole->z_up ? 1 : 2;
    *subject = *whole;
    *points = NULL;
    if (request->has_eye) {
        return UMB_OK;
    }
    UMB__TRY(umbt_camera_make(request, whole, size[0], size[1], &camera, error));
    double(*corners)[3] = malloc((3 * scene->count + 4) * sizeof *corners);
    f.casters = calloc(CANDIDATES + 1, sizeof *f.casters);
    plan_measure(&f);
    const enum umb_status status =
        corners != NULL && f.casters != NULL
            ? framing_choose(&f, &camera, corners, &chosen, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "out of memory for framing a scene");
    free(f.casters);
    if (status != UMB_OK) {
        free(corners);
        return status;
    }
    if (chosen.share > 0.0) {
        subject->count = square_points(&f, chosen.corner, chosen.side, corners);
        box_of((const double(*)[3])corners, subject->count, &subject->box);
    } else {
        memcpy(corners, whole->points, whole->count * sizeof *corners);
    }
    subject->count = with_ground ? add_shadows(subject, corners) : subject->count;
    subject->points = (const double(*)[3])corners;
    *points = corners;
    return UMB_OK;
}
