/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Half edges of front faces wait in a hash table until their counterpart comes. What waits at the
 * end has none: a border.
 */
#include "bake/depth/front_marks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A projected area below this share of the products it comes from may be rounding alone. */
#define AREA_DOUBT 1e-9

/* Squares of 64 x 64 texels for every so many casters make marks worth having (measured: eight
 * texels along a triangle's edge). */
#define CASTERS_PER_SQUARE 8

#define SLOT_FREE UINT32_MAX
#define SLOT_GONE (UINT32_MAX - 1U) /* was taken; a search goes on */

struct finder {
    const struct umbb_casters *casters;
    uint8_t *marks;
    uint32_t *slots; /* 4 * triangle + edge */
    size_t last;     /* number of slots - 1 */
};

static size_t slot_count(size_t fronts)
{
    size_t slots = 64;
    while (slots < 4 * fronts) {
        slots *= 2;
    }
    return slots;
}

static int are_wanted(const struct umbb_casters *casters, enum umbb_prove prove)
{
    const uint64_t across = (uint64_t)casters->size >> UMBB_SQUARE_LOG2;
    /* Bounds over a square are the predicate's own values: those of parallel light only. */
    return casters->closed_rule && !casters->open_on_word && !(casters->depth_scale > 0.0) &&
           casters->count > 0 && casters->count < UINT32_MAX / 4 && prove != UMBB_PROVE_NEVER &&
           (prove == UMBB_PROVE_ALWAYS || across * across * CASTERS_PER_SQUARE >= casters->count);
}

static int is_front(const struct umbb_casters *casters, size_t triangle)
{
    const double(*v)[3] = casters->corners[triangle];
    const double a = (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]);
    const double b = (v[1][1] - v[0][1]) * (v[2][0] - v[0][0]);
    if (casters->kinds[triangle] == UMBB_CASTER_OPEN ||
        !(fabs(a - b) > AREA_DOUBT * (fabs(a) + fabs(b)))) {
        return 0;
    }
    return (a - b < 0.0) != (casters->kinds[triangle] == UMBB_CASTER_CLOSED_FLIPPED);
}

static uint64_t mix(uint64_t h)
{
    h = (h ^ (h >> 32)) * 0xd6e8feb86659fd93ULL;
    return h ^ (h >> 32);
}

static uint64_t corner_hash(const double corner[3])
{
    uint64_t hash = 0;
    for (size_t axis = 0; axis < 3; axis++) {
        const double value = corner[axis] + 0.0; /* one zero, as they compare equal */
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        hash = mix(hash ^ bits);
    }
    return hash;
}

static int same_corner(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* An edge's two corners, going around every front face the same way. */
static void edge_corners(const struct umbb_casters *casters, uint32_t half_edge,
                         const double **from, const double **to)
{
    const size_t triangle = half_edge >> 2, edge = half_edge & 3;
    const double(*v)[3] = casters->corners[triangle];
    const int flipped = casters->kinds[triangle] == UMBB_CASTER_CLOSED_FLIPPED;
    *from = v[flipped ? (edge + 1) % 3 : edge];
    *to = v[flipped ? edge : (edge + 1) % 3];
}

/* Pairs a half edge with its waiting counterpart, or lets it wait. */
static void add_half_edge(struct finder *f, uint32_t half_edge)
{
    const double *from, *to, *other_from, *other_to;
    edge_corners(f->casters, half_edge, &from, &to);
    /* The same from both sides. */
    size_t at = (size_t)mix(corner_hash(from) + corner_hash(to)) & f->last;
    for (; f->slots[at] != SLOT_FREE; at = (at + 1) & f->last) {
        const uint32_t other = f->slots[at];
        if (other != SLOT_GONE) {
            edge_corners(f->casters, other, &other_from, &other_to);
            if (same_corner(from, other_to) && same_corner(to, other_from)) {
                f->slots[at] = SLOT_GONE;
                return;
            }
        }
    }
    f->slots[at] = half_edge;
}

/* Pairs the edges of all front faces. */
static void find_borders(struct finder *f)
{
    for (size_t i = 0; i < f->casters->count; i++) {
        for (uint32_t edge = 0; edge < 3 && f->marks[i] != 0; edge++) {
            add_half_edge(f, (uint32_t)(4 * i) + edge);
        }
    }
    for (size_t at = 0; at <= f->last; at++) {
        const uint32_t waiting = f->slots[at];
        if (waiting < SLOT_GONE) {
            f->marks[waiting >> 2] |= (uint8_t)(1U << (waiting & 3));
        }
    }
}

enum umb_status umbb_front_marks_make(const struct umbb_casters *casters, enum umbb_prove prove,
                                      uint8_t **marks, struct umb_error *error)
{
    *marks = NULL;
    if (!are_wanted(casters, prove)) {
        return UMB_OK;
    }
    struct finder finder = {.casters = casters, .marks = malloc(casters->count)};
    size_t fronts = 0;
    for (size_t i = 0; finder.marks != NULL && i < casters->count; i++) {
        finder.marks[i] = is_front(casters, i) ? UMBB_MARK_FRONT : 0;
        fronts += finder.marks[i] != 0;
    }
    const size_t slots = slot_count(fronts);
    finder.last = slots - 1;
    finder.slots = malloc(slots * sizeof *finder.slots);
    if (finder.marks == NULL || finder.slots == NULL) {
        free(finder.marks);
        free(finder.slots);
        return umb_fail(error, UMB_E_NO_MEMORY, "edges of %zu triangles: memory refused", fronts);
    }
    memset(finder.slots, 0xff, slots * sizeof *finder.slots);
    find_borders(&finder);
    free(finder.slots);
    *marks = finder.marks;
    return UMB_OK;
}
