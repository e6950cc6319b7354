/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: mapped files. Source: docs/reference/umb-format.md, section 6.
 *
 * starts[w] is the level of the node that begins at word w of the node section, 0 if none does: the
 * proof that a child's number leads to a node of the level below and not into the middle of one.
 */
#include "oracle_parts.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

enum {
    HEAD_FIXED = 128,
    ENTRY_SIZE = 32,
    SECTION_COUNT = 7,
    SECTION_ALIGN = 4096,
    TOP_SIZE = 32,
    COLUMN_SIZE = 8,
    BRICK_SIZE = 64,
    GRID_LOG2_MAX = 7,
    LEVEL_STARTS = 9, /* levels 5, 7, ... 19, and the end */
};

static uint64_t word_at(const struct oracle *oracle, uint64_t word)
{
    return oracle_number(oracle->node.data + 8 * word, 8);
}

static uint32_t child_at(const struct oracle *oracle, uint64_t word, uint32_t rank)
{
    return (uint32_t)oracle_number(oracle->node.data + 8 * (word + 2) + 4 * (uint64_t)rank, 4);
}

static int read_sections(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    static const char names[SECTION_COUNT][5] = {"TOPS", "LVLS", "GRID", "NODE",
                                                 "BRIK", "COLS", "PIEC"};
    struct oracle_section *sections[SECTION_COUNT] = {&oracle->tops, &oracle->lvls, &oracle->grid,
                                                      &oracle->node, &oracle->brik, &oracle->cols,
                                                      &oracle->piec};
    uint64_t at = oracle->head_size;
    for (uint32_t i = 0; i < SECTION_COUNT; i++) {
        const uint8_t *entry =
            oracle->bytes + HEAD_FIXED + oracle->block_size + (size_t)i * ENTRY_SIZE;
        uint64_t offset = oracle_number(entry + 8, 8), length = oracle_number(entry + 16, 8);
        if (memcmp(entry, names[i], 4) != 0 || !oracle_all_zero(entry + 4, 4)) {
            return oracle_refuse(error, "directory: entry %" PRIu32 " is not %s", i, names[i]);
        }
        if (offset % SECTION_ALIGN != 0 || offset < at || offset > oracle->size ||
            length > oracle->size - offset) {
            return oracle_refuse(error, "%s: %" PRIu64 " bytes at %" PRIu64 " of %zu", names[i],
                                 length, offset, oracle->size);
        }
        if (!oracle_all_zero(oracle->bytes + at, offset - at)) {
            return oracle_refuse(error, "%s: the bytes before it are not zero", names[i]);
        }
        if (XXH3_64bits(oracle->bytes + offset, (size_t)length) != oracle_number(entry + 24, 8)) {
            return oracle_refuse(error, "%s: XXH3 differs", names[i]);
        }
        *sections[i] = (struct oracle_section){oracle->bytes + offset, length};
        at = offset + length;
    }
    if (!oracle_all_zero(oracle->bytes + at, oracle->size - at)) {
        return oracle_refuse(error, "file: the bytes after the last section are not zero");
    }
    if (oracle->tops.size != (uint64_t)oracle->frustum_count * TOP_SIZE ||
        oracle->lvls.size != 8 * LEVEL_STARTS || oracle->grid.size % 4 != 0 ||
        oracle->node.size % 8 != 0 || oracle->brik.size % BRICK_SIZE != 0 ||
        oracle->cols.size % COLUMN_SIZE != 0 || oracle->piec.size % 4 != 0) {
        return oracle_refuse(error, "directory: a section has a length its content cannot have");
    }
    return 1;
}

