/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A slice of work is a row of squares. Each square is drawn from the list of triangles that touch
 * it. The results of the rows are joined in order.
 */
#include "bake/depth/transmittance_make.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "bake/depth/coverage.h"
#include "bake/depth/cut_out.h"
#include "bake/depth/depth_perspective.h"
#include "bake/depth/triangle_bins.h"

#define SIDE ((int32_t)UMB__TRANSMITTANCE_SIDE)

struct fragment {
    uint32_t texel; /* texel of the square, row by row */
    int32_t lit;
    double opacity;
};

/* Working memory of a thread. */
struct bench {
    struct fragment *fragments, *sorted;   /* [capacity] */
    struct umb__transmittance_drop *steps; /* [capacity] */
    size_t count, capacity;
    int too_many; /* 1: fragments_max was exceeded */
    struct umb__transmittance_list lists[UMB__TRANSMITTANCE_SIDE * UMB__TRANSMITTANCE_SIDE];
    uint32_t first[UMB__TRANSMITTANCE_SIDE * UMB__TRANSMITTANCE_SIDE + 1];
};

struct maker {
    const struct umbb_transmittance_input *job;
    struct umbb_bins bins;
    unsigned threads;
    size_t fragments_max;                  /* limit of fragments for each thread */
    atomic_size_t total;                   /* bytes of all rows so far */
    struct bench *benches;                 /* [job->threads] */
    struct umb__transmittance_bytes *rows; /* [squares a side] */
    enum umb_status *statuses;             /* [squares a side] */
    struct umb_error *errors;              /* [squares a side] */
};

/* Makes room for one more fragment. */
static enum umb_status reserve(const struct maker *m, struct bench *bench, struct umb_error *error)
{
    if (bench->count < bench->capacity) {
        return UMB_OK;
    }
    if (bench->count >= m->fragments_max) {
        bench->too_many = 1;
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: more than %zu translucent surfaces before 64 x 64 texels",
                        m->fragments_max);
    }
    size_t capacity = bench->capacity == 0 ? 1U << 14 : bench->capacity * 2;
    capacity = capacity < m->fragments_max ? capacity : m->fragments_max;
    struct fragment *fragments = realloc(bench->fragments, capacity * sizeof *fragments);
    bench->fragments = fragments != NULL ? fragments : bench->fragments;
    struct fragment *sorted = realloc(bench->sorted, capacity * sizeof *sorted);
    bench->sorted = sorted != NULL ? sorted : bench->sorted;
    struct umb__transmittance_drop *steps = realloc(bench->steps, capacity * sizeof *steps);
    bench->steps = steps != NULL ? steps : bench->steps;
    if (fragments == NULL || sorted == NULL || steps == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: memory for %zu surfaces refused",
                        capacity);
    }
    bench->capacity = capacity;
    return UMB_OK;
}

static void bench_free(struct bench *bench)
{
    free(bench->fragments);
    free(bench->sorted);
    free(bench->steps);
    memset(bench, 0, sizeof *bench);
}

/* Collects the fragments of a triangle in the square at (x0, y0). */
static enum umb_status draw(const struct maker *m, uint32_t triangle, int32_t x0, int32_t y0,
                            struct bench *bench, struct umb_error *error)
{
    const struct umbb_casters *casters = m->job->casters;
    const struct umbb_rays rays = umbb_rays_of(casters);
    const uint32_t cut = casters->cuts->of[triangle];
    struct umbb_coverage coverage;
    if (!umbb_perspective_prepare(casters, triangle, &coverage)) {
        return UMB_OK;
    }
    const int32_t right = x0 + SIDE - 1;
    int32_t row, last;
    umbb_coverage_rows_within(&coverage, y0, SIDE, &row, &last);
    for (; row <= last; row++) {
        int32_t x_first, x_last;
        umbb_coverage_row_once(&coverage, row, &x_first, &x_last);
        const double row_z = umbb_coverage_row_z(&coverage, row);
        x_first = x_first > x0 ? x_first : x0;
        x_last = x_last < right ? x_last : right;
        for (int32_t x = x_first; x <= x_last; x++) {
            const int32_t lit = umbb_rays_lit(&rays, &coverage, row_z, x);
            const double opacity =
                lit < casters->size ? umbb_cut_takes(casters->cuts, cut, x, row) : 0.0;
            if (!(opacity > 0.0)) {
                continue;
            }
            UMB__TRY(reserve(m, bench, error));
            bench->fragments[bench->count++] =
                (struct fragment){(uint32_t)((row - y0) * SIDE + (x - x0)), lit, opacity};
        }
    }
    return UMB_OK;
}

