/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: what section 1 of docs/umb-format.md promises of written trees. No two equal
 * nodes in a level, none that is uniform, none that no root reaches, and as many as CNTS states.
 * Levels are taken from the bottom, so that equal children have equal numbers already.
 */
#include "oracle_parts.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static int compare_bricks(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(struct oracle_brick));
}

static int compare_nodes(const void *a, const void *b)
{
    const struct oracle_node *x = a, *y = b;
    if (x->mask != y->mask) {
        return x->mask < y->mask ? -1 : 1;
    }
    return memcmp(x->child, y->child, sizeof x->child);
}

/* 1 if no two of the elements are equal; sorts a copy. -1 if there is no memory. */
static int all_differ(const void *elements, uint64_t count, size_t size,
                      int (*compare)(const void *, const void *))
{
    if (count < 2) {
        return 1;
    }
    uint8_t *copy = calloc((size_t)count, size);
    if (copy == NULL) {
        return -1;
    }
    memcpy(copy, elements, (size_t)count * size);
    qsort(copy, (size_t)count, size, compare);
    int differ = 1;
    for (uint64_t i = 1; differ && i < count; i++) {
        differ = compare(copy + (size_t)(i - 1) * size, copy + (size_t)i * size) != 0;
    }
    free(copy);
    return differ;
}

static int check_uniform(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    for (uint64_t i = 0; i < oracle->counts[3]; i++) {
        uint64_t any = 0, all = UINT64_MAX;
        for (int z = 0; z < 8; z++) {
            any |= oracle->bricks[i].slice[z];
            all &= oracle->bricks[i].slice[z];
        }
        if (any == 0 || all == UINT64_MAX) {
            return oracle_refuse(error, "brick %" PRIu64 ": all lit or all shadowed", i);
        }
    }
    for (uint32_t l = 4; l < ORACLE_LEVELS; l++) {
        for (uint64_t i = 0; i < oracle->counts[l]; i++) {
            uint16_t mask = oracle->nodes[l][i].mask;
            if (mask == 0 || mask == 0x5555) {
                return oracle_refuse(
                    error, "level %" PRIu32 ": node %" PRIu64 " is all lit or all shadowed", l, i);
            }
        }
    }
    return 1;
}

static void mark_children(const struct oracle *oracle, uint32_t l, const uint8_t *reached,
                          uint8_t *below)
{
    for (uint64_t i = 0; i < oracle->counts[l]; i++) {
        for (uint32_t c = 0; reached[i] && c < 8; c++) {
            if (((oracle->nodes[l][i].mask >> (2 * c)) & 3) == 2) {
                below[oracle->nodes[l][i].child[c]] = 1;
            }
        }
    }
}

static int check_reached(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    uint8_t *reached[ORACLE_LEVELS + 1] = {NULL};
    int good = 1;
    for (uint32_t l = 3; l < ORACLE_LEVELS; l++) {
        reached[l] = calloc((size_t)oracle->counts[l] + 1, 1);
        good = good && (reached[l] != NULL || oracle_refuse(error, "out of memory"));
    }
    for (uint32_t i = 0; good && i < oracle->frustum_count; i++) {
        if (oracle->frusta[i].root_state == 2) {
            reached[oracle->frusta[i].n][oracle->frusta[i].root] = 1;
        }
    }
    for (uint32_t l = ORACLE_LEVELS - 1; good && l >= 3; l--) {
        for (uint64_t i = 0; good && i < oracle->counts[l]; i++) {
            good = reached[l][i] || oracle_refuse(error,
                                                  "level %" PRIu32 ": no root reaches node "
                                                  "%" PRIu64,
                                                  l, i);
        }
        if (good && l > 3) {
            mark_children(oracle, l, reached[l], reached[l - 1]);
        }
    }
    for (uint32_t l = 3; l < ORACLE_LEVELS; l++) {
        free(reached[l]);
    }
    return good;
}

int oracle_check_tree(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t l = 3; l < ORACLE_LEVELS; l++) {
        if (oracle->counts[l] != oracle->unique[l]) {
            return oracle_refuse(
                error, "CNTS: %" PRIu64 " nodes of level %" PRIu32 ", the pages have %" PRIu64,
                oracle->unique[l], l, oracle->counts[l]);
        }
        int differ = l == 3 ? all_differ(oracle->bricks, oracle->counts[3], sizeof *oracle->bricks,
                                         compare_bricks)
                            : all_differ(oracle->nodes[l], oracle->counts[l],
                                         sizeof *oracle->nodes[l], compare_nodes);
        if (differ != 1) {
            return oracle_refuse(
                error, differ < 0 ? "out of memory" : "level %" PRIu32 ": two equal nodes", l);
        }
    }
    return check_uniform(oracle, error) && check_reached(oracle, error);
}
