/* SPDX-License-Identifier: Apache-2.0 */
/* Pages made by several helpers, given up, and hashed together. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "make_asset.h"

static const double origin[3] = {84616.5, 447423.25, -3};

/* Every column ends anywhere, so that hardly two bricks are equal. */
static int noisy(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    const uint64_t column = (uint64_t)frustum << 32 | x << 16 | y;
    (void)user;
    return z < (column * 0x9e3779b97f4a7c15ULL ^ 0x5bf03635) * 0xbf58476d1ce4e5b9ULL >> 56;
}

static void run_backwards(void *user, void (*job)(void *, uint32_t, unsigned), void *job_user,
                          uint32_t jobs)
{
    *(uint32_t *)user = jobs;
    while (jobs-- > 0) {
        job(job_user, jobs, jobs % 3);
    }
}

static void helpers_in_any_order_write_the_same_bytes(void **state)
{
    /* More pages than one job makes. */
    static const struct voxels larger = {noisy, NULL, 8, 2};
    struct bytes whole = make_packed(&larger, 0.5, origin), again = {0};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_sink sink = bytes_sink(&again);
    uint32_t jobs = 0;
    const struct umb_workers workers = {3, run_backwards, &jobs};
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .workers = &workers};
    uint8_t id[UMB_ID_BYTES];
    (void)state;
    make_octree(&larger, &octree);
    make_content(&larger, 0.5, origin, &content);
    assert_int_equal(umb__pack_run(&job, id, NULL), UMB_OK);
    assert_true(jobs > 1);
    assert_int_equal(again.size, whole.size);
    assert_memory_equal(again.data, whole.data, whole.size);
    umb__octree_finish(&octree);
    bytes_finish(&again);
    bytes_finish(&whole);
}

static int asked; /* how often it was asked whether to go on */

static int cancelled_at_the_second_time(void)
{
    return ++asked >= 2;
}

static void a_cancelled_packing_ends_between_pages_and_writes_nothing(void **state)
{
    static const struct voxels larger = {noisy, NULL, 8, 2};
    struct umb__octree octree;
    struct umb__content content;
    uint32_t jobs = 0;
    const struct umb_workers workers = {3, run_backwards, &jobs};
    (void)state;
    make_octree(&larger, &octree);
    make_content(&larger, 0.5, origin, &content);
    for (int helped = 0; helped < 2; helped++) {
        struct bytes out = {0};
        struct umb_sink sink = bytes_sink(&out);
        struct umb_error error = {0};
        uint8_t id[UMB_ID_BYTES];
        const struct umb__pack_job job = {.content = &content,
                                          .octree = &octree,
                                          .sha256 = &test_digest,
                                          .sink = &sink,
                                          .workers = helped ? &workers : NULL,
                                          .cancelled = cancelled_at_the_second_time};
        asked = 0;
        assert_int_equal(umb__pack_run(&job, id, &error), UMB_E_CANCELLED);
        assert_int_equal(error.status, UMB_E_CANCELLED);
        assert_true(asked >= 2);
        assert_int_equal(out.size, 0);
        bytes_finish(&out);
    }
    umb__octree_finish(&octree);
}

/* Digests of several messages at once: how many calls, and which digest fails. */
struct many {
    size_t calls, digests;
    size_t failing; /* number of the digest that cannot be made */
};

static void digest_backwards(void *user, const uint8_t *const *messages, const size_t *sizes,
                             size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    struct many *many = user;
    many->calls++;
    for (size_t i = count; i-- > 0; many->digests++) {
        const void *part = messages[i];
        test_digest.digest(NULL, &part, &sizes[i], 1, digests[i]);
        if (many->digests == many->failing) {
            memset(digests[i], 0, UMB_ID_BYTES);
        }
    }
}

static void single_digest(void *user, const void *const *parts, const size_t *sizes,
                          size_t part_count, uint8_t out[UMB_ID_BYTES])
{
    (void)user;
    test_digest.digest(NULL, parts, sizes, part_count, out);
}

static void pages_hashed_together_are_those_hashed_one_by_one(void **state)
{
    static const struct voxels larger = {noisy, NULL, 8, 2}; /* more pages than go together */
    struct bytes file = make_packed(&larger, 0.5, origin), again = {0}, spoiled = {0};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_sink sink = bytes_sink(&again), spoiled_sink = bytes_sink(&spoiled);
    uint8_t id[UMB_ID_BYTES];
    struct many many = {.failing = SIZE_MAX};
    const struct umb_sha256 hasher = {single_digest, &many, digest_backwards};
    (void)state;
    make_octree(&larger, &octree);
    make_content(&larger, 0.5, origin, &content);
    assert_int_equal(umb__pack_write(&content, &octree, &hasher, &sink, id, NULL), UMB_OK);
    assert_int_equal(again.size, file.size);
    assert_memory_equal(again.data, file.data, file.size);
    const size_t pages = many.digests;
    assert_true(many.calls > 1 && pages > 16 * (many.calls - 1)); /* all but the last were full */

    many = (struct many){.failing = SIZE_MAX};
    assert_int_equal(umb_packed_prove(file.data, file.size, NULL, &hasher, NULL), UMB_OK);
    assert_int_equal(many.digests, pages);
    for (size_t failing = 0; failing < pages; failing += 1 + pages / 3) {
        many = (struct many){.failing = failing};
        assert_int_equal(umb_packed_prove(file.data, file.size, NULL, &hasher, NULL),
                         UMB_E_NO_MEMORY);
        many = (struct many){.failing = failing};
        spoiled.size = 0;
        assert_int_equal(umb__pack_write(&content, &octree, &hasher, &spoiled_sink, id, NULL),
                         UMB_E_NO_MEMORY);
    }
    umb__octree_finish(&octree);
    bytes_finish(&spoiled);
    bytes_finish(&again);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(helpers_in_any_order_write_the_same_bytes),
        cmocka_unit_test(a_cancelled_packing_ends_between_pages_and_writes_nothing),
        cmocka_unit_test(pages_hashed_together_are_those_hashed_one_by_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
