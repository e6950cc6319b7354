/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One node that very many nodes of other pages claim as their child: its page comes and goes at a
 * cost that its claims bound, and answers are right before and after.
 */
#include "partial_fixture.h"

#include "partial_oracle.h"

enum {
    LOG2_SIZE = 12,
    LEVEL = 5, /* Level of the nodes that claim the one node below them */
    POINTS = 2000,
};

#define SIDE_M 100.0

/* A level of `count` nodes, of which each has `mixed` mixed children: its own ones, or node 0. */
static void make_level(struct umb__octree_level *level, uint32_t count, uint32_t mixed, bool own,
                       uint64_t *seed)
{
    level->count = count;
    level->masks = calloc(count, sizeof *level->masks);
    level->first = calloc((size_t)count + 1, sizeof *level->first);
    level->children = calloc((size_t)count * mixed, sizeof *level->children);
    for (uint32_t i = 0; i < count; i++) {
        unsigned mask = (unsigned)next_random(seed) & 0x5555U;
        for (uint32_t c = 0; c < mixed; c++) {
            mask = (mask & ~(3U << (2 * c))) | 2U << (2 * c);
            level->children[i * mixed + c] = own ? i * mixed + c : 0;
        }
        level->masks[i] = (uint16_t)mask;
        level->first[i + 1] = (i + 1) * mixed;
    }
}

/* Parents: 8^6 nodes of level 6 with so many mixed children each. */
static struct bytes claimed_asset(uint32_t per_node)
{
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {.log2_size = LOG2_SIZE, .frustum_count = 1};
    struct umb__octree octree = {.root_count = 1, .brick_count = 1};
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    uint64_t seed = 7;
    uint32_t count = 1;
    octree.roots = calloc(1, sizeof *octree.roots);
    octree.roots[0] = (struct umb__octree_root){UMB__NODE_MIXED, LOG2_SIZE, 0};
    octree.bricks = calloc(1, sizeof *octree.bricks);
    octree.bricks[0][0] = 1;
    for (uint32_t l = LOG2_SIZE; l > LEVEL; l--) {
        const uint32_t mixed = l == LEVEL + 1 ? per_node : 8;
        make_level(&octree.level[l], count, mixed, true, &seed);
        count *= mixed;
    }
    make_level(&octree.level[LEVEL], count, 1, false, &seed);
    make_level(&octree.level[LEVEL - 1], 1, 1, true, &seed);
    make_content(&voxels, SIDE_M / (1U << LOG2_SIZE), origin, &content);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
};
    if (umb__pack_run(&job, id, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__octree_finish(&octree);
    return file;
}

static void expect_answers_of_the_oracle(struct umb_partial *partial)
{
    static double positions[3 * POINTS];
    static float got[4][POINTS], wanted[4][POINTS];
    struct oracle oracle = {.part = partial};
    const struct umb_query_settings settings = {.taps = 1};
    const struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F64, .count = POINTS};
    struct umb_partial_answers ours = {got[0], got[1], got[2], got[3], 0, 0, {0}, {0}};
    struct umb_partial_answers theirs = {wanted[0], wanted[1], wanted[2], wanted[3],
                                         0,         0,         {0},       {0}};
    uint64_t seed = 11;
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        positions[i] = random_unit(&seed) * SIDE_M;
    }
    assert_int_equal(oracle_build(&oracle, NULL), UMB_OK);
    assert_int_equal(umb_partial_query(partial, &settings, &points, 0, &ours, NULL), UMB_OK);
    assert_int_equal(oracle_query(&oracle, &settings, &points, 0, &theirs, NULL), UMB_OK);
    for (unsigned i = 0; i < 4; i++) {
        assert_memory_equal(got[i], wanted[i], sizeof got[i]);
    }
    oracle_finish(&oracle);
}

/* Returns the number of wide nodes that watch a page. */
static uint64_t watchers_of(const struct umb_partial *p, uint32_t page)
{
    uint64_t count = 0;
    for (uint32_t at = p->pages[page].watchers; at > 0; at = p->watches[at - 1].next) {
        count++;
    }
    return count;
}

static void a_node_that_a_million_nodes_claim_comes_and_goes(void **state)
{
    (void)state;
    const uint32_t per_node = (uint32_t)short_count(4, 1), parents = per_node << 18;
    const struct umb_partial_view view = {.light = UINT32_MAX};
    struct partial_fixture f = {.file = claimed_asset(per_node)};
    struct umb_partial_stats stats;
    uint32_t claimed = 0;
    f.partial = partial_open(&f.file, (uint64_t)1 << 32);
    umb_partial_get_stats(f.partial, &stats);
    assert_true(stats.page_count > 100);
    for (uint32_t page = stats.page_count; page-- > 0;) {
        partial_add(&f, page);
    }
    partial_build(&f);
    for (uint32_t page = 0; page < stats.page_count; page++) {
        claimed = watchers_of(f.partial, page) > watchers_of(f.partial, claimed) ? page : claimed;
    }
    /* But for those of its own page, each parent watches the page, once. */
    assert_true(watchers_of(f.partial, claimed) > parents - parents / 64);
    assert_true(watchers_of(f.partial, claimed) <= parents);
    umb_partial_drop(f.partial, claimed);
    partial_build(&f);
    expect_answers_of_the_oracle(f.partial);
    assert_int_equal(umb_partial_want(f.partial, &view, 0, NULL), UMB_OK);
    assert_true(f.partial->want_steps <= 1024 + 17 * f.partial->node_count);
    uint32_t list[2];
    assert_int_equal(umb_partial_missing(f.partial, list, 2, 0), 1);
    assert_int_equal(list[0], claimed);
    partial_add(&f, claimed);
    partial_build(&f);
    expect_answers_of_the_oracle(f.partial);
    umb_partial_close(f.partial);
    bytes_finish(&f.file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_node_that_a_million_nodes_claim_comes_and_goes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
