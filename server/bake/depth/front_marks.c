/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pairing the half edges of front faces. A half edge is put into a hash table, unless its
 * counterpart is there: then both are paired. A half edge that is left in the table at the end is a
 * border.
 *
 * Several threads share the table. A slot goes from free to taken to gone and never back. So a half
 * edge and its counterpart, whose searches start at the same slot, cannot miss each other: both
 * want the first free slot, and the later one finds the other there. Threads share only the slots.
 * The triangles that slots name were written before, so no memory ordering is needed.
 */
#include "bake/depth/proven_squares.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "tool/threads.h"

/* A projected area is a difference of two products. Below this share of their sum it may be
 * rounding error alone. */
#define AREA_DOUBT 1e-9

/* Greatest number of casters for each square of 64 x 64 texels at which marks are worth their cost,
 * by measurement. */
#define CASTERS_PER_SQUARE 8

#define SLOT_FREE UINT32_MAX
#define SLOT_GONE (UINT32_MAX - 1U) /* the slot's half edge was paired; searches go on past it */

struct finder {
    const struct umbb_casters *casters;
    uint8_t *marks;
    _Atomic uint32_t *slots; /* 4 * triangle + edge */
    size_t last;             /* number of slots - 1 */
    atomic_size_t fronts;
};

/* Number of triangles of a slice, and of triangles whose slots are prefetched together. */
#define JOB_TRIANGLES   ((size_t)1 << 14)
#define FETCH_TRIANGLES ((size_t)16)

static uint32_t job_count(const struct umbb_casters *casters)
{
    return (uint32_t)((casters->count + JOB_TRIANGLES - 1) / JOB_TRIANGLES);
}

static size_t job_end(const struct umbb_casters *casters, uint32_t job)
{
    const size_t end = ((size_t)job + 1) * JOB_TRIANGLES;
    return end < casters->count ? end : casters->count;
}

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
    return casters->closed_rule && !casters->open_on_word && casters->count > 0 &&
           casters->count < UINT32_MAX / 4 && prove != UMBB_PROVE_NEVER &&
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
        const double value = corner[axis] + 0.0; /* -0 becomes 0, as the two compare equal */
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

/* An edge's two corners, in the same sense around every front face. */
static void edge_corners(const struct umbb_casters *casters, uint32_t half_edge,
                         const double **from, const double **to)
{
    const size_t triangle = half_edge >> 2, edge = half_edge & 3;
    const double(*v)[3] = casters->corners[triangle];
    const int flipped = casters->kinds[triangle] == UMBB_CASTER_CLOSED_FLIPPED;
    *from = v[flipped ? (edge + 1) % 3 : edge];
    *to = v[flipped ? edge : (edge + 1) % 3];
}

static int are_counterparts(const struct umbb_casters *casters, uint32_t one, uint32_t other)
{
    const double *from, *to, *other_from, *other_to;
    edge_corners(casters, one, &from, &to);
    edge_corners(casters, other, &other_from, &other_to);
    return same_corner(from, other_to) && same_corner(to, other_from);
}

static int slot_change(_Atomic uint32_t *slot, uint32_t *from, uint32_t to)
{
    return atomic_compare_exchange_strong_explicit(slot, from, to, memory_order_relaxed,
                                                   memory_order_relaxed);
}

/* Pairs a half edge with its waiting counterpart, or makes it wait. at: first slot to search. */
static void add_half_edge(struct finder *f, uint32_t half_edge, size_t at)
{
    for (;; at = (at + 1) & f->last) {
        uint32_t other = atomic_load_explicit(&f->slots[at], memory_order_relaxed);
        if (other == SLOT_FREE && slot_change(&f->slots[at], &other, half_edge)) {
            return;
        }
        /* Another thread took the slot, perhaps a moment ago. */
        if (other != SLOT_GONE && are_counterparts(f->casters, half_edge, other) &&
            slot_change(&f->slots[at], &other, SLOT_GONE)) {
            return;
        }
    }
}

/* Finds the first slots to search for a triangle's edges, equal from both sides of an edge. */
static void edge_slots(const struct finder *f, size_t triangle, size_t at[3])
{
    uint64_t hash[3];
    for (size_t corner = 0; corner < 3; corner++) {
        hash[corner] = corner_hash(f->casters->corners[triangle][corner]);
    }
    for (size_t edge = 0; edge < 3; edge++) {
        at[edge] = (size_t)mix(hash[edge] + hash[(edge + 1) % 3]) & f->last;
    }
}

/* Finds and prefetches the first slots for the edges of front faces from `first` on; returns the
 * number of triangles done. */
