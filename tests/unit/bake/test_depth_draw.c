/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drawing: vector kernels, which draw at once or note cells first, must give the bits of the plain
 * kernel, whatever was drawn before and however full the notes are.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "bake/depth/depth_cells.h"
#include "bake_soups.h"

#define SIZE 64

static struct soup source; /* of random numbers */

/* Rays of the light under test. */
static struct umbb_rays rays;

/* Rays that meet in a point some way before the first voxel. */
static const struct umbb_rays meeting = {.scale = 40.0, .offset = -50.0, .size = SIZE};

static uint64_t random_bits(void)
{
    return soup_bits(&source);
}

static double random_unit(void)
{
    return soup_unit(&source);
}

static double random_coordinate(void)
{
    return soup_coordinate(&source);
}

static void seed(uint64_t value)
{
    soup_init(&source, SIZE, value);
}

enum {
    CANVAS = 32, /* a quarter of the triangles' square, so that all sides clip */
    CANVAS_TEXELS = CANVAS * CANVAS
};

/* Two layers as a kernel finds them. */
struct drawing {
    int32_t texels[2][CANVAS_TEXELS], far[2][CANVAS_TEXELS / 64];
};

static void drawing_init(struct drawing *drawing, const int32_t *texels)
{
    memcpy(drawing->texels, texels, sizeof drawing->texels);
    for (int layer = 0; layer < 2; layer++) {
        umbb_far_plain(drawing->texels[layer], CANVAS, drawing->far[layer]);
    }
}

static void drawing_add(struct drawing *drawing, const struct umbb_coverage *c, size_t count,
                        int round, umbb_draw_fn draw)
{
    const int one_layer = round % 5 == 0;
    const struct umbb_canvas canvas = {
        .x0 = round & 32,
        .y0 = round / 2 & 32,
        .n = CANVAS,
        .rays = rays,
        .front = drawing->texels[0],
        .back = drawing->texels[one_layer ? 0 : 1],
        .front_far = drawing->far[0],
        .back_far = drawing->far[one_layer ? 0 : 1],
    };
    draw(c, count, &canvas);
}

static void random_triangle(int round, double v[3][3])
{
    for (int i = 0; i < 9; i++) {
        v[i / 3][i % 3] = random_coordinate();
    }
    if (round % 3 == 0) { /* a sliver with huge or not finite gradients */
        memcpy(v[1], v[0], sizeof v[1]);
        v[1][1] = nextafter(v[1][1], 100.0);
        v[1][2] = random_coordinate();
    } else if (round % 3 == 1) { /* hardly any area: its crossings are the same but for rounding */
        const double t = random_unit();
        for (int k = 0; k < 2; k++) {
            v[2][k] = v[0][k] + t * (v[1][k] - v[0][k]);
        }
    }
    for (int i = 0; umbb_rays_meet(&rays) && i < 3; i++) { /* from a depth to its q, 0 < q <= 1 */
        v[i][2] = fmin(rays.scale / fmax(v[i][2] - rays.offset, 1.0), 1.0);
    }
}

/* Prepares a triangle as a rasteriser does. */
static int prepare(const double v[3][3], struct umbb_coverage *c)
{
    if (!umbb_coverage_prepare(v, SIZE, c)) {
        return 0;
    }
    if (umbb_rays_meet(&rays)) {
        umbb_perspective_steady(&rays, v, c);
    }
    return 1;
}

/* Draws several triangles at once and one after the other, so that the first ones let the kernel
 * skip much of the later ones. */
static void kernel_gives_the_bits_of_the_plain_one(umbb_draw_fn quick)
{
    seed(5);
    static struct drawing drawings[2];
    static int32_t texels[2 * CANVAS_TEXELS];
    static struct umbb_coverage coverages[UMBB_DRAW_MAX];
    for (int round = 0; round < 3000; round++) {
        const int32_t depth = (int32_t)(random_bits() % SIZE);
        for (size_t i = 0; i < 2 * CANVAS_TEXELS; i++) {
            texels[i] = round % 2 == 0 ? (int32_t)(random_bits() % (SIZE + 1))
                                       : depth + (int32_t)(random_bits() % 2);
        }
        drawing_init(&drawings[0], texels);
        drawing_init(&drawings[1], texels);
        for (int k = 0; k < 4; k++) {
            const size_t wanted = round % 50 == 0 ? UMBB_DRAW_MAX : (size_t)(round % 3 + 1);
            size_t count = 0;
            for (size_t i = 0; i < wanted; i++) {
                double v[3][3];
                random_triangle(round + k, v);
                count += (size_t)prepare((const double(*)[3])v, &coverages[count]);
            }
            drawing_add(&drawings[0], coverages, count, round, umbb_draw_plain);
            drawing_add(&drawings[1], coverages, count, round, quick);
        }
        assert_memory_equal(drawings[0].texels, drawings[1].texels, sizeof texels);
        for (size_t i = 0; i < 2 * CANVAS_TEXELS; i++) {
            const size_t layer = i / CANVAS_TEXELS, at = i % CANVAS_TEXELS;
            assert_true(drawings[1].texels[layer][at] <= drawings[1].far[layer][at / 64]);
        }
    }
}

