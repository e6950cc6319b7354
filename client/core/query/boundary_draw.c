/* SPDX-License-Identifier: Apache-2.0 */
/* See boundary_draw.h. */
#include "query/boundary_draw.h"

#include <string.h>

#include "query/voxel_walk.h"

enum {
    SHADOW_STEPS = 64, /* Cubes and voxels visited on the way from an edge to the surface */
    BRICK_MASKS = 23,  /* Seven pairs of slices, then rows along x and y of eight slices */
    NODE_MASKS = 3,
};

#define GOLDEN UINT64_C(0x9e3779b97f4a7c15) /* 2^64 divided by the golden ratio */

/* Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014. */
static uint64_t mix(uint64_t bits)
{
    bits = (bits ^ bits >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    bits = (bits ^ bits >> 27) * UINT64_C(0x94d049bb133111eb);
    return bits ^ bits >> 31;
}

struct umb__draws umb__draws_of(uint64_t seed, uint32_t point)
{
    return (struct umb__draws){mix(mix(seed + GOLDEN) + (point + UINT64_C(1)) * GOLDEN), 0};
}

uint64_t umb__draw(struct umb__draws *draws)
{
    return mix(draws->key + ++draws->count * GOLDEN);
}

uint32_t umb__draw_below(struct umb__draws *draws, uint32_t limit)
{
    return (uint32_t)((umb__draw(draws) >> 32) * limit >> 32);
}

double umb__draw_unit(struct umb__draws *draws)
{
    return (double)(umb__draw(draws) >> 11) * 0x1p-53;
}

/* The common face of two aligned cubes of different states. */
struct face {
    uint32_t first[3]; /* First voxel of the cube before the face */
    uint32_t level;    /* Level of the cubes */
    unsigned axis;     /* Axis that crosses the face */
    bool lit;          /* State of the cube before it */
};

static uint32_t count_bits(const uint64_t *masks, size_t first, size_t end)
{
    uint32_t count = 0;
    for (size_t i = first; i < end; i++) {
        count += (uint32_t)__builtin_popcountll(masks[i]);
    }
    return count;
}

/* Returns the position of set bit `number` of a mask, counted from the lowest. */
static unsigned find_bit(uint64_t mask, uint32_t number)
{
    for (; number > 0; number--) {
        mask &= mask - 1;
    }
    return (unsigned)__builtin_ctzll(mask);
}

/*
 * Draws one of the faces that the masks mark, a bit for each face. The first `depth_count` masks
 * mark faces across the light, the others mark faces along it. Both kinds have equal chances, and
 * within a kind all faces have. If one kind has no face, draws from the other. Returns false if no
 * bit is set.
 */
static bool draw_bit(const uint64_t *masks, size_t depth_count, size_t count,
                     struct umb__draws *draws, size_t *mask, unsigned *bit)
{
    const uint32_t across = count_bits(masks, 0, depth_count);
    const uint32_t aside = count_bits(masks, depth_count, count);
    if (across + aside == 0) {
        return false;
    }
    const bool is_aside = (umb__draw(draws) & 1 && aside > 0) || across == 0;
    uint32_t number = umb__draw_below(draws, is_aside ? aside : across);
    *mask = is_aside ? depth_count : 0;
    for (;; (*mask)++) {
        const uint32_t here = (uint32_t)__builtin_popcountll(masks[*mask]);
        if (number < here) {
            *bit = find_bit(masks[*mask], number);
            return true;
        }
        number -= here;
    }
}

/* Draws a face between voxels of a brick. In: first: first voxel of the brick. */
static bool face_of_brick(const uint64_t brick[8], const uint32_t first[3],
                          struct umb__draws *draws, struct face *face)
{
    uint64_t slices[8], masks[BRICK_MASKS];
    size_t mask;
    unsigned bit;
    memcpy(slices, brick, sizeof slices);
    for (unsigned z = 0; z < 8; z++) {
        if (z < 7) {
            masks[z] = slices[z] ^ slices[z + 1];
        }
        masks[7 + z] = (slices[z] ^ slices[z] >> 1) & UINT64_C(0x7f7f7f7f7f7f7f7f);
        masks[15 + z] = (slices[z] ^ slices[z] >> 8) & UINT64_MAX >> 8;
    }
    if (!draw_bit(masks, 7, BRICK_MASKS, draws, &mask, &bit)) {
        return false;
    }
    const uint32_t z = (uint32_t)(mask < 7 ? mask : (mask - 7) % 8);
    *face = (struct face){.first = {first[0] + bit % 8, first[1] + bit / 8, first[2] + z},
                          .axis = mask < 7 ? 2 : (unsigned)(mask - 7) / 8,
                          .lit = slices[z] >> bit & 1};
    return true;
}

/* Draws a face between the children of a wide node, all of which are uniform. In: lit: states of
 * the children. level: level of the children. */
static bool face_of_node(uint64_t lit, const uint32_t first[3], uint32_t level,
                         struct umb__draws *draws, struct face *face)
{
    const uint64_t masks[NODE_MASKS] = {(lit ^ lit >> 16) & UINT64_MAX >> 16,
                                        (lit ^ lit >> 1) & UINT64_C(0x7777777777777777),
                                        (lit ^ lit >> 4) & UINT64_C(0x0fff0fff0fff0fff)};
    size_t mask;
    unsigned bit;
    if (!draw_bit(masks, 1, NODE_MASKS, draws, &mask, &bit)) {
        return false;
    }
    *face =
        (struct face){.first = {first[0] + (bit % 4 << level), first[1] + (bit / 4 % 4 << level),
                                first[2] + (bit / 16 << level)},
                      .level = level,
                      .axis = (unsigned)(mask + 2) % 3,
                      .lit = lit >> bit & 1};
    return true;
}

/* Draws a face inside a mixed cell. In: first: first voxel of the cell. The walk ends: levels fall
 * by two down to bricks. */
static bool face_inside(const struct umb__tree *tree, struct umb__link link, uint32_t first[3],
                        struct umb__draws *draws, struct face *face)
{
    uint32_t level = umb__tree_cell_level(tree);
    while (link.mixed && level > UMB_LEVEL_BRICK) {
        const uint64_t *node = tree->nodes + link.number;
        const uint64_t mixed = node[0];
        level -= 2;
        if (mixed == 0) {
            return face_of_node(node[1], first, level, draws, face);
        }
        const uint32_t count = (uint32_t)__builtin_popcountll(mixed);
        const unsigned child = find_bit(mixed, umb__draw_below(draws, count));
        first[0] += child % 4 << level;
        first[1] += child / 4 % 4 << level;
        first[2] += child / 16 << level;
        link = umb__tree_child(tree, link.number, child);
    }
    return link.mixed && face_of_brick(tree->bricks[link.number], first, draws, face);
}

static bool is_lit(const struct umb__tree *tree, const uint32_t voxel[3])
{
    struct umb_volume_stats ignored = {0};
    const struct umb__place place = umb__tree_locate(tree, voxel[0], voxel[1], voxel[2], &ignored);
    return place.brick ? umb__brick_voxel(place.brick, voxel[0], voxel[1], voxel[2]) : place.lit;
}

/* Draws two voxels on both sides of a face. */
static struct umb__boundary boundary_at(const struct face *face, struct umb__draws *draws)
{
    struct umb__boundary boundary;
    uint32_t *before = face->lit ? boundary.lit : boundary.shadowed;
    uint32_t *behind = face->lit ? boundary.shadowed : boundary.lit;
    const uint32_t side = 1U << face->level;
    for (unsigned axis = 0; axis < 3; axis++) {
        const uint32_t offset = axis == face->axis ? side - 1 : umb__draw_below(draws, side);
        before[axis] = behind[axis] = face->first[axis] + offset;
    }
    behind[face->axis]++;
    return boundary;
}

/* Moves a boundary at a shadow's edge along the light to the surface that receives the shadow. The
 * boundary does not move if the shadowed voxels end before that surface. */
static void move_to_surface(const struct umb__tree *tree, struct umb__boundary *boundary)
{
    const uint32_t *lit = boundary->lit;
    const int64_t shadow = umb__first_shadow(tree, lit[0], lit[1], lit[2], SHADOW_STEPS);
    if (shadow > 0) {
        const uint32_t depth = (uint32_t)shadow - 1;
        const uint32_t beside[3] = {boundary->shadowed[0], boundary->shadowed[1], depth};
        if (!is_lit(tree, beside)) {
            boundary->lit[2] = boundary->shadowed[2] = depth;
        }
    }
}

/* Draws a face of a cell. */
static bool face_of_cell(const struct umb__tree *tree, const struct umb__boundary_cell *cell,
                         struct umb__draws *draws, struct face *face)
{
    uint32_t first[3];
    size_t mask;
    unsigned bit;
    memcpy(first, cell->first, sizeof first);
    if (cell->link.mixed) {
        return face_inside(tree, cell->link, first, draws, face);
    }
    if (!draw_bit(cell->faces, 1, NODE_MASKS, draws, &mask, &bit)) {
        return false;
    }
    *face = (struct face){.first = {first[0], first[1], first[2]},
                          .level = umb__tree_cell_level(tree),
                          .axis = (unsigned)(mask + 2) % 3,
                          .lit = cell->link.lit};
    return true;
}

bool umb__boundary_cell_read(const struct umb__tree *tree, uint32_t x, uint32_t y, uint32_t z,
                             struct umb__boundary_cell *cell)
{
    const uint32_t level = umb__tree_cell_level(tree), last = (1U << tree->grid_log2) - 1;
    cell->link = umb__tree_cell(tree, x, y, z);
    if (!cell->link.mixed) {
        const struct umb__link own = cell->link;
        const struct umb__link next[NODE_MASKS] = {
            z < last ? umb__tree_cell(tree, x, y, z + 1) : own,
            x < last ? umb__tree_cell(tree, x + 1, y, z) : own,
            y < last ? umb__tree_cell(tree, x, y + 1, z) : own,
        };
        uint64_t any = 0;
        for (unsigned i = 0; i < NODE_MASKS; i++) {
            cell->faces[i] = !next[i].mixed && next[i].lit != own.lit;
            any |= cell->faces[i];
        }
        if (any == 0) {
            return false;
        }
    }
    cell->first[0] = x << level;
    cell->first[1] = y << level;
    cell->first[2] = z << level;
    return true;
}

bool umb__boundary_draw(const struct umb__tree *tree, const struct umb__boundary_cell *cell,
                        struct umb__draws *draws, struct umb__boundary *boundary)
{
    struct face face;
    if (!face_of_cell(tree, cell, draws, &face)) {
        return false;
    }
    *boundary = boundary_at(&face, draws);
    if (face.axis < 2) {
        move_to_surface(tree, boundary);
    }
    return true;
}
