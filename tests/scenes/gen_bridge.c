/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A suspension bridge, 600 m long: deck, pylons, main cables, and wires no map can resolve: `size`
 * hangers a side and rails, all 10 mm thick. Every part is a closed outward solid; joints are sunk
 * so that no two parts share an edge.
 */
#include "gen.h"

enum {
    HALF_LENGTH_MM = 300000,
    PYLON_X_MM = 180000,
    CABLE_Y_MM = 7500,
    CABLE_PARTS = 120,
    CABLE_HALF_MM = 150,
    WIRE_HALF_MM = 5,
    RAIL_PART_MM = 10000,
    RAIL_Y_MM = 7800,
    DECK_TOP_MM = 20000,
};

/* Height of the main cable's axis: a parabola between the pylons, straight outside. */
static int32_t cable_height(int32_t x)
{
    int64_t reach = x < 0 ? -(int64_t)x : x;
    if (reach <= PYLON_X_MM) {
        return (int32_t)(25000 + 53000 * (reach * reach) / ((int64_t)PYLON_X_MM * PYLON_X_MM));
    }
    return (int32_t)(78000 - (reach - PYLON_X_MM) * 58500 / (HALF_LENGTH_MM - PYLON_X_MM));
}

/* One closed tube of square section through all points of the cable. */
static void add_cable(struct gen_mesh *mesh, int32_t y)
{
    static const int32_t corner[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    uint32_t first = (uint32_t)mesh->vertex_count;
    for (int32_t k = 0; k <= CABLE_PARTS; k++) {
        int32_t x = -HALF_LENGTH_MM + k * (2 * HALF_LENGTH_MM / CABLE_PARTS);
        for (int i = 0; i < 4; i++) {
            gen_vertex(mesh, x, y + CABLE_HALF_MM * corner[i][0],
                       cable_height(x) + CABLE_HALF_MM * corner[i][1]);
        }
    }
    for (uint32_t k = 0; k < CABLE_PARTS; k++) {
        for (uint32_t i = 0; i < 4; i++) {
            uint32_t a = first + 4 * k + i, b = first + 4 * k + (i + 1) % 4;
            gen_quad(mesh, a, b, b + 4, a + 4);
        }
    }
    uint32_t last = first + 4 * CABLE_PARTS;
    gen_quad(mesh, first + 3, first + 2, first + 1, first);
    gen_quad(mesh, last, last + 1, last + 2, last + 3);
}

static void add_box_at(struct gen_mesh *mesh, int32_t x, int32_t y, const int32_t half[2],
                       const int32_t z[2])
{
    const int32_t low[3] = {x - half[0], y - half[1], z[0]};
    const int32_t high[3] = {x + half[0], y + half[1], z[1]};
    gen_box(mesh, low, high);
}

static void add_pylon(struct gen_mesh *mesh, int32_t x)
{
    for (int side = -1; side <= 1; side += 2) {
        struct gen_point2 foot[4], head[4];
        static const int32_t corner[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
        for (int i = 0; i < 4; i++) {
            foot[i].x = x + 2500 * corner[i][0];
            foot[i].y = side * 10500 + 1800 * corner[i][1];
            head[i].x = x + 1400 * corner[i][0];
            head[i].y = side * 8300 + 1300 * corner[i][1];
        }
        const struct gen_frustum leg = {foot, head, 4, -26000, 81000};
        gen_prism(mesh, &leg);
    }
    add_box_at(mesh, x, 0, (const int32_t[2]){1203, 9000}, (const int32_t[2]){73011, 76000});
    add_box_at(mesh, x, 0, (const int32_t[2]){1507, 10011}, (const int32_t[2]){15003, 18507});
}

/* Hangers, at places that miss the pylons and vary a little with the seed. */
static void add_hangers(struct gen_mesh *mesh, int32_t size, int32_t y, struct gen_rng *rng)
{
    const int32_t reach = PYLON_X_MM - 4000;
    for (int32_t i = 0; i < size; i++) {
        int64_t place = 2 * (int64_t)reach * (2 * i + 1) / (2 * size) - reach;
        int32_t x = (int32_t)place + gen_range(rng, -137, 137);
        add_box_at(mesh, x, y, (const int32_t[2]){WIRE_HALF_MM, WIRE_HALF_MM},
                   (const int32_t[2]){DECK_TOP_MM - 503, cable_height(x)});
    }
}

static void add_rails(struct gen_mesh *mesh, int32_t y)
{
    static const int32_t heights[3] = {20400, 20750, 21100};
    for (int32_t x = -HALF_LENGTH_MM; x < HALF_LENGTH_MM; x += RAIL_PART_MM) {
        for (int i = 0; i < 3; i++) {
            const int32_t from[3] = {x + 3, y, heights[i]};
            const int32_t to[3] = {x + RAIL_PART_MM + 1, y, heights[i]}; /* overlaps the next */
            gen_bar(mesh, from, to, WIRE_HALF_MM);
        }
        add_box_at(mesh, x + RAIL_PART_MM / 2, y,
                   (const int32_t[2]){WIRE_HALF_MM, WIRE_HALF_MM + 1},
                   (const int32_t[2]){DECK_TOP_MM - 211, 21113});
    }
}

/* Stays from the pylon heads to the deck, crossing the hangers. */
static void add_stays(struct gen_mesh *mesh, int32_t y)
{
    for (int32_t end = -1; end <= 1; end += 2) {
        for (int32_t i = 1; i <= 6; i++) {
            const int32_t head[3] = {end * (PYLON_X_MM - 17), y, 79000 - 607 * i};
            const int32_t foot[3] = {end * (PYLON_X_MM - 9011 * i), y, DECK_TOP_MM - 307};
            gen_bar(mesh, head, foot, WIRE_HALF_MM + 3);
        }
    }
}

void gen_bridge(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    struct gen_rng rng = {seed};
    add_box_at(mesh, 0, 0, (const int32_t[2]){350000, 80000}, (const int32_t[2]){-30000, -25000});
    add_box_at(mesh, 0, 0, (const int32_t[2]){HALF_LENGTH_MM, 8000},
               (const int32_t[2]){DECK_TOP_MM - 1200, DECK_TOP_MM});
    add_pylon(mesh, -PYLON_X_MM);
    add_pylon(mesh, PYLON_X_MM);
    for (int side = -1; side <= 1; side += 2) {
        add_cable(mesh, side * CABLE_Y_MM);
        add_hangers(mesh, size, side * CABLE_Y_MM, &rng);
        add_rails(mesh, side * RAIL_Y_MM);
        add_stays(mesh, side * (CABLE_Y_MM - 401));
    }
}
