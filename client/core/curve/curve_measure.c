/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See curve_measure.h. Each point is looked up as in a query. A second look-up at full resolution,
 * moved by up to half a voxel to the side, gives the error of the answer, since an answer cannot
 * tell where in a voxel the true boundary runs. The second look-up is half a texel farther off the
 * surface, so that the sideways move does not lead into the surface itself.
 */
#include "curve/curve_measure.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"
#include "query/perspective.h"

/* A node or uniform cube during the descent. */
struct cube {
    enum umb__node_state state;
    uint32_t level, index;
    int32_t x, y, z; /* Index of the first voxel */
};

/* Counts the cache lines below a grid cell: one for each wide node that is read, and one for each
 * brick. The caller counts the line of the cell itself. */
static bool costs_line(const struct umb__octree_window *w, const struct cube *cube)
{
    const uint32_t cells = umb_level_max(w->octree->roots[w->root].level);
    return cube->level % 2 == 1 && cube->level <= cells && cube->level > w->level;
}

static uint32_t count_cube(struct umb__octree_window *w, struct cube cube)
{
    const int32_t last = ((int32_t)1 << cube.level) - 1;
    const int32_t width = umb__min(w->x1, cube.x + last) - umb__max(w->x0, cube.x) + 1;
    const int32_t height = umb__min(w->y1, cube.y + last) - umb__max(w->y0, cube.y) + 1;
    if (width <= 0 || height <= 0) {
        return 0;
    }
    if (cube.state != UMB__NODE_MIXED) {
        const uint32_t texels = (uint32_t)(width * height);
        const uint32_t each = w->level > 0 ? 2 : 1;
        return cube.state == UMB__NODE_LIT ? each * texels : 0;
    }
    if (cube.level <= w->level) {
        return 1; /* half of a coarse cell */
    }
    w->lines += costs_line(w, &cube);
    if (cube.level == UMB_LEVEL_BRICK) {
        const struct umb__rectangle window = {w->x0, w->x1, w->y0, w->y1};
        const uint64_t slice = w->octree->bricks[cube.index][w->z & 7];
        return (uint32_t)__builtin_popcountll(slice & umb__slice_mask(cube.x, cube.y, &window));
    }
    w->nodes++;
    const struct umb__octree_level *level = &w->octree->level[cube.level];
    const uint16_t mask = level->masks[cube.index];
    const int32_t half = (int32_t)1 << (cube.level - 1);
    const unsigned deep = w->z - cube.z >= half ? 4 : 0;
    const uint32_t *child = level->children + level->first[cube.index];
    child += umb__mask_mixed_count((uint16_t)(mask & ((1U << (2 * deep)) - 1U)));
    uint32_t lit = 0;
    for (unsigned c = deep; c < deep + 4; c++) {
        const enum umb__node_state state = umb__mask_state(mask, c);
        const struct cube part = {.state = state,
                                  .level = cube.level - 1,
                                  .index = state == UMB__NODE_MIXED ? *child++ : 0,
                                  .x = cube.x + (c & 1 ? half : 0),
                                  .y = cube.y + (c & 2 ? half : 0),
                                  .z = cube.z + (c & 4 ? half : 0)};
        lit += count_cube(w, part); /* Levels descend: recursion is at most 17 deep */
    }
    return lit;
}

uint32_t umb__octree_window_count(struct umb__octree_window *window)
{
    const struct umb__octree_root *root = &window->octree->roots[window->root];
    window->lines++;
    return count_cube(window, (struct cube){root->state, root->level, root->index, 0, 0, 0});
}

struct setting {
    struct umb__query query;  /* Query with the setting */
    struct umb__query fine;   /* Second look-up: the same window, at full resolution */
    struct umb__query beside; /* Places the second look-up: with the bias of one texel more */
    struct umb__curve_record sums;
};

