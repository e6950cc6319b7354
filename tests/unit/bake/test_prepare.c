/* SPDX-License-Identifier: Apache-2.0 */
/* Triangles prepared several at a time: the numbers must be those of the plain way, bit by bit. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "bake/depth/coverage.h"
#include "bake/depth/depth_kernels.h"

#define SIZE 64

static uint64_t random_state;

/* splitmix64 */
static uint64_t random_bits(void)
{
    uint64_t z = (random_state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

static void seed(uint64_t value)
{
    random_state = value;
    print_message("seed %llu\n", (unsigned long long)value);
}

/* A coordinate in and around the column, often exactly on a texel centre or border. */
static double random_coordinate(void)
{
    const double value = (double)(random_bits() >> 11) * 0x1p-53 * (SIZE + 20) - 10.0;
    const uint64_t kind = random_bits() % 4;
    return kind == 0 ? floor(value) + 0.5 : kind == 1 ? floor(value) : value;
}

/* The triangles include slivers with huge gradients, or gradients that are not finite. */
static void random_triangle(double v[3][3])
{
    for (int i = 0; i < 9; i++) {
        v[i / 3][i % 3] = random_coordinate();
    }
    if (random_bits() % 3 == 0) {
        memcpy(v[1], v[0], sizeof v[1]);
        v[1][1] = nextafter(v[1][1], 100.0);
        v[1][2] = random_coordinate();
    }
}

/* Ordinary triangles, slivers, ties between corners and triangles without rows, in batches of every
 * length. All fields of a coverage with rows are compared. */
static void the_bits_of_the_plain_way_come_from(umbb_prepare_fn quick)
{
    seed(8);
    static double v[64][3][3];
    static struct umbb_coverage coverages[2][UMBB_DRAW_MAX];
    uint32_t triangles[UMBB_DRAW_MAX];
    size_t with_rows = 0, without = 0;
    for (int round = 0; round < 20000; round++) {
        const size_t count = 1 + (size_t)round % UMBB_DRAW_MAX;
        for (size_t i = 0; i < count; i++) {
            double one[3][3];
            triangles[i] = (uint32_t)(random_bits() % 64);
            random_triangle(one);
            if (random_bits() % 4 == 0) { /* a tie, or a wall across the rows */
                const size_t from = random_bits() % 3, axes = random_bits() % 3 + 1;
                memcpy(one[random_bits() % 3], one[from], axes * sizeof one[0][0]);
            }
            if (random_bits() % 8 == 0) {
                one[0][0] = one[1][0] = one[2][0] = (double)(random_bits() % 3) - 1.0;
            }
            memcpy(v[triangles[i]], one, sizeof v[0]);
        }
        umbb_prepare_plain((const double(*)[3][3])v, triangles, count, SIZE, coverages[0]);
        quick((const double(*)[3][3])v, triangles, count, SIZE, coverages[1]);
        for (size_t i = 0; i < count; i++) {
            const int has_rows = coverages[0][i].row_first <= coverages[0][i].row_last;
            assert_int_equal(coverages[1][i].row_first <= coverages[1][i].row_last, has_rows);
            with_rows += (size_t)has_rows;
            without += (size_t)!has_rows;
            if (has_rows) {
                assert_memory_equal(&coverages[1][i], &coverages[0][i], sizeof coverages[0][i]);
            }
        }
    }
    assert_true(with_rows > 10000 && without > 10000); /* else nothing was tested */
}

static void preparing_with_avx2_gives_the_bits_of_the_plain_way(void **state)
{
    (void)state;
    const struct umbb_depth_kernels *kernels = umbb_depth_kernels(UMBB_VECTORS_AVX2);
    if (kernels == NULL) {
        print_message("skipped: no AVX2 on this processor\n");
        skip();
    }
    the_bits_of_the_plain_way_come_from(kernels->prepare);
}

static void preparing_with_avx512_gives_the_bits_of_the_plain_way(void **state)
{
    (void)state;
    const struct umbb_depth_kernels *kernels = umbb_depth_kernels(UMBB_VECTORS_AVX512);
    if (kernels == NULL) {
        print_message("skipped: no AVX-512 on this processor\n");
        skip();
    }
    the_bits_of_the_plain_way_come_from(kernels->prepare);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(preparing_with_avx2_gives_the_bits_of_the_plain_way),
        cmocka_unit_test(preparing_with_avx512_gives_the_bits_of_the_plain_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
