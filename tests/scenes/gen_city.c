/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A closed city, 1 km across: a ground slab and size x size lots between streets, with houses,
 * towers, round buildings, halls and parks. Every part is a closed outward solid; parts overlap
 * (walls stand in the ground, roofs enclose the tops of walls), but no two share an edge, because
 * every joint is sunk by a random amount.
 *
 * C leaves the order in which operands and initialisers are evaluated open, so no expression here
 * draws two numbers unless their order makes no difference to the result.
 */
#include "gen.h"

enum {
    ACROSS_MM = 1000000,
    LOTS_A_BLOCK = 4, /* between two streets, each as wide as a lot */
    GROUND_MM = 2000, /* thickness of the slab */
};

/* Where a building stands: centre, half width, and how high it may be. */
struct lot {
    struct gen_point2 at;
    int32_t half;
    int32_t storeys_max;
    struct gen_rng *rng;
};

/* Draws how deep the next part is sunk into the one below: random, so that edges never coincide. */
static int32_t sink(const struct lot *lot)
{
    return gen_range(lot->rng, 101, 997);
}

static void add_tree(struct gen_mesh *mesh, const struct lot *lot, struct gen_point2 at)
{
    struct gen_point2 bottom[6], top[6];
    int32_t trunk = gen_range(lot->rng, 1800, 3200);
    int32_t crown = gen_range(lot->rng, 1200, 2600);
    for (uint32_t i = 0; i < 6; i++) {
        bottom[i] = gen_circle(at.x, at.y, 260, i, 4);
        top[i] = gen_circle(at.x, at.y, 170, i, 4);
    }
    const struct gen_frustum frustum = {bottom, top, 6, -sink(lot), trunk + crown / 2};
    gen_prism(mesh, &frustum);
    const int32_t centre[3] = {at.x, at.y, trunk + crown};
    gen_ball(mesh, centre, crown, 4, lot->rng, 90);
}

static void add_house(struct gen_mesh *mesh, const struct lot *lot)
{
    int32_t hx = lot->half * gen_range(lot->rng, 55, 85) / 100;
    int32_t hy = lot->half * gen_range(lot->rng, 45, 70) / 100;
    int32_t wall = gen_range(lot->rng, 2, 4) * 2900, pitch = gen_range(lot->rng, 2000, 4500);
    int32_t eaves = gen_range(lot->rng, 203, 551), x = lot->at.x, y = lot->at.y;
    const int32_t low[3] = {x - hx, y - hy, -sink(lot)}, high[3] = {x + hx, y + hy, wall};
    gen_box(mesh, low, high);
    int32_t base = wall - sink(lot) / 4;
    const int32_t roof_low[3] = {x - hx - eaves, y - hy - eaves, base};
    const int32_t roof_high[3] = {x + hx + eaves, y + hy + eaves, base + pitch};
    gen_gable(mesh, roof_low, roof_high, (int)(gen_random(lot->rng) & 1));
    int32_t cx = x + gen_range(lot->rng, -hx / 2, hx / 2), cy = y + hy / 3;
    const int32_t chimney_low[3] = {cx - 307, cy - 293, wall - 53};
    const int32_t chimney_high[3] = {cx + 307, cy + 293, base + pitch + 811};
    gen_box(mesh, chimney_low, chimney_high);
}

/* Two wings that overlap in an L, and a plant room across the joint. */
static void add_hall(struct gen_mesh *mesh, const struct lot *lot)
{
    int32_t h = lot->half * 9 / 10, x = lot->at.x, y = lot->at.y;
    int32_t deep = h * gen_range(lot->rng, 45, 80) / 100;
    int32_t first = gen_range(lot->rng, 2, 6) * 3100, second = gen_range(lot->rng, 2, 7) * 3300;
    const int32_t a_low[3] = {x - h, y - h, -sink(lot)};
    const int32_t a_high[3] = {x + h - sink(lot), y - h + deep, first};
    int32_t b_x = x - h + sink(lot) / 8, b_y = y - h + sink(lot) / 4, b_z = -sink(lot);
    const int32_t b_low[3] = {b_x, b_y, b_z};
    const int32_t b_high[3] = {x - h + deep, y + h, second + 7};
    gen_box(mesh, a_low, a_high);
    gen_box(mesh, b_low, b_high);
    const int32_t c_low[3] = {x - h + deep / 3, y - h + deep / 4, first - sink(lot)};
    int32_t higher = first > second ? first : second;
    const int32_t c_high[3] = {x + deep / 5, y - deep / 9, higher + 2303};
    if (c_high[0] > c_low[0] && c_high[1] > c_low[1]) {
        gen_box(mesh, c_low, c_high);
    }
}

/* Steps of boxes, each narrower than the one below, and a mast. */
static void add_tower(struct gen_mesh *mesh, const struct lot *lot)
{
    int32_t half = lot->half * 8 / 10, bottom = -sink(lot), x = lot->at.x, y = lot->at.y;
    for (int step = 0; step < 4; step++) {
        int32_t rise = gen_range(lot->rng, 2, 2 + lot->storeys_max / 4) * 3200;
        const int32_t low[3] = {x - half, y - half, bottom};
        const int32_t high[3] = {x + half, y + half, bottom + rise};
        gen_box(mesh, low, high);
        bottom += rise - sink(lot);
        half = half * gen_range(lot->rng, 70, 90) / 100;
    }
    struct gen_point2 foot[4], tip[4];
    for (uint32_t i = 0; i < 4; i++) {
        foot[i] = gen_circle(x, y, half / 4 + 61, i, 6);
        tip[i] = gen_circle(x, y, 47, i, 6);
    }
    const struct gen_frustum mast = {foot, tip, 4, bottom, bottom + half * 2};
    gen_prism(mesh, &mast);
}

