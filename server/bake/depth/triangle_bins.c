/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Binning by counting: one pass counts the entries of each cell, a second writes them. Both are cut
 * into chunks of triangles for several threads; the lists do not depend on that. Most triangles lie
 * in one cell. The first pass keeps the number of that cell, so the second pass need not read the
 * triangle's corners.
 *
 * A triangle that spans several rows and columns of cells is cut into the rows' strips. So a sliver
 * across the map is listed along its length and not all over its bounding box.
 */
#include "bake/depth/triangle_bins.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "tool/threads.h"
#include "bake/depth/proven_squares.h"

/* The cells that a triangle's texel centres may fall into; empty if x0 > x1. */
struct cell_range {
    int32_t x0, x1, y0, y1;
};

/*
 * Finds the first and last cell along one axis for the centres in [low, high]; returns 0 if there
 * are no centres. Truncation replaces ceiling and floor: coordinates are at most
 * UMBB_COORDINATE_MAX.
 */
static inline int axis_range(const struct umbb_bins_input *input, int32_t origin, double low,
                             double high, int32_t *first, int32_t *last)
{
    const int32_t end = (int32_t)((int64_t)input->cells_x << input->cell_log2) - 1;
    const double l = low - 0.5, h = high - 0.5;
    int32_t a = (int32_t)l, b = (int32_t)h;
    a += (double)a < l;
    b -= (double)b > h;
    a -= origin;
    b -= origin;
    *first = (a > 0 ? a : 0) >> input->cell_log2;
    *last = (b < end ? b : end) >> input->cell_log2;
    return (a <= b) & (b >= 0) & (a <= end);
}

/* Texels by which the listed area of a triangle with a border exceeds the triangle. A border counts
 * for squares within a texel, and a square's first centre is half a texel further. */
#define BORDER_SLACK 2.0

/* Texels by which the listed area of a triangle exceeds the triangle. */
static inline double slack(const struct umbb_bins_input *input, uint32_t triangle)
{
    return input->borders && (input->casters->marks[triangle] & UMBB_MARK_BORDER) != 0
               ? BORDER_SLACK
               : 0.0;
}

/* Finds a triangle's cells. min and max replace branches, which would be unpredictable. */
static inline int triangle_cells(const struct umbb_bins_input *input, uint32_t triangle,
                                 struct cell_range *range)
{
    const double(*v)[3] = input->casters->corners[triangle];
    const double further = slack(input, triangle);
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        const double a = v[0][axis], b = v[1][axis], c = v[2][axis];
        const double ab_low = a < b ? a : b, ab_high = a < b ? b : a;
        low[axis] = (ab_low < c ? ab_low : c) - further;
        high[axis] = (ab_high > c ? ab_high : c) + further;
    }
    return axis_range(input, input->x0, low[0], high[0], &range->x0, &range->x1) &
           axis_range(input, input->y0, low[1], high[1], &range->y0, &range->y1);
}

/* Least and greatest x seen so far. */
struct reach {
    double low, high;
};

static void reach_add(struct reach *reach, double x)
{
    reach->low = x < reach->low ? x : reach->low;
    reach->high = x > reach->high ? x : reach->high;
}

/* Widens the range of x by the part of an edge that lies in the rows top .. bottom. a, b: its ends,
 * a.y <= b.y. */
static void reach_add_edge(struct reach *reach, const double a[3], const double b[3], double top,
                           double bottom)
{
    if (b[1] < top || a[1] > bottom) {
        return;
    }
    const double height = b[1] - a[1];
    const double from = a[1] < top ? (top - a[1]) / height : 0.0;
    const double to = b[1] > bottom ? (bottom - a[1]) / height : 1.0;
    reach_add(reach, a[0] + from * (b[0] - a[0]));
    reach_add(reach, a[0] + to * (b[0] - a[0]));
}

