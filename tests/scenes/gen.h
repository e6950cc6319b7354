/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_SCENES_GEN_H
#define UMBRAGE_TESTS_SCENES_GEN_H
/*
 * Generated test scenes: the same bytes on every machine.
 *
 * Geometry is made in whole millimetres, z up, x east, y north: integers only, but for one square
 * root that IEEE 754 rounds correctly everywhere. Random numbers are SplitMix64. A scene's mesh
 * grows by the gen_* functions below; running out of memory sets `failed` and makes later calls
 * harmless, so that the makers need no error paths.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct gen_mesh {
    int32_t (*vertices)[3]; /* millimetres */
    uint32_t (*triangles)[3];
    size_t vertex_count, vertex_capacity;
    size_t triangle_count, triangle_capacity;
    int32_t (*places)[3]; /* where all of it stands, millimetres; none: once, as it is */
    size_t place_count, place_capacity;
    int failed;
};

struct gen_rng {
    uint64_t state;
};

struct gen_point2 {
    int32_t x, y; /* millimetres */
};

/* A vertical solid between two convex polygons of `count` corners, counter-clockwise from above. */
struct gen_frustum {
    const struct gen_point2 *bottom, *top;
    uint32_t count;
    int32_t bottom_z, top_z;
};

enum gen_format {
    GEN_FORMAT_GLB = 0, /* y up, float32 about a node's translation */
    GEN_FORMAT_OBJ = 1, /* z up, three decimals: exact */
    GEN_FORMAT_PLY = 2, /* z up, binary little-endian doubles */
};

uint64_t gen_random(struct gen_rng *rng);
int32_t gen_range(struct gen_rng *rng, int32_t low, int32_t high); /* both included */

void gen_mesh_finish(struct gen_mesh *mesh);
uint32_t gen_vertex(struct gen_mesh *mesh, int32_t x, int32_t y, int32_t z);
void gen_triangle(struct gen_mesh *mesh, uint32_t a, uint32_t b, uint32_t c);
void gen_place(struct gen_mesh *mesh, int32_t x, int32_t y, int32_t z);
void gen_quad(struct gen_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d);

/* Closed outward solids. */
void gen_box(struct gen_mesh *mesh, const int32_t low[3], const int32_t high[3]);
void gen_prism(struct gen_mesh *mesh, const struct gen_frustum *frustum);
/* A roof: rectangle low..high at low[2], ridge at high[2] along x (axis 0) or y (axis 1). */
void gen_gable(struct gen_mesh *mesh, const int32_t low[3], const int32_t high[3], int axis);
/* An octahedron of 8 * detail^2 triangles blown up to a ball; bumps: per mille of the radius. */
void gen_ball(struct gen_mesh *mesh, const int32_t centre[3], int32_t radius, int32_t detail,
              struct gen_rng *rng, int32_t bumps);
/* A straight bar of square section 2 * half in y and z between two points of different x. */
void gen_bar(struct gen_mesh *mesh, const int32_t from[3], const int32_t to[3], int32_t half);

/* Corner i of a regular polygon of 24 / step corners; i counts corners. */
struct gen_point2 gen_circle(int32_t x, int32_t y, int32_t radius, uint32_t i, uint32_t step);

/* Turns vertices from `first` on about a vertical axis by the angle of cosine c/d, sine s/d. */
void gen_turn(struct gen_mesh *mesh, size_t first, struct gen_point2 axis, const int32_t csd[3]);

/* The scenes. size: see scenegen's usage. */
void gen_terrain(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_city(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_arch(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_bridge(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_hall(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_forest(struct gen_mesh *mesh, int32_t size, uint64_t seed);
void gen_houses(struct gen_mesh *mesh, int32_t size, uint64_t seed);

/* Writes the mesh; light: also a sun from south-east, 45 degrees high (GLB). 0 if it failed. */
int gen_write(FILE *file, const struct gen_mesh *mesh, enum gen_format format, int light);

#endif
