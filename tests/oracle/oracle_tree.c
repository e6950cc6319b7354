/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader checks what section 1 of docs/reference/umb-format.md promises of written
 * trees: no node is uniform, each node is reached from a root, and a level has as many different
 * nodes as CNTS states (pages of the lowest band hold copies). Levels are checked from the bottom
 * up. Once all references to equal children name the first of them, equal nodes have equal bytes.
 */
#include "oracle_parts.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* A node or brick, and its number. */
struct record {
    const void *bytes;
    size_t size;
    uint32_t number;
};

static int compare_records(const void *a, const void *b)
{
    const struct record *x = a, *y = b;
    int order = memcmp(x->bytes, y->bytes, x->size);
    return order != 0 ? order : (x->number > y->number) - (x->number < y->number);
}

/* Finds equal records of a level. Out: first: for each record the number of the first record that
 * equals it. Returns the number of different records; -1 if memory is short. */
static int64_t find_equal(const struct oracle *oracle, uint32_t l, uint32_t *first)
{
    const uint64_t count = oracle->counts[l];
    struct record *records = calloc((size_t)count + 1, sizeof *records);
    int64_t different = 0;
    if (records == NULL) {
        return -1;
    }
    for (uint64_t i = 0; i < count; i++) {
        records[i].number = (uint32_t)i;
        records[i].size = l == 3 ? sizeof(struct oracle_brick) : sizeof(struct oracle_node);
        records[i].bytes =
            l == 3 ? (const void *)&oracle->bricks[i] : (const void *)&oracle->nodes[l][i];
    }
    qsort(records, (size_t)count, sizeof *records, compare_records);
    for (uint64_t i = 0; i < count; i++) {
        int equal = i > 0 && memcmp(records[i].bytes, records[i - 1].bytes, records[i].size) == 0;
        first[records[i].number] = equal ? first[records[i - 1].number] : records[i].number;
        different += !equal;
    }
    free(records);
    return different;
}

/* Makes a level's references lead to the first of equal children. */
static void lead_to_first(struct oracle *oracle, uint32_t l, const uint32_t *below)
{
    for (uint64_t i = 0; i < oracle->counts[l]; i++) {
        struct oracle_node *node = &oracle->nodes[l][i];
        for (uint32_t c = 0; c < 8; c++) {
            if (((node->mask >> (2 * c)) & 3) == 2) {
                node->child[c] = below[node->child[c]];
            }
        }
    }
}

/* Afterwards equal subtrees have one number. */
static int check_counts(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    uint32_t *below = NULL;
    int good = 1;
    for (uint32_t l = 3; good && l < ORACLE_LEVELS; l++) {
        uint32_t *first = calloc((size_t)oracle->counts[l] + 1, sizeof *first);
        if (first == NULL) {
            good = oracle_refuse(error, "out of memory");
            break;
        }
        if (l > 3) {
            lead_to_first(oracle, l, below);
        }
        int64_t different = find_equal(oracle, l, first);
        if (different < 0 || (uint64_t)different != oracle->unique[l]) {
            good = oracle_refuse(
                error, "CNTS: %" PRIu64 " nodes of level %" PRIu32 ", the pages have %" PRId64,
                oracle->unique[l], l, different);
        }
        free(below);
        below = first;
    }
    free(below);
    return good;
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
    return check_uniform(oracle, error) && check_reached(oracle, error) &&
           check_counts(oracle, error);
}