static int read_tops(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const uint8_t *top = oracle->tops.data + (size_t)i * TOP_SIZE;
        struct oracle_frustum *frustum = &oracle->frusta[i];
        frustum->grid_log2 = (uint32_t)oracle_number(top, 4);
        frustum->grid_first = oracle_number(top + 8, 8);
        if (frustum->grid_log2 > GRID_LOG2_MAX || frustum->grid_log2 + 3 > frustum->n ||
            (frustum->n - frustum->grid_log2) % 2 != 1) {
            return oracle_refuse(error, "TOPS: frustum %" PRIu32 ": g %" PRIu32 " for n %" PRIu32,
                                 i, frustum->grid_log2, frustum->n);
        }
        uint64_t cells = (uint64_t)1 << (3 * frustum->grid_log2);
        uint64_t all = oracle->grid.size / 4;
        if (frustum->grid_first > all || cells > all - frustum->grid_first) {
            return oracle_refuse(
                error, "TOPS: frustum %" PRIu32 ": %" PRIu64 " cells from %" PRIu64 " of %" PRIu64,
                i, cells, frustum->grid_first, all);
        }
        uint32_t c = frustum->column_level = (uint32_t)oracle_number(top + 4, 4);
        frustum->column_first = oracle_number(top + 16, 8);
        frustum->piece_first = oracle_number(top + 24, 8);
        if (c % 2 == 0 || c < 3 || c > frustum->n - frustum->grid_log2 ||
            (c == 3 && frustum->n - frustum->grid_log2 > 3)) {
            return oracle_refuse(error, "TOPS: frustum %" PRIu32 ": columns of level %" PRIu32, i,
                                 c);
        }
        uint64_t columns = (uint64_t)1 << (2 * (frustum->n - c));
        if (frustum->column_first > oracle->cols.size / COLUMN_SIZE ||
            columns > oracle->cols.size / COLUMN_SIZE - frustum->column_first ||
            frustum->piece_first + 2 > oracle->piec.size / 4) {
            return oracle_refuse(error, "TOPS: frustum %" PRIu32 ": columns out of range", i);
        }
    }
    return 1;
}

/* Records where the nodes of one level begin; pairs of zero words may stand between them. */
static int find_starts(const struct oracle *oracle, uint32_t level, const uint64_t range[2],
                       uint8_t *starts, char error[ORACLE_ERROR_SIZE])
{
    for (uint64_t at = range[0]; at < range[1];) {
        if (range[1] - at < 2) {
            return oracle_refuse(error, "NODE: level %" PRIu32 " ends inside a node", level);
        }
        uint64_t mixed = word_at(oracle, at), lit = word_at(oracle, at + 1);
        if (mixed == 0 && lit == 0) { /* a gap: no node is all shadowed */
            at += 2;
            continue;
        }
        uint32_t children = (uint32_t)__builtin_popcountll(mixed);
        uint64_t words = 2 + ((uint64_t)children + 3) / 4 * 2;
        if (words > range[1] - at) {
            return oracle_refuse(error, "NODE: level %" PRIu32 " ends inside a node", level);
        }
        if ((mixed & lit) != 0) {
            return oracle_refuse(error, "NODE: word %" PRIu64 ": a child both mixed and lit", at);
        }
        if (mixed == 0 && lit == UINT64_MAX) {
            return oracle_refuse(error, "NODE: word %" PRIu64 ": all lit", at);
        }
        for (uint32_t k = children; k < 2 * (words - 2); k++) {
            if (child_at(oracle, at, k) != 0) {
                return oracle_refuse(error, "NODE: word %" PRIu64 ": padding is not zero", at);
            }
        }
        starts[at] = (uint8_t)level;
        at += words;
    }
    return 1;
}

static int read_levels(const struct oracle *oracle, uint8_t *starts, char error[ORACLE_ERROR_SIZE])
{
    uint64_t words = oracle->node.size / 8;
    uint64_t begin[LEVEL_STARTS];
    for (uint32_t i = 0; i < LEVEL_STARTS; i++) {
        begin[i] = oracle_number(oracle->lvls.data + (size_t)i * 8, 8);
        if (begin[i] > words || (i > 0 && begin[i] < begin[i - 1])) {
            return oracle_refuse(error,
                                 "LVLS: level %" PRIu32 " begins at word %" PRIu64 " of %" PRIu64,
                                 5 + 2 * i, begin[i], words);
        }
    }
    if (begin[0] != 0 || begin[LEVEL_STARTS - 1] != words) {
        return oracle_refuse(error, "LVLS: the levels do not fill the node section");
    }
    for (uint32_t i = 0; i + 1 < LEVEL_STARTS; i++) {
        if (!find_starts(oracle, 5 + 2 * i, &begin[i], starts, error)) {
            return 0;
        }
    }
    return 1;
}

/* Returns the value for the cube of a column's level around a voxel, read from the column's
 * list. */
static uint64_t piece_at(const struct oracle *oracle, const struct oracle_frustum *f,
                         const uint32_t cube[3])
{
    uint64_t column = cube[0] + ((uint64_t)cube[1] << (f->n - f->column_level));
    const uint8_t *at = oracle->cols.data + COLUMN_SIZE * (f->column_first + column);
    uint64_t first = oracle_number(at, 4), low = oracle_number(at + 4, 2);
    uint64_t high = oracle_number(at + 6, 2), z = cube[2];
    z = z < low ? low : z > high ? high : z;
    uint64_t piece = f->piece_first + first + z - low;
    return low <= high && piece < oracle->piec.size / 4
               ? oracle_number(oracle->piec.data + 4 * piece, 4)
               : UINT64_MAX;
}

