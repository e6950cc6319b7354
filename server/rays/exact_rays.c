/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Embree finds candidates, as user primitives; hits are computed in doubles.
 *
 * Boxes are padded by PAD of the scene's radius R, and rays are cut to the sphere around the scene
 * before they become floats. A ray in floats then deviates from the ray in doubles by at most
 * sqrt(3) 2^-24 (R + 2 R + 2 R) < 2^-20 R. The three terms come from the start, the direction over
 * a length of 2 R, and the corners of the boxes. Embree's robust box test itself errs on the safe
 * side.
 */
#include "rays/exact_rays.h"

#include <embree3/rtcore.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec.h"

#define PAD 0x1p-19

/* Distance by which a ray may miss an edge and still pass through it, as a share of the edge's
 * distance: 2^-53 for each of some twenty roundings. Signs alone could leave a gap at a corner. */
#define ROUNDING 0x1p-48

struct umbr_exact {
    RTCDevice device;
    RTCScene scene;
    const double (*corners)[3][3]; /* world */
    const struct umbs_cuts *cuts;  /* NULL: none */
    double base[3];                /* middle of the scene, world: origin of Embree's coordinates */
    double radius;                 /* metres, of the scene around base */
};

enum wanted {
    WANT_ANY,
    WANT_NEAREST,
    WANT_WINDING
};

/* Embree's context, extended by the ray in doubles and its nearest hit. */
struct search {
    struct RTCIntersectContext context; /* first field: Embree sees only this */
    const struct umbr_exact *exact;
    double from[3], direction[3]; /* relative to base */
    double far_m;
    enum wanted wanted;
    const uint8_t *closed; /* for WANT_WINDING */
    struct umbr_exact_hit nearest;
    int winding;
};

void umbr_sphere_of(const double (*corners)[3][3], size_t count, double centre[3], double *radius)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < 3 * count; i++) {
            const double value = corners[i / 3][i % 3][k];
            low = value < low ? value : low;
            high = value > high ? value : high;
        }
        centre[k] = low <= high ? 0.5 * low + 0.5 * high : 0;
        const double half = low <= high ? 0.5 * high - 0.5 * low : 0;
        square += half * half;
    }
    *radius = sqrt(square);
}

int umbr_is_hole(const struct umbs_cuts *cuts, uint32_t triangle, double second, double third)
{
    const uint32_t number = cuts->of[triangle];
    if (number >= UMBS_CUT_CLEAR || umbs_cut_is_translucent(cuts, number)) {
        return number != UMBS_CUT_NONE;
    }
    const float(*uv)[2] = cuts->cuts[number].uv;
    const double first = 1 - second - third;
    const double u =
        first * (double)uv[0][0] + second * (double)uv[1][0] + third * (double)uv[2][0];
    const double v =
        first * (double)uv[0][1] + second * (double)uv[1][1] + third * (double)uv[2][1];
    return !umbs_cut_keeps(cuts, number, u, v);
}

static void triangle_bounds(const struct RTCBoundsFunctionArguments *arguments)
{
    const struct umbr_exact *exact = arguments->geometryUserPtr;
    const double(*v)[3] = exact->corners[arguments->primID];
    const double pad = PAD * exact->radius;
    float low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = (float)(fmin(fmin(v[0][k], v[1][k]), v[2][k]) - exact->base[k] - pad);
        high[k] = (float)(fmax(fmax(v[0][k], v[1][k]), v[2][k]) - exact->base[k] + pad);
    }
    struct RTCBounds *box = arguments->bounds_o;
    box->lower_x = low[0];
    box->lower_y = low[1];
    box->lower_z = low[2];
    box->upper_x = high[0];
    box->upper_y = high[1];
    box->upper_z = high[2];
}

static double largest(const double a[3])
{
    return fmax(fmax(fabs(a[0]), fabs(a[1])), fabs(a[2]));
}

/*
 * Returns the side of the edge a, b on which a ray from the origin passes: the sign of the volume
 * that ray and edge span, or 0 if rounding decides. The Pluecker form of difference and sum has an
 * error in proportion to the length of the edge, not to its distance. Exchanging a and b changes
 * the sign and no other bit.
 */
