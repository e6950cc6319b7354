/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Open architecture: size x size bays of 6 m with walls of no thickness, seen from either side:
 * plain, with windows, doors and arches, single and in pairs 20 mm apart; floors, open stairs,
 * columns without ends, roofs with holes and courts without roofs. Nothing here is closed.
 */
#include "gen.h"

enum {
    BAY_MM = 6000,
    STOREY_MM = 4000,
    PAIR_MM = 20, /* between the sheets of a double wall */
    STEPS = 16,
    ARCH_PARTS = 12,
};

/* A vertical rectangle: u runs along x (axis 0) or y (axis 1) from `at`. */
struct wall {
    struct gen_point2 at;
    int axis;
    int32_t base;
};

static uint32_t wall_vertex(struct gen_mesh *mesh, const struct wall *wall, int32_t u, int32_t z)
{
    return gen_vertex(mesh, wall->at.x + (wall->axis == 0 ? u : 0),
                      wall->at.y + (wall->axis == 1 ? u : 0), wall->base + z);
}

static void wall_rectangle(struct gen_mesh *mesh, const struct wall *wall, const int32_t u[2],
                           const int32_t z[2])
{
    uint32_t a = wall_vertex(mesh, wall, u[0], z[0]), b = wall_vertex(mesh, wall, u[1], z[0]);
    uint32_t c = wall_vertex(mesh, wall, u[1], z[1]), d = wall_vertex(mesh, wall, u[0], z[1]);
    gen_quad(mesh, a, b, c, d);
}

/* A frame of eight triangles between an outer and an inner rectangle. */
static void frame(struct gen_mesh *mesh, const uint32_t outer[4], const uint32_t inner[4])
{
    for (int i = 0; i < 4; i++) {
        int next = (i + 1) % 4;
        gen_quad(mesh, outer[i], outer[next], inner[next], inner[i]);
    }
}

static void wall_window(struct gen_mesh *mesh, const struct wall *wall)
{
    static const int32_t u[2][2] = {{0, BAY_MM}, {1700, 4300}};
    static const int32_t z[2][2] = {{0, STOREY_MM}, {900, 2600}};
    uint32_t ring[2][4];
    for (int i = 0; i < 2; i++) {
        ring[i][0] = wall_vertex(mesh, wall, u[i][0], z[i][0]);
        ring[i][1] = wall_vertex(mesh, wall, u[i][1], z[i][0]);
        ring[i][2] = wall_vertex(mesh, wall, u[i][1], z[i][1]);
        ring[i][3] = wall_vertex(mesh, wall, u[i][0], z[i][1]);
    }
    frame(mesh, ring[0], ring[1]);
}

static void wall_door(struct gen_mesh *mesh, const struct wall *wall)
{
    wall_rectangle(mesh, wall, (const int32_t[2]){0, 2400}, (const int32_t[2]){0, STOREY_MM});
    wall_rectangle(mesh, wall, (const int32_t[2]){2400, 3600}, (const int32_t[2]){2300, STOREY_MM});
    wall_rectangle(mesh, wall, (const int32_t[2]){3600, BAY_MM}, (const int32_t[2]){0, STOREY_MM});
}

/* An arcade bay: two piers and a half circle of radius 2.2 m above 1.4 m. */
static void wall_arch(struct gen_mesh *mesh, const struct wall *wall)
{
    const int32_t radius = 2200, spring = 1400, centre = BAY_MM / 2;
    wall_rectangle(mesh, wall, (const int32_t[2]){0, centre - radius},
                   (const int32_t[2]){0, STOREY_MM});
    wall_rectangle(mesh, wall, (const int32_t[2]){centre + radius, BAY_MM},
                   (const int32_t[2]){0, STOREY_MM});
    for (uint32_t i = 0; i < ARCH_PARTS; i++) {
        struct gen_point2 a = gen_circle(centre, spring, radius, i, 1);
        struct gen_point2 b = gen_circle(centre, spring, radius, i + 1, 1);
        uint32_t foot_b = wall_vertex(mesh, wall, b.x, b.y);
        uint32_t foot_a = wall_vertex(mesh, wall, a.x, a.y);
        uint32_t head_a = wall_vertex(mesh, wall, a.x, STOREY_MM);
        uint32_t head_b = wall_vertex(mesh, wall, b.x, STOREY_MM);
        gen_quad(mesh, foot_b, foot_a, head_a, head_b);
    }
}

static void add_sheet(struct gen_mesh *mesh, const struct wall *wall, int kind)
{
    switch (kind) {
    case 0:
        wall_rectangle(mesh, wall, (const int32_t[2]){0, BAY_MM}, (const int32_t[2]){0, STOREY_MM});
        break;
    case 1:
        wall_window(mesh, wall);
        break;
    case 2:
        wall_door(mesh, wall);
        break;
    default:
        wall_arch(mesh, wall);
        break;
    }
}

