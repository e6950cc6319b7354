/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Connected parts and closedness.
 *
 * Corners are welded (parts_weld.h). Each half-edge of a triangle goes into the bucket of its lower
 * vertex. Sorting a bucket by the other vertex puts all uses of one edge side by side: a run. The
 * run joins its triangles in a union-find forest, and shows how often and in which directions the
 * edge is used. Half-edges of a run are in the order of their triangles. So nothing depends on
 * hashing, and the result is the same on every machine.
 *
 * Invariant: a forest root is the lowest triangle of its tree, so parts come out in the order of
 * their first triangle.
 */
#include "scene/parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "base/vec.h"
#include "scene/parts_nest.h"
#include "scene/parts_weld.h"

enum {
    INSERTION_MAX = 24, /* a bucket of a usual mesh has about six entries */
};

/* State of the search for parts. Half-edge h belongs to triangle h / 3 and goes from its corner h %
 * 3 to the next. */
struct finder {
    const double (*corners)[3][3];
    uint32_t count;
    uint32_t *vertex_of; /* [3 * count] */
    uint32_t vertex_count;
    uint32_t *bucket;  /* [vertex_count + 1] start of each vertex's entries */
    uint64_t *entries; /* [bucket[vertex_count]] higher vertex << 32 | half-edge */
    uint32_t *parent;  /* [count] forest; a degenerate triangle is its own tree */
    uint64_t *scratch; /* room to sort the third vertices of a run */
    size_t scratch_capacity;
    uint32_t *first_bad; /* [part_count], lowest half-edge on a bad edge, UINT32_MAX = none */
};

static uint32_t edge_from(const struct finder *f, uint32_t half_edge)
{
    return f->vertex_of[half_edge];
}

static uint32_t edge_to(const struct finder *f, uint32_t half_edge)
{
    return f->vertex_of[half_edge % 3 == 2 ? half_edge - 2 : half_edge + 1];
}

static uint32_t edge_low(const struct finder *f, uint32_t half_edge)
{
    const uint32_t from = edge_from(f, half_edge), to = edge_to(f, half_edge);
    return from < to ? from : to;
}

static uint32_t edge_third(const struct finder *f, uint32_t half_edge)
{
    return f->vertex_of[half_edge % 3 == 0 ? half_edge + 2 : half_edge - 1];
}

/* Returns 1 if two corners are equal, or if the area in doubles is 0 or not finite. */
static int is_degenerate(const struct finder *f, uint32_t t)
{
    const uint32_t *v = f->vertex_of + 3 * (size_t)t;
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) {
        return 1;
    }
    const double(*c)[3] = f->corners[t];
    double u[3], w[3], n[3];
    umb__subtract(c[1], c[0], u);
    umb__subtract(c[2], c[0], w);
    umb__cross(u, w, n);
    return !(fabs(n[0]) + fabs(n[1]) + fabs(n[2]) > 0); /* also if one is NaN */
}

static uint32_t forest_root(uint32_t *parent, uint32_t t)
{
    while (parent[t] != t) {
        parent[t] = parent[parent[t]];
        t = parent[t];
    }
    return t;
}

static void forest_join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = forest_root(parent, a);
    b = forest_root(parent, b);
    if (a < b) {
        parent[b] = a;
    } else {
        parent[a] = b;
    }
}