/* A drum with a dome or a cone. */
static void add_round(struct gen_mesh *mesh, const struct lot *lot)
{
    struct gen_point2 wall[24], rim[24], tip[24];
    int32_t radius = lot->half * gen_range(lot->rng, 60, 90) / 100;
    int32_t top = gen_range(lot->rng, 6000, 8000 + lot->storeys_max * 900);
    for (uint32_t i = 0; i < 24; i++) {
        wall[i] = gen_circle(lot->at.x, lot->at.y, radius, i, 1);
        rim[i] = gen_circle(lot->at.x, lot->at.y, radius + 433, i, 1);
        tip[i] = gen_circle(lot->at.x, lot->at.y, 251, i, 1);
    }
    const struct gen_frustum drum = {wall, wall, 24, -sink(lot), top};
    gen_prism(mesh, &drum);
    if (gen_random(lot->rng) & 1) {
        const int32_t centre[3] = {lot->at.x, lot->at.y, top - radius / 5};
        gen_ball(mesh, centre, radius * 9 / 10, 8, lot->rng, 0);
    } else {
        const struct gen_frustum cone = {rim, tip, 24, top - 157, top + radius};
        gen_prism(mesh, &cone);
    }
}

/* A six-sided block whose upper storeys lean outward. */
static void add_prism(struct gen_mesh *mesh, const struct lot *lot)
{
    struct gen_point2 bottom[6], top[6];
    int32_t radius = lot->half * gen_range(lot->rng, 60, 80) / 100;
    int32_t rise = gen_range(lot->rng, 3, 3 + lot->storeys_max / 2) * 3000;
    for (uint32_t i = 0; i < 6; i++) {
        bottom[i] = gen_circle(lot->at.x, lot->at.y, radius, i, 4);
        top[i] = gen_circle(lot->at.x, lot->at.y, radius * 115 / 100, i, 4);
    }
    const struct gen_frustum block = {bottom, top, 6, -sink(lot), rise};
    gen_prism(mesh, &block);
}

static void add_park(struct gen_mesh *mesh, const struct lot *lot)
{
    int trees = gen_range(lot->rng, 2, 5);
    for (int i = 0; i < trees; i++) {
        struct gen_point2 at = lot->at;
        at.x += gen_range(lot->rng, -lot->half, lot->half);
        at.y += gen_range(lot->rng, -lot->half, lot->half);
        add_tree(mesh, lot, at);
    }
}

static void add_lot(struct gen_mesh *mesh, const struct lot *lot)
{
    /* Whole-number right triangles: exact small angles. */
    static const int32_t angles[5][3] = {
        {1, 0, 1}, {24, 7, 25}, {40, -9, 41}, {60, 11, 61}, {84, -13, 85}};
    size_t first = mesh->vertex_count;
    int kind = gen_range(lot->rng, 0, 19);
    if (kind < 9) {
        add_house(mesh, lot);
    } else if (kind < 12) {
        add_hall(mesh, lot);
    } else if (kind < 13) {
        add_tower(mesh, lot);
    } else if (kind < 15) {
        add_round(mesh, lot);
    } else if (kind < 17) {
        add_prism(mesh, lot);
    } else {
        add_park(mesh, lot);
    }
    gen_turn(mesh, first, lot->at, angles[gen_range(lot->rng, 0, 4)]);
    if (gen_random(lot->rng) & 1) {
        struct gen_point2 at = lot->at;
        at.x += lot->half + gen_range(lot->rng, 11, 499);
        at.y += gen_range(lot->rng, -lot->half, lot->half);
        add_tree(mesh, lot, at);
    }
}

/* More storeys towards the middle: up to 27 there, 3 at the edge. */
static int32_t storeys_at(struct gen_point2 at)
{
    int64_t x = at.x / 1000, y = at.y / 1000, reach = ACROSS_MM / 2000;
    int64_t rest = reach * reach - x * x - y * y;
    return rest < 0 ? 3 : (int32_t)(3 + 24 * rest / (reach * reach) * rest / (reach * reach));
}

void gen_city(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    struct gen_rng rng = {seed};
    const int32_t low[3] = {-ACROSS_MM / 2, -ACROSS_MM / 2, -GROUND_MM};
    const int32_t high[3] = {ACROSS_MM / 2, ACROSS_MM / 2, 0};
    gen_box(mesh, low, high);
    int32_t width = ACROSS_MM / (size + size / LOTS_A_BLOCK + 1);
    for (int32_t j = 0; j < size; j++) {
        for (int32_t i = 0; i < size; i++) {
            struct lot lot = {.half = width * 45 / 100, .rng = &rng};
            lot.at.x = low[0] + width + (i + i / LOTS_A_BLOCK) * width;
            lot.at.y = low[1] + width + (j + j / LOTS_A_BLOCK) * width;
            lot.storeys_max = storeys_at(lot.at);
            add_lot(mesh, &lot);
        }
    }
}