/* Mixes a counter into bits (splitmix64, Steele et al. 2014). */
static uint64_t mix(uint64_t counter)
{
    uint64_t bits = (counter + 1) * UINT64_C(0x9e3779b97f4a7c15);
    bits = (bits ^ bits >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    bits = (bits ^ bits >> 27) * UINT64_C(0x94d049bb133111eb);
    return bits ^ bits >> 31;
}

/* Answers a look-up; space beyond the frustum is lit and reads nothing. */
static uint32_t look_up(const struct umb__query *q, const struct umb__content *content,
                        const struct umb__octree *octree, uint32_t frustum, const double voxel[3],
                        struct umb__octree_window *read)
{
    struct umb__query sized = *q;
    struct umb_query_stats ignored = {0};
    sized.log2_size = content->frusta[frustum].log2_size;
    const struct umb__window window = umb__window_at(&sized, voxel, &ignored);
    *read = (struct umb__octree_window){.octree = octree,
                                        .root = frustum,
                                        .level = q->level,
                                        .x0 = window.x0,
                                        .x1 = window.x1,
                                        .y0 = window.y0,
                                        .y1 = window.y1,
                                        .z = window.z};
    if (window.all_lit) {
        read->lines = 1;
        return q->level > 0 ? 2 : (uint32_t)(q->taps * q->taps);
    }
    return window.outside + umb__octree_window_count(read);
}

static void add_point(struct setting *s, const struct umb__content *content,
                      const struct umb__octree *octree, const struct umb_points *points, size_t i)
{
    const struct umb__query *q = &s->query;
    struct umb__octree_window read;
    double voxel[3], aside[3];
    uint32_t frustum;
    if (!umb__look_up_at(q, points, i, voxel, &frustum)) {
        return;
    }
    const uint64_t total = q->level > 0 ? 2 : (uint64_t)q->taps * (uint64_t)q->taps;
    const uint64_t lit = look_up(q, content, octree, frustum, voxel, &read);
    s->sums.points++;
    s->sums.nodes += read.nodes;
    s->sums.lines += read.lines;
    (void)umb__look_up_at(&s->beside, points, i, aside, &frustum);
    const uint64_t bits = mix(i);
    aside[0] += (double)(bits >> 40) * 0x1p-24 - 0.5;
    aside[1] += (double)(bits & 0xffffffU) * 0x1p-24 - 0.5;
    uint64_t other = look_up(&s->fine, content, octree, frustum, aside, &read);
    other *= q->level > 0 ? 2 : 1; /* One tap in units of halves */
    const uint64_t difference = lit > other ? lit - other : other - lit;
    s->sums.squares += difference * difference * UMB__CURVE_SQUARE / (total * total);
}

static enum umb_status prepare(const struct umb_asset *bare, struct umb_query_settings settings,
                               struct setting *s, struct umb_error *error)
{
    struct umb_query query;
    memset(s, 0, sizeof *s);
    UMB__TRY(umb_query_prepare(bare, &settings, &query, error));
    memcpy(&s->query, query.opaque, sizeof s->query);
    settings.level = 0;
    UMB__TRY(umb_query_prepare(bare, &settings, &query, error));
    memcpy(&s->fine, query.opaque, sizeof s->fine);
    s->beside = s->fine;
    s->beside.taps++;
    s->sums = (struct umb__curve_record){
        .light = settings.light, .level = s->query.level, .taps = settings.taps};
    return UMB_OK;
}

static enum umb_status list_settings(const struct umb_asset *bare, uint32_t light,
                                     struct setting *settings, uint32_t *count,
                                     struct umb_error *error)
{
    const struct umb_light_info *info = &bare->canonical.content.lights[light];
    const struct umb_frustum_info *frustum = &bare->canonical.content.frusta[info->first_frustum];
    const uint32_t highest =
        info->kind == UMB_LIGHT_DIRECTIONAL && bare->canonical.content.receiver_mask_cells == NULL
            ? umb_level_max(frustum->log2_size)
            : 0;
    *count = 0;
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 2) {
        const struct umb_query_settings wanted = {.light = light, .taps = taps};
        UMB__TRY(prepare(bare, wanted, &settings[(*count)++], error));
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= highest; level += 2) {
        const struct umb_query_settings wanted = {.light = light, .taps = 1, .level = level};
        UMB__TRY(prepare(bare, wanted, &settings[(*count)++], error));
    }
    return UMB_OK;
}

