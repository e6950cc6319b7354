/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of the kernels of footprints (receivers.h). Included by kernel_squares_base.c,
 * kernel_squares_avx2.c and kernel_squares_avx512.c, which name the functions (UMB__RECEIVERS_FN,
 * UMB__SQUARES_FN) and the steps that they have hand-written; else the steps are those in C. There
 * is no include guard: each file includes this one once.
 *
 * The samples of a point are scattered over a few hundred texels: each has its own brick, but most
 * share the nodes above. So samples descend in groups. A group is a node and the samples of one
 * point in it, a bit each. A step tells for all 64 samples of a point at once whether their
 * children are lit, shadowed or mixed, and makes a group for each mixed child. Most groups end
 * above the bricks.
 *
 * Up to sixteen points go together, stage by stage as in kernel_body.h: each stage prefetches what
 * the next one reads.
 */
#include "query/kernel_lamp_squares.h"
#include "query/kernel_receivers.h"
#include "query/kernel_square_steps.h"

#ifndef UMB__PLACE_SAMPLES
#define UMB__PLACE_SAMPLES umb__place_samples
#define UMB__CHILD_BYTES   umb__child_bytes_make
#define UMB__CHILDREN_IN   umb__children_in
#define UMB__SAMPLES_IN    umb__samples_in
#endif
#ifndef UMB__LIT_IN_BRICK
#define UMB__SLICE_PLACES umb__slice_places_make
#define UMB__LIT_IN_BRICK umb__lit_in_brick
#endif

#define TOGETHER 16U /* Points that descend together */
#define GROUPS   (TOGETHER * UMB__SAMPLES)

/* Groups of samples. At most one group for each sample, and one to spare. */
struct sample_groups {
    uint32_t count;
    uint32_t points; /* Bit p: a group is of point p */
    uint8_t point[GROUPS + 1];
    uint32_t number[GROUPS + 1]; /* Number of the group's node or brick. In a group made from a
                                    first cube: number of one of its samples */
    uint64_t samples[GROUPS + 1];
};

/* Points on their way through the stages. */
struct square_block {
    const struct umb__query *query;
    uint32_t count;
    uint32_t level;          /* Level of the cubes at which descents begin, the first cubes */
    bool pieces;             /* True: these are pieces of columns; false: cells of the grid */
    uint8_t lane[TOGETHER];  /* Receivers of the points */
    bool compact[TOGETHER];  /* By point: all samples are within four first cubes on each axis */
    uint64_t todo[TOGETHER]; /* By point: samples that need a look-up */
    uint64_t lit[TOGETHER];  /* By point: lit samples so far */
    struct umb__samples samples[TOGETHER];
    struct umb__child_bytes faces[TOGETHER]; /* By point, for lamps: faces of the samples */
    union {
        struct umb__child_bytes bytes[TOGETHER];
        struct umb__slice_places places[TOGETHER];
    };
    struct sample_groups groups[2];
    /* Open groups: those with samples that no new group has yet */
    uint8_t open_point[GROUPS];
    const uint64_t *open_node[GROUPS];
    uint64_t open[GROUPS];             /* Samples that are left */
    const uint32_t *child[GROUPS + 1]; /* By new group: where its number is stored */
};

/* Prefetches a node or brick of `level`. */
UMB__INLINE void ask_for(const struct umb__query *q, uint32_t level, uint32_t number)
{
    UMB__PREFETCH(level > UMB_LEVEL_BRICK ? q->nodes + number : q->bricks[number]);
}

static inline uint32_t last_bit(uint64_t bits)
{
    return 63 - (uint32_t)__builtin_clzll(bits);
}

/* Chooses where descents begin: at the pieces of columns or at the cells of the grid. The grid is
 * chosen if a piece is as large as a cell, or so small that a square touches many pieces. */
static void choose_start(struct square_block *block)
{
    const struct umb__query *q = block->query;
    const uint32_t cell = q->log2_size - q->grid_log2, column = q->column_level;
    block->pieces = column > UMB__SHARE_LEVEL && column < cell;
    block->level = block->pieces ? column : cell;
}

/* Returns the address of the value of a sample's first cube, at which the descent begins. */
static const uint32_t *find_cube(const struct square_block *block,
                                 const struct umb__samples *samples, uint32_t k)
{
    const struct umb__query *q = block->query;
    const int32_t x = samples->x[k], y = samples->y[k], z = samples->z[k];
    const uint32_t level = block->level, row = q->log2_size - level;
    if (!block->pieces) {
        return q->grid + umb__grid_index(x, y, z, level, q->grid_log2);
    }
    uint64_t column;
    memcpy(&column, q->columns + ((uint32_t)x >> level) + ((uint32_t)y >> level << row),
           sizeof column);
    return q->pieces + umb__piece_of(column, (uint32_t)z >> level);
}