/* Does what kernel_gives_the_bits_of_the_plain_one does, for both kinds of light. */
static void kernel_gives_the_bits_under_all_lights(umbb_draw_fn quick)
{
    kernel_gives_the_bits_of_the_plain_one(quick);
    rays = meeting;
    kernel_gives_the_bits_of_the_plain_one(quick);
    rays = (struct umbb_rays){0};
}

/* A slope along y, of which the nearest row in a band lies exactly on a voxel's centre, before a
 * wall in the next voxel. A bound that rounds in another way than the predicate would find the
 * slope hidden. */
static void slopes_that_touch_a_centre_are_drawn_by(umbb_draw_fn quick)
{
    seed(7);
    static struct drawing drawings[2];
    static int32_t texels[2 * CANVAS_TEXELS];
    int drawn = 0;
    for (int round = 0; round < 20000; round++) {
        const double y = -3.0 * random_unit(), below = 7.5 - y;
        const double gradient = -0.25 * (double)(1 + random_bits() % 4);
        const int32_t lit = 10 + (int32_t)(random_bits() % 20);
        const double z = lit + 0.5 - gradient * below;
        const double v[3][3] = {
            {-40.0, y, z}, {80.0, y, z}, {-40.0, y + 40.0, z + 40.0 * gradient}};
        struct umbb_coverage c;
        assert_int_equal(umbb_coverage_prepare(v, SIZE, &c), 1);
        for (size_t i = 0; i < 2 * CANVAS_TEXELS; i++) {
            texels[i] = lit + 1;
        }
        drawing_init(&drawings[0], texels);
        drawing_init(&drawings[1], texels);
        drawing_add(&drawings[0], &c, 1, 0, umbb_draw_plain);
        drawing_add(&drawings[1], &c, 1, 0, quick);
        assert_memory_equal(drawings[0].texels, drawings[1].texels, sizeof texels);
        drawn += drawings[0].texels[0][7 * 8] == lit;
    }
    assert_true(drawn > 1000); /* else nothing was tested */
}

static void drawing_with_avx2_gives_the_bits_of_the_plain_one(void **state)
{
    (void)state;
    const struct umbb_depth_kernels *kernels = umbb_depth_kernels(UMBB_VECTORS_AVX2);
    if (kernels == NULL) {
        print_message("skipped: no AVX2 on this processor\n");
        skip();
    }
    kernel_gives_the_bits_under_all_lights(kernels->draw);
    slopes_that_touch_a_centre_are_drawn_by(kernels->draw);
}

static void greatest_texels_are_found_by_vectors_too(void **state)
{
    (void)state;
    static int32_t texels[CANVAS_TEXELS], far[2][CANVAS_TEXELS / 64];
    const struct umbb_depth_kernels *kernels = umbb_depth_kernels(UMBB_VECTORS_AVX2);
    if (kernels == NULL) {
        print_message("skipped: no AVX2 on this processor\n");
        skip();
    }
    seed(6);
    for (int round = 0; round < 200; round++) {
        for (size_t i = 0; i < CANVAS_TEXELS; i++) {
            texels[i] = (int32_t)(random_bits() % (SIZE + 1));
        }
        umbb_far_plain(texels, CANVAS, far[0]);
        kernels->find_far(texels, CANVAS, far[1]);
        assert_memory_equal(far[0], far[1], sizeof far[0]);
    }
}

/* Returns the steps of AVX-512, or NULL. */
static const struct umbb_cells_steps *steps_of_avx512(void)
{
    const struct umbb_depth_kernels *kernels = umbb_depth_kernels(UMBB_VECTORS_AVX512);
    return kernels == NULL ? NULL : kernels->cells;
}

/* Notes triangles as a rasteriser does; earlier ones may hide those farther away. Returns how many
 * times the notes were full. */
static int note_all(const struct umbb_cells_steps *steps, struct umbb_cells *cells,
                    const struct umbb_coverage *c, size_t count, struct umbb_sides sides,
                    int32_t *layers)
{
    int full = 0;
    for (size_t i = 0; i < count;) {
        const size_t step = count - i < UMBB_DRAW_MAX ? count - i : UMBB_DRAW_MAX;
        const size_t taken = steps->note(cells, c + i, step, &sides);
        i += taken;
        if (taken < step) {
            steps->draw(cells, layers);
            full++;
        }
        sides.often_hidden = i > count / 2;
    }
    return full;
}