/* Finds the columns of cell row y that a triangle may touch: range's x0 .. x1, or fewer. */
static void strip_columns(const struct umbb_bins_input *input, uint32_t triangle,
                          const struct cell_range *range, int32_t y, int32_t *x0, int32_t *x1)
{
    *x0 = range->x0;
    *x1 = range->x1;
    if (range->x0 == range->x1 || range->y0 == range->y1) {
        return; /* the bounding box is as good */
    }
    const double(*v)[3] = input->casters->corners[triangle];
    const double further = slack(input, triangle);
    const double top = (double)input->y0 + (double)((int64_t)y << input->cell_log2) - further;
    const double bottom = top + (double)((int64_t)1 << input->cell_log2) + 2.0 * further;
    struct reach reach = {INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        const double *a = v[i], *b = v[(i + 1) % 3];
        reach_add_edge(&reach, a[1] < b[1] ? a : b, a[1] < b[1] ? b : a, top, bottom);
    }
    /* The slack of one texel is far more than these crossings differ from the predicate's. */
    const double width = (double)((int64_t)1 << input->cell_log2);
    const double first = (reach.low - 1.0 - further - (double)input->x0) / width;
    const double last = (reach.high + 1.0 + further - (double)input->x0) / width;
    if (first > (double)*x0) {
        *x0 = first < (double)*x1 ? (int32_t)first : *x1;
    }
    if (last < (double)*x1) {
        *x1 = last > (double)*x0 ? (int32_t)last : *x0;
    }
}

/* Makes room for `wanted` entries, next to `used` bytes in use; the old content is lost. */
static enum umb_status reserve(struct umbb_bins *bins, const struct umbb_bins_input *input,
                               uint64_t wanted, size_t used, struct umb_error *error)
{
    const size_t left = input->max_bytes > used ? input->max_bytes - used : 0;
    if (wanted <= bins->capacity) {
        return UMB_OK;
    }
    if (wanted > left / sizeof *bins->entries) {
        return umb_fail(error, UMB_E_LIMIT,
                        "--memory: %llu MiB for lists of which triangle touches which of %u x %u "
                        "blocks of texels are more than the %zu MiB left; give more memory or "
                        "another --tile",
                        (unsigned long long)(wanted / (1048576U / sizeof *bins->entries) + 1U),
                        input->cells_x, input->cells_x, left >> 20);
    }
    free(bins->entries);
    bins->capacity = 0;
    bins->entries = malloc((size_t)wanted * sizeof *bins->entries);
    if (bins->entries == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "triangle bins: memory for %llu entries refused",
                        (unsigned long long)wanted);
    }
    bins->capacity = wanted;
    return UMB_OK;
}

/* Least number of triangles in a chunk, and greatest number of counters of all chunks together. */
#define CHUNK_TRIANGLES ((size_t)4096)
#define CHUNK_NUMBERS   ((size_t)1 << 20)

/* The input in chunks of consecutive triangles. In each cell's list the places of the first chunk
 * come first, then those of the second. So the order is that of a single thread. */
struct fill {
    const struct umbb_bins_input *input;
    size_t count, chunks, cells;
    uint64_t *numbers; /* [chunks][cells]: counts, then places */
    uint32_t *only;    /* [count] number of the one cell of a triangle, CELL_NONE or CELL_MANY */
    uint32_t *entries; /* written in the second pass */
};

#define CELL_NONE UINT32_MAX
#define CELL_MANY (UINT32_MAX - 1U)

static inline uint32_t triangle_at(const struct umbb_bins_input *input, size_t i)
{
    return input->all ? (uint32_t)i : input->list[i];
}

/* First triangle of a chunk; for chunk `chunks` the end. */
static size_t chunk_first(const struct fill *fill, uint32_t chunk)
{
    return fill->count * chunk / fill->chunks;
}

/* Counts a triangle in each of its cells or, if entries is not NULL, writes the triangle at the
 * next place of each cell. */
static void add_to_cells(const struct umbb_bins_input *input, uint32_t triangle,
                         const struct cell_range *r, uint64_t *cells, uint32_t *entries)
{
    int32_t x, x1;
    for (int32_t y = r->y0; y <= r->y1; y++) {
        for (strip_columns(input, triangle, r, y, &x, &x1); x <= x1; x++) {
            uint64_t *cell = &cells[(size_t)y * input->cells_x + (size_t)x];
            if (entries != NULL) {
                entries[*cell] = triangle;
            }
            ++*cell;
        }
    }
}

static void count_job(void *user, uint32_t chunk, unsigned thread)
{
    (void)thread;
    const struct fill *fill = user;
    const struct umbb_bins_input *input = fill->input;
    uint64_t *cells = fill->numbers + chunk * fill->cells;
    const size_t end = chunk_first(fill, chunk + 1);
    for (size_t i = chunk_first(fill, chunk); i < end; i++) {
        const uint32_t triangle = triangle_at(input, i);
        struct cell_range r;
        fill->only[i] = CELL_NONE;
        if (!triangle_cells(input, triangle, &r)) {
            continue;
        }
        if ((r.x0 == r.x1) & (r.y0 == r.y1)) {
            fill->only[i] = (uint32_t)r.y0 * input->cells_x + (uint32_t)r.x0;
            cells[fill->only[i]]++;
        } else {
            fill->only[i] = CELL_MANY;
            add_to_cells(input, triangle, &r, cells, NULL);
        }
    }
}