static double side_of_edge(const double a[3], const double b[3], const double direction[3])
{
    double difference[3], sum[3], across[3];
    for (int k = 0; k < 3; k++) {
        difference[k] = a[k] - b[k];
        sum[k] = a[k] + b[k];
    }
    umb__cross(difference, sum, across);
    const double side = umb__dot(direction, across);
    return fabs(side) <= ROUNDING * largest(difference) * largest(sum) ? 0 : side;
}

/* Tests a ray against a triangle. Returns 1 with the distance, the weights of the corners and
 * whether the ray meets the back; else 0. */
static int hit_triangle(const struct search *search, uint32_t triangle, double *distance,
                        double weight[3], int *leaving)
{
    const double(*v)[3] = search->exact->corners[triangle];
    double at[3][3], edge[3], normal[3], one[3], two[3], sum = 0;
    int before = 0, beyond = 0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            at[i][k] = (v[i][k] - search->exact->base[k]) - search->from[k];
        }
    }
    for (int i = 0; i < 3; i++) {
        edge[i] = side_of_edge(at[(i + 1) % 3], at[(i + 2) % 3], search->direction);
        before |= edge[i] < 0;
        beyond |= edge[i] > 0;
        sum += edge[i];
    }
    if (before == beyond) { /* on both sides, or the triangle is seen edge on */
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        one[k] = at[1][k] - at[0][k];
        two[k] = at[2][k] - at[0][k];
        weight[k] = edge[k] / sum;
    }
    umb__cross(one, two, normal);
    *distance = umb__dot(normal, at[0]) / umb__dot(normal, search->direction);
    *leaving = beyond;
    return *distance >= 0 && *distance <= search->far_m; /* a NaN is no hit */
}

static void triangle_candidate(const struct RTCOccludedFunctionNArguments *arguments)
{
    /* The context is the search's first member, so the cast yields the search. */
    struct search *search = (struct search *)(void *)arguments->context;
    const struct umbs_cuts *cuts = search->exact->cuts;
    const uint32_t triangle = arguments->primID;
    double distance, weight[3];
    int leaving;
    if (arguments->valid[0] == 0 || !hit_triangle(search, triangle, &distance, weight, &leaving) ||
        (cuts != NULL && umbr_is_hole(cuts, triangle, weight[1], weight[2]))) {
        return;
    }
    if (search->wanted == WANT_ANY) {
        ((struct RTCRay *)(void *)arguments->ray)->tfar = -INFINITY; /* ends the search */
        search->nearest.distance = distance;
    } else if (search->wanted == WANT_WINDING) {
        search->winding += search->closed[triangle] ? (leaving ? 1 : -1) : 0;
    } else if (search->nearest.distance < 0 || distance < search->nearest.distance) {
        search->nearest = (struct umbr_exact_hit){distance, triangle, leaving};
    }
}

