/* SPDX-License-Identifier: Apache-2.0 */
/* Embree at its best; see embree_peer.h. */
#include "embree_peer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <embree3/rtcore.h>
#if defined(__SSE3__) || defined(__x86_64__)
#include <pmmintrin.h>
#endif

#include "bench_report.h"

#define METRE 1000.0 /* of the mesh's units */

struct embree_peer {
    RTCDevice device;
    RTCScene scene;
};

static void denormals_flush(void)
{
#if defined(__x86_64__)
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _mm_setcsr(_mm_getcsr() | 0x0040U); /* denormals are zero */
#endif
}

/* A vertex as the peer's floats see it. */
static void vertex_put(const struct bench_scene *scene, int light_space, const int32_t mm[3],
                       float *to)
{
    double p[3];
    for (int k = 0; k < 3; k++) {
        p[k] = mm[k] / METRE - scene->origin[k];
    }
    for (int k = 0; k < 3; k++) {
        const double *m = scene->frustum.world_to_voxel[k];
        to[k] = (float)(light_space ? m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3] : p[k]);
    }
}

static RTCGeometry geometry_make(const struct embree_peer *peer, const struct bench_scene *scene,
                                 int light_space)
{
    const struct gen_mesh *mesh = &scene->mesh;
    RTCGeometry geometry = rtcNewGeometry(peer->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    float *vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), mesh->vertex_count);
    uint32_t *triangles =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(uint32_t), mesh->triangle_count);
    if (vertices == NULL || triangles == NULL) {
        bench_fail("Embree: no memory for the mesh");
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        vertex_put(scene, light_space, mesh->vertices[i], vertices + 3 * i);
    }
    memcpy(triangles, mesh->triangles, 3 * sizeof(uint32_t) * mesh->triangle_count);
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    rtcCommitGeometry(geometry);
    return geometry;
}

struct embree_peer *embree_peer_make(const struct bench_scene *scene, int light_space)
{
    struct embree_peer *peer = calloc(1, sizeof *peer);
    if (peer == NULL) {
        bench_fail("out of memory");
    }
    denormals_flush();
    peer->device = rtcNewDevice(NULL);
    if (peer->device == NULL) {
        bench_fail("Embree: no device");
    }
    peer->scene = rtcNewScene(peer->device);
    rtcSetSceneBuildQuality(peer->scene, RTC_BUILD_QUALITY_HIGH);
    RTCGeometry geometry = geometry_make(peer, scene, light_space);
    rtcAttachGeometry(peer->scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(peer->scene);
    if (rtcGetDeviceError(peer->device) != RTC_ERROR_NONE) {
        bench_fail("Embree: the scene could not be built");
    }
    bench_say("%s: Embree built", scene->name);
    return peer;
}

void embree_peer_destroy(struct embree_peer *peer)
{
    if (peer != NULL) {
        rtcReleaseScene(peer->scene);
        rtcReleaseDevice(peer->device);
        free(peer);
    }
}

static void run_one(const struct embree_query *query)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (size_t i = 0; i < query->count; i++) {
        struct RTCRay ray = {
            .org_x = query->points[3 * i],
            .org_y = query->points[3 * i + 1],
            .org_z = query->points[3 * i + 2],
            .dir_x = query->to_light[0],
            .dir_y = query->to_light[1],
            .dir_z = query->to_light[2],
            .tfar = INFINITY,
            .mask = UINT32_MAX,
        };
        rtcOccluded1(query->peer->scene, &context, &ray);
        query->answers[i] = ray.tfar >= 0.0F ? 1.0F : 0.0F; /* a hit is marked by -inf */
    }
}

static void context_init(struct RTCIntersectContext *context, int coherent)
{
    rtcInitIntersectContext(context);
    context->flags =
        coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
}

