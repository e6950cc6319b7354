/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Houses with eaves, and with doors and windows in recesses: the places where a bias loses shadows
 * first. size x size lots of 20 m on a slab. Every part is a closed outward solid; parts reach into
 * one another by JOINT_MM, and no two share an edge.
 */
#include "gen.h"

enum {
    LOT_MM = 20000,
    GROUND_MM = 2000, /* Thickness of the slab */
    JOINT_MM = 17,
    DOOR_MM = 550, /* Half the width of a door */
    DOOR_TOP_MM = 2150,
    WINDOW_MM = 700, /* Half the width of a window */
    SILL_MM = 950,
    WINDOW_TOP_MM = 2250,
    LINTEL_SUNK_MM = 7, /* How far lintels and sills stand behind the wall's face */
};

/* A wall along an axis: its face is at `face`, and the wall extends `depth` behind the face, in the
 * direction `inward`. */
struct wall {
    int axis; /* 0: along x, 1: along y */
    int32_t face, inward, depth;
    int32_t from, to, height;
};

/* Adds the part of a wall between two places along it and two heights, `sunk` behind its face. */
static void add_piece(struct gen_mesh *mesh, const struct wall *wall, const int32_t along[2],
                      const int32_t z[2], int32_t sunk)
{
    const int32_t front = wall->face + wall->inward * sunk;
    const int32_t back = wall->face + wall->inward * (wall->depth + JOINT_MM);
    int32_t low[3], high[3];
    low[wall->axis] = along[0];
    high[wall->axis] = along[1];
    low[1 - wall->axis] = front < back ? front : back;
    high[1 - wall->axis] = front < back ? back : front;
    low[2] = z[0];
    high[2] = z[1];
    gen_box(mesh, low, high);
}

/* Adds a wall with a door (bottom 0) or window in the middle of each half. */
static void add_wall(struct gen_mesh *mesh, const struct wall *wall, int door)
{
    const int32_t quarter = (wall->to - wall->from) / 4;
    int32_t at = wall->from;
    for (int side = 0; side < 2; side++) {
        const int is_door = door && side == 0;
        const int32_t half = is_door ? DOOR_MM : WINDOW_MM;
        const int32_t middle = wall->from + (side ? 3 * quarter : quarter);
        const int32_t opening[2] = {middle - half, middle + half};
        const int32_t across[2] = {opening[0] - JOINT_MM, opening[1] + JOINT_MM};
        const int32_t before[2] = {at, opening[0]};
        add_piece(mesh, wall, before, (const int32_t[2]){-JOINT_MM, wall->height}, 0);
        add_piece(
            mesh, wall, across,
            (const int32_t[2]){is_door ? DOOR_TOP_MM : WINDOW_TOP_MM, wall->height - JOINT_MM},
            LINTEL_SUNK_MM);
        if (!is_door) {
            add_piece(mesh, wall, across, (const int32_t[2]){-2 * JOINT_MM, SILL_MM},
                      LINTEL_SUNK_MM);
        }
        at = opening[1];
    }
    add_piece(mesh, wall, (const int32_t[2]){at, wall->to},
              (const int32_t[2]){-JOINT_MM, wall->height}, 0);
}

static void add_house(struct gen_mesh *mesh, struct gen_point2 at, struct gen_rng *rng)
{
    const int32_t hx = gen_range(rng, 4200, 6500), hy = gen_range(rng, 3600, 5400);
    const int32_t height = gen_range(rng, 2700, 5600), depth = gen_range(rng, 180, 420);
    const int32_t eaves = gen_range(rng, 350, 900), thick = gen_range(rng, 90, 160);
    const int32_t pitch = gen_range(rng, 1800, 4200);
    const int32_t core_low[3] = {at.x - hx + depth, at.y - hy + depth, -3 * JOINT_MM};
    const int32_t core_high[3] = {at.x + hx - depth, at.y + hy - depth, height - 2 * JOINT_MM};
    gen_box(mesh, core_low, core_high);
    for (int side = -1; side <= 1; side += 2) {
        /* Walls along y stand between those along x, which have the corners. */
        const struct wall along_x = {0,         at.y + side * hy, -side, depth,
                                     at.x - hx, at.x + hx,        height};
        const struct wall along_y = {1,
                                     at.x + side * hx,
                                     -side,
                                     depth,
                                     at.y - hy + depth / 2,
                                     at.y + hy - depth / 2,
                                     height - 3 * JOINT_MM};
        add_wall(mesh, &along_x, side < 0);
        add_wall(mesh, &along_y, 0);
    }
    const int32_t slab_low[3] = {at.x - hx - eaves, at.y - hy - eaves, height - JOINT_MM};
    const int32_t slab_high[3] = {at.x + hx + eaves, at.y + hy + eaves, height + thick};
    gen_box(mesh, slab_low, slab_high);
    const int32_t roof_low[3] = {slab_low[0] + 3, slab_low[1] + 3, height + thick - JOINT_MM};
    const int32_t roof_high[3] = {slab_high[0] - 3, slab_high[1] - 3, height + thick + pitch};
    gen_gable(mesh, roof_low, roof_high, (int)(gen_random(rng) & 1));
    const int32_t cx = at.x + gen_range(rng, -hx / 2, hx / 2);
    const int32_t chimney_low[3] = {cx - 307, at.y + hy / 3 - 293, height - 53};
    const int32_t chimney_high[3] = {cx + 307, at.y + hy / 3 + 293, height + pitch + 611};
    gen_box(mesh, chimney_low, chimney_high);
}

/* A garden wall beside the house. */
static void add_fence(struct gen_mesh *mesh, struct gen_point2 at, struct gen_rng *rng)
{
    const int32_t x = at.x - LOT_MM / 2 + gen_range(rng, 301, 899);
    const int32_t low[3] = {x, at.y - LOT_MM / 2 + 1103, -JOINT_MM};
    const int32_t high[3] = {x + 150, at.y + LOT_MM / 2 - 1109, gen_range(rng, 900, 1600)};
    gen_box(mesh, low, high);
}

void gen_houses(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    /* Whole-number right triangles: exact small angles. */
    static const int32_t angles[5][3] = {
        {1, 0, 1}, {24, 7, 25}, {40, -9, 41}, {60, 11, 61}, {84, -13, 85}};
    struct gen_rng rng = {seed};
    const int32_t half = size * LOT_MM / 2 + LOT_MM / 2;
    const int32_t low[3] = {-half, -half, -GROUND_MM}, high[3] = {half, half, 0};
    gen_box(mesh, low, high);
    for (int32_t j = 0; j < size; j++) {
        for (int32_t i = 0; i < size; i++) {
            const struct gen_point2 at = {(2 * i + 1 - size) * (LOT_MM / 2),
                                          (2 * j + 1 - size) * (LOT_MM / 2)};
            const size_t first = mesh->vertex_count;
            add_house(mesh, at, &rng);
            add_fence(mesh, at, &rng);
            gen_turn(mesh, first, at, angles[gen_range(&rng, 0, 4)]);
        }
    }
}
