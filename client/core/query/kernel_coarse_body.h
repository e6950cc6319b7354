/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The body of the coarse kernel: look-ups that stop at cells of 1 << level voxels
 * (umb_query_settings .level). Included behind kernel_body.h by kernel_base.c and kernel_avx2.c,
 * which name the function (UMB__COARSE). There is no include guard: each file includes this one
 * once.
 *
 * As in kernel_body.h a block of 64 points goes stage by stage: place, grid, one stage for each
 * level of wide nodes above the wanted one. Points whose node is still mixed then get the answer
 * one half; no brick is read. Answers are counted in halves: 0, 1 or 2.
 */
#define HALVES 2U

/* Reads the grid's cells. Points in uniform cells leave `todo`; others get a node's number. */
static void coarse_grid(const struct umb__query *q, struct umb__block *block,
                        uint32_t number[UMB__BLOCK])
{
    const uint32_t level = q->log2_size - q->grid_log2, g = q->grid_log2;
    uint64_t mixed = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        UMB__PREFETCH(q->grid + umb__grid_index(block->x[i], block->y[i], block->z[i], level, g));
    }
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        uint32_t value = q->grid[umb__grid_index(block->x[i], block->y[i], block->z[i], level, g)];
        number[i] = value - UMB__CELL_FIRST;
        block->lit[i] = value < UMB__CELL_FIRST ? HALVES * value : 1;
        mixed |= (uint64_t)(value >= UMB__CELL_FIRST) << i;
    }
    block->todo = mixed;
}

/* Reads one level of wide nodes: for each point the child of `level` that contains the point. */
static void coarse_step(const struct umb__query *q, struct umb__block *block, uint32_t level,
                        uint32_t number[UMB__BLOCK])
{
    const uint32_t *child[UMB__BLOCK];
    uint64_t mixed = 0;
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        UMB__PREFETCH(q->nodes + number[umb__first_bit(rest)]);
    }
    for (uint64_t rest = block->todo; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        const uint64_t *node = q->nodes + number[i];
        unsigned bit = umb__child_bit(block->x[i], block->y[i], block->z[i], level);
        uint32_t more = (uint32_t)(node[0] >> bit & 1);
        child[i] = umb__child_place(node, bit);
        block->lit[i] = HALVES * (uint32_t)(node[1] >> bit & 1) + more; /* lit is 0 where mixed */
        mixed |= (uint64_t)more << i;
    }
    for (uint64_t rest = mixed; rest; rest &= rest - 1) {
        uint32_t i = umb__first_bit(rest);
        number[i] = *child[i];
    }
    block->todo = mixed;
}

void UMB__COARSE(const struct umb__query *query, const struct umb_points *points, size_t first,
                 size_t count, struct umb_answers *answers)
{
    struct umb__block block;
    uint32_t number[UMB__BLOCK];
    struct umb_query_stats stats = {.points = count};
    struct UMB__PLACER placer;
    UMB__PLACER_INIT(query, points, &placer);
    for (size_t end = first + count; first < end; first += block.size) {
        block.size = (uint32_t)(end - first < UMB__BLOCK ? end - first : UMB__BLOCK);
        UMB__PLACE(&placer, first, &block, &stats);
        for (uint32_t i = 0; i < block.size; i++) {
            block.lit[i] *= HALVES; /* For points whose answer was known when they were placed */
        }
        stats.nodes += umb__count_bits(block.todo);
        coarse_grid(query, &block, number);
        for (uint32_t level = query->log2_size - query->grid_log2;
             level > query->level && block.todo; level -= 2) {
            stats.nodes += umb__count_bits(block.todo);
            coarse_step(query, &block, level - 2, number);
        }
        for (uint32_t i = 0; i < block.size; i++) {
            umb__store_answer(answers->values, query->format, first + i, block.lit[i], HALVES);
        }
    }
    umb_query_stats_add(&answers->stats, &stats);
}
