/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The cuts of a packed file against docs/reference/umb-format.md, section 5, followed word by word:
 * pieces are walked as they are, with a mark for each node.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "format/node_pool.h"
#include "format/pack_cut.h"
#include "make_asset.h"

#define LEVELS 14U
#define SMALL  256U

/* The cuts under construction. */
struct slow {
    const struct umb__octree *octree;
    const struct umb__pack_survey *survey; /* for the reached nodes */
    uint32_t page;                         /* Most estimated bytes of a page */
    uint32_t *parts[LEVELS];               /* [node] */
    uint8_t *coarse[LEVELS];               /* [node] */
    uint32_t *bound[LEVELS];               /* [node] Bound of a piece's bytes */
    uint32_t *mark[LEVELS];                /* [node] Walk that met the node last */
    uint32_t walk;
    uint64_t bytes;
};

static void *room(size_t count, size_t size)
{
    void *block = calloc(count + 1, size);
    assert_non_null(block);
    return block;
}

static uint32_t count_of(const struct umb__octree *octree, uint32_t level)
{
    return level == 3 ? octree->brick_count : octree->level[level].count;
}

static uint32_t own_bytes(const struct slow *s, uint32_t level, uint32_t node)
{
    uint32_t bytes = 4;
    if (level > 3) {
        const struct umb__octree_level *nodes = &s->octree->level[level];
        return 2 + nodes->first[node + 1] - nodes->first[node];
    }
    for (int z = 1; z < 8; z++) {
        bytes += s->octree->bricks[node][z] != s->octree->bricks[node][z - 1] ? 3 : 0;
    }
    return bytes;
}

/* Bytes that a piece adds to the walk's page. */
static uint32_t slow_add(struct slow *s, uint32_t level, uint32_t node)
{
    if (s->mark[level][node] == s->walk) {
        return 0;
    }
    s->mark[level][node] = s->walk;
    uint32_t bytes = own_bytes(s, level, node);
    const struct umb__octree_level *nodes = &s->octree->level[level];
    for (uint32_t i = 0; level > 3 && i < nodes->first[node + 1] - nodes->first[node]; i++) {
        bytes += s->parts[level][node] >> 4 * i & 15
                     ? 2
                     : slow_add(s, level - 1, nodes->children[nodes->first[node] + i]);
    }
    return bytes;
}

/* Puts the children of one kind into pages. Returns the bytes of the last page. */
static uint32_t slow_pages(struct slow *s, uint32_t level, uint32_t node, int coarse,
                           uint32_t *pages, uint32_t *parts)
{
    const struct umb__octree_level *nodes = &s->octree->level[level];
    uint32_t open = 0;
    for (uint32_t i = 0; i < nodes->first[node + 1] - nodes->first[node]; i++) {
        const uint32_t child = nodes->children[nodes->first[node] + i];
        if (s->coarse[level - 1][child] != coarse) {
            continue;
        }
        uint32_t more = open > 0 ? slow_add(s, level - 1, child) : 0;
        if (open == 0 || open + more > s->page) {
            s->walk++;
            s->bytes += open;
            ++*pages;
            open = 0;
            more = slow_add(s, level - 1, child);
        }
        open += more;
        *parts |= *pages << 4 * i;
    }
    s->bytes += open;
    return open;
}

static void slow_node(struct slow *s, uint32_t level, uint32_t node)
{
    const struct umb__octree_level *nodes = &s->octree->level[level];
    const uint32_t own = own_bytes(s, level, node), count = own - 2;
    uint32_t whole = 0, coarse = 0, coarse_count = 0, pages = 0, parts = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t child = nodes->children[nodes->first[node] + i];
        *(s->coarse[level - 1][child] ? &coarse : &whole) += s->bound[level - 1][child];
        coarse_count += s->coarse[level - 1][child];
    }
    uint32_t bound = own + whole + coarse;
    if (coarse_count == 0 && level >= 5 && own + whole > s->page) {
        const uint64_t before = s->bytes;
        const uint32_t open = slow_pages(s, level, node, 0, &pages, &parts);
        bound = own + 2 * count;
        if (pages == 1 && own + open <= s->page) { /* shared nodes count once: it is whole */
            pages = parts = 0;
            s->bytes = before;
            bound = own + open;
        }
    } else if (coarse_count > 0) {
        if (whole > SMALL) {
            (void)slow_pages(s, level, node, 0, &pages, &parts);
            bound = own + 2 * count + coarse;
        }
        if (bound > s->page) {
            (void)slow_pages(s, level, node, 1, &pages, &parts);
            bound = own + 2 * count + (whole > SMALL ? 0 : whole);
        }
    }
    s->parts[level][node] = parts;
    s->coarse[level][node] = coarse_count > 0 || pages > 0;
    s->bound[level][node] = bound;
}

/* Cuts an octree of one root, of level 13. Returns the estimated bytes of all pages. */
static uint64_t slow_cut(struct slow *s, uint32_t page)
{
    s->page = page;
    s->bytes = 0;
    for (uint32_t i = 0; i < s->octree->brick_count; i++) {
        s->bound[3][i] = own_bytes(s, 3, i);
    }
    for (uint32_t level = 4; level < LEVELS; level++) {
        for (uint32_t i = 0; i < s->octree->level[level].count; i++) {
            s->parts[level][i] = 0;
        }
        for (uint32_t i = 0; i < s->octree->level[level].count; i++) {
            if (umb__pack_reached(s->survey, level, i)) {
                slow_node(s, level, i);
            }
        }
    }
    s->walk++;
    s->bytes += slow_add(s, 13, s->octree->roots[0].index);
    return s->bytes;
}