static int compare_entries(const void *a, const void *b)
{
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

static void sort_entries(uint64_t *entries, size_t count)
{
    if (count > INSERTION_MAX) {
        qsort(entries, count, sizeof *entries, compare_entries);
        return;
    }
    for (size_t i = 1; i < count; i++) {
        uint64_t entry = entries[i];
        size_t at = i;
        while (at > 0 && entries[at - 1] > entry) {
            entries[at] = entries[at - 1];
            at--;
        }
        entries[at] = entry;
    }
}

/* Sorts all half-edges by counting: by their lower vertex, then by the higher one. */
static int bucket_edges(struct finder *f, struct umbs_parts *parts)
{
    f->bucket = umb__alloc_zeroed(NULL, (size_t)f->vertex_count + 1, sizeof *f->bucket);
    if (f->bucket == NULL) {
        return 0;
    }
    for (uint32_t h = 0; h < 3 * f->count; h++) {
        if (h % 3 == 0 && parts->part_of[h / 3] == UINT32_MAX) {
            h += 2;
            continue;
        }
        f->bucket[edge_low(f, h)]++;
    }
    uint32_t total = 0;
    for (size_t v = 0; v <= f->vertex_count; v++) {
        total += f->bucket[v];
        f->bucket[v] = total; /* the end of the bucket; filling moves it back to its start */
    }
    f->entries = umb__alloc(NULL, total > 0 ? total : 1, sizeof *f->entries);
    if (f->entries == NULL) {
        return 0;
    }
    for (uint32_t h = 3 * f->count; h-- > 0;) {
        if (parts->part_of[h / 3] == UINT32_MAX) {
            h -= 2;
            continue;
        }
        const uint32_t from = edge_from(f, h), to = edge_to(f, h), low = edge_low(f, h);
        f->entries[--f->bucket[low]] = (uint64_t)(from == low ? to : from) << 32 | h;
    }
    for (size_t v = 0; v < f->vertex_count; v++) {
        sort_entries(f->entries + f->bucket[v], f->bucket[v + 1] - f->bucket[v]);
    }
    return 1;
}

/* Returns the end of the run of equal edges from entry `first` of a bucket that ends at `last`. */
static uint32_t run_end(const struct finder *f, uint32_t first, uint32_t last)
{
    uint32_t end = first + 1;
    while (end < last && f->entries[end] >> 32 == f->entries[first] >> 32) {
        end++;
    }
    return end;
}

/*
 * Counts triangles of a run that repeat an earlier one. A triangle is compared only in the run of
 * its two lowest vertices, so each is seen once. Two triangles of a run are equal if their third
 * vertices are.
 */
static int count_duplicates(struct finder *f, uint32_t first, uint32_t end, size_t *duplicates)
{
    uint32_t high = (uint32_t)(f->entries[first] >> 32);
    size_t n = 0;
    if (!umb__grow(NULL, &f->scratch, &f->scratch_capacity, end - first, sizeof *f->scratch)) {
        return 0;
    }
    for (uint32_t i = first; i < end; i++) {
        uint32_t third = edge_third(f, (uint32_t)f->entries[i]);
        if (third > high) {
            f->scratch[n++] = third;
        }
    }
    sort_entries(f->scratch, n);
    for (size_t i = 1; i < n; i++) {
        *duplicates += f->scratch[i] == f->scratch[i - 1];
    }
    return 1;
}

static int join_triangles(struct finder *f, size_t *duplicates)
{
    for (size_t v = 0; v < f->vertex_count; v++) {
        uint32_t last = f->bucket[v + 1];
        for (uint32_t first = f->bucket[v]; first < last;) {
            uint32_t end = run_end(f, first, last);
            uint32_t triangle = (uint32_t)f->entries[first] / 3;
            for (uint32_t i = first + 1; i < end; i++) {
                forest_join(f->parent, triangle, (uint32_t)f->entries[i] / 3);
            }
            if (end - first > 1 && !count_duplicates(f, first, end, duplicates)) {
                return 0;
            }
            first = end;
        }
    }
    return 1;
}

/* Numbers the trees of the forest in order of their roots and makes the array of parts. */
static int number_parts(struct finder *f, struct umbs_parts *parts)
{
    size_t roots = 0;
    for (uint32_t t = 0; t < f->count; t++) {
        if (parts->part_of[t] != UINT32_MAX) {
            uint32_t root = forest_root(f->parent, t);
            parts->part_of[t] = root == t ? (uint32_t)roots++ : parts->part_of[root];
        }
    }
    parts->part_count = roots;
    parts->parts = umb__alloc_zeroed(NULL, roots > 0 ? roots : 1, sizeof *parts->parts);
    f->first_bad = umb__alloc(NULL, roots > 0 ? roots : 1, sizeof *f->first_bad);
    if (parts->parts == NULL || f->first_bad == NULL) {
        return 0;
    }
    memset(f->first_bad, 0xff, roots * sizeof *f->first_bad);
    return 1;
}

/* Adds one run to the counts of its part. */
static void judge_run(struct finder *f, struct umbs_parts *parts, uint32_t first, uint32_t end)
{
    uint32_t half_edge = (uint32_t)f->entries[first];
    uint32_t number = parts->part_of[half_edge / 3];
    struct umbs_part *part = &parts->parts[number];
    if (end - first == 1) {
        part->boundary_edges++;
    } else if (end - first > 2) {
        part->nonmanifold_edges++;
    } else if (edge_from(f, half_edge) == edge_from(f, (uint32_t)f->entries[first + 1])) {
        part->inconsistent_edges++;
    } else {
        return;
    }
    if (half_edge < f->first_bad[number]) {
        f->first_bad[number] = half_edge;
    }
}

static void judge_edges(struct finder *f, struct umbs_parts *parts)
{
    for (size_t v = 0; v < f->vertex_count; v++) {
        uint32_t last = f->bucket[v + 1];
        for (uint32_t first = f->bucket[v]; first < last;) {
            uint32_t end = run_end(f, first, last);
            judge_run(f, parts, first, end);
            first = end;
        }
    }
    for (size_t i = 0; i < parts->part_count; i++) {
        struct umbs_part *part = &parts->parts[i];
        uint32_t h = f->first_bad[i];
        part->closed = h == UINT32_MAX;
        if (!part->closed) {
            const double *a = f->corners[h / 3][h % 3];
            const double *b = f->corners[h / 3][(h + 1) % 3];
            for (int k = 0; k < 3; k++) {
                part->hole[k] = 0.5 * a[k] + 0.5 * b[k];
            }
        }
    }
}

static void add_to_box(struct umbs_part *part, const double (*c)[3])
{
    double *min = part->box.min, *max = part->box.max;
    if (part->triangle_count == 0) {
        memcpy(min, c[0], sizeof part->box.min);
        memcpy(max, c[0], sizeof part->box.max);
    }
    for (int i = 0; i < 9; i++) {
        const double place = c[i / 3][i % 3];
        min[i % 3] = place < min[i % 3] ? place : min[i % 3];
        max[i % 3] = place > max[i % 3] ? place : max[i % 3];
    }
}

/* Returns the volume of the tetrahedron between a triangle and the centre of the part's box. The
 * centre keeps large coordinates from cancelling each other. */
static double signed_volume(const struct umbs_part *part, const double (*c)[3])
{
    double p[3][3], n[3];
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) {
            p[k][i] = c[k][i] - (0.5 * part->box.min[i] + 0.5 * part->box.max[i]);
        }
    }
    umb__cross(p[1], p[2], n);
    return umb__dot(p[0], n) / 6.0;
}