/* Returns the value for the same cube, found through the grid: 0, 1 or 2 + number. */
static uint64_t value_at(const struct oracle *oracle, const struct oracle_frustum *f,
                         const uint32_t cube[3])
{
    uint32_t g = f->grid_log2, level = f->n - g, up = level - f->column_level;
    uint64_t cell = (uint64_t)(cube[0] >> up) + ((uint64_t)(cube[1] >> up) << g) +
                    ((uint64_t)(cube[2] >> up) << (2 * g));
    uint64_t value = oracle_number(oracle->grid.data + 4 * (f->grid_first + cell), 4);
    while (up > 0 && value >= 2) {
        up -= 2;
        uint32_t bit =
            ((cube[0] >> up) & 3) + 4 * ((cube[1] >> up) & 3) + 16 * ((cube[2] >> up) & 3);
        uint64_t mixed = word_at(oracle, value - 2), lit = word_at(oracle, value - 1);
        uint64_t before = mixed & (((uint64_t)1 << bit) - 1);
        value = (mixed >> bit) & 1 ? 2 + (uint64_t)child_at(oracle, value - 2,
                                                            (uint32_t)__builtin_popcountll(before))
                                   : (lit >> bit) & 1;
    }
    return value;
}

/* Checks that columns give the same value for every cube as grid and nodes. */
static int check_columns(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const struct oracle_frustum *f = &oracle->frusta[i];
        uint32_t side = (uint32_t)1 << (f->n - f->column_level), cube[3];
        if (oracle_number(oracle->piec.data + 4 * f->piece_first, 4) != 0 ||
            oracle_number(oracle->piec.data + 4 * f->piece_first + 4, 4) != 1) {
            return oracle_refuse(error, "PIEC: frustum %" PRIu32 " does not begin with 0, 1", i);
        }
        for (cube[2] = 0; cube[2] < side; cube[2]++) {
            for (cube[1] = 0; cube[1] < side; cube[1]++) {
                for (cube[0] = 0; cube[0] < side; cube[0]++) {
                    if (piece_at(oracle, f, cube) != value_at(oracle, f, cube)) {
                        return oracle_refuse(error,
                                             "COLS: frustum %" PRIu32 ": cube %" PRIu32 " %" PRIu32
                                             " %" PRIu32 " is not as in the grid",
                                             i, cube[0], cube[1], cube[2]);
                    }
                }
            }
        }
    }
    return 1;
}

/* What is reached from the grids: nodes by their first word, and bricks. */
struct reach {
    const uint8_t *starts;
    uint8_t *nodes, *bricks;
};

/* Returns 0 if `number` is no node or brick of a level. Else marks it as reached, if the node that
 * refers to it is reached. */
static int reach_child(const struct oracle *oracle, const struct reach *reach, uint32_t level,
                       uint64_t number, uint8_t reached)
{
    if (level == 3) {
        if (number >= oracle->brik.size / BRICK_SIZE) {
            return 0;
        }
        reach->bricks[number] |= reached;
        return 1;
    }
    if (number >= oracle->node.size / 8 || reach->starts[number] != level) {
        return 0;
    }
    reach->nodes[number] |= reached;
    return 1;
}

/* The least level of all frusta's cells. */
static uint32_t least_cell_level(const struct oracle *oracle)
{
    uint32_t least = ORACLE_LEVELS;
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        uint32_t level = oracle->frusta[i].n - oracle->frusta[i].grid_log2;
        least = level < least ? level : least;
    }
    return least;
}

static int check_grid(const struct oracle *oracle, const struct reach *reach,
                      char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const struct oracle_frustum *frustum = &oracle->frusta[i];
        uint64_t cells = (uint64_t)1 << (3 * frustum->grid_log2);
        for (uint64_t k = 0; k < cells; k++) {
            uint64_t cell = oracle_number(oracle->grid.data + 4 * (frustum->grid_first + k), 4);
            if (cell >= 2 &&
                !reach_child(oracle, reach, frustum->n - frustum->grid_log2, cell - 2, 1)) {
                return oracle_refuse(error,
                                     "GRID: frustum %" PRIu32 ": cell %" PRIu64 " holds %" PRIu64,
                                     i, k, cell);
            }
        }
    }
    return 1;
}

/*
 * From the top level down, as a node's parents are all of higher levels. The page does not say
 * whether nodes above the cells of a grid, which no look-up reaches, may be stored: they are
 * accepted.
 */
