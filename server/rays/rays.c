/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Embree 3.13 behind rays.h: one triangle geometry, robust.
 *
 * The vertices that Embree traces, floats relative to the centre, stay readable in its own buffer.
 * Normals and the treatment of shared edges are computed from them in doubles.
 *
 * Counting all crossings needs care in three places:
 * - Embree's high-quality build may split triangles among leaves, and its manual allows the filter
 *   to be called twice for one hit then. Hits are kept in a list without repetitions.
 * - The list has a fixed size (a query allocates nothing). A ray with more hits is traced again
 *   for those beyond the last one kept, until none are left: exact for any number.
 * - A ray through an edge or a corner that two facets share hits both, which is one crossing of
 *   the surface. Hits on a triangle's border that face the same way at the same distance and touch
 *   in a vertex count once. On a silhouette they face opposite ways and cancel each other.
 *
 * Source: Wald et al. 2014 (Embree); Woop, Benthin, Wald 2013 (watertight intersection).
 */
#include "rays/rays.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include <embree3/rtcore.h>

#include "base/memory.h"
#include "base/vec.h"

enum {
    HITS_MAX = 128, /* hits kept at a time; rays through a city have fewer than twenty */
};

/* Barycentric coordinate below which a hit is on the border: 16 times the float rounding. */
static const double border_coordinate = 16 * FLT_EPSILON;

/* Hits closer together than this share of their distance (and of a metre) may be one crossing. */
static const double same_distance = 64 * FLT_EPSILON;

/* Hierarchy for rays in doubles, built by the first request. */
struct exact_slot {
    pthread_mutex_t lock; /* guards the rest while it is being filled in */
    struct umbr_exact *exact;
    const double (*corners)[3][3];
    unsigned threads;
};

struct umbr_rays {
    RTCDevice device;
    RTCScene scene;
    const float (*vertices)[3]; /* [3 * count], relative to centre; Embree's buffer */
    double centre[3];
    double radius; /* metres: distance of the farthest corner from the centre, or more */
    size_t count;
    enum RTCBuildQuality quality;
    const struct umbs_cuts *cuts; /* NULL: none */
    struct exact_slot *slot;
};

struct crossing {
    float distance;
    uint32_t triangle;
    float second, third; /* weights of the corners */
    int32_t sign;        /* +1 back-facing (leaving a solid), -1 front-facing */
    int32_t border;      /* 1 if the hit lies on the triangle's border */
};

/* The context of one all-hits ray. Embree passes its first member back to the filter. */
struct crossing_list {
    struct RTCIntersectContext context;
    const uint8_t *only;            /* [triangles] not 0: counts; NULL: all count */
    struct crossing hits[HITS_MAX]; /* sorted by distance, then triangle */
    size_t count;
    int more;     /* 1 if hits were left out */
    int has_last; /* 1 if only hits beyond `last` count */
    struct crossing last;
};

struct build_report {
    enum RTCError code;
    char text[160];
};

static void note_error(void *user, enum RTCError code, const char *text)
{
    struct build_report *report = user;
    if (report->code == RTC_ERROR_NONE) {
        report->code = code;
        (void)snprintf(report->text, sizeof report->text, "%s", text != NULL ? text : "");
    }
}

/* Copies a four-byte number of hit i of n. Embree names these numbers for C++ only; their order is
 * that of struct RTCHit. */
static void hit_number(const struct RTCHitN *hit, unsigned n, unsigned i, size_t offset, void *out)
{
    memcpy(out, (const char *)hit + offset * n + 4 * (size_t)i, 4);
}

/* Refuses hits where the texture cuts the triangle out. This is Embree's filter for scenes with
 * holes, for one ray or for a packet. */