static int compare(const void *a, const void *b)
{
    const struct fragment *x = a, *y = b;
    if (x->lit != y->lit) {
        return x->lit < y->lit ? -1 : 1;
    }
    return (x->opacity > y->opacity) - (x->opacity < y->opacity);
}

/* Sorts the fragments by texel: those of texel i are first[i] .. first[i + 1] - 1. */
static void sort_by_texel(struct bench *bench)
{
    const size_t texels = UMB__TRANSMITTANCE_SIDE * UMB__TRANSMITTANCE_SIDE;
    memset(bench->first, 0, sizeof bench->first);
    for (size_t i = 0; i < bench->count; i++) {
        bench->first[bench->fragments[i].texel + 1]++;
    }
    for (size_t i = 0; i < texels; i++) {
        bench->first[i + 1] += bench->first[i];
    }
    for (size_t i = 0; i < bench->count; i++) { /* moves each entry of first to its end */
        bench->sorted[bench->first[bench->fragments[i].texel]++] = bench->fragments[i];
    }
    memmove(bench->first + 1, bench->first, texels * sizeof bench->first[0]);
    bench->first[0] = 0;
}

/* Makes the list of sorted fragments. A product of n doubles has an error of n 2^-53. */
static uint32_t make_list(const struct fragment *fragments, size_t count,
                          struct umb__transmittance_drop *steps)
{
    double left = 1.0;
    uint32_t before = UMB__TRANSMITTANCE_ONE, length = 0;
    for (size_t i = 0; i < count; i++) {
        left *= 1.0 - fragments[i].opacity;
        if (i + 1 < count && fragments[i + 1].lit == fragments[i].lit) {
            continue;
        }
        const uint32_t units = (uint32_t)(left * (double)UMB__TRANSMITTANCE_ONE + 0.5);
        if (units < before) {
            steps[length++] =
                (struct umb__transmittance_drop){(uint32_t)fragments[i].lit, before - units};
            before = units;
        }
        if (left < UMBB_TRANSMITTANCE_LEAST) {
            break;
        }
    }
    return length;
}

static enum umb_status make_square(const struct maker *m, int32_t x0, int32_t y0,
                                   struct bench *bench, struct umb__transmittance_bytes *bytes,
                                   struct umb_error *error)
{
    size_t count;
    const uint32_t *triangles = umbb_bins_cell(&m->bins, x0 / SIDE, y0 / SIDE, &count);
    bench->count = 0;
    for (size_t i = 0; i < count; i++) {
        UMB__TRY(draw(m, triangles[i], x0, y0, bench, error));
    }
    sort_by_texel(bench);
    for (size_t i = 0; i < UMB__TRANSMITTANCE_SIDE * UMB__TRANSMITTANCE_SIDE; i++) {
        const uint32_t first = bench->first[i], length = bench->first[i + 1] - first;
        uint32_t steps = 0;
        if (length > 0) {
            qsort(bench->sorted + first, length, sizeof *bench->sorted, compare);
            steps = make_list(bench->sorted + first, length, bench->steps + first);
        }
        bench->lists[i] =
            (struct umb__transmittance_list){steps > 0 ? bench->steps + first : NULL, steps};
    }
    return umb__transmittance_square(bytes, bench->lists, m->job->max_bytes, error);
}

/* Returns the bytes of the masks of a map's squares, the whole size of an empty map. */
static size_t empty_bytes(const struct maker *m)
{
    return (size_t)8 << (2 * (m->job->level - 6));
}

static void row_job(void *user, uint32_t row, unsigned thread)
{
    struct maker *m = user;
    const int32_t across = (int32_t)1 << m->job->level;
    const size_t most = m->job->max_bytes + empty_bytes(m);
    enum umb_status status = UMB_OK;
    m->rows[row].count = 0;
    for (int32_t x = 0; x < across && status == UMB_OK; x += SIDE) {
        const size_t before = m->rows[row].count;
        status = make_square(m, x, (int32_t)row * SIDE, &m->benches[thread], &m->rows[row],
                             &m->errors[row]);
        const size_t more = m->rows[row].count - before;
        if (atomic_fetch_add(&m->total, more) + more > most && status == UMB_OK) {
            status = umb_fail(&m->errors[row], UMB_E_LIMIT, "transmittance: more than %zu bytes",
                              m->job->max_bytes);
        }
    }
    if (status == UMB_OK && m->job->cancelled != NULL && m->job->cancelled()) {
        status = umb_fail(&m->errors[row], UMB_E_CANCELLED, "interrupted: nothing was written");
    }
    m->statuses[row] = status;
}

