/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A closed hall: size bays of 6 m along x, 18 m wide, 12 m high, with tall windows between piers in
 * both long walls, one in the western end, two rows of columns and a gabled roof. Every part is a
 * closed solid, and parts reach into one another, as masonry does, so that no light leaks through
 * joints. Light comes in through the windows alone.
 */
#include "gen.h"

enum {
    BAY_MM = 6000,
    HALF_WIDTH_MM = 9000, /* to the inner face of a long wall */
    WALL_MM = 700,
    HEIGHT_MM = 12000,
    RIDGE_MM = 16500,
    SILL_MM = 2500,
    LINTEL_MM = 9500,
    PIER_MM = 2000, /* half of it on each side of a bay's border */
    BAR_MM = 90,    /* half the thickness of a mullion */
    JOINT_MM = 10,  /* how far parts reach into one another */
    COLUMN_MM = 520,
    AISLE_MM = 4200, /* from the middle to the columns */
    CORNERS = 24,
};

static void box(struct gen_mesh *mesh, const int32_t x[2], const int32_t y[2], const int32_t z[2])
{
    const int32_t low[3] = {x[0], y[0], z[0]}, high[3] = {x[1], y[1], z[1]};
    gen_box(mesh, low, high);
}

/* The wall of one bay from x to x + BAY_MM, between y[0] and y[1]: pier, sill, lintel, mullions. */
static void add_wall_bay(struct gen_mesh *mesh, int32_t x, const int32_t y[2])
{
    const int32_t middle = (y[0] + y[1]) / 2;
    const int32_t glass[2] = {middle - BAR_MM, middle + BAR_MM};
    const int32_t bay[2] = {x - JOINT_MM, x + BAY_MM + JOINT_MM};
    box(mesh, bay, y, (const int32_t[2]){-JOINT_MM, SILL_MM});
    box(mesh, bay, y, (const int32_t[2]){LINTEL_MM, HEIGHT_MM + JOINT_MM});
    for (int32_t side = 0; side < 2; side++) {
        int32_t from = side ? x + BAY_MM - PIER_MM / 2 : x - JOINT_MM;
        const int32_t pier[2] = {from, from + PIER_MM / 2 + JOINT_MM};
        box(mesh, pier, y, (const int32_t[2]){SILL_MM - JOINT_MM, LINTEL_MM + JOINT_MM});
    }
    for (int32_t i = 1; i < 3; i++) {
        int32_t at = x + PIER_MM / 2 + i * (BAY_MM - PIER_MM) / 3;
        box(mesh, (const int32_t[2]){at - BAR_MM, at + BAR_MM}, glass,
            (const int32_t[2]){SILL_MM - JOINT_MM, LINTEL_MM + JOINT_MM});
    }
    int32_t across = (SILL_MM + 2 * LINTEL_MM) / 3;
    box(mesh, bay, glass, (const int32_t[2]){across - BAR_MM, across + BAR_MM});
}

/* An end wall between x[0] and x[1], with a window in the middle if `window`. */
static void add_end(struct gen_mesh *mesh, const int32_t x[2], int window)
{
    const int32_t half = HALF_WIDTH_MM + WALL_MM, opening = window ? 2500 : 0;
    const int32_t all[2] = {-JOINT_MM, HEIGHT_MM + JOINT_MM};
    const int32_t middle[2] = {-opening - JOINT_MM, opening + JOINT_MM};
    box(mesh, x, (const int32_t[2]){-half, -opening}, all);
    box(mesh, x, (const int32_t[2]){opening, half}, all);
    if (window) {
        box(mesh, x, middle, (const int32_t[2]){-JOINT_MM, SILL_MM});
        box(mesh, x, middle, (const int32_t[2]){LINTEL_MM, HEIGHT_MM + JOINT_MM});
    }
}

static void add_column(struct gen_mesh *mesh, int32_t x, int32_t y)
{
    struct gen_point2 ring[CORNERS];
    for (uint32_t i = 0; i < CORNERS; i++) {
        ring[i] = gen_circle(x, y, COLUMN_MM, i, 1);
    }
    const struct gen_frustum shaft = {ring, ring, CORNERS, -JOINT_MM, HEIGHT_MM - 400};
    const int32_t base = COLUMN_MM + 180;
    gen_prism(mesh, &shaft);
    box(mesh, (const int32_t[2]){x - base, x + base}, (const int32_t[2]){y - base, y + base},
        (const int32_t[2]){-JOINT_MM, 350});
    box(mesh, (const int32_t[2]){x - base, x + base}, (const int32_t[2]){y - base, y + base},
        (const int32_t[2]){HEIGHT_MM - 450, HEIGHT_MM + JOINT_MM});
}

void gen_hall(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    (void)seed;
    const int32_t start = -size * BAY_MM / 2, end = start + size * BAY_MM;
    const int32_t half = HALF_WIDTH_MM + WALL_MM;
    const int32_t length[2] = {start - WALL_MM, end + WALL_MM}, width[2] = {-half, half};
    const int32_t south[2] = {-half, -HALF_WIDTH_MM}, north[2] = {HALF_WIDTH_MM, half};
    box(mesh, length, width, (const int32_t[2]){-600, 0});
    box(mesh, length, width, (const int32_t[2]){HEIGHT_MM, HEIGHT_MM + 500});
    const int32_t eaves[3] = {start - 1200, -half - 600, HEIGHT_MM + 490};
    const int32_t ridge[3] = {end + 1200, half + 600, RIDGE_MM};
    gen_gable(mesh, eaves, ridge, 0);
    add_end(mesh, (const int32_t[2]){start - WALL_MM, start + JOINT_MM}, 1);
    add_end(mesh, (const int32_t[2]){end - JOINT_MM, end + WALL_MM}, 0);
    for (int32_t i = 0; i < size; i++) {
        add_wall_bay(mesh, start + i * BAY_MM, south);
        add_wall_bay(mesh, start + i * BAY_MM, north);
    }
    for (int32_t i = 1; i < size; i++) {
        add_column(mesh, start + i * BAY_MM, -AISLE_MM);
        add_column(mesh, start + i * BAY_MM, AISLE_MM);
    }
}