static void refuse_holes(const struct RTCFilterFunctionNArguments *arguments)
{
    const struct RTCHitN *hit = arguments->hit;
    const unsigned n = arguments->N;
    for (unsigned i = 0; i < n; i++) {
        uint32_t triangle;
        float u, v;
        if (arguments->valid[i] == 0) {
            continue;
        }
        hit_number(hit, n, i, offsetof(struct RTCHit, primID), &triangle);
        hit_number(hit, n, i, offsetof(struct RTCHit, u), &u);
        hit_number(hit, n, i, offsetof(struct RTCHit, v), &v);
        if (umbr_is_hole(arguments->geometryUserPtr, triangle, (double)u, (double)v)) {
            arguments->valid[i] = 0;
        }
    }
}

/* Passes the triangles to Embree; on failure Embree has reported why. */
static int add_geometry(struct umbr_rays *rays, const double (*corners)[3][3])
{
    RTCGeometry geometry = rtcNewGeometry(rays->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (geometry == NULL) {
        return 0;
    }
    float *vertices = rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 3 * rays->count);
    uint32_t *indices = rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), rays->count);
    if (vertices == NULL || indices == NULL) {
        rtcReleaseGeometry(geometry);
        return 0;
    }
    for (size_t t = 0; t < rays->count; t++) {
        for (size_t k = 0; k < 9; k++) {
            vertices[9 * t + k] = (float)(corners[t][k / 3][k % 3] - rays->centre[k % 3]);
        }
        for (size_t k = 0; k < 3; k++) {
            indices[3 * t + k] = (uint32_t)(3 * t + k);
        }
    }
    rays->vertices = (const float(*)[3])vertices;
    if (rays->cuts != NULL) {
        rtcSetGeometryUserData(geometry, (void *)(uintptr_t)rays->cuts);
        rtcSetGeometryIntersectFilterFunction(geometry, refuse_holes);
        rtcSetGeometryOccludedFilterFunction(geometry, refuse_holes);
    }
    rtcSetGeometryBuildQuality(geometry, rays->quality);
    rtcCommitGeometry(geometry);
    (void)rtcAttachGeometry(rays->scene, geometry);
    rtcReleaseGeometry(geometry); /* the scene holds it, and with it the vertices */
    return 1;
}