static void measure_parts(const struct finder *f, struct umbs_parts *parts)
{
    for (uint32_t t = 0; t < f->count; t++) {
        if (parts->part_of[t] != UINT32_MAX) {
            struct umbs_part *part = &parts->parts[parts->part_of[t]];
            add_to_box(part, f->corners[t]);
            part->triangle_count++;
        }
    }
    for (uint32_t t = 0; t < f->count; t++) {
        if (parts->part_of[t] != UINT32_MAX) {
            struct umbs_part *part = &parts->parts[parts->part_of[t]];
            part->volume += signed_volume(part, f->corners[t]);
            parts->closed[t] = (uint8_t)part->closed;
            parts->closed_triangles += (size_t)part->closed;
        }
    }
}

/* Decides which closed parts of negative volume are turned around and which are cavities. */
static int orient_parts(struct umbs_parts *parts)
{
    size_t solids = 0, inverted = 0;
    for (size_t i = 0; i < parts->part_count; i++) {
        solids += parts->parts[i].closed && parts->parts[i].volume > 0;
        inverted += parts->parts[i].closed && parts->parts[i].volume < 0;
    }
    if (inverted == 0) {
        return 1;
    }
    struct umb_box *boxes = umb__alloc(NULL, solids > 0 ? solids : 1, sizeof *boxes);
    if (boxes == NULL) {
        return 0;
    }
    size_t n = 0;
    for (size_t i = 0; i < parts->part_count; i++) {
        if (parts->parts[i].closed && parts->parts[i].volume > 0) {
            boxes[n++] = parts->parts[i].box;
        }
    }
    struct umbs_nest nest;
    int good = umbs_nest_init(&nest, boxes, n);
    for (size_t i = 0; good && i < parts->part_count; i++) {
        struct umbs_part *part = &parts->parts[i];
        part->flipped = part->closed && part->volume < 0 && !umbs_nest_holds(&nest, &part->box);
    }
    umbs_nest_finish(&nest);
    umb__free(NULL, boxes);
    return good;
}