/* A tree of random nodes. In: near: children lie where their parent does in its level, and so are
 * shared by neighbours; else anywhere. Of 20000 trees a sample is asked: all of them are reached.
 */
static void random_octree(uint64_t seed, uint32_t trees, int near, struct umb__octree *octree)
{
    uint32_t counts[LEVELS] = {0, 0, 0, trees, trees, trees, trees, trees};
    uint32_t refs[2][1 << 17], level = 13, root = 0;
    struct umb__pool pool;
    umb__pool_init(&pool, NULL, SIZE_MAX);
    for (uint32_t l = 8; l < LEVELS; l++) {
        counts[l] = counts[l - 1] / 6 + 1;
    }
    for (uint32_t l = 3; l < LEVELS; l++) {
        for (uint32_t i = 0; i < counts[l]; i++) {
            uint64_t slices[8] = {1, i};
            uint32_t children[8];
            for (uint32_t c = 0; c < 8 && l > 3; c++) {
                const uint64_t any = next_random(&seed) >> 20;
                const uint64_t at = near && (l <= 7 || trees < 20000)
                                        ? (uint64_t)i * counts[l - 1] / counts[l] + any % 16
                                        : (l > 7 ? 6ULL * i + c : any);
                children[c] =
                    any % 7 > (l > 7 ? 6 : 3) ? UMB__REF_LIT : refs[l & 1][at % counts[l - 1]];
            }
            children[0] = l > 3 && i % 2 ? UMB__REF_SHADOWED : children[0];
            slices[7] = next_random(&seed) % 3;
            const enum umb_status status = l == 3 ? umb__pool_brick(&pool, slices, &root, NULL)
                                                  : umb__pool_node(&pool, l, children, &root, NULL);
            assert_int_equal(status, UMB_OK);
            refs[(l + 1) & 1][i] = root;
        }
    }
    assert_int_equal(umb__pool_take(&pool, &root, &level, 1, octree, NULL), UMB_OK);
    assert_int_equal(octree->roots[0].state, UMB__NODE_MIXED);
}

/* Helpers of which each does every third job, the last one first. */
static void run_backwards(void *user, void (*job)(void *, uint32_t, unsigned), void *job_user,
                          uint32_t jobs)
{
    (void)user;
    while (jobs-- > 0) {
        job(job_user, jobs, jobs % 3);
    }
}

static uint64_t once_bytes(const struct slow *s)
{
    uint64_t bytes = 0;
    for (uint32_t level = 3; level < LEVELS; level++) {
        for (uint32_t i = 0; i < count_of(s->octree, level); i++) {
            bytes += umb__pack_reached(s->survey, level, i) ? own_bytes(s, level, i) : 0;
        }
    }
    return bytes;
}

/* Returns the number of cut nodes; shared: counts the octrees with larger pages. */
static uint32_t compare_cuts(const struct umb__octree *octree, const struct umb_workers *workers,
                             int *shared)
{
    struct umb__pack_survey survey;
    struct slow s = {.octree = octree, .survey = &survey};
    struct umb__pack_cuts cuts;
    uint32_t cut = 0;
    for (uint32_t level = 3; level < LEVELS; level++) {
        const size_t count = count_of(octree, level);
        s.parts[level] = room(count, sizeof(uint32_t));
        s.coarse[level] = room(count, 1);
        s.bound[level] = room(count, sizeof(uint32_t));
        s.mark[level] = room(count, sizeof(uint32_t));
    }
    assert_int_equal(umb__pack_survey(octree, &survey, NULL), UMB_OK);
    uint64_t bytes = slow_cut(&s, 7168);
    if (bytes > 2 * once_bytes(&s)) {
        bytes = slow_cut(&s, 98304);
        ++*shared;
    }
    assert_int_equal(umb__pack_cut(octree, &survey, workers, 0, NULL, &cuts, NULL), UMB_OK);
    assert_int_equal(cuts.page_bytes, s.page);
    for (uint32_t level = 4; level < LEVELS; level++) {
        for (uint32_t i = 0; i < octree->level[level].count; i++) {
            assert_int_equal(umb__pack_parts(&cuts, level, i), s.parts[level][i]);
            cut += s.parts[level][i] != 0;
        }
    }
    assert_int_equal(cuts.top_count, 1);
    assert_int_equal(cuts.tops[0].part, 1);
    const double copies = (double)bytes / (double)once_bytes(&s);
    assert_true(cuts.copies == (copies > 1 ? copies : 1));
    umb__pack_cuts_finish(&cuts);
    umb__pack_survey_finish(&survey);
    for (uint32_t level = 3; level < LEVELS; level++) {
        free(s.parts[level]);
        free(s.coarse[level]);
        free(s.bound[level]);
        free(s.mark[level]);
    }
    return cut;
}

static void cuts_are_those_of_the_format_page(void **state)
{
    static const uint32_t trees[] = {50, 3000, 15000, 20000};
    const struct umb_workers three = {3, run_backwards, NULL};
    int shared = 0;
    uint32_t cut = 0;
    (void)state;
    for (uint64_t seed = 1; seed <= 8; seed++) {
        struct umb__octree octree;
        random_octree(seed, trees[seed / 2 % 4], seed % 2, &octree);
        cut += compare_cuts(&octree, seed % 4 < 2 ? &three : NULL, &shared);
        umb__octree_finish(&octree);
    }
    print_message("%u cut nodes, %d octrees of 8 have larger pages\n", cut, shared);
    assert_true(cut > 1000 && shared > 0 && shared < 8);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cuts_are_those_of_the_format_page),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