static int build_scene(struct umbr_rays *rays, const double (*corners)[3][3])
{
    rays->scene = rtcNewScene(rays->device);
    if (rays->scene == NULL) {
        return 0;
    }
    rtcSetSceneFlags(rays->scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
    rtcSetSceneBuildQuality(rays->scene, rays->quality);
    if (rays->count > 0 && !add_geometry(rays, corners)) {
        return 0;
    }
    rtcCommitScene(rays->scene);
    return rtcGetDeviceError(rays->device) == RTC_ERROR_NONE;
}

static int open_slot(struct umbr_rays *rays, const double (*corners)[3][3], unsigned threads)
{
    struct exact_slot *slot = umb__alloc_zeroed(NULL, 1, sizeof *slot);
    if (slot == NULL || pthread_mutex_init(&slot->lock, NULL) != 0) {
        umb__free(NULL, slot);
        return 0;
    }
    slot->corners = corners;
    slot->threads = threads;
    rays->slot = slot;
    return 1;
}

enum umb_status umbr_rays_exact(const struct umbr_rays *rays, const struct umbr_exact **exact,
                                struct umb_error *error)
{
    struct exact_slot *slot = rays->slot;
    enum umb_status status = UMB_OK;
    (void)pthread_mutex_lock(&slot->lock);
    if (slot->exact == NULL) {
        status = umbr_exact_create(slot->corners, rays->count, rays->cuts, slot->threads,
                                   &slot->exact, error);
    }
    *exact = slot->exact;
    (void)pthread_mutex_unlock(&slot->lock);
    return status;
}

double umbr_rays_error_m(const struct umbr_rays *rays)
{
    return 0x1p-20 * rays->radius;
}

enum umb_status umbr_rays_build(const double (*corners)[3][3], size_t count,
                                const struct umbr_rays_options *options, struct umbr_rays **out,
                                struct umb_error *error)
{
    const struct umbr_rays_options chosen =
        options != NULL ? *options : (struct umbr_rays_options){0};
    char config[32];
    *out = NULL;
    if (count > UINT32_MAX / 3) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%zu triangles to trace; the limit is %u", count,
                        (unsigned)(UINT32_MAX / 3));
    }
    struct umbr_rays *rays = umb__alloc_zeroed(NULL, 1, sizeof *rays);
    if (rays == NULL || !open_slot(rays, corners, chosen.threads)) {
        umb__free(NULL, rays);
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory for a ray tracer");
    }
    rays->count = count;
    rays->quality = chosen.quick ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_HIGH;
    rays->cuts = chosen.cuts != NULL && chosen.cuts->of != NULL ? chosen.cuts : NULL;
    umbr_sphere_of(corners, count, rays->centre, &rays->radius);
    struct build_report report = {.code = RTC_ERROR_NONE};
    (void)snprintf(config, sizeof config, "threads=%u", chosen.threads); /* 0: Embree uses all */
    rays->device = rtcNewDevice(config);
    if (rays->device == NULL) {
        report.code = rtcGetDeviceError(NULL);
        (void)snprintf(report.text, sizeof report.text, "cannot make a device");
    } else {
        rtcSetDeviceErrorFunction(rays->device, note_error, &report);
        if (!build_scene(rays, corners) && report.code == RTC_ERROR_NONE) {
            note_error(&report, RTC_ERROR_UNKNOWN, "cannot build the scene");
        }
        rtcSetDeviceErrorFunction(rays->device, NULL, NULL);
    }
    if (report.code != RTC_ERROR_NONE || rays->device == NULL) {
        umbr_rays_destroy(rays);
        return umb_fail(error,
                        report.code == RTC_ERROR_OUT_OF_MEMORY ? UMB_E_NO_MEMORY : UMB_E_INTERNAL,
                        "Embree, building %zu triangles: %s", count, report.text);
    }
    *out = rays;
    return UMB_OK;
}

void umbr_rays_destroy(struct umbr_rays *rays)
{
    if (rays == NULL) {
        return;
    }
    if (rays->scene != NULL) {
        rtcReleaseScene(rays->scene);
    }
    if (rays->device != NULL) {
        rtcReleaseDevice(rays->device);
    }
    umbr_exact_destroy(rays->slot->exact);
    (void)pthread_mutex_destroy(&rays->slot->lock);
    umb__free(NULL, rays->slot);
    umb__free(NULL, rays);
}

static struct RTCRay ray_of(const struct umbr_rays *rays, const double from[3],
                            const double direction[3], double near_m, double far_m)
{
    struct RTCRay ray = {
        .org_x = (float)(from[0] - rays->centre[0]),
        .org_y = (float)(from[1] - rays->centre[1]),
        .org_z = (float)(from[2] - rays->centre[2]),
        .dir_x = (float)direction[0],
        .dir_y = (float)direction[1],
        .dir_z = (float)direction[2],
        .tnear = near_m > 0 ? (float)near_m : 0, /* Embree requires it */
        .tfar = (float)far_m,
        .mask = UINT32_MAX,
    };
    return ray;
}

int umbr_occluded(const struct umbr_rays *rays, const double from[3], const double direction[3],
                  double near_m, double far_m)
{
    struct RTCIntersectContext context;
    struct RTCRay ray = ray_of(rays, from, direction, near_m, far_m);
    if (!(ray.tfar >= ray.tnear)) {
        return 0; /* an empty range; Embree leaves its result undefined */
    }
    rtcInitIntersectContext(&context);
    rtcOccluded1(rays->scene, &context, &ray);
    return isinf(ray.tfar) && ray.tfar < 0; /* Embree's mark of a hit */
}

