/* SPDX-License-Identifier: Apache-2.0 */
/* Pages come and go in any order: answers, bounds and marks are those of a layout made anew. */
#include "partial_fixture.h"

#include "deep_asset.h"
#include "partial_oracle.h"
#include "spot_asset.h"

enum {
    POINTS = 200,
};

/* An asset, and the box in which its points lie. */
struct subject {
    const char *name;
    struct bytes file;
    struct umb_box box;
    uint32_t lights;
};

static struct umb_box cube_at(const double *low, double side)
{
    return (struct umb_box){{low[0], low[1], low[2]},
                            {low[0] + side, low[1] + side, low[2] + side}};
}

/* An asset of partial_scene. In: page_bytes: most estimated bytes of a page; 0: as packed. */
static struct bytes scene_file(uint32_t log2_size, uint32_t frusta, uint32_t page_bytes)
{
    const struct voxels voxels = {partial_scene, NULL, log2_size, frusta};
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.25, fixture_origin, &content);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = &test_digest,
                                      .sink = &sink,
                                      .page_bytes = page_bytes};
    if (umb__pack_run(&job, id, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    umb__octree_finish(&octree);
    return file;
}

static struct subject subject_of(unsigned number)
{
    static const double zero[3] = {0, 0, 0};
    static const struct deep deep[] = {
        {13, 1, 8, 7, 32},
        {20, 40, 8, 1, 1024},
        {19, 150, 3, 3, 0},
        {14, 300, 4, 9, 0},
    };
    const struct umb_box scene = cube_at(fixture_origin, 70);
    switch (number) {
    case 0:
        return (struct subject){"two lights", scene_file(8, 2, 0), scene, 2};
    case 1:
        return (struct subject){"small pages", scene_file(8, 1, 1024), scene, 1};
    case 2:
        return (struct subject){"six lights", scene_file(7, 6, 0), scene, 6};
    case 3: {
        const double low[3] = {spot_eye[0] - 20, spot_eye[1] - 20, spot_eye[2]};
        return (struct subject){"spot", spot_file(), cube_at(low, 40), 1};
    }
    default:
        return (struct subject){"deep", deep_asset(&deep[number - 4], 1000), cube_at(zero, 1000),
                                1};
    }
}

/* A partial asset, and what is asked of it. */
struct bench {
    const struct subject *subject;
    struct partial_fixture f;
    struct oracle oracle;
    bool has_budget; /* The memory budget is small: pages may be refused and dropped */
    uint64_t seed;
    double positions[3 * POINTS];
    float normals[3 * POINTS];
};

static void random_place(struct bench *b, double place[3])
{
    for (unsigned k = 0; k < 3; k++) {
        const struct umb_box *box = &b->subject->box;
        place[k] = box->min[k] + random_unit(&b->seed) * (box->max[k] - box->min[k]);
    }
}

static void random_points(struct bench *b)
{
    for (size_t i = 0; i < POINTS; i++) {
        random_place(b, b->positions + 3 * i);
        for (unsigned k = 0; k < 3; k++) {
            b->normals[3 * i + k] = i % 3 ? 0.0F : (float)(random_unit(&b->seed) - 0.5);
        }
    }
}

static void expect_equal_marks(const struct bench *b)
{
    const struct umb_partial *p = b->f.partial;
    for (uint32_t page = 0; page < p->head.page_count; page++) {
        if (memcmp(&p->pages[page].benefit, &b->oracle.benefit[page], sizeof(double)) != 0) {
            fail_msg("%s: page %u: benefit %.17g, made anew %.17g", b->subject->name, page,
                     p->pages[page].benefit, b->oracle.benefit[page]);
        }
    }
}

static void compare_answers(struct bench *b, const struct umb_query_settings *s, int want)
{
    static float got[4][POINTS], wanted[4][POINTS];
    const struct umb_points points = {
        .positions = b->positions, .format = UMB_POINT_F64, .normals = b->normals, .count = POINTS};
    struct umb_partial_answers ours = {got[0], got[1], got[2], got[3], 0, 0, {0}, {0}};
    struct umb_partial_answers theirs = {wanted[0], wanted[1], wanted[2], wanted[3],
                                         0,         0,         {0},       {0}};
    struct umb_error error = {0};
    if (umb_partial_query(b->f.partial, s, &points, want, &ours, &error) != UMB_OK ||
        oracle_query(&b->oracle, s, &points, want, &theirs, &error) != UMB_OK) {
        fail_msg("%s: %s", b->subject->name, error.message);
    }
    for (unsigned i = 0; i < 4; i++) {
        assert_memory_equal(got[i], wanted[i], sizeof got[i]);
    }
    assert_int_equal(ours.exact, theirs.exact);
    assert_memory_equal(&ours.worst_error_m, &theirs.worst_error_m, sizeof(double));
}

static void compare_queries(struct bench *b)
{
    const uint32_t light = (uint32_t)(next_random(&b->seed) % b->subject->lights);
    const struct umb_query_settings ways[] = {
        {.light = light, .taps = 1},
        {.light = light, .taps = 9},
        {.light = light, .taps = 17, .filter = UMB_FILTER_TENT},
        {.light = light, .taps = 1, .level = 3},
        {.light = light, .taps = 7, .filter = UMB_FILTER_GAUSSIAN},
    };
    const size_t coarse = 3;
    const bool spot = b->f.partial->canonical.content.lights[light].kind != UMB_LIGHT_DIRECTIONAL;
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        if (i != coarse || !spot) {
            random_points(b);
            compare_answers(b, &ways[i], i == 1);
        }
    }
    expect_equal_marks(b);
}