static size_t fetch_slots(const struct finder *f, size_t first, size_t end,
                          size_t at[FETCH_TRIANGLES][3])
{
    const size_t count = end - first < FETCH_TRIANGLES ? end - first : FETCH_TRIANGLES;
    for (size_t i = 0; i < count; i++) {
        if (f->marks[first + i] != 0) {
            edge_slots(f, first + i, at[i]);
            for (size_t edge = 0; edge < 3; edge++) {
                __builtin_prefetch((const void *)&f->slots[at[i][edge]], 1);
            }
        }
    }
    return count;
}

/* Callback for an edge of a front face. at: first slot of the edge's search. */
typedef void (*edge_fn)(struct finder *f, size_t triangle, size_t edge, size_t at);

/* Visits the edges of the front faces of a slice. */
static void visit_edges(struct finder *f, uint32_t job, edge_fn visit)
{
    const size_t end = job_end(f->casters, job);
    size_t at[FETCH_TRIANGLES][3];
    for (size_t first = job * JOB_TRIANGLES; first < end; first += FETCH_TRIANGLES) {
        const size_t count = fetch_slots(f, first, end, at);
        for (size_t i = 0; i < count; i++) {
            for (size_t edge = 0; edge < 3 && f->marks[first + i] != 0; edge++) {
                visit(f, first + i, edge, at[i][edge]);
            }
        }
    }
}

static void pair_edge(struct finder *f, size_t triangle, size_t edge, size_t at)
{
    add_half_edge(f, (uint32_t)(4 * triangle + edge), at);
}

/* Pairs the edges of the front faces of a slice. */
static void pair_job(void *user, uint32_t job, unsigned thread)
{
    (void)thread;
    visit_edges(user, job, pair_edge);
}

/* Marks the front faces of a slice. */
static void front_job(void *user, uint32_t job, unsigned thread)
{
    (void)thread;
    struct finder *f = user;
    const size_t end = job_end(f->casters, job);
    size_t fronts = 0;
    for (size_t i = job * JOB_TRIANGLES; i < end; i++) {
        f->marks[i] = is_front(f->casters, i) ? UMBB_MARK_FRONT : 0;
        fronts += f->marks[i] != 0;
    }
    atomic_fetch_add_explicit(&f->fronts, fronts, memory_order_relaxed);
}

/* True if the same edge, in the same sense, waits; `at`: first slot. */
static int is_waiting(const struct finder *f, uint32_t half_edge, size_t at)
{
    const double *from, *to, *other_from, *other_to;
    edge_corners(f->casters, half_edge, &from, &to);
    for (;; at = (at + 1) & f->last) {
        const uint32_t other = atomic_load_explicit(&f->slots[at], memory_order_relaxed);
        if (other == SLOT_FREE) {
            return 0;
        }
        if (other != SLOT_GONE) {
            edge_corners(f->casters, other, &other_from, &other_to);
            if (same_corner(from, other_from) && same_corner(to, other_to)) {
                return 1;
            }
        }
    }
}

static void mark_edge(struct finder *f, size_t triangle, size_t edge, size_t at)
{
    if (is_waiting(f, (uint32_t)(4 * triangle + edge), at)) {
        f->marks[triangle] |= (uint8_t)(1U << edge);
    }
}

/* Marks the borders of the front faces of a slice of triangles: edges without a partner. If several
 * edges are equal, the order of threads decides which of them found a partner. So all equal edges
 * become borders, and the marks do not depend on that order. */
static void border_job(void *user, uint32_t job, unsigned thread)
{
    (void)thread;
    visit_edges(user, job, mark_edge);
}

enum umb_status umbb_front_marks_make(const struct umbb_casters *casters, enum umbb_prove prove,
                                      const struct umb_workers *workers, uint8_t **marks,
                                      struct umb_error *error)
{
    *marks = NULL;
    if (!are_wanted(casters, prove)) {
        return UMB_OK;
    }
    struct finder finder = {.casters = casters, .marks = malloc(casters->count)};
    atomic_init(&finder.fronts, 0);
    if (finder.marks != NULL) {
        umbu_workers_run(workers, front_job, &finder, job_count(casters));
    }
    const size_t fronts = atomic_load(&finder.fronts), slots = slot_count(fronts);
    finder.last = slots - 1;
    finder.slots = malloc(slots * sizeof *finder.slots);
    if (finder.marks == NULL || finder.slots == NULL) {
        free(finder.marks);
        free((void *)finder.slots);
        return umb_fail(error, UMB_E_NO_MEMORY, "edges of %zu triangles: memory refused", fronts);
    }
    memset((void *)finder.slots, 0xff, slots * sizeof *finder.slots);
    umbu_workers_run(workers, pair_job, &finder, job_count(casters));
    umbu_workers_run(workers, border_job, &finder, job_count(casters));
    free((void *)finder.slots);
    *marks = finder.marks;
    return UMB_OK;
}