static enum umb_status make_rows(struct maker *m, uint32_t rows, struct umb_error *error)
{
    struct umbu_threads *jobs;
    UMB__TRY(umbu_threads_create(m->threads, &jobs, error));
    atomic_store(&m->total, 0);
    umbu_threads_start(jobs, row_job, m, rows);
    umbu_threads_wait(jobs, NULL, NULL);
    umbu_threads_destroy(jobs);
    for (uint32_t i = 0; i < rows; i++) {
        if (m->statuses[i] != UMB_OK) {
            return umb_fail(error, m->statuses[i], "%s", m->errors[i].message);
        }
    }
    return UMB_OK;
}

/* Makes the rows, with fewer threads if the threads' shares of the memory are too small. The number
 * of threads must not decide whether there is a map. */
static enum umb_status make_rows_in_memory(struct maker *m, uint32_t rows, int *too_large,
                                           struct umb_error *error)
{
    const size_t fragment_bytes =
        2 * sizeof(struct fragment) + sizeof(struct umb__transmittance_drop);
    const size_t fragments = m->job->working_bytes / 2 / fragment_bytes;
    for (m->threads = m->job->threads;; m->threads = (m->threads + 3) / 4) {
        int too_many = 0;
        m->fragments_max = fragments / m->threads;
        const enum umb_status status = make_rows(m, rows, error);
        *too_large = atomic_load(&m->total) > m->job->max_bytes + empty_bytes(m);
        for (uint32_t i = 0; i < rows; i++) {
            *too_large |= m->rows[i].count > m->job->max_bytes;
        }
        for (unsigned i = 0; i < m->threads; i++) {
            too_many |= m->benches[i].too_many;
            bench_free(&m->benches[i]);
        }
        if (status != UMB_E_LIMIT || *too_large || !too_many || m->threads == 1) {
            return status;
        }
    }
}

/* Joins the rows; writes nothing if all squares are empty. */
static enum umb_status join(const struct maker *m, uint32_t rows,
                            struct umb__transmittance_bytes *bytes, int *too_large,
                            struct umb_error *error)
{
    size_t total = 0;
    for (uint32_t i = 0; i < rows; i++) {
        total += m->rows[i].count;
    }
    *too_large = bytes->count + total > m->job->max_bytes;
    for (uint32_t i = 0; i < rows && total > empty_bytes(m); i++) {
        UMB__TRY(umb__transmittance_append(bytes, m->rows[i].data, m->rows[i].count,
                                           m->job->max_bytes, error));
    }
    return UMB_OK;
}

static enum umb_status fill_bins(struct maker *m, uint32_t rows, struct umb_error *error)
{
    const struct umbb_bins_input input = {
        .casters = m->job->casters,
        .all = 1,
        .count = m->job->casters->count,
        .cell_log2 = 6,
        .cells_x = rows,
        .max_bytes = m->job->working_bytes / 2,
    };
    return umbb_bins_fill(&m->bins, &input, error);
}

/* Makes the map from allocated arrays. */
static enum umb_status make_map(struct maker *m, uint32_t rows,
                                struct umb__transmittance_bytes *bytes, int *too_large,
                                struct umb_error *error)
{
    if (m->benches == NULL || m->rows == NULL || m->statuses == NULL || m->errors == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "transmittance: memory refused");
    }
    UMB__TRY(fill_bins(m, rows, error));
    UMB__TRY(make_rows_in_memory(m, rows, too_large, error));
    return join(m, rows, bytes, too_large, error);
}

enum umb_status umbb_transmittance_make(const struct umbb_transmittance_input *job,
                                        struct umb__transmittance_bytes *bytes, int *too_large,
                                        struct umb_error *error)
{
    const uint32_t rows = (uint32_t)1 << (job->level - 6);
    struct maker m = {.job = job,
                      .benches = calloc(job->threads, sizeof *m.benches),
                      .rows = calloc(rows, sizeof *m.rows),
                      .statuses = calloc(rows, sizeof *m.statuses),
                      .errors = calloc(rows, sizeof *m.errors)};
    *too_large = 0;
    const enum umb_status status = make_map(&m, rows, bytes, too_large, error);
    for (uint32_t i = 0; m.rows != NULL && i < rows; i++) {
        umb__transmittance_bytes_finish(&m.rows[i]);
    }
    umbb_bins_finish(&m.bins);
    free(m.benches);
    free(m.rows);
    free(m.statuses);
    free(m.errors);
    return status;
}
