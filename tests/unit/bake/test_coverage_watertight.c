/* SPDX-License-Identifier: Apache-2.0 */
/*
 * No light may pass through shared edges and corners. The test makes sheets of triangles whose
 * corners lie on texel centres, so that edges run through centres too. A centre on an edge belongs
 * to both of its triangles: where more than one triangle covers a centre, the light's column
 * through it meets an edge or a corner. A sheet whose border runs around a square must cover every
 * centre in the square, folded or not; an uncovered centre would be a ray of light.
 * UMBRAGE_CASES=1000000 tries some 1.6 10^8 of such columns.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "bake/depth/coverage.h"
#include "make_asset.h"

enum {
    SIZE = 64,
    CELLS = 8,
    PITCH = 7, /* texels a cell */
    SIDE = CELLS * PITCH,
    FIRST = 3 /* the sheet's border runs through the centres of texels FIRST and FIRST + SIDE */
};

typedef double sheet[CELLS + 1][CELLS + 1][3];

/* Puts corners on centres; some are a unit in the last place beside one, some anywhere in their
 * cell. */
static double jitter(uint64_t *seed, double place)
{
    switch (next_random(seed) % 8) {
    case 0:
        return place + 3.0 * (random_unit(seed) - 0.5);
    case 1:
        return place + (random_unit(seed) - 0.5) * 0x1p-46;
    default:
        return place + (double)(next_random(seed) % 7) - 3.0;
    }
}

static void make_sheet(uint64_t *seed, sheet s)
{
    for (int j = 0; j <= CELLS; j++) {
        for (int i = 0; i <= CELLS; i++) {
            const int border = i == 0 || j == 0 || i == CELLS || j == CELLS;
            const double x = FIRST + 0.5 + PITCH * i, y = FIRST + 0.5 + PITCH * j;
            s[j][i][0] = border ? x : jitter(seed, x);
            s[j][i][1] = border ? y : jitter(seed, y);
            s[j][i][2] = random_unit(seed) * SIZE;
        }
    }
}

static void cover(const double *a, const double *b, const double *c, uint8_t counts[SIZE][SIZE])
{
    const double corners[3][3] = {{a[0], a[1], a[2]}, {b[0], b[1], b[2]}, {c[0], c[1], c[2]}};
    struct umbb_coverage coverage;
    if (!umbb_coverage_prepare(corners, SIZE, &coverage)) {
        return;
    }
    for (int32_t y = coverage.row_first; y <= coverage.row_last; y++) {
        int32_t first, last;
        (void)umbb_coverage_row(&coverage, y, &first, &last);
        for (int32_t x = first; x <= last; x++) {
            counts[y][x]++;
        }
    }
}

/* Divides each cell by one diagonal or the other, with any corner first. */
static void cover_sheet(uint64_t *seed, sheet s, uint8_t counts[SIZE][SIZE])
{
    for (int j = 0; j < CELLS; j++) {
        for (int i = 0; i < CELLS; i++) {
            const double *q[4] = {s[j][i], s[j][i + 1], s[j + 1][i + 1], s[j + 1][i]};
            const unsigned turn = (unsigned)(next_random(seed) % 4);
            cover(q[turn], q[(turn + 1) % 4], q[(turn + 2) % 4], counts);
            cover(q[(turn + 3) % 4], q[turn], q[(turn + 2) % 4], counts);
        }
    }
}

static void no_light_passes_shared_edges_and_corners(void **state)
{
    (void)state;
    uint64_t seed = round_seed(19780823), columns = 0, on_edges = 0;
    for (int round = 0; round < case_count(3000); round++) {
        static uint8_t counts[SIZE][SIZE];
        sheet s;
        memset(counts, 0, sizeof counts);
        make_sheet(&seed, s);
        cover_sheet(&seed, s, counts);
        /* Rows: the first row of the border belongs to the square, the last does not. */
        for (int y = FIRST; y < FIRST + SIDE; y++) {
            for (int x = FIRST; x <= FIRST + SIDE; x++) {
                columns++;
                on_edges += counts[y][x] > 1;
                if (counts[y][x] == 0) {
                    fail_msg("round %d: light through texel %d, %d", round, x, y);
                }
            }
        }
    }
    print_message("%llu columns, %llu of them through edges and corners or folds\n",
                  (unsigned long long)columns, (unsigned long long)on_edges);
    assert_true(on_edges > columns / 30);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_light_passes_shared_edges_and_corners),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