/* A drawing kernel that is made of the separate steps. */
static void draw_by_cells(const struct umbb_coverage *c, size_t count,
                          const struct umbb_canvas *canvas)
{
    static struct umbb_cells cells;
    static int32_t layers[UMBB_LAYER_COUNT * CANVAS_TEXELS];
    int32_t *front = layers + (size_t)UMBB_LAYER_FRONT * CANVAS_TEXELS;
    int32_t *back = layers + (size_t)UMBB_LAYER_BACK * CANVAS_TEXELS;
    const int one_layer = canvas->front == canvas->back;
    const struct umbb_sides sides = {UMBB_LAYER_FRONT,
                                     one_layer ? UMBB_LAYER_FRONT : UMBB_LAYER_BACK, 0};
    cells.background = SIZE;
    cells.rays = canvas->rays;
    cells.layer_count = UMBB_LAYER_COUNT;
    umbb_cells_begin(&cells, CANVAS, canvas->x0, canvas->y0);
    memcpy(front, canvas->front, CANVAS_TEXELS * sizeof *front);
    memcpy(back, canvas->back, CANVAS_TEXELS * sizeof *back);
    for (size_t i = 0; i < count; i++) {
        if (umbb_cells_can_note(&canvas->rays, &c[i])) {
            (void)note_all(steps_of_avx512(), &cells, &c[i], 1, sides, layers);
        } else {
            umbb_draw_plain(&c[i], 1, canvas);
        }
    }
    steps_of_avx512()->draw(&cells, layers);
    for (size_t i = 0; i < CANVAS_TEXELS; i++) {
        canvas->front[i] = front[i] < canvas->front[i] ? front[i] : canvas->front[i];
        canvas->back[i] = one_layer || canvas->back[i] < back[i] ? canvas->back[i] : back[i];
    }
}

static void drawing_by_noted_cells_gives_the_bits_of_the_plain_one(void **state)
{
    (void)state;
    if (steps_of_avx512() == NULL) {
        print_message("skipped: no AVX-512 on this processor\n");
        skip();
    }
    kernel_gives_the_bits_under_all_lights(draw_by_cells);
    slopes_that_touch_a_centre_are_drawn_by(draw_by_cells);
}

enum {
    BLOCK_TEXELS = UMBB_CANVAS_MAX * UMBB_CANVAS_MAX,
    CROWD = 3000
};

/* Large triangles, most of them from back to front, so that few are hidden. */
static size_t crowd_make(struct umbb_coverage *c, const struct umbb_rays *light)
{
    size_t count = 0;
    for (int i = 0; i < CROWD; i++) {
        double v[3][3];
        for (int k = 0; k < 3; k++) {
            v[k][0] = 300.0 * random_unit() - 20.0;
            v[k][1] = 300.0 * random_unit() - 20.0;
            v[k][2] = i % 16 == 0 ? 900.0 + 100.0 * random_unit()
                                  : 1000.0 * (double)(CROWD - i) / CROWD + random_unit();
            v[k][2] = umbb_rays_meet(light) ? light->scale / (v[k][2] - light->offset) : v[k][2];
        }
        count += (size_t)umbb_coverage_prepare((const double(*)[3])v, 1024, &c[count]);
    }
    return count;
}

static void full_notes_are_drawn_under(const struct umbb_rays *light)
{
    const struct umbb_cells_steps *steps = steps_of_avx512();
    static struct umbb_cells cells;
    static struct umbb_coverage c[CROWD];
    static int32_t layers[2][BLOCK_TEXELS];
    static int32_t far[BLOCK_TEXELS / 64];
    seed(8);
    const size_t count = crowd_make(c, light);
    for (size_t i = 0; i < BLOCK_TEXELS; i++) {
        layers[0][i] = layers[1][i] = 1024;
    }
    cells.background = 1024;
    cells.rays = *light;
    cells.layer_count = 1;
    umbb_cells_begin(&cells, UMBB_CANVAS_MAX, 0, 0);
    const struct umbb_sides sides = {UMBB_LAYER_OPEN, UMBB_LAYER_OPEN, 0};
    assert_true(note_all(steps, &cells, c, count, sides, layers[0]) > 2);
    steps->draw(&cells, layers[0]);
    const struct umbb_canvas canvas = {
        .n = UMBB_CANVAS_MAX,
        .rays = *light,
        .front = layers[1],
        .back = layers[1],
        .front_far = far,
        .back_far = far,
    };
    for (size_t i = 0; i < count; i++) {
        umbb_draw_plain(&c[i], 1, &canvas);
    }
    assert_memory_equal(layers[0], layers[1], sizeof layers[0]);
}

static void full_notes_are_drawn_and_go_on(void **state)
{
    (void)state;
    const struct umbb_rays parallel = {0}, near = {.scale = 100.0, .offset = -150.0, .size = 1024};
    if (steps_of_avx512() == NULL) {
        print_message("skipped: no AVX-512 on this processor\n");
        skip();
    }
    full_notes_are_drawn_under(&parallel);
    full_notes_are_drawn_under(&near);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(drawing_with_avx2_gives_the_bits_of_the_plain_one),
        cmocka_unit_test(drawing_by_noted_cells_gives_the_bits_of_the_plain_one),
        cmocka_unit_test(full_notes_are_drawn_and_go_on),
        cmocka_unit_test(greatest_texels_are_found_by_vectors_too),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