void umbr_occluded8(const struct umbr_rays *rays, const double (*from)[3],
                    const double direction[3], double near_m, double far_m, uint8_t occluded[8])
{
    struct RTCIntersectContext context;
    struct RTCRay8 packet;
    _Alignas(32) int valid[8];
    for (int i = 0; i < 8; i++) {
        const struct RTCRay ray = ray_of(rays, from[i], direction, near_m, far_m);
        valid[i] = ray.tfar >= ray.tnear ? -1 : 0;
        packet.org_x[i] = ray.org_x;
        packet.org_y[i] = ray.org_y;
        packet.org_z[i] = ray.org_z;
        packet.tnear[i] = ray.tnear;
        packet.dir_x[i] = ray.dir_x;
        packet.dir_y[i] = ray.dir_y;
        packet.dir_z[i] = ray.dir_z;
        packet.time[i] = ray.time;
        packet.tfar[i] = ray.tfar;
        packet.mask[i] = ray.mask;
        packet.id[i] = ray.id;
        packet.flags[i] = ray.flags;
    }
    rtcInitIntersectContext(&context);
    rtcOccluded8(valid, rays->scene, &context, &packet);
    for (int i = 0; i < 8; i++) {
        occluded[i] = valid[i] && isinf(packet.tfar[i]) && packet.tfar[i] < 0;
    }
}

/* Twice the area vector of a triangle, by its winding, in doubles. */
static void area_vector(const struct umbr_rays *rays, uint32_t triangle, double out[3])
{
    const float(*v)[3] = rays->vertices + 3 * (size_t)triangle;
    double a[3], b[3];
    for (int i = 0; i < 3; i++) {
        a[i] = (double)v[1][i] - (double)v[0][i];
        b[i] = (double)v[2][i] - (double)v[0][i];
    }
    umb__cross(a, b, out);
}

void umbr_nearest(const struct umbr_rays *rays, const double from[3], const double direction[3],
                  double near_m, double far_m, struct umbr_hit *hit)
{
    struct RTCIntersectContext context;
    struct RTCRayHit query = {.ray = ray_of(rays, from, direction, near_m, far_m)};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.primID = RTC_INVALID_GEOMETRY_ID;
    *hit = (struct umbr_hit){.distance = -1, .triangle = UINT32_MAX};
    if (!(query.ray.tfar >= query.ray.tnear)) {
        return;
    }
    rtcInitIntersectContext(&context);
    rtcIntersect1(rays->scene, &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        return;
    }
    hit->distance = (double)query.ray.tfar;
    hit->triangle = query.hit.primID;
    double n[3];
    area_vector(rays, hit->triangle, n);
    const double length = umb__length(n);
    for (int i = 0; i < 3; i++) {
        hit->normal[i] = length > 0 ? n[i] / length : 0;
    }
}

static int before(const struct crossing *a, const struct crossing *b)
{
    return a->distance < b->distance || (a->distance == b->distance && a->triangle < b->triangle);
}

/* Inserts a hit. A repeated hit is dropped; if the list is full, the farthest hit is dropped. */
static void keep_hit(struct crossing_list *list, const struct crossing *hit)
{
    if (list->has_last && !before(&list->last, hit)) {
        return;
    }
    for (size_t i = 0; i < list->count; i++) {
        if (list->hits[i].triangle == hit->triangle) {
            return;
        }
    }
    if (list->count == HITS_MAX) {
        list->more = 1;
        if (!before(hit, &list->hits[HITS_MAX - 1])) {
            return;
        }
        list->count--;
    }
    size_t at = list->count++;
    while (at > 0 && before(hit, &list->hits[at - 1])) {
        list->hits[at] = list->hits[at - 1];
        at--;
    }
    list->hits[at] = *hit;
}

/* Records a hit and refuses it, so that the ray continues to the next hit. This is Embree's filter
 * of all-hits rays. */
