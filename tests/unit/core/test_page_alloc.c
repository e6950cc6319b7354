/* SPDX-License-Identifier: Apache-2.0 */
/* Blocks that grow by moving their pages: their content must stay, and a refusal must change
 * nothing. */
#define _GNU_SOURCE /* mremap */
#include <errno.h>
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/page_alloc.h"

#define BLOCKS 5
#define LARGE  UMB__PAGE_ALLOC_LARGE

#ifdef SYS_mremap
static int memory_is_short;
static unsigned char *stranger; /* what another thread has mapped meanwhile */
static size_t stranger_bytes;

/* Replaces libc's mremap. When told that memory is short it fails as kernels do, after it has
 * unmapped the range to be replaced, and then maps that range again as another thread might. */
void *mremap(void *old, size_t old_bytes, size_t bytes, int flags, ...)
{
    va_list rest;
    va_start(rest, flags);
    void *to = flags & MREMAP_FIXED ? va_arg(rest, void *) : NULL;
    va_end(rest);
    if (!memory_is_short) {
        const long moved = syscall(SYS_mremap, old, old_bytes, bytes, flags, to);
        return moved == -1 ? MAP_FAILED : (void *)(uintptr_t)moved;
    }
    if (to != NULL) {
        (void)munmap(to, bytes);
        stranger = mmap(to, bytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0);
        stranger_bytes = bytes;
    }
    errno = ENOMEM;
    return MAP_FAILED;
}

static void a_block_that_cannot_move_leaves_other_mappings_alone(void **state)
{
    (void)state;
    unsigned char *block = umb__alloc(&umb__page_alloc, LARGE, 1), resident;
    assert_non_null(block);
    memset(block, 7, LARGE);
    memory_is_short = 1;
    assert_null(umb__resize(&umb__page_alloc, block, 3 * LARGE));
    memory_is_short = 0;
    assert_true(stranger != NULL && (void *)stranger != MAP_FAILED);
    assert_int_equal(mincore(stranger, 1, &resident), 0); /* ENOMEM: nothing is mapped there */
    (void)munmap(stranger, stranger_bytes);
    for (size_t i = 0; i < LARGE; i++) {
        assert_int_equal(block[i], 7);
    }
    umb__free(&umb__page_alloc, block);
}
#endif

/* Word i of a block. */
static uint64_t word_of(uint64_t block, size_t i)
{
    return (block + 1) * 0x9e3779b97f4a7c15U ^ i;
}

/* Grows blocks that stand in each other's way, from a few bytes to several mappings and back. */
static void blocks_keep_what_they_hold_while_they_grow_and_shrink(void **state)
{
    (void)state;
    static const size_t sizes[] = {1000,      70000,         LARGE - 8,      LARGE,
                                   LARGE + 8, 3 * LARGE / 2, 15 * LARGE / 8, 6 * LARGE,
                                   2 * LARGE, 5000,          3 * LARGE};
    uint64_t *blocks[BLOCKS] = {0};
    size_t held = 0; /* words of each that are known */
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        const size_t words = sizes[s] / sizeof(uint64_t), kept = held < words ? held : words;
        for (uint64_t b = 0; b < BLOCKS; b++) {
            blocks[b] = umb__resize(&umb__page_alloc, blocks[b], sizes[s]);
            assert_non_null(blocks[b]);
            assert_int_equal((uintptr_t)blocks[b] % 16, 0);
            for (size_t i = 0; i < kept; i++) {
                if (blocks[b][i] != word_of(b, i)) {
                    fail_msg("block %d, size %zu: word %zu is lost", (int)b, sizes[s], i);
                }
            }
            for (size_t i = kept; i < words; i++) {
                blocks[b][i] = word_of(b, i);
            }
        }
        held = words;
    }
    for (int b = 0; b < BLOCKS; b++) {
        umb__free(&umb__page_alloc, blocks[b]);
    }
}

static void large_blocks_begin_where_cache_lines_do(void **state)
{
    (void)state;
    for (size_t bytes = LARGE; bytes < 5 * LARGE; bytes += LARGE / 3) {
        void *block = umb__alloc_large(&umb__page_alloc, bytes, 1);
        assert_non_null(block);
        assert_int_equal((uintptr_t)block % 64, 0);
        umb__free(&umb__page_alloc, block);
    }
}

static void a_refused_size_leaves_the_block_alone(void **state)
{
    (void)state;
    static const size_t refused[] = {SIZE_MAX, SIZE_MAX - 8, SIZE_MAX / 2 + 1, SIZE_MAX / 4};
    for (size_t bytes = 100; bytes <= LARGE; bytes += LARGE - 100) {
        unsigned char *block = umb__alloc(&umb__page_alloc, bytes, 1);
        assert_non_null(block);
        memset(block, 7, bytes);
        for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
            assert_null(umb__resize(&umb__page_alloc, block, refused[i]));
            assert_null(umb__alloc(&umb__page_alloc, refused[i], 1));
        }
        for (size_t i = 0; i < bytes; i++) {
            assert_int_equal(block[i], 7);
        }
        umb__free(&umb__page_alloc, block);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_keep_what_they_hold_while_they_grow_and_shrink),
        cmocka_unit_test(large_blocks_begin_where_cache_lines_do),
        cmocka_unit_test(a_refused_size_leaves_the_block_alone),
#ifdef SYS_mremap
        cmocka_unit_test(a_block_that_cannot_move_leaves_other_mappings_alone),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
