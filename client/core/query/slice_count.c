/* SPDX-License-Identifier: Apache-2.0 */
/* See slice_count.h. Descents end: levels fall by two down to bricks. */
#include "query/slice_count.h"

/* A cube of the slice: its first texel and its level. */
struct square {
    int32_t x, y;
    uint32_t level;
};

/* Two ranges of columns and two of rows; range 0 contains range 1. Each of the four products of
 * columns and rows is a window to count. */
struct ranges {
    int32_t x0[2], x1[2], y0[2], y1[2];
};

struct count {
    const struct umb__slice *slice;
    uint32_t z;
    struct ranges in; /* Ranges inside the frustum; the walk goes through range 0 */
    uint64_t lit[4];  /* Number of lit texels of window k: columns k % 2, rows k / 2 */
    bool counts;      /* True: lit texels are added up; false: the walk ends at the wanted state */
    bool wanted;
};

/* Returns the texels of a square's side that lie in low..high. */
static uint64_t overlap(int32_t at, uint32_t level, int32_t low, int32_t high)
{
    const int32_t last = at + (int32_t)(((uint32_t)1 << level) - 1);
    const int32_t count = umb__min(high, last) - umb__max(low, at) + 1;
    return count > 0 ? (uint64_t)count : 0;
}

/* Returns the product of column i and row j of the ranges. */
static struct umb__rectangle rectangle_of(const struct ranges *in, unsigned i, unsigned j)
{
    return (struct umb__rectangle){in->x0[i], in->x1[i], in->y0[j], in->y1[j]};
}

static uint64_t slice_bits(struct count *c, uint32_t brick)
{
    c->slice->stats->bricks++;
    return c->slice->tree->bricks[brick][c->z & 7];
}

static void add_uniform(struct count *c, const struct square *s)
{
    uint64_t columns[2], rows[2];
    for (unsigned i = 0; i < 2; i++) {
        columns[i] = overlap(s->x, s->level, c->in.x0[i], c->in.x1[i]);
        rows[i] = overlap(s->y, s->level, c->in.y0[i], c->in.y1[i]);
    }
    for (unsigned k = 0; k < 4; k++) {
        c->lit[k] += columns[k % 2] * rows[k / 2];
    }
}

static void add_brick(struct count *c, const struct square *s, uint32_t number)
{
    const uint64_t bits = slice_bits(c, number);
    for (unsigned k = 0; k < 4; k++) {
        const struct umb__rectangle window = rectangle_of(&c->in, k % 2, k / 2);
        c->lit[k] += (uint64_t)__builtin_popcountll(bits & umb__slice_mask(s->x, s->y, &window));
    }
}

/* Adds the lit texels of a brick or a uniform square. Returns false, so that the walk goes on. */
static bool add_leaf(struct count *c, const struct square *s, struct umb__link link)
{
    if (link.mixed) {
        add_brick(c, s, link.number);
    } else if (link.lit) {
        add_uniform(c, s);
    }
    return false;
}

/* Returns true, which ends the walk, if a brick or a uniform square has a texel of the wanted
 * state. */
static bool find_leaf(struct count *c, const struct square *s, struct umb__link link)
{
    if (!link.mixed) {
        return link.lit == c->wanted;
    }
    const uint64_t bits = slice_bits(c, link.number);
    const struct umb__rectangle window = rectangle_of(&c->in, 0, 0);
    return ((c->wanted ? bits : ~bits) & umb__slice_mask(s->x, s->y, &window)) != 0;
}

static bool walk_link(struct count *c, const struct square *s, struct umb__link link)
{
    if (!link.mixed || s->level == UMB_LEVEL_BRICK) {
        return c->counts ? add_leaf(c, s, link) : find_leaf(c, s, link);
    }
    const uint32_t level = s->level - 2;
    const int32_t side = (int32_t)1 << level, end = 4 * side - 1;
    c->slice->stats->nodes++;
    for (int32_t y = umb__max(c->in.y0[0], s->y) & -side; y <= umb__min(c->in.y1[0], s->y + end);
         y += side) {
        for (int32_t x = umb__max(c->in.x0[0], s->x) & -side;
             x <= umb__min(c->in.x1[0], s->x + end); x += side) {
            const struct square child = {x, y, level};
            const unsigned bit = umb__child_at(level, (uint32_t)x, (uint32_t)y, c->z);
            if (walk_link(c, &child, umb__tree_child(c->slice->tree, link.number, bit))) {
                return true;
            }
        }
    }
    return false;
}