/* Missing pages have the marks of a walk through everything in the view, down to the bricks. */
static void expect_marks_of_a_whole_walk(struct bench *b, const struct umb_partial_view *view)
{
    const struct umb_partial *p = b->f.partial;
    struct oracle *oracle = &b->oracle;
    const size_t size = p->head.page_count * sizeof *oracle->benefit;
    double *kept = malloc(size);
    memcpy(kept, oracle->benefit, size);
    const bool met_bound = oracle->met_bound;
    oracle->walks_all = true;
    assert_int_equal(oracle_want(oracle, view, 0, NULL), UMB_OK);
    oracle->walks_all = false;
    for (uint32_t page = 0; page < p->head.page_count && !oracle->met_bound && !met_bound; page++) {
        if (!umb_partial_has(p, page) &&
            memcmp(&oracle->benefit[page], &kept[page], sizeof(double)) != 0) {
            fail_msg("%s: missing page %u: benefit %.17g, of a whole walk %.17g", b->subject->name,
                     page, kept[page], oracle->benefit[page]);
        }
    }
    memcpy(oracle->benefit, kept, size);
    free(kept);
}

static void compare_wants(struct bench *b)
{
    struct umb_partial_view view = {.light = UINT32_MAX, .taps = next_random(&b->seed) % 2 ? 1 : 0};
    double a[3], c[3];
    random_place(b, a);
    random_place(b, c);
    view.has_box = next_random(&b->seed) % 2;
    view.has_camera = next_random(&b->seed) % 3 == 0;
    for (unsigned k = 0; k < 3; k++) {
        view.box.min[k] = a[k] < c[k] ? a[k] : c[k];
        view.box.max[k] = a[k] < c[k] ? c[k] : a[k];
        view.camera.eye[k] = a[k];
        view.camera.forward[k] = c[k] - a[k];
        view.camera.up[k] = k == 2;
    }
    view.camera.fov_y = 1;
    view.camera.aspect = 1.5;
    view.max_error_m = next_random(&b->seed) % 4 ? 0 : 2;
    view.max_error_rad = next_random(&b->seed) % 4 ? 0 : 0.01;
    const int add = next_random(&b->seed) % 4 == 0;
    assert_int_equal(umb_partial_want(b->f.partial, &view, add, NULL), UMB_OK);
    assert_int_equal(oracle_want(&b->oracle, &view, add, NULL), UMB_OK);
    expect_equal_marks(b);
    if (!add) {
        expect_marks_of_a_whole_walk(b, &view);
    }
}

