/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Builds the columns of columns.h by a walk over the quadtree of squares of texels, from the
 * largest square down. On the way back the columns of four squares are joined into the column of
 * their parent square.
 *
 * A square whose column has no mixed node is not entered: its texels are not read (and may be
 * unset). Recursion is as deep as there are levels above the leaves, at most 15.
 */
#include "bake/build/columns.h"

#include "base/memory.h"
#include "base/try.h"

#include <stdlib.h>
#include <string.h>

void umbb_runs_finish(struct umbb_runs *runs)
{
    free(runs->items);
    memset(runs, 0, sizeof *runs);
}

/* Makes room for more runs. */
static enum umb_status reserve(struct umbb_runs *runs, size_t more, struct umb_error *error)
{
    const size_t needed = runs->count + more;
    return umb__grow(NULL, &runs->items, &runs->capacity, needed, sizeof *runs->items)
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "column runs: %zu bytes refused",
                          needed * sizeof *runs->items);
}

enum umb_status umbb_runs_keep(struct umbb_runs *to, const struct umbb_runs *from,
                               struct umbb_column *column, struct umb_error *error)
{
    UMB__TRY(reserve(to, column->run_count, error));
    if (column->run_count > 0) {
        memcpy(to->items + to->count, from->items + column->run_first,
               column->run_count * sizeof *to->items);
    }
    column->run_first = to->count;
    to->count += column->run_count;
    return UMB_OK;
}

enum umb_status umbb_runs_push(struct umbb_runs *runs, size_t column_first, uint32_t z_end,
                               uint32_t ref, struct umb_error *error)
{
    if (runs->count > column_first && runs->items[runs->count - 1].ref == ref) {
        runs->items[runs->count - 1].z_end = z_end;
        return UMB_OK;
    }
    UMB__TRY(reserve(runs, 1, error));
    runs->items[runs->count++] = (struct umbb_column_run){z_end, ref};
    return UMB_OK;
}

/* A position in a column, moving along z. */
struct cursor {
    const struct umbb_column *column;
    size_t run; /* run that contains z, if z is in the mixed range */
};

/* Returns the node at z, and sets *end to the first node after z that may differ. z must not
 * decrease from call to call. */
static uint32_t cursor_read(struct cursor *cursor, const struct umbb_runs *runs, uint32_t z,
                            uint32_t *end)
{
    const struct umbb_column *column = cursor->column;
    if (z < column->mixed_first) {
        *end = column->mixed_first;
        return UMB__REF_LIT;
    }
    if (z >= column->mixed_end) {
        *end = UINT32_MAX;
        return UMB__REF_SHADOWED;
    }
    while (runs->items[cursor->run].z_end <= z) {
        cursor->run++;
    }
    *end = runs->items[cursor->run].z_end;
    return runs->items[cursor->run].ref;
}

/*
 * Reads the eight children of the node at z. Returns the first node after z whose children may
 * differ.
 */
static uint32_t read_children(struct cursor cursors[4], const struct umbb_runs *runs, uint32_t z,
                              uint32_t children[8])
{
    uint32_t same_until = UINT32_MAX; /* in nodes of the children's level */
    for (unsigned q = 0; q < 4; q++) {
        uint32_t end;
        const uint32_t near = cursor_read(&cursors[q], runs, 2 * z, &end);
        uint32_t far = near;
        if (end <= 2 * z + 1) {
            far = cursor_read(&cursors[q], runs, 2 * z + 1, &end);
            end = near == far ? end : 0;
        }
        children[q] = near;
        children[q + 4] = far;
        same_until = end < same_until ? end : same_until;
    }
    const uint32_t next = same_until / 2;
    return next > z + 1 ? next : z + 1;
}

enum umb_status umbb_column_join(struct umb__pool *pool, uint32_t level,
                                 const struct umbb_column four[4], struct umbb_runs *runs,
                                 struct umbb_column *column, struct umb_error *error)
{
    const size_t mark = four[0].run_first;
    struct cursor cursors[4];
    for (unsigned q = 0; q < 4; q++) {
        cursors[q] = (struct cursor){&four[q], four[q].run_first};
    }
    const size_t first = runs->count;
    uint32_t z = column->mixed_first;
    while (z < column->mixed_end) {
        uint32_t children[8], ref;
        uint32_t next = read_children(cursors, runs, z, children);
        next = next < column->mixed_end ? next : column->mixed_end;
        UMB__TRY(umb__pool_node(pool, level, children, &ref, error));
        UMB__TRY(umbb_runs_push(runs, first, next, ref, error));
        z = next;
    }
    /* The four columns' runs are no longer needed: the new ones move down over them. */
    column->run_first = mark;
    column->run_count = runs->count - first;
    if (column->run_count > 0) {
        memmove(runs->items + mark, runs->items + first, column->run_count * sizeof *runs->items);
    }
    runs->count = mark + column->run_count;
    return UMB_OK;
}

enum umb_status umbb_column_of_tree(const struct umbb_column_tree *tree, uint32_t level,
                                    const size_t place[2], struct umbb_column *column,
                                    struct umb_error *error)
{
    const size_t at = (place[1] << (tree->log2_size - level)) + place[0];
    *column = umbb_column_bounds(level, tree->max_lit[level][at], tree->min_end[level][at]);
    column->run_first = tree->runs->count;
    if (column->mixed_first == column->mixed_end) {
        return UMB_OK;
    }
    if (level == tree->leaf_level) {
        return tree->leaf(tree->user, place[0], place[1], column, error);
    }
    struct umbb_column four[4];
    for (size_t q = 0; q < 4; q++) {
        const size_t quarter[2] = {2 * place[0] + (q & 1), 2 * place[1] + (q >> 1)};
        UMB__TRY(umbb_column_of_tree(tree, level - 1, quarter, &four[q], error));
    }
    return umbb_column_join(tree->pool, level, four, tree->runs, column, error);
}