static void add_wall(struct gen_mesh *mesh, const struct wall *wall, int outer, struct gen_rng *rng)
{
    int kind = gen_range(rng, 0, 7);
    if (outer) {
        kind = kind < 4 ? 3 : kind < 7 ? 1 : 2;
    } else if (kind > 3) {
        return; /* open to the next bay */
    }
    add_sheet(mesh, wall, kind);
    if (gen_random(rng) % 3 == 0) {
        struct wall second = *wall;
        second.at.x += second.axis == 1 ? PAIR_MM : 0;
        second.at.y += second.axis == 0 ? PAIR_MM : 0;
        add_sheet(mesh, &second, kind);
    }
}

/* A horizontal or sloping sheet over a bay, with a square hole if `hole`. */
static void add_cover(struct gen_mesh *mesh, struct gen_point2 at, int32_t z, int32_t slope,
                      int hole)
{
    uint32_t ring[2][4];
    static const int32_t inset[2] = {0, 2100};
    for (int i = 0; i < 2; i++) {
        int32_t x0 = inset[i], x1 = BAY_MM - inset[i];
        int32_t rise0 = slope * x0 / BAY_MM, rise1 = slope * x1 / BAY_MM;
        ring[i][0] = gen_vertex(mesh, at.x + x0, at.y + x0, z + rise0);
        ring[i][1] = gen_vertex(mesh, at.x + x1, at.y + x0, z + rise1);
        ring[i][2] = gen_vertex(mesh, at.x + x1, at.y + x1, z + rise1);
        ring[i][3] = gen_vertex(mesh, at.x + x0, at.y + x1, z + rise0);
    }
    frame(mesh, ring[0], ring[1]);
    if (!hole) {
        gen_quad(mesh, ring[1][0], ring[1][1], ring[1][2], ring[1][3]);
    }
}

/* Treads and risers, open below and at the sides. */
static void add_stairs(struct gen_mesh *mesh, struct gen_point2 at)
{
    for (int32_t i = 0; i < STEPS; i++) {
        int32_t x0 = at.x + 700 + i * 280, x1 = x0 + 280, y0 = at.y + 600, y1 = y0 + 1500;
        int32_t z0 = i * STOREY_MM / STEPS, z1 = (i + 1) * STOREY_MM / STEPS;
        uint32_t a = gen_vertex(mesh, x0, y0, z0), b = gen_vertex(mesh, x0, y1, z0);
        uint32_t c = gen_vertex(mesh, x0, y1, z1), d = gen_vertex(mesh, x0, y0, z1);
        uint32_t e = gen_vertex(mesh, x1, y0, z1), f = gen_vertex(mesh, x1, y1, z1);
        gen_quad(mesh, a, d, c, b);
        gen_quad(mesh, d, e, f, c);
    }
}

static void add_column(struct gen_mesh *mesh, struct gen_point2 at, int32_t top)
{
    uint32_t first = (uint32_t)mesh->vertex_count;
    for (uint32_t i = 0; i < 8; i++) {
        struct gen_point2 p = gen_circle(at.x, at.y, 220, i, 3);
        gen_vertex(mesh, p.x, p.y, 0);
        gen_vertex(mesh, p.x, p.y, top);
    }
    for (uint32_t i = 0; i < 8; i++) {
        uint32_t a = first + 2 * i, b = first + 2 * ((i + 1) % 8);
        gen_quad(mesh, a, b, b + 1, a + 1);
    }
}

static void add_bay(struct gen_mesh *mesh, struct gen_point2 at, struct gen_rng *rng)
{
    int roof = gen_range(rng, 0, 5);
    add_cover(mesh, at, 0, 0, 0);
    if (roof > 0) {
        int32_t slope = roof > 3 ? gen_range(rng, 300, 1500) : 0;
        add_cover(mesh, at, STOREY_MM + 3, slope, roof % 2);
    }
    if (gen_random(rng) % 4 == 0) {
        add_stairs(mesh, at);
    }
    if (gen_random(rng) % 3 == 0) {
        struct gen_point2 middle = {at.x + BAY_MM / 2, at.y + BAY_MM / 2};
        add_column(mesh, middle, STOREY_MM);
    }
}

void gen_arch(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    struct gen_rng rng = {seed};
    int32_t start = -size * BAY_MM / 2;
    for (int32_t j = 0; j <= size; j++) {
        for (int32_t i = 0; i <= size; i++) {
            struct gen_point2 at = {start + i * BAY_MM, start + j * BAY_MM};
            if (i < size && j < size) {
                add_bay(mesh, at, &rng);
            }
            if (i < size) {
                const struct wall wall = {at, 0, 0};
                add_wall(mesh, &wall, j == 0 || j == size, &rng);
            }
            if (j < size) {
                const struct wall wall = {at, 1, 0};
                add_wall(mesh, &wall, i == 0 || i == size, &rng);
            }
        }
    }
}