/* Makes the per-triangle arrays and marks degenerate triangles. */
static int mark_triangles(struct finder *f, struct umbs_parts *parts)
{
    size_t n = f->count > 0 ? f->count : 1;
    parts->part_of = umb__alloc_zeroed(NULL, n, sizeof *parts->part_of);
    parts->closed = umb__alloc_zeroed(NULL, n, sizeof *parts->closed);
    f->parent = umb__alloc(NULL, n, sizeof *f->parent);
    if (parts->part_of == NULL || parts->closed == NULL || f->parent == NULL) {
        return 0;
    }
    for (uint32_t t = 0; t < f->count; t++) {
        f->parent[t] = t;
        if (is_degenerate(f, t)) {
            parts->part_of[t] = UINT32_MAX;
            parts->degenerate_count++;
        }
    }
    return 1;
}

enum umb_status umbs_parts_find(const double (*corners)[3][3], size_t count,
                                struct umbs_parts *parts, struct umb_error *error)
{
    *parts = (struct umbs_parts){0};
    if (count > UMBS_WELD_TRIANGLES_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%zu triangles; the limit is %zu", count,
                        UMBS_WELD_TRIANGLES_MAX);
    }
    struct finder f = {.corners = corners, .count = (uint32_t)count};
    UMB__TRY(umbs_weld(corners, count, &f.vertex_of, &f.vertex_count, error));
    int good = mark_triangles(&f, parts) && bucket_edges(&f, parts) &&
               join_triangles(&f, &parts->duplicate_triangles) && number_parts(&f, parts);
    if (good) {
        judge_edges(&f, parts);
        measure_parts(&f, parts);
        good = orient_parts(parts);
    }
    umb__free(NULL, f.vertex_of);
    umb__free(NULL, f.bucket);
    umb__free(NULL, f.entries);
    umb__free(NULL, f.parent);
    umb__free(NULL, f.scratch);
    umb__free(NULL, f.first_bad);
    if (!good) {
        umbs_parts_finish(parts);
        return umb_fail(error, UMB_E_NO_MEMORY, "no memory to find the parts of %zu triangles",
                        count);
    }
    return UMB_OK;
}

void umbs_parts_finish(struct umbs_parts *parts)
{
    umb__free(NULL, parts->parts);
    umb__free(NULL, parts->part_of);
    umb__free(NULL, parts->closed);
    *parts = (struct umbs_parts){0};
}

void umbs_part_reason(const struct umbs_part *part, char *text, size_t size)
{
    const struct {
        size_t count;
        const char *one, *many;
    } kinds[3] = {
        {part->boundary_edges, "boundary edge", "boundary edges"},
        {part->nonmanifold_edges, "edge of three or more triangles",
         "edges of three or more triangles"},
        {part->inconsistent_edges, "edge used twice in one direction",
         "edges used twice in one direction"},
    };
    if (size == 0) {
        return;
    }
    if (part->closed) {
        (void)snprintf(text, size, "closed");
        return;
    }
    if (kinds[0].count + kinds[1].count + kinds[2].count == 0) {
        const int holes = part->cut_triangles > 0;
        const size_t count = holes ? part->cut_triangles : part->translucent_triangles;
        (void)snprintf(text, size, "%zu triangle%s %s", count, count == 1 ? "" : "s",
                       holes ? "with holes by alpha" : "that let light through");
        return;
    }
    size_t used = 0;
    for (int i = 0; i < 3; i++) {
        if (kinds[i].count > 0 && used < size) {
            int n = snprintf(text + used, size - used, "%s%zu %s", used > 0 ? ", " : "",
                             kinds[i].count, kinds[i].count == 1 ? kinds[i].one : kinds[i].many);
            used += n > 0 ? (size_t)n : 0;
        }
    }
    if (used < size) {
        (void)snprintf(text + used, size - used, " (first at %.9g %.9g %.9g)", part->hole[0],
                       part->hole[1], part->hole[2]);
    }
}

void umbs_triangle_turn(double corners[3][3])
{
    double kept[3];
    memcpy(kept, corners[1], sizeof kept);
    memcpy(corners[1], corners[2], sizeof kept);
    memcpy(corners[2], kept, sizeof kept);
}

void umbs_parts_orient(const struct umbs_parts *parts, double (*corners)[3][3], size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t part = parts->part_of[i];
        if (part < parts->part_count && parts->parts[part].flipped) {
            umbs_triangle_turn(corners[i]);
        }
    }
}