/* One body for packets of 8 and 16: the structs differ in width only. */
#define PACKET_RUN(name, width, type, occluded)                                                    \
    static void name(const struct embree_query *query, int coherent)                               \
    {                                                                                              \
        struct RTCIntersectContext context;                                                        \
        context_init(&context, coherent);                                                          \
        for (size_t first = 0; first < query->count; first += (width)) {                           \
            const size_t left = query->count - first;                                              \
            _Alignas(64) int valid[width];                                                         \
            _Alignas(64) struct type ray;                                                          \
            for (size_t k = 0; k < (width); k++) {                                                 \
                const float *point = query->points + 3 * (first + (k < left ? k : 0));             \
                valid[k] = k < left ? -1 : 0;                                                      \
                ray.org_x[k] = point[0];                                                           \
                ray.org_y[k] = point[1];                                                           \
                ray.org_z[k] = point[2];                                                           \
                ray.dir_x[k] = query->to_light[0];                                                 \
                ray.dir_y[k] = query->to_light[1];                                                 \
                ray.dir_z[k] = query->to_light[2];                                                 \
                ray.tnear[k] = 0.0F;                                                               \
                ray.tfar[k] = INFINITY;                                                            \
                ray.time[k] = 0.0F;                                                                \
                ray.mask[k] = UINT32_MAX;                                                          \
                ray.flags[k] = 0;                                                                  \
            }                                                                                      \
            occluded(valid, query->peer->scene, &context, &ray);                                   \
            for (size_t k = 0; k < (width) && k < left; k++) {                                     \
                query->answers[first + k] = ray.tfar[k] >= 0.0F ? 1.0F : 0.0F;                     \
            }                                                                                      \
        }                                                                                          \
    }

PACKET_RUN(run_eight, 8, RTCRay8, rtcOccluded8)
PACKET_RUN(run_sixteen, 16, RTCRay16, rtcOccluded16)

void embree_run(const struct embree_query *query)
{
    denormals_flush();
    switch (query->way) {
    case EMBREE_EIGHT:
    case EMBREE_EIGHT_COHERENT:
        run_eight(query, query->way == EMBREE_EIGHT_COHERENT);
        break;
    case EMBREE_SIXTEEN:
    case EMBREE_SIXTEEN_COHERENT:
        run_sixteen(query, query->way == EMBREE_SIXTEEN_COHERENT);
        break;
    default:
        run_one(query);
        break;
    }
}

void embree_tune(struct embree_query *query, unsigned ways)
{
    double best_s = INFINITY;
    enum embree_way best = query->way;
    for (int way = 0; way < EMBREE_WAYS; way++) {
        if ((ways >> way & 1U) == 0) {
            continue;
        }
        query->way = (enum embree_way)way;
        const double start = bench_cpu_s();
        embree_run(query);
        const double seconds = bench_cpu_s() - start;
        if (seconds < best_s) {
            best_s = seconds;
            best = query->way;
        }
    }
    query->way = best;
}

size_t embree_depth_window(const struct embree_peer *peer, int32_t x0, int32_t y0, int32_t n,
                           const uint8_t *covered, float *depth)
{
    struct RTCIntersectContext context;
    size_t hits = 0;
    denormals_flush();
    context_init(&context, 1);
    for (int32_t packet = 0; packet < n * n / 8; packet++) {
        const int32_t px = packet % (n / 4) * 4, py = packet / (n / 4) * 2;
        _Alignas(64) int valid[8];
        _Alignas(64) struct RTCRayHit8 query;
        int any = 0;
        for (int32_t k = 0; k < 8; k++) {
            const int32_t x = px + k % 4, y = py + k / 4;
            valid[k] = covered[y * n + x] ? -1 : 0;
            any |= valid[k];
            query.ray.org_x[k] = (float)(x0 + x) + 0.5F;
            query.ray.org_y[k] = (float)(y0 + y) + 0.5F;
            query.ray.org_z[k] = 0.0F;
            query.ray.dir_x[k] = 0.0F;
            query.ray.dir_y[k] = 0.0F;
            query.ray.dir_z[k] = 1.0F;
            query.ray.tnear[k] = 0.0F;
            query.ray.tfar[k] = INFINITY;
            query.ray.time[k] = 0.0F;
            query.ray.mask[k] = UINT32_MAX;
            query.ray.flags[k] = 0;
            query.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
        }
        if (any != 0) {
            rtcIntersect8(valid, peer->scene, &context, &query);
        }
        for (int32_t k = 0; k < 8; k++) {
            const int32_t at = (py + k / 4) * n + px + k % 4;
            hits += valid[k] != 0 && query.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
            depth[at] = query.ray.tfar[k];
        }
    }
    return hits;
}