/* Walks through the grid's cells of the outer window, if it has any texel. */
static bool walk(struct count *c)
{
    const struct umb__tree *tree = c->slice->tree;
    const uint32_t level = umb__tree_cell_level(tree);
    if (c->in.x0[0] > c->in.x1[0] || c->in.y0[0] > c->in.y1[0]) {
        return false;
    }
    for (int32_t y = c->in.y0[0] >> level; y <= c->in.y1[0] >> level; y++) {
        for (int32_t x = c->in.x0[0] >> level; x <= c->in.x1[0] >> level; x++) {
            const struct square cell = {(int32_t)((uint32_t)x << level),
                                        (int32_t)((uint32_t)y << level), level};
            c->slice->stats->nodes++;
            if (walk_link(c, &cell,
                          umb__tree_cell(tree, (uint32_t)x, (uint32_t)y, c->z >> level))) {
                return true;
            }
        }
    }
    return false;
}

/* Clips low..high to the frustum; empty ranges stay empty. */
static void clip(int64_t low, int64_t high, int32_t size, int32_t *first, int32_t *last)
{
    *first = low < 0 ? 0 : low >= size ? size : (int32_t)low;
    *last = high < 0 ? -1 : high >= size ? size - 1 : (int32_t)high;
}

static uint32_t clamp_depth(const struct umb__slice *slice, int32_t size)
{
    return slice->z >= size ? (uint32_t)size - 1 : (uint32_t)slice->z;
}

bool umb__slice_has(const struct umb__slice *slice, struct umb__texels texels, bool lit)
{
    const int32_t size = (int32_t)1 << slice->tree->log2_size;
    if (slice->z < 0) {
        return lit;
    }
    struct count c = {.slice = slice, .z = clamp_depth(slice, size), .wanted = lit};
    clip(texels.x0, texels.x1, size, &c.in.x0[0], &c.in.x1[0]);
    clip(texels.y0, texels.y1, size, &c.in.y0[0], &c.in.y1[0]);
    const bool cut = c.in.x0[0] != texels.x0 || c.in.x1[0] != texels.x1 ||
                     c.in.y0[0] != texels.y0 || c.in.y1[0] != texels.y1;
    return (cut && lit) || walk(&c);
}

/* One axis of a box: the texels covered wholly, the texels covered at all, and the covered part of
 * the outer ones. */
struct span {
    int64_t low[2], high[2]; /* First and last texel; 0: covered at all, 1: covered wholly */
    double weight[2];        /* Weights of the two windows; their sum is 1 */
};

static struct span span_of(int64_t middle, double width)
{
    const int64_t half = (int64_t)((width - 1.0) / 2.0);
    const double part = (width - (double)(2 * half + 1)) / 2.0;
    const int64_t more = part > 0 ? 1 : 0;
    return (struct span){{middle - half - more, middle - half},
                         {middle + half + more, middle + half},
                         {part, 1.0 - part}};
}

static int64_t length(int64_t low, int64_t high)
{
    return high >= low ? high - low + 1 : 0;
}

double umb__slice_share(const struct umb__slice *slice, const struct umb__real_box *box)
{
    const int32_t size = (int32_t)1 << slice->tree->log2_size;
    if (slice->z < 0) {
        return 1;
    }
    const struct span x = span_of(box->x, box->width), y = span_of(box->y, box->height);
    struct count c = {.slice = slice, .z = clamp_depth(slice, size), .counts = true};
    for (unsigned i = 0; i < 2; i++) {
        clip(x.low[i], x.high[i], size, &c.in.x0[i], &c.in.x1[i]);
        clip(y.low[i], y.high[i], size, &c.in.y0[i], &c.in.y1[i]);
    }
    int64_t all[4];
    for (unsigned k = 0; k < 4; k++) {
        const unsigned i = k % 2, j = k / 2;
        all[k] = length(x.low[i], x.high[i]) * length(y.low[j], y.high[j]);
        /* What is cut off is lit. */
        c.lit[k] =
            (uint64_t)(all[k] - length(c.in.x0[i], c.in.x1[i]) * length(c.in.y0[j], c.in.y1[j]));
    }
    (void)walk(&c);
    double lit = 0, total = 0;
    for (unsigned k = 0; k < 4; k++) {
        const double weight = x.weight[k % 2] * y.weight[k / 2];
        lit += weight * (double)c.lit[k];
        total += weight * (double)all[k];
    }
    return lit / total;
}

void umb__store_share(void *values, enum umb_answer_format format, size_t i, double share)
{
    const float value = (float)share;
    if (format == UMB_ANSWER_F32) {
        memcpy((uint8_t *)values + i * sizeof value, &value, sizeof value);
    } else if (format == UMB_ANSWER_U8) {
        /* A share exactly between two bytes may be slightly smaller as a float. The factor makes
         * such a tie round up. */
        ((uint8_t *)values)[i] = (uint8_t)(255.0 * ((double)value * (1 + 0x1p-23)) + 0.5);
    } else {
        umb__store_answer(values, format, i, value >= 0.5F, 1);
    }
}
