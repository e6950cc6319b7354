/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Mesh building blocks of the generated scenes. Every solid has its own vertices, shared by index
 * among its triangles, so that rounding or turning a vertex cannot open it.
 */
#include "gen.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"

enum {
    DETAIL_MAX = 32, /* of a ball */
};

/* SplitMix64 (Steele, Lea, Flood 2014). */
uint64_t gen_random(struct gen_rng *rng)
{
    uint64_t z = rng->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

int32_t gen_range(struct gen_rng *rng, int32_t low, int32_t high)
{
    uint64_t span = (uint64_t)((int64_t)high - low + 1);
    return (int32_t)(low + (int64_t)(gen_random(rng) % span));
}

void gen_mesh_finish(struct gen_mesh *mesh)
{
    umb__free(NULL, mesh->vertices);
    umb__free(NULL, mesh->triangles);
    umb__free(NULL, mesh->places);
    *mesh = (struct gen_mesh){0};
}

uint32_t gen_vertex(struct gen_mesh *mesh, int32_t x, int32_t y, int32_t z)
{
    if (mesh->failed || mesh->vertex_count >= UINT32_MAX ||
        !umb__grow(NULL, &mesh->vertices, &mesh->vertex_capacity, mesh->vertex_count + 1,
                   sizeof *mesh->vertices)) {
        mesh->failed = 1;
        return 0;
    }
    int32_t *v = mesh->vertices[mesh->vertex_count];
    v[0] = x;
    v[1] = y;
    v[2] = z;
    return (uint32_t)mesh->vertex_count++;
}

void gen_place(struct gen_mesh *mesh, int32_t x, int32_t y, int32_t z)
{
    if (mesh->failed || !umb__grow(NULL, &mesh->places, &mesh->place_capacity,
                                   mesh->place_count + 1, sizeof *mesh->places)) {
        mesh->failed = 1;
        return;
    }
    int32_t *place = mesh->places[mesh->place_count++];
    place[0] = x;
    place[1] = y;
    place[2] = z;
}

void gen_triangle(struct gen_mesh *mesh, uint32_t a, uint32_t b, uint32_t c)
{
    if (mesh->failed || !umb__grow(NULL, &mesh->triangles, &mesh->triangle_capacity,
                                   mesh->triangle_count + 1, sizeof *mesh->triangles)) {
        mesh->failed = 1;
        return;
    }
    uint32_t *t = mesh->triangles[mesh->triangle_count++];
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

void gen_quad(struct gen_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    gen_triangle(mesh, a, b, c);
    gen_triangle(mesh, a, c, d);
}

void gen_prism(struct gen_mesh *mesh, const struct gen_frustum *frustum)
{
    uint32_t n = frustum->count, first = (uint32_t)mesh->vertex_count;
    for (uint32_t i = 0; i < n; i++) {
        gen_vertex(mesh, frustum->bottom[i].x, frustum->bottom[i].y, frustum->bottom_z);
    }
    for (uint32_t i = 0; i < n; i++) {
        gen_vertex(mesh, frustum->top[i].x, frustum->top[i].y, frustum->top_z);
    }
    for (uint32_t i = 0; i < n; i++) {
        uint32_t next = (i + 1) % n;
        gen_quad(mesh, first + i, first + next, first + n + next, first + n + i);
    }
    for (uint32_t i = 1; i + 1 < n; i++) {
        gen_triangle(mesh, first, first + i + 1, first + i);
        gen_triangle(mesh, first + n, first + n + i, first + n + i + 1);
    }
}

void gen_box(struct gen_mesh *mesh, const int32_t low[3], const int32_t high[3])
{
    const struct gen_point2 corners[4] = {
        {low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}};
    const struct gen_frustum frustum = {corners, corners, 4, low[2], high[2]};
    gen_prism(mesh, &frustum);
}

void gen_gable(struct gen_mesh *mesh, const int32_t low[3], const int32_t high[3], int axis)
{
    int32_t x0 = low[0], y0 = low[1], x1 = high[0], y1 = high[1], z = low[2];
    uint32_t a = gen_vertex(mesh, x0, y0, z), b = gen_vertex(mesh, x1, y0, z);
    uint32_t c = gen_vertex(mesh, x1, y1, z), d = gen_vertex(mesh, x0, y1, z);
    int32_t mx = x0 + (x1 - x0) / 2, my = y0 + (y1 - y0) / 2;
    uint32_t e, f;
    gen_quad(mesh, a, d, c, b);
    if (axis == 0) {
        e = gen_vertex(mesh, x0, my, high[2]);
        f = gen_vertex(mesh, x1, my, high[2]);
        gen_quad(mesh, a, b, f, e);
        gen_quad(mesh, c, d, e, f);
        gen_triangle(mesh, d, a, e);
        gen_triangle(mesh, b, c, f);
    } else {
        e = gen_vertex(mesh, mx, y0, high[2]);
        f = gen_vertex(mesh, mx, y1, high[2]);
        gen_quad(mesh, b, c, f, e);
        gen_quad(mesh, d, a, e, f);
        gen_triangle(mesh, a, b, e);
        gen_triangle(mesh, c, d, f);
    }
}

void gen_bar(struct gen_mesh *mesh, const int32_t from[3], const int32_t to[3], int32_t half)
{
    const int32_t *ends[2] = {from[0] < to[0] ? from : to, from[0] < to[0] ? to : from};
    static const int32_t corner[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    uint32_t first = (uint32_t)mesh->vertex_count;
    for (int e = 0; e < 2; e++) {
        for (int i = 0; i < 4; i++) {
            gen_vertex(mesh, ends[e][0], ends[e][1] + half * corner[i][0],
                       ends[e][2] + half * corner[i][1]);
        }
    }
    for (uint32_t i = 0; i < 4; i++) {
        uint32_t next = (i + 1) % 4;
        gen_quad(mesh, first + i, first + next, first + 4 + next, first + 4 + i);
    }
    /* The section runs counter-clockwise seen from +x. */
    gen_quad(mesh, first + 3, first + 2, first + 1, first);
    gen_quad(mesh, first + 4, first + 5, first + 6, first + 7);
}

/* One vertex of a ball: lattice point q of the octahedron |x| + |y| + |z| = detail. */
static uint32_t ball_vertex(struct gen_mesh *mesh, const int32_t centre[3], const int32_t q[3],
                            int64_t radius)
{
    double length = sqrt((double)(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]));
    int32_t p[3];
    for (int i = 0; i < 3; i++) {
        p[i] = centre[i] + (int32_t)floor((double)radius * (double)q[i] / length + 0.5);
    }
    return gen_vertex(mesh, p[0], p[1], p[2]);
}

/* Number of the ball's vertex at lattice x, y; the lower half's if `lower`. */
#define BALL_SIDE (2 * DETAIL_MAX + 1)
struct ball {
    uint32_t vertex[2][BALL_SIDE][BALL_SIDE];
    int32_t detail;
};

static uint32_t ball_at(const struct ball *ball, int32_t x, int32_t y, int lower)
{
    return ball->vertex[lower][y + ball->detail][x + ball->detail];
}

static void ball_face(struct gen_mesh *mesh, const struct ball *ball, int32_t sx, int32_t sy,
                      int lower)
{
    int32_t n = ball->detail;
    int turned = (sx * sy < 0) != lower;
    for (int32_t y = 0; y < n; y++) {
        for (int32_t x = 0; x + y < n; x++) {
            uint32_t a = ball_at(ball, sx * x, sy * y, lower);
            uint32_t b = ball_at(ball, sx * (x + 1), sy * y, lower);
            uint32_t c = ball_at(ball, sx * x, sy * (y + 1), lower);
            gen_triangle(mesh, a, turned ? c : b, turned ? b : c);
            if (x + y + 2 <= n) {
                uint32_t d = ball_at(ball, sx * (x + 1), sy * (y + 1), lower);
                gen_triangle(mesh, b, turned ? c : d, turned ? d : c);
            }
        }
    }
}

void gen_ball(struct gen_mesh *mesh, const int32_t centre[3], int32_t radius, int32_t detail,
              struct gen_rng *rng, int32_t bumps)
{
    struct ball ball;
    int32_t n = detail < 1 ? 1 : detail > DETAIL_MAX ? DETAIL_MAX : detail;
    ball.detail = n;
    for (int32_t y = -n; y <= n; y++) {
        int32_t rest = n - abs(y);
        for (int32_t x = -rest; x <= rest; x++) {
            int32_t height = rest - abs(x);
            for (int lower = 0; lower < 2; lower++) {
                const int32_t q[3] = {x, y, lower ? -height : height};
                uint32_t *slot = &ball.vertex[lower][y + n][x + n];
                if (lower && height == 0) {
                    *slot = ball.vertex[0][y + n][x + n]; /* the equator is shared */
                    continue;
                }
                int64_t bump = bumps > 0 ? gen_range(rng, -bumps, bumps) : 0;
                *slot = ball_vertex(mesh, centre, q, radius + radius * bump / 1000);
            }
        }
    }
    for (int face = 0; face < 8; face++) {
        ball_face(mesh, &ball, face & 1 ? 1 : -1, face & 2 ? 1 : -1, face >> 2);
    }
}

struct gen_point2 gen_circle(int32_t x, int32_t y, int32_t radius, uint32_t i, uint32_t step)
{
    /* 1e9 * cos(15 degrees * k), k = 0..6, rounded. */
    static const int64_t cosine[7] = {1000000000, 965925826, 866025404, 707106781,
                                      500000000,  258819045, 0};
    const int64_t unit = 1000000000;
    uint32_t k = i * step % 24, quarter = k / 6, part = k % 6;
    int64_t c = cosine[part] * radius / unit, s = cosine[6 - part] * radius / unit;
    const int64_t turned[4][2] = {{c, s}, {-s, c}, {-c, -s}, {s, -c}};
    struct gen_point2 p = {(int32_t)(x + turned[quarter][0]), (int32_t)(y + turned[quarter][1])};
    return p;
}

void gen_turn(struct gen_mesh *mesh, size_t first, struct gen_point2 axis, const int32_t csd[3])
{
    for (size_t i = first; i < mesh->vertex_count; i++) {
        int64_t x = mesh->vertices[i][0] - (int64_t)axis.x;
        int64_t y = mesh->vertices[i][1] - (int64_t)axis.y;
        mesh->vertices[i][0] = (int32_t)(axis.x + (x * csd[0] - y * csd[1]) / csd[2]);
        mesh->vertices[i][1] = (int32_t)(axis.y + (x * csd[1] + y * csd[0]) / csd[2]);
    }
}
