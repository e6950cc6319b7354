/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Fractal terrain, 8 km across, as one closed solid: a height field of size x size cells of two
 * triangles, vertical sides and a flat bottom. Heights are a sum of octaves of gradient noise in
 * fixed point (Perlin 2002), the coarse ones folded into ridges; octaves finer than the grid are
 * left out, so that a finer grid of the same seed is the same land with more detail.
 */
#include "gen.h"

enum {
    ACROSS_MM = 8000000,
    FIRST_WAVES = 3, /* lattice cells of the coarsest octave across the land */
    RIDGED_OCTAVES = 3,
    FIRST_HEIGHT_MM = 450000,
    BOTTOM_MM = -1200000,
    ONE = 65536,  /* 1 in fixed point */
    LONG = 60547, /* cosine and sine of 22.5 degrees: no slope along the grid */
    SHORT = 25080,
    SHIFT_X = 40503, /* of each octave against the last, so that their grids never meet */
    SHIFT_Y = 24593,
};

/* Slope of a lattice point towards one of eight directions, times an offset from it. */
static int64_t corner(const int64_t at[2], const int64_t offset[2], int octave, uint64_t seed)
{
    static const int64_t slopes[8][2] = {{LONG, SHORT},  {SHORT, LONG},   {-SHORT, LONG},
                                         {-LONG, SHORT}, {-LONG, -SHORT}, {-SHORT, -LONG},
                                         {SHORT, -LONG}, {LONG, -SHORT}};
    struct gen_rng rng = {seed + (uint64_t)octave * UINT64_C(0x100000001b3)};
    rng.state = gen_random(&rng) + (uint64_t)at[0];
    rng.state = gen_random(&rng) + (uint64_t)at[1];
    const int64_t *slope = slopes[gen_random(&rng) >> 61];
    return (slope[0] * offset[0] + slope[1] * offset[1]) / ONE;
}

/* 6 t^5 - 15 t^4 + 10 t^3 in fixed point. */
static int64_t smooth(int64_t t)
{
    int64_t inner = t * (6 * t - 15 * ONE) / ONE + 10 * ONE;
    return t * t / ONE * t / ONE * inner / ONE;
}

/* Gradient noise at x, y in fixed-point lattice units, about -ONE..ONE. */
static int64_t noise(int64_t x, int64_t y, int octave, uint64_t seed)
{
    int64_t rows[2], fx = x % ONE, fy = y % ONE;
    for (int64_t j = 0; j < 2; j++) {
        int64_t ends[2];
        for (int64_t i = 0; i < 2; i++) {
            const int64_t at[2] = {x / ONE + i, y / ONE + j};
            const int64_t offset[2] = {fx - i * ONE, fy - j * ONE};
            ends[i] = corner(at, offset, octave, seed);
        }
        rows[j] = ends[0] + (ends[1] - ends[0]) * smooth(fx) / ONE;
    }
    return (rows[0] + (rows[1] - rows[0]) * smooth(fy) / ONE) * 3 / 2;
}

static int32_t height(int32_t i, int32_t j, int32_t size, uint64_t seed)
{
    int64_t sum = 0, amplitude = FIRST_HEIGHT_MM, waves = FIRST_WAVES;
    for (int octave = 0; waves <= size || octave == 0; octave++) {
        int64_t x = i * waves * ONE / size + octave * SHIFT_X;
        int64_t y = j * waves * ONE / size + octave * SHIFT_Y;
        int64_t n = noise(x, y, octave, seed);
        if (octave < RIDGED_OCTAVES) {
            n = ONE - 2 * (n < 0 ? -n : n);
        }
        sum += amplitude * n / ONE;
        amplitude = amplitude * 46 / 100;
        waves *= 2;
    }
    return (int32_t)sum;
}

static int32_t along(int32_t i, int32_t size)
{
    return (int32_t)((int64_t)i * ACROSS_MM / size) - ACROSS_MM / 2;
}

static void add_top(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    uint32_t row = (uint32_t)size + 1;
    for (int32_t j = 0; j <= size; j++) {
        for (int32_t i = 0; i <= size; i++) {
            gen_vertex(mesh, along(i, size), along(j, size), height(i, j, size, seed));
        }
    }
    for (uint32_t j = 0; j < (uint32_t)size; j++) {
        for (uint32_t i = 0; i < (uint32_t)size; i++) {
            uint32_t a = j * row + i;
            if ((i + j) % 2 == 0) {
                gen_quad(mesh, a, a + 1, a + row + 1, a + row);
            } else {
                gen_quad(mesh, a + 1, a + row + 1, a + row, a);
            }
        }
    }
}

/* Number of the top vertex at step k of the rim, counter-clockwise from above. */
static uint32_t rim(uint32_t k, uint32_t size)
{
    uint32_t row = size + 1, side = k / size % 4, step = k % size;
    switch (side) {
    case 0:
        return step;
    case 1:
        return step * row + size;
    case 2:
        return size * row + size - step;
    default:
        return (size - step) * row;
    }
}

static void add_sides_and_bottom(struct gen_mesh *mesh, uint32_t size)
{
    uint32_t first = (uint32_t)mesh->vertex_count, steps = 4 * size;
    for (uint32_t k = 0; k < steps && !mesh->failed; k++) {
        const int32_t *top = mesh->vertices[rim(k, size)];
        gen_vertex(mesh, top[0], top[1], BOTTOM_MM);
    }
    uint32_t centre = gen_vertex(mesh, 0, 0, BOTTOM_MM);
    for (uint32_t k = 0; k < steps; k++) {
        uint32_t next = (k + 1) % steps;
        gen_quad(mesh, first + k, first + next, rim(next, size), rim(k, size));
        gen_triangle(mesh, centre, first + next, first + k);
    }
}

void gen_terrain(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    add_top(mesh, size, seed);
    add_sides_and_bottom(mesh, (uint32_t)size);
}