/* Groups the samples of a point by the cubes at which their descents begin. It compares each sample
 * with all others, so it serves points of any extent; list_compact is faster. */
static uint32_t list_wide(struct square_block *block, uint32_t p, struct sample_groups *to,
                          uint32_t count)
{
    const struct umb__samples *samples = &block->samples[p];
    uint64_t rest = block->todo[p];
    while (rest) {
        const uint32_t i = umb__first_bit(rest);
        uint64_t same = 0;
        for (uint64_t others = rest; others; others &= others - 1) {
            const uint32_t k = umb__first_bit(others);
            const uint32_t differ = (uint32_t)(samples->x[i] ^ samples->x[k]) |
                                    (uint32_t)(samples->y[i] ^ samples->y[k]) |
                                    (uint32_t)(samples->z[i] ^ samples->z[k]);
            same |= (uint64_t)(differ >> block->level == 0) << k;
        }
        to->point[count] = (uint8_t)p;
        to->samples[count] = same;
        to->number[count++] = i;
        rest &= ~same;
    }
    return count;
}

/* Does what list_wide does, for the open points, in rounds as group_by_child does. The samples of
 * such a point lie within four cubes on each axis, so the lowest two bits of a cube's place on each
 * axis tell its cubes apart. */
static uint32_t list_compact(struct square_block *block, uint32_t open, struct sample_groups *to,
                             uint32_t count)
{
    for (uint32_t k = 0; k < open; k++) {
        const uint32_t p = block->open_point[k];
        UMB__CHILD_BYTES(&block->samples[p], block->level, &block->bytes[p]);
    }
    for (uint32_t left; open > 0; open = left) {
        left = 0;
        for (uint32_t k = 0; k < open; k++) {
            const uint32_t p = block->open_point[k];
            const struct umb__child_bytes *bytes = &block->bytes[p];
            uint64_t rest = block->open[k];
            const uint32_t first = umb__first_bit(rest), last = last_bit(rest);
            const uint8_t one = bytes->of[first], other = bytes->of[last];
            const uint64_t in_one = UMB__SAMPLES_IN(bytes, rest, one);
            const uint64_t in_other = UMB__SAMPLES_IN(bytes, rest, other);
            to->point[count] = to->point[count + 1] = (uint8_t)p;
            to->samples[count] = in_one;
            to->samples[count + 1] = in_other;
            to->number[count] = first;
            to->number[count + 1] = last;
            count += 1 + (uint32_t)(one != other);
            rest &= ~(in_one | in_other);
            block->open_point[left] = (uint8_t)p;
            block->open[left] = rest;
            left += rest != 0;
        }
    }
    return count;
}

/* Settles the samples whose first cube, at which the descent begins, is uniform, and makes groups
 * of the other samples. */
static void group_by_cube(struct square_block *block, struct sample_groups *to,
                          struct umb_query_stats *stats)
{
    uint32_t count = 0, left = 0, open = 0;
    for (uint32_t p = 0; p < block->count; p++) {
        const bool compact = block->compact[p];
        block->open_point[open] = (uint8_t)p;
        block->open[open] = block->todo[p];
        open += compact && block->todo[p] != 0;
        count = compact ? count : list_wide(block, p, to, count);
    }
    count = list_compact(block, open, to, count);
    stats->nodes += count;
    for (uint32_t k = 0; k < count; k++) {
        block->child[k] = find_cube(block, &block->samples[to->point[k]], to->number[k]);
        UMB__PREFETCH(block->child[k]);
    }
    to->points = 0;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t value = *block->child[k], p = to->point[k];
        const uint64_t mixed = value >= UMB__CELL_FIRST, samples = to->samples[k];
        const uint32_t number = (uint32_t)umb__select(mixed, value - UMB__CELL_FIRST, 0);
        block->lit[p] |= samples & (0 - (uint64_t)(value == UMB__CELL_LIT));
        to->point[left] = (uint8_t)p;
        to->samples[left] = samples;
        to->number[left] = number;
        to->points |= (uint32_t)mixed << p;
        ask_for(block->query, block->level, number);
        left += (uint32_t)mixed;
    }
    to->count = left;
}

/* Settles those samples of the groups that lie in uniform children of `level`. Returns the number
 * of groups that have other samples, the open groups. */