static int check_nodes(const struct oracle *oracle, const struct reach *reach,
                       char error[ORACLE_ERROR_SIZE])
{
    uint32_t cell_level = least_cell_level(oracle);
    for (uint32_t level = 19; level >= 5; level -= 2) {
        for (uint64_t w = 0; w < oracle->node.size / 8; w++) {
            if (reach->starts[w] != level) {
                continue;
            }
            if (!reach->nodes[w] && level <= cell_level) {
                return oracle_refuse(error, "NODE: no grid reaches word %" PRIu64, w);
            }
            uint32_t children = (uint32_t)__builtin_popcountll(word_at(oracle, w));
            for (uint32_t k = 0; k < children; k++) {
                if (!reach_child(oracle, reach, level - 2, child_at(oracle, w, k),
                                 reach->nodes[w])) {
                    return oracle_refuse(
                        error, "NODE: word %" PRIu64 ": child %" PRIu32 " leads nowhere", w, k);
                }
            }
        }
    }
    for (uint64_t i = 0; i < oracle->brik.size / BRICK_SIZE; i++) {
        if (!reach->bricks[i]) {
            return oracle_refuse(error, "BRIK: no grid reaches brick %" PRIu64, i);
        }
    }
    return 1;
}

static int check_bricks(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    uint64_t count = oracle->brik.size / BRICK_SIZE;
    if (count != oracle->unique[3]) {
        return oracle_refuse(error, "BRIK: %" PRIu64 " bricks, CNTS says %" PRIu64, count,
                             oracle->unique[3]);
    }
    for (uint64_t i = 0; i < count; i++) {
        const uint8_t *brick = oracle->brik.data + i * BRICK_SIZE;
        uint32_t zeros = 0, ones = 0;
        for (uint32_t k = 0; k < BRICK_SIZE; k++) {
            zeros += brick[k] == 0x00;
            ones += brick[k] == 0xff;
        }
        if (zeros == BRICK_SIZE || ones == BRICK_SIZE) {
            return oracle_refuse(error, "BRIK: brick %" PRIu64 " is all lit or all shadowed", i);
        }
    }
    return 1;
}

int oracle_read_mapped(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    if (!read_sections(oracle, error) || !read_tops(oracle, error)) {
        return 0;
    }
    size_t words = (size_t)(oracle->node.size / 8) + 1;
    uint8_t *starts = calloc(words, 1);
    uint8_t *nodes = calloc(words, 1);
    uint8_t *bricks = calloc((size_t)(oracle->brik.size / BRICK_SIZE) + 1, 1);
    const struct reach reach = {starts, nodes, bricks};
    int good = starts != NULL && nodes != NULL && bricks != NULL;
    if (!good) {
        (void)oracle_refuse(error, "out of memory");
    }
    good = good && read_levels(oracle, starts, error) && check_grid(oracle, &reach, error) &&
           check_nodes(oracle, &reach, error) && check_bricks(oracle, error) &&
           check_columns(oracle, error);
    free(starts);
    free(nodes);
    free(bricks);
    return good;
}

int oracle_mapped_voxel(const struct oracle *oracle, uint32_t frustum, const uint32_t at[3])
{
    const struct oracle_frustum *f = &oracle->frusta[frustum];
    uint32_t g = f->grid_log2, level = f->n - g;
    uint64_t cell = (uint64_t)(at[0] >> level) + ((uint64_t)(at[1] >> level) << g) +
                    ((uint64_t)(at[2] >> level) << (2 * g));
    uint64_t value = oracle_number(oracle->grid.data + 4 * (f->grid_first + cell), 4);
    if (value < 2) {
        return (int)value;
    }
    uint64_t number = value - 2;
    for (; level > 3; level -= 2) {
        uint32_t shift = level - 2;
        uint32_t bit =
            ((at[0] >> shift) & 3) + 4 * ((at[1] >> shift) & 3) + 16 * ((at[2] >> shift) & 3);
        uint64_t mixed = word_at(oracle, number);
        if (((mixed >> bit) & 1) == 0) {
            return (int)((word_at(oracle, number + 1) >> bit) & 1);
        }
        uint64_t before = mixed & (((uint64_t)1 << bit) - 1);
        number = child_at(oracle, number, (uint32_t)__builtin_popcountll(before));
    }
    uint64_t slice = oracle_number(oracle->brik.data + number * BRICK_SIZE + 8 * (at[2] & 7), 8);
    return (int)((slice >> ((at[0] & 7) + 8 * (at[1] & 7))) & 1);
}