static void collect_hit(const struct RTCFilterFunctionNArguments *arguments)
{
    /* The context is the list's first member, so the cast yields the list. */
    struct crossing_list *list = (struct crossing_list *)(void *)arguments->context;
    if (arguments->N != 1 || arguments->valid[0] == 0) {
        return;
    }
    const struct RTCRay *ray = (const struct RTCRay *)(const void *)arguments->ray;
    const struct RTCHit *found = (const struct RTCHit *)(const void *)arguments->hit;
    arguments->valid[0] = 0;
    if (list->only != NULL && list->only[found->primID] == 0) {
        return;
    }
    double u = (double)found->u, v = (double)found->v, w = 1 - u - v;
    double facing = (double)found->Ng_x * (double)ray->dir_x +
                    (double)found->Ng_y * (double)ray->dir_y +
                    (double)found->Ng_z * (double)ray->dir_z;
    const struct crossing hit = {
        .distance = ray->tfar,
        .triangle = found->primID,
        .second = found->u,
        .third = found->v,
        .sign = facing > 0 ? 1 : -1,
        .border = u < border_coordinate || v < border_coordinate || w < border_coordinate,
    };
    keep_hit(list, &hit);
}

static int share_a_vertex(const struct umbr_rays *rays, uint32_t a, uint32_t b)
{
    for (size_t i = 0; i < 3; i++) {
        for (size_t k = 0; k < 3; k++) {
            const float *p = rays->vertices[3 * (size_t)a + i];
            const float *q = rays->vertices[3 * (size_t)b + k];
            if (p[0] == q[0] && p[1] == q[1] && p[2] == q[2]) {
                return 1;
            }
        }
    }
    return 0;
}

/* Returns 1 if hit i crosses the surface at an edge or corner where an earlier hit crossed it. */
static int crossed_already(const struct umbr_rays *rays, const struct crossing_list *list, size_t i)
{
    const struct crossing *hit = &list->hits[i];
    double reach = same_distance * (1 + fabs((double)hit->distance));
    if (!hit->border) {
        return 0;
    }
    for (size_t j = i; j-- > 0;) {
        const struct crossing *other = &list->hits[j];
        if ((double)hit->distance - (double)other->distance > reach) {
            return 0;
        }
        if (other->border && other->sign == hit->sign &&
            share_a_vertex(rays, hit->triangle, other->triangle)) {
            return 1;
        }
    }
    return 0;
}

void umbr_each_crossing(const struct umbr_rays *rays, const double from[3],
                        const double direction[3], double far_m, const uint8_t *only,
                        umbr_crossing_fn visit, void *user)
{
    struct crossing_list list;
    list.only = only;
    list.has_last = 0;
    if (!(far_m >= 0)) {
        return; /* an empty range */
    }
    do {
        rtcInitIntersectContext(&list.context);
        list.context.filter = collect_hit;
        list.count = 0;
        list.more = 0;
        struct RTCRay ray = ray_of(rays, from, direction, 0, far_m);
        rtcOccluded1(rays->scene, &list.context, &ray);
        for (size_t i = 0; i < list.count; i++) {
            const struct crossing *hit = &list.hits[i];
            const struct umbr_crossing crossing = {(double)hit->distance, (double)hit->second,
                                                   (double)hit->third, hit->triangle,
                                                   hit->sign > 0};
            if (!crossed_already(rays, &list, i) && !visit(user, &crossing)) {
                return;
            }
        }
        if (list.count > 0) {
            list.last = list.hits[list.count - 1];
            list.has_last = 1;
        }
    } while (list.more); /* ends: each round visits at least one hit more */
}

/* Sums of crossings. */
struct sums {
    int winding, crossings;
};

static int sum_up(void *user, const struct umbr_crossing *crossing)
{
    struct sums *sums = user;
    sums->winding += crossing->leaving ? 1 : -1;
    sums->crossings++;
    return 1;
}

void umbr_crossings(const struct umbr_rays *rays, const double from[3], const double direction[3],
                    const uint8_t *closed, int *winding, int *crossings)
{
    struct sums sums = {0, 0};
    umbr_each_crossing(rays, from, direction, INFINITY, closed, sum_up, &sums);
    *winding = sums.winding;
    *crossings = sums.crossings;
}