static uint32_t settle_children(struct square_block *block, uint32_t level,
                                const struct sample_groups *from)
{
    const struct umb__query *q = block->query;
    uint32_t count = 0;
    for (uint32_t rest = from->points; rest; rest &= rest - 1) {
        const uint32_t p = umb__first_bit(rest);
        UMB__CHILD_BYTES(&block->samples[p], level, &block->bytes[p]);
    }
    for (uint32_t k = 0; k < from->count; k++) {
        const uint32_t p = from->point[k];
        const uint64_t *node = q->nodes + from->number[k], samples = from->samples[k];
        const struct umb__child_bytes *bytes = &block->bytes[p];
        block->lit[p] |= UMB__CHILDREN_IN(bytes, samples, node[1]);
        const uint64_t mixed = UMB__CHILDREN_IN(bytes, samples, node[0]);
        block->open_point[count] = (uint8_t)p;
        block->open_node[count] = node;
        block->open[count] = mixed;
        count += mixed != 0;
    }
    return count;
}

/* Adds a group for one child of a node. */
UMB__INLINE void add_group(struct square_block *block, struct sample_groups *to, uint32_t at,
                           uint32_t p, uint64_t samples, const uint64_t *node, uint32_t child)
{
    const uint64_t below = ((uint64_t)1 << child) - 1;
    to->point[at] = (uint8_t)p;
    to->samples[at] = samples;
    block->child[at] = (const uint32_t *)(const void *)node + 4 + umb__count_bits(node[0] & below);
    UMB__PREFETCH(block->child[at]);
}

/*
 * Makes the groups of `level` from the open groups of the level above. A round takes two groups out
 * of each open one: those of its first and of its last sample. Few need a second round. So no
 * branch depends on one group's samples, and the groups of a round do not wait for each other.
 */
static void group_by_child(struct square_block *block, uint32_t level,
                           const struct sample_groups *from, struct sample_groups *to,
                           struct umb_query_stats *stats)
{
    uint32_t count = 0;
    stats->nodes += from->count;
    to->points = 0;
    for (uint32_t open = settle_children(block, level, from), left; open > 0; open = left) {
        left = 0;
        for (uint32_t k = 0; k < open; k++) {
            const uint32_t p = block->open_point[k];
            const uint64_t *node = block->open_node[k];
            const struct umb__child_bytes *bytes = &block->bytes[p];
            uint64_t rest = block->open[k];
            const uint8_t one = bytes->of[umb__first_bit(rest)];
            const uint8_t other = bytes->of[last_bit(rest)];
            const uint64_t in_one = UMB__SAMPLES_IN(bytes, rest, one);
            const uint64_t in_other = UMB__SAMPLES_IN(bytes, rest, other);
            add_group(block, to, count, p, in_one, node, one);
            add_group(block, to, count + 1, p, in_other, node, other);
            to->points |= 1U << p;
            count += 1 + (uint32_t)(one != other);
            rest &= ~(in_one | in_other);
            block->open_point[left] = (uint8_t)p;
            block->open_node[left] = node;
            block->open[left] = rest;
            left += rest != 0;
        }
    }
    for (uint32_t k = 0; k < count; k++) {
        to->number[k] = *block->child[k];
        ask_for(block->query, level, to->number[k]);
    }
    to->count = count;
}

/* Answers the samples of groups in bricks. */
static void read_bricks(struct square_block *block, const struct sample_groups *from)
{
    for (uint32_t rest = from->points; rest; rest &= rest - 1) {
        const uint32_t p = umb__first_bit(rest);
        UMB__SLICE_PLACES(&block->samples[p], &block->places[p]);
    }
    for (uint32_t k = 0; k < from->count; k++) {
        const uint32_t p = from->point[k];
        block->lit[p] |= UMB__LIT_IN_BRICK(&block->samples[p], &block->places[p], from->samples[k],
                                           block->query->bricks[from->number[k]]);
    }
}

static void descend_together(struct square_block *block, struct umb_query_stats *stats)
{
    struct sample_groups *from = &block->groups[0], *to = &block->groups[1];
    group_by_cube(block, from, stats);
    for (uint32_t level = block->level; level > UMB_LEVEL_BRICK;) {
        struct sample_groups *made = to;
        level -= 2;
        group_by_child(block, level, from, to, stats);
        to = from;
        from = made;
    }
    stats->bricks += from->count;
    read_bricks(block, from);
}

/* Starts a block with the next points that have squares, from receiver i. Returns the receiver
 * after them. Out: all samples are still to do. */