static int build_scene(struct umbr_exact *exact, size_t count)
{
    exact->scene = rtcNewScene(exact->device);
    RTCGeometry geometry = rtcNewGeometry(exact->device, RTC_GEOMETRY_TYPE_USER);
    if (exact->scene == NULL || geometry == NULL) {
        if (geometry != NULL) {
            rtcReleaseGeometry(geometry);
        }
        return 0;
    }
    rtcSetSceneFlags(exact->scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetGeometryUserPrimitiveCount(geometry, (unsigned)count);
    rtcSetGeometryUserData(geometry, exact);
    rtcSetGeometryBoundsFunction(geometry, triangle_bounds, NULL);
    rtcSetGeometryOccludedFunction(geometry, triangle_candidate);
    rtcCommitGeometry(geometry);
    (void)rtcAttachGeometry(exact->scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(exact->scene);
    return rtcGetDeviceError(exact->device) == RTC_ERROR_NONE;
}

enum umb_status umbr_exact_create(const double (*corners)[3][3], size_t count,
                                  const struct umbs_cuts *cuts, unsigned threads,
                                  struct umbr_exact **out, struct umb_error *error)
{
    char config[32];
    *out = NULL;
    struct umbr_exact *exact = umb__alloc_zeroed(NULL, 1, sizeof *exact);
    if (exact == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for rays in doubles");
    }
    exact->corners = corners;
    exact->cuts = cuts;
    umbr_sphere_of(corners, count, exact->base, &exact->radius);
    (void)snprintf(config, sizeof config, "threads=%u", threads);
    exact->device = rtcNewDevice(config);
    if (exact->device == NULL) {
        umb__free(NULL, exact);
        return umb_fail(error, UMB_E_INTERNAL, "rays in doubles: Embree gives no device (error %d)",
                        (int)rtcGetDeviceError(NULL));
    }
    if (!build_scene(exact, count)) {
        umbr_exact_destroy(exact);
        return umb_fail(error, UMB_E_NO_MEMORY,
                        "rays in doubles: Embree could not build %zu triangles", count);
    }
    *out = exact;
    return UMB_OK;
}

void umbr_exact_destroy(struct umbr_exact *exact)
{
    if (exact == NULL) {
        return;
    }
    if (exact->scene != NULL) {
        rtcReleaseScene(exact->scene);
    }
    rtcReleaseDevice(exact->device);
    umb__free(NULL, exact);
}

/* Finds the part of a ray inside the padded sphere around the scene; returns 0 if there is none. */
static int cut_to_scene(const struct search *search, double *begin, double *end)
{
    const double radius = search->exact->radius * (1 + 4 * PAD);
    const double nearest = -umb__dot(search->from, search->direction);
    double square = radius * radius;
    for (int k = 0; k < 3; k++) {
        const double off = search->from[k] + nearest * search->direction[k];
        square -= off * off;
    }
    if (!(square >= 0)) {
        return 0;
    }
    *begin = fmax(nearest - sqrt(square), 0);
    *end = fmin(nearest + sqrt(square), search->far_m);
    return *begin <= *end;
}

static void run(struct search *search, const struct umbr_exact_ray *ray)
{
    double begin, end;
    search->nearest = (struct umbr_exact_hit){.distance = -1, .triangle = UINT32_MAX};
    search->winding = 0;
    search->far_m = ray->far_m;
    for (int k = 0; k < 3; k++) {
        search->from[k] = ray->from[k] + (ray->origin[k] - search->exact->base[k]);
        search->direction[k] = ray->direction[k];
    }
    if (!cut_to_scene(search, &begin, &end)) {
        return;
    }
    const double *d = search->direction;
    const double pad = PAD * search->exact->radius;
    struct RTCRay traced = {
        .org_x = (float)(search->from[0] + begin * d[0]),
        .org_y = (float)(search->from[1] + begin * d[1]),
        .org_z = (float)(search->from[2] + begin * d[2]),
        .dir_x = (float)d[0],
        .dir_y = (float)d[1],
        .dir_z = (float)d[2],
        .tfar = (float)(end - begin + pad),
        .mask = UINT32_MAX,
    };
    rtcInitIntersectContext(&search->context);
    rtcOccluded1(search->exact->scene, &search->context, &traced);
}

int umbr_exact_occluded(const struct umbr_exact *exact, const struct umbr_exact_ray *ray)
{
    struct search search = {.exact = exact, .wanted = WANT_ANY};
    run(&search, ray);
    return search.nearest.distance >= 0;
}

void umbr_exact_nearest(const struct umbr_exact *exact, const struct umbr_exact_ray *ray,
                        struct umbr_exact_hit *hit)
{
    struct search search = {.exact = exact, .wanted = WANT_NEAREST};
    run(&search, ray);
    *hit = search.nearest;
}

int umbr_exact_winding(const struct umbr_exact *exact, const struct umbr_exact_ray *ray,
                       const uint8_t *closed)
{
    struct search search = {.exact = exact, .wanted = WANT_WINDING, .closed = closed};
    run(&search, ray);
    return search.winding;
}