static void write_job(void *user, uint32_t chunk, unsigned thread)
{
    (void)thread;
    const struct fill *fill = user;
    const struct umbb_bins_input *input = fill->input;
    uint64_t *places = fill->numbers + chunk * fill->cells;
    const size_t end = chunk_first(fill, chunk + 1);
    for (size_t i = chunk_first(fill, chunk); i < end; i++) {
        const uint32_t triangle = triangle_at(input, i), cell = fill->only[i];
        struct cell_range r;
        if (cell < CELL_MANY) {
            fill->entries[places[cell]++] = triangle;
        } else if (cell == CELL_MANY && triangle_cells(input, triangle, &r)) {
            add_to_cells(input, triangle, &r, places, fill->entries);
        }
    }
}

/* Turns counts into places, and sets where each cell's list starts. */
static void places_find(const struct fill *fill, uint64_t *first)
{
    uint64_t total = 0;
    for (size_t cell = 0; cell < fill->cells; cell++) {
        first[cell] = total;
        for (size_t chunk = 0; chunk < fill->chunks; chunk++) {
            uint64_t *number = &fill->numbers[chunk * fill->cells + cell];
            const uint64_t count = *number;
            *number = total;
            total += count;
        }
    }
    first[fill->cells] = total;
}

static size_t chunk_count(const struct umbb_bins_input *input, size_t count, size_t cells)
{
    const size_t workers = input->workers == NULL ? 1 : input->workers->count;
    const size_t worth = count / CHUNK_TRIANGLES;
    size_t chunks = workers < worth ? workers : worth;
    chunks = chunks * cells > CHUNK_NUMBERS ? CHUNK_NUMBERS / cells : chunks;
    return chunks > 0 ? chunks : 1;
}

/* Room for the starts of the cells' lists. */
static enum umb_status cells_reserve(struct umbb_bins *bins, uint32_t cells_x,
                                     struct umb_error *error)
{
    const size_t cells = (size_t)cells_x * cells_x;
    if (bins->first == NULL || bins->cells_x != cells_x) {
        free(bins->first);
        bins->cells_x = cells_x;
        bins->first = malloc((cells + 1) * sizeof *bins->first);
        if (bins->first == NULL) {
            bins->cells_x = 0;
            return umb_fail(error, UMB_E_NO_MEMORY, "triangle bins: memory for %zu cells refused",
                            cells);
        }
    }
    return UMB_OK;
}

enum umb_status umbb_bins_fill(struct umbb_bins *bins, const struct umbb_bins_input *input,
                               struct umb_error *error)
{
    enum umb_status status;
    UMB__TRY(cells_reserve(bins, input->cells_x, error));
    struct fill fill = {.input = input,
                        .count = input->all ? input->casters->count : input->count,
                        .cells = (size_t)input->cells_x * input->cells_x};
    fill.chunks = chunk_count(input, fill.count, fill.cells);
    const size_t used =
        fill.chunks * fill.cells * sizeof *fill.numbers + fill.count * sizeof *fill.only;
    fill.numbers = calloc(fill.chunks * fill.cells, sizeof *fill.numbers);
    fill.only = malloc((fill.count + 1) * sizeof *fill.only);
    if (fill.numbers == NULL || fill.only == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY,
                          "triangle bins: memory for %zu triangles in %zu cells refused",
                          fill.count, fill.cells);
        goto done;
    }
    umbu_workers_run(input->workers, count_job, &fill, (uint32_t)fill.chunks);
    places_find(&fill, bins->first);
    status = reserve(bins, input, bins->first[fill.cells], used, error);
    if (status == UMB_OK && bins->first[fill.cells] > 0) {
        fill.entries = bins->entries;
        umbu_workers_run(input->workers, write_job, &fill, (uint32_t)fill.chunks);
    }
done:
    free(fill.numbers);
    free(fill.only);
    return status;
}

void umbb_bins_finish(struct umbb_bins *bins)
{
    free(bins->first);
    free(bins->entries);
    memset(bins, 0, sizeof *bins);
}
