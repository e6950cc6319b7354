/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The zstd decoder of the WebAssembly module against the library: frames of all levels and kinds of
 * content, and frames that were changed. What it accepts, the library accepts with the same bytes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#include "web/module/zstd_frame.h"

#define MOST (400U << 10) /* Bytes of the longest content: four blocks */

static uint64_t next_random(uint64_t *state)
{
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *state >> 33;
}

/* Kinds of content: noise, few letters, one byte, counters, copies from before, long copies. */
enum {
    KINDS = 6
};

static void make_content(unsigned kind, size_t size, uint64_t *state, uint8_t *to)
{
    for (size_t i = 0; i < size; i++) {
        const uint64_t random = next_random(state);
        to[i] = kind == 0   ? (uint8_t)random
                : kind == 1 ? (uint8_t)(random % 1000 < 700 ? 'a' : random % 23)
                : kind == 2 ? 7
                : kind == 3 ? (uint8_t)(i / 4 >> 8 * (i % 4))
                            : (uint8_t)(random % 11 * (random >> 8 & 1));
    }
    const size_t longest = kind == 5 ? 70000 : 40;
    for (size_t at = 64; kind >= 4 && at + longest < size;) {
        const size_t from = next_random(state) % at, length = 3 + next_random(state) % longest;
        for (size_t i = 0; i < length && at + i < size; i++) {
            to[at + i] = to[from + i];
        }
        at += length + next_random(state) % 30;
    }
}

struct frames {
    struct umbx_zstd *zstd;
    ZSTD_CCtx *packer;
    ZSTD_DCtx *judge;
    uint8_t content[MOST], packed[2 * MOST], ours[MOST + 16], theirs[MOST];
};

static int set_up(void **state)
{
    struct frames *f = calloc(1, sizeof *f);
    assert_non_null(f);
    f->zstd = umbx_zstd_make();
    f->packer = ZSTD_createCCtx();
    f->judge = ZSTD_createDCtx();
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    struct frames *f = *state;
    umbx_zstd_free(f->zstd);
    ZSTD_freeCCtx(f->packer);
    ZSTD_freeDCtx(f->judge);
    free(f);
    return 0;
}

static size_t pack(struct frames *f, size_t size, int level, int flags)
{
    (void)ZSTD_CCtx_reset(f->packer, ZSTD_reset_session_and_parameters);
    (void)ZSTD_CCtx_setParameter(f->packer, ZSTD_c_compressionLevel, level);
    (void)ZSTD_CCtx_setParameter(f->packer, ZSTD_c_checksumFlag, flags & 1);
    (void)ZSTD_CCtx_setParameter(f->packer, ZSTD_c_contentSizeFlag, flags >> 1 & 1);
    const size_t length = ZSTD_compress2(f->packer, f->packed, sizeof f->packed, f->content, size);
    assert_false(ZSTD_isError(length));
    return length;
}

static void frames_decode(void **state)
{
    static const size_t sizes[] = {0, 1, 5, 63, 300, 4096, 9000, 131072, 131073, 300000};
    struct frames *f = *state;
    uint64_t random = 20261123;
    for (unsigned kind = 0; kind < KINDS; kind++) {
        for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
            make_content(kind, sizes[s], &random, f->content);
            for (int level = -3; level <= 19; level += level < 5 ? 1 : 7) {
                const size_t length = pack(f, sizes[s], level, (int)next_random(&random));
                size_t got = SIZE_MAX;
                assert_int_equal(umbx_zstd_frame_bytes(f->packed, length), length);
                assert_true(umbx_zstd_decode(f->zstd, f->ours, sizes[s], f->packed, length, &got));
                assert_int_equal(got, sizes[s]);
                assert_memory_equal(f->ours, f->content, got);
                assert_false(sizes[s] > 0 && umbx_zstd_decode(f->zstd, f->ours, sizes[s] - 1,
                                                              f->packed, length, &got));
            }
        }
    }
}

/* Compares both decoders on `length` bytes. Returns whether ours accepts them. */
static bool compare(struct frames *f, size_t length, size_t room)
{
    static const uint8_t guard[16] = {0xa5, 0x5a, 0xa5, 0x5a};
    size_t got = 0;
    memcpy(f->ours + room, guard, sizeof guard);
    const bool accepted = umbx_zstd_decode(f->zstd, f->ours, room, f->packed, length, &got);
    assert_memory_equal(f->ours + room, guard, sizeof guard);
    if (accepted) {
        assert_int_equal(ZSTD_findFrameCompressedSize(f->packed, length), length);
        const size_t theirs = ZSTD_decompressDCtx(f->judge, f->theirs, room, f->packed, length);
        assert_int_equal(theirs, got);
        assert_memory_equal(f->ours, f->theirs, got);
    }
    return accepted;
}

/* Bytes before the literals of the first block are changed often: headers and tables. */
static void changed_frames(void **state)
{
    struct frames *f = *state;
    const char *cases = getenv("UMBRAGE_CASES");
    const unsigned rounds = cases ? (unsigned)strtoul(cases, NULL, 10) : 3000;
    uint64_t random = 7;
    unsigned accepted = 0;
    for (unsigned round = 0; round < rounds; round++) {
        const size_t size = 1 + next_random(&random) % 6000;
        make_content(round % KINDS, size, &random, f->content);
        const size_t length = pack(f, size, (int)(round % 9) - 2, (int)next_random(&random));
        for (unsigned change = 0; change < 8; change++) {
            const size_t within = next_random(&random) % 2 && length > 40 ? 40 : length;
            const size_t at = next_random(&random) % within;
            const uint8_t kept = f->packed[at];
            f->packed[at] ^= (uint8_t)(1U << next_random(&random) % 8);
            accepted += compare(f, length, size + 200);
            f->packed[at] = kept;
        }
        assert_false(compare(f, next_random(&random) % length, size + 200));
    }
    assert_true(accepted > 0);
}

/* A compressor may use what the library's never does; noise behind a good header reaches it. */
static void noise(void **state)
{
    struct frames *f = *state;
    uint64_t random = 99;
    for (unsigned round = 0; round < 20000; round++) {
        const size_t length = 12 + next_random(&random) % 80;
        static const uint8_t header[] = {0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x48};
        make_content(0, length, &random, f->packed);
        memcpy(f->packed, header, sizeof header);
        const uint32_t block = 1 | 2 << 1 | (uint32_t)(length - 9) << 3;
        f->packed[6] = (uint8_t)block;
        f->packed[7] = (uint8_t)(block >> 8);
        f->packed[8] = (uint8_t)(block >> 16);
        (void)compare(f, length, 70000);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frames_decode),
        cmocka_unit_test(changed_frames),
        cmocka_unit_test(noise),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