/* Adds a page, if the memory budget has room for it. */
static void add_page(struct bench *b, uint32_t page)
{
    struct umb_error error = {0};
    uint32_t length;
    const uint8_t *stored = partial_page(&b->f, page, &length);
    const enum umb_status status = umb_partial_add(b->f.partial, page, stored, length, &error);
    if (status != UMB_OK && (status != UMB_E_NO_MEMORY || !b->has_budget)) {
        fail_msg("%s: page %u: %s", b->subject->name, page, error.message);
    }
}

/* Adds or drops a random page. About `share` of 16 pages are held in the long run; of the first
 * pages, without which nothing below them is seen, most. */
static void change_page(struct bench *b, unsigned share)
{
    struct umb_partial *p = b->f.partial;
    const uint32_t page = (uint32_t)(next_random(&b->seed) % p->head.page_count);
    if (next_random(&b->seed) % 16 < (page < p->head.page_count / 4 + 1 ? 14 : share)) {
        if (!umb_partial_has(p, page)) {
            add_page(b, page);
        }
    } else {
        umb_partial_drop(p, page);
    }
}

/* Changes pages in `steps` steps and compares after each. Returns the greatest memory in use. */
static uint64_t change_and_compare(struct bench *b, uint64_t budget, int steps)
{
    struct umb_error error = {0};
    struct umb_partial_stats stats;
    b->has_budget = budget > 0;
    b->f.partial = partial_open(&b->f.file, budget);
    b->oracle = (struct oracle){.part = b->f.partial};
    for (int step = 0; step < steps; step++) {
        const unsigned share = 2 + (unsigned)(step / 5 * 5 % 13);
        const uint32_t changes = 1 + (uint32_t)(next_random(&b->seed) % (step % 10 == 0 ? 64 : 3));
        for (uint32_t i = 0; i < changes; i++) {
            change_page(b, share);
        }
        partial_build(&b->f);
        if (oracle_build(&b->oracle, &error) != UMB_OK) {
            fail_msg("%s: %s", b->subject->name, error.message);
        }
        compare_wants(b);
        compare_queries(b);
    }
    umb_partial_get_stats(b->f.partial, &stats);
    assert_true(budget == 0 || stats.memory_peak_bytes <= budget);
    oracle_finish(&b->oracle);
    umb_partial_close(b->f.partial);
    return stats.memory_peak_bytes;
}

static void pages_come_and_go_and_all_is_as_made_anew(void **state)
{
    (void)state;
    for (unsigned number = 0; number < 8; number++) {
        const struct subject subject = subject_of(number);
        struct bench b = {
            .subject = &subject, .f = {.file = subject.file}, .seed = round_seed(number + 1)};
        (void)change_and_compare(&b, 0, case_count(short_count(40, 12)));
        bytes_finish(&b.f.file);
    }
}

static void a_budget_decides_what_is_held_and_not_what_is_answered(void **state)
{
    (void)state;
    for (unsigned number = 0; number < 8; number++) {
        const struct subject subject = subject_of(number);
        struct bench b = {
            .subject = &subject, .f = {.file = subject.file}, .seed = round_seed(number + 9)};
        const uint64_t peak = change_and_compare(&b, 0, 20);
        for (unsigned tenths = 3; tenths < 10 && peak > 1 << 18;
             tenths += 2) { /* Not three pages */
            (void)change_and_compare(&b, peak * tenths / 10, short_count(10, 4));
        }
        bytes_finish(&b.f.file);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pages_come_and_go_and_all_is_as_made_anew),
        cmocka_unit_test(a_budget_decides_what_is_held_and_not_what_is_answered),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