_Static_assert(UMB__CURVE_TAPS_COUNT + (UMB_LEVEL_MAX - UMB__GRID_LOG2_MAX + 1) / 2 <=
                   UMB_CURVE_ROWS_MAX,
               "rows of a light");

/* A light's settings, each measured as a whole by one thread. */
struct measuring {
    struct setting *settings;
    const struct umb__content *content;
    const struct umb__octree *octree;
    const struct umb_points *points;
    uint32_t rows;
};

/* Measures one setting: those with wide windows, which cost most, first. */
static void measure_row(void *user, uint32_t number, unsigned worker)
{
    const struct measuring *m = user;
    struct setting *setting =
        &m->settings[number < UMB__CURVE_TAPS_COUNT ? UMB__CURVE_TAPS_COUNT - 1 - number : number];
    (void)worker;
    for (size_t i = 0; i < m->points->count; i++) {
        add_point(setting, m->content, m->octree, m->points, i);
    }
}

static void measure_rows(struct measuring *m, const struct umb_workers *workers)
{
    if (workers != NULL) {
        workers->run(workers->user, measure_row, m, m->rows);
        return;
    }
    for (uint32_t row = 0; row < m->rows; row++) {
        measure_row(m, row, 0);
    }
}

enum umb_status umb__curve_measure(const struct umb__content *content,
                                   const struct umb__octree *octree, uint32_t light,
                                   const struct umb_points *points,
                                   const struct umb_workers *workers,
                                   struct umb__curve_record records[UMB_CURVE_ROWS_MAX],
                                   uint32_t *count, struct umb_error *error)
{
    const struct umb_alloc *alloc = octree->alloc;
    struct umb_asset bare = {.canonical.content = *content}; /* The parts of an asset that preparing
                                                                a query reads */
    struct umb__top *tops = umb__alloc_zeroed(alloc, content->frustum_count, sizeof *tops);
    struct umb_frustum_info *frusta = umb__alloc(alloc, content->frustum_count, sizeof *frusta);
    struct setting *settings = umb__alloc_zeroed(alloc, UMB_CURVE_ROWS_MAX, sizeof *settings);
    static const uint32_t no_grid[1];
    static const struct umb__column no_columns[1];
    uint32_t rows = 0;
    enum umb_status status = UMB_OK;
    *count = 0;
    bare.view.tops = tops;
    bare.view.grid = no_grid;
    bare.view.columns = no_columns;
    bare.view.pieces = no_grid;
    bare.canonical.content.frusta = frusta;
    if (!tops || !settings || !frusta) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "accuracy curve: out of memory");
    } else if (light >= content->light_count) {
        status = umb_fail(error, UMB_E_NOT_FOUND, UMB__NO_LIGHT, light,
                          content->light_count - 1);
    } else {
        memcpy(frusta, content->frusta, content->frustum_count * sizeof *frusta);
        umb__content_derive(&bare.canonical.content); /* As every reader of the file does */
        status = list_settings(&bare, light, settings, &rows, error);
    }
    if (status == UMB_OK) {
        struct measuring m = {settings, &bare.canonical.content, octree, points, rows};
        measure_rows(&m, workers);
    }
    for (uint32_t row = 0; row < rows && status == UMB_OK; row++) {
        if (settings[row].sums.points > 0) {
            records[(*count)++] = settings[row].sums;
        }
    }
    umb__free(alloc, settings);
    umb__free(alloc, frusta);
    umb__free(alloc, tops);
    return status;
}