static uint32_t take_points(const struct umb__receivers *receivers, uint32_t i,
                            struct square_block *block)
{
    block->count = 0;
    for (; i < receivers->count && block->count < TOGETHER; i++) {
        block->lane[block->count] = (uint8_t)i;
        block->todo[block->count] = receivers->both[i] ? UINT64_MAX : UINT64_MAX << 32;
        block->count += !receivers->window[i];
    }
    return i;
}

/* Answers a block of points under parallel light. */
static void answer_sun(const struct umb__receivers *receivers, struct square_block *block,
                       struct umb_query_stats *stats)
{
    for (uint32_t p = 0; p < block->count; p++) {
        const uint32_t i = block->lane[p];
        const uint64_t wanted = block->todo[p];
        const uint64_t inside =
            UMB__PLACE_SAMPLES(receivers, i, block->query->log2_size, &block->samples[p]);
        block->compact[p] = receivers->compact[i] != 0;
        block->lit[p] = wanted & ~inside;
        block->todo[p] = wanted & inside;
    }
    descend_together(block, stats);
}

/* Answers the samples that a block has in one face. In: wanted: samples of the points. only: by
 * point, the face of all its samples in faces. */
static void answer_face(const struct umb__query *query, uint32_t face,
                        const uint64_t wanted[TOGETHER], const uint32_t only[TOGETHER],
                        struct square_block *block, struct umb_query_stats *stats)
{
    struct umb__query face_query;
    uint64_t any = 0;
    for (uint32_t p = 0; p < block->count; p++) {
        block->todo[p] = UMB__SAMPLES_IN(&block->faces[p], wanted[p], (uint8_t)face);
        any |= block->todo[p];
    }
    if (any == 0) {
        return;
    }
    umb__perspective_face(query, face, &face_query);
    block->query = &face_query;
    choose_start(block);
    for (uint32_t p = 0; p < block->count; p++) {
        block->compact[p] = only[p] == face && umb__is_compact(&block->samples[p], block->level);
    }
    descend_together(block, stats);
}

/* Answers a block of points under a lamp, face by face. In: a, b: unit vectors along surfaces. */
static void answer_lamp(const struct umb__query *query, const struct umb__receivers *receivers,
                        const umb__vectors a, const umb__vectors b, struct square_block *block,
                        struct umb_query_stats *stats)
{
    uint64_t wanted[TOGETHER];
    uint32_t only[TOGETHER];
    for (uint32_t p = 0; p < block->count; p++) {
        const uint32_t i = block->lane[p];
        const double one[3] = {a[0][i], a[1][i], a[2][i]}, other[3] = {b[0][i], b[1][i], b[2][i]};
        wanted[p] = block->todo[p];
        only[p] = umb__place_under_lamp(query, receivers, i, one, other, &block->samples[p],
                                        &block->faces[p]);
        block->lit[p] = UMB__SAMPLES_IN(&block->faces[p], wanted[p], UMB__FACE_LIT);
    }
    for (uint32_t face = 0; face < query->face_count; face++) {
        answer_face(query, face, wanted, only, block, stats);
    }
}

void UMB__SQUARES_FN(const struct umb__query *query, struct umb__receivers *receivers,
                     struct umb_query_stats *stats)
{
    struct square_block block;
    umb__vectors a, b;
    block.query = query;
    if (query->face_count > 0) {
        umb__receivers_span(receivers, a, b);
    } else {
        choose_start(&block);
        umb__receivers_place(query, (double)(1U << block.level), receivers);
    }
    for (uint32_t i = 0; i < receivers->count;) {
        i = take_points(receivers, i, &block);
        if (query->face_count > 0) {
            answer_lamp(query, receivers, a, b, &block, stats);
        } else {
            answer_sun(receivers, &block, stats);
        }
        for (uint32_t p = 0; p < block.count; p++) {
            const uint32_t lane = block.lane[p];
            receivers->lit[lane] = block.lit[p];
            receivers->lit_count[0][lane] = umb__count_bits(block.lit[p] & UINT32_MAX);
            receivers->lit_count[1][lane] = umb__count_bits(block.lit[p] >> 32);
        }
    }
}

void UMB__RECEIVERS_FN(const struct umb__query *query, const struct umb_points *points,
                       size_t first, uint32_t count, struct umb__receivers *receivers)
{
    umb__receivers_read(query, points, first, count, receivers);
    umb__receivers_light(query, receivers);
    umb__receivers_normal(receivers);
    umb__receivers_side(query, points, first, receivers);
    umb__receivers_level(query, receivers);
}
