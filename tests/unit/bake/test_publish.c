/* SPDX-License-Identifier: Apache-2.0 */
/* Publishing: only an asset that passes its checks gets its name; a failure leaves nothing
 * behind. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <dirent.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "bake/analysis/light_frame.h"
#include "bake/write/publish.h"
#include "bake_soups.h"
#include "tool/exit_code.h"

#define LOG2_SIZE 8U

/* A box over a floor, 20 m across, light from straight above, baked. */
struct fixture {
    struct soup soup; /* world metres */
    double world[14][3][3];
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    struct umb__content content;
    struct umb__octree octree;
    char folder[64], path[96];
};

static char plan[] = "", settings[] = "resolution=256\n", notes[] = "";

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    soup_init(&f->soup, 1 << LOG2_SIZE, 0);
    const double low[3] = {-3, -4, 5}, high[3] = {4, 3, 8};
    soup_box(&f->soup, low, high, 0);
    const double floor[4][3] = {{-10, -10, 0}, {10, -10, 0}, {10, 10, 0}, {-10, 10, 0}};
    soup_add(&f->soup, floor[0], floor[1], floor[2], UMBB_CASTER_OPEN);
    soup_add(&f->soup, floor[0], floor[2], floor[3], UMBB_CASTER_OPEN);
    memcpy(f->world, f->soup.corners, sizeof f->world);
    struct umb_error error;
    const double origin[3] = {0, 0, 0};
    memcpy(f->light.name, "sun", 4);
    f->light.frustum_count = 1;
    umbb_sun_direction(135.0, 60.0, 1, f->light.direction);
    const struct umbb_fit fit = {(const double(*)[3][3])f->world, 14, origin, LOG2_SIZE, 1};
    assert_int_equal(umbb_light_frame_fit(&fit, f->light.direction, &f->frustum, &error), UMB_OK);
    umbb_light_frame_apply(&f->frustum, origin, f->soup.corners, 14);
    soup_bake(&f->soup, 0, 7, 1, &f->octree);
    f->content = (struct umb__content){
        .light_count = 1,
        .frustum_count = 1,
        .lights = &f->light,
        .frusta = &f->frustum,
        .bounds = {{-10, -10, 0}, {10, 10, 8}},
        .plan = plan,
        .settings = settings,
        .notes = notes,
    };
    const int length = snprintf(f->folder, sizeof f->folder, "/tmp/umb_test_publish_");
    memset(f->folder + length, 'X', 6); /* mkdtemp's template; the rest is zero */
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->path, sizeof f->path, "%s/out.umb", f->folder);
    *state = f;
    return 0;
}

/* Names in the fixture's folder. */
static int file_count(const struct fixture *f)
{
    int count = 0;
    DIR *folder = opendir(f->folder);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        count += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    }
    closedir(folder);
    return count;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    unlink(f->path);
    assert_int_equal(rmdir(f->folder), 0);
    umb__octree_finish(&f->octree);
    soup_finish(&f->soup);
    free(f);
    return 0;
}

static struct umbb_check check_of(const struct fixture *f)
{
    return (struct umbb_check){
        .corners = (const double(*)[3][3])f->world, .count = 14, .points = 20000, .threads = 1};
}

static void a_right_asset_is_published_under_its_name(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    assert_int_equal(umbb_publish_write(&publish, &f->content, &f->octree, &error), UMB_OK);
    assert_int_not_equal(access(f->path, F_OK), 0); /* not yet */
    const struct umbb_check check = check_of(f);
    assert_int_equal(umbb_publish_check(&publish, &f->octree, &check, &error), UMB_OK);
    assert_true(publish.checked.verified.points > 10000);
    assert_int_equal(publish.checked.verified.outside_band, 0);
    assert_int_equal(umbb_publish_commit(&publish, &error), UMB_OK);
    umbb_publish_abandon(&publish);
    assert_int_equal(access(f->path, F_OK), 0);
    assert_int_equal(file_count(f), 1);
    struct umb_asset *asset;
    assert_int_equal(umb_asset_open_file(f->path, NULL, &asset, &error), UMB_OK);
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    assert_memory_equal(info.id, publish.id, sizeof info.id);
    assert_int_equal(info.file_bytes, publish.bytes);
    umb_asset_close(asset);
}

static void a_wrong_octree_is_found_by_rays_and_not_published(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    /* Makes a lit child of one of the root's children shadowed: a region far from any boundary is
     * then wrong. */
    struct umb__octree_level *top = &f->octree.level[LOG2_SIZE];
    assert_int_equal(top->count, 1);
    struct umb__octree_level *next = &f->octree.level[LOG2_SIZE - 1];
    int planted = 0;
    for (unsigned c = 0; c < 8 && !planted; c++) {
        for (uint32_t node = 0; node < next->count && !planted; node++) {
            if (umb__mask_state(next->masks[node], c) == UMB__NODE_LIT) {
                next->masks[node] = (uint16_t)(next->masks[node] & ~(3U << (2 * c)));
                planted = next->masks[node] != 0;
            }
        }
    }
    assert_true(planted);
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    assert_int_equal(umbb_publish_write(&publish, &f->content, &f->octree, &error), UMB_OK);
    const struct umbb_check check = check_of(f);
    const enum umb_status status = umbb_publish_check(&publish, &f->octree, &check, &error);
    assert_int_equal(status, UMB_E_INTERNAL);
    assert_int_equal(umbu_exit_code(status), 70);
    assert_non_null(strstr(error.message, "disagree with traced rays"));
    umbb_publish_abandon(&publish);
    assert_int_equal(file_count(f), 0);
}

/* Changes an octree in one place, or changes it back. In: kind: what; pick: which. Returns 0 if
 * there is nothing of this kind. */
static int change(struct umb__octree *octree, uint64_t kind, uint64_t pick)
{
    struct umb__octree_level *level = &octree->level[UMB_LEVEL_BRICK + 1 + pick % 4];
    const uint32_t node = level->count > 0 ? (uint32_t)(pick >> 8) % level->count : 0;
    const unsigned child = (unsigned)(pick >> 4) % 8;
    switch (kind) {
    case 0: /* a voxel */
        octree->bricks[(pick >> 16) % octree->brick_count][pick & 7] ^= (uint64_t)1
                                                                        << (pick >> 8 & 63);
        return 1;
    case 1: /* a uniform child */
        if (level->count == 0 || umb__mask_state(level->masks[node], child) == UMB__NODE_MIXED) {
            return 0;
        }
        level->masks[node] ^= (uint16_t)(1U << (2 * child));
        return 1;
    case 2: { /* two children change places */
        const uint32_t count = level->count > 0 ? level->first[level->count] : 0;
        const uint32_t a = count > 1 ? (uint32_t)(pick >> 8) % (count - 1) : 0;
        if (count < 2 || level->children[a] == level->children[a + 1]) {
            return 0;
        }
        const uint32_t kept = level->children[a];
        level->children[a] = level->children[a + 1];
        level->children[a + 1] = kept;
        return 1;
    }
    default: /* the number of nodes */
        octree->level[LOG2_SIZE].count ^= 2;
        return 1;
    }
}

static void a_file_that_is_not_of_the_octree_is_found(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    const struct umbb_check check = check_of(f);
    int tried[4] = {0};
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    publish.threads = 2;
    assert_int_equal(umbb_publish_write(&publish, &f->content, &f->octree, &error), UMB_OK);
    for (int i = 0; i < 1000; i++) {
        const uint64_t bits = soup_bits(&f->soup), kind = bits % 4, pick = bits >> 4;
        if (change(&f->octree, kind, pick)) {
            tried[kind]++;
            assert_int_equal(umbb_publish_check(&publish, &f->octree, &check, &error),
                             UMB_E_INTERNAL);
            assert_true(change(&f->octree, kind, pick));
        }
    }
    for (int kind = 0; kind < 4; kind++) {
        assert_true(tried[kind] > 50);
    }
    assert_int_equal(umbb_publish_check(&publish, &f->octree, &check, &error), UMB_OK);
    umbb_publish_abandon(&publish);
}

static void a_file_with_one_wrong_bit_is_found(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    const struct umbb_check check = check_of(f);
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    assert_int_equal(umbb_publish_write(&publish, &f->content, &f->octree, &error), UMB_OK);
    FILE *file = fopen(publish.file.temporary, "r+b");
    assert_non_null(file);
    for (int i = 0; i < 1000; i++) {
        const uint64_t bits = soup_bits(&f->soup);
        const long at = (long)((bits >> 8) % publish.bytes);
        for (int back = 0; back < 2; back++) {
            assert_int_equal(fseek(file, at, SEEK_SET), 0);
            const int byte = fgetc(file);
            assert_int_equal(fseek(file, at, SEEK_SET), 0);
            assert_true(fputc(byte ^ (1 << (bits & 7)), file) != EOF && fflush(file) == 0);
            if (back == 0 && umbb_publish_check(&publish, &f->octree, &check, &error) == UMB_OK) {
                fail_msg("byte %ld was changed, and nothing was found", at);
            }
        }
    }
    fclose(file);
    assert_int_equal(umbb_publish_check(&publish, &f->octree, &check, &error), UMB_OK);
    umbb_publish_abandon(&publish);
}

/* The file is right: memory to check it is missing. */
static void a_check_that_lacks_memory_asks_for_more(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    struct umbb_check check = check_of(f);
    check.max_memory_bytes = 10000;
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    assert_int_equal(umbb_publish_write(&publish, &f->content, &f->octree, &error), UMB_OK);
    const enum umb_status status = umbb_publish_check(&publish, &f->octree, &check, &error);
    assert_int_equal(status, UMB_E_LIMIT);
    assert_int_equal(umbu_exit_code(status), 75);
    assert_non_null(strstr(error.message, "--memory"));
    umbb_publish_abandon(&publish);
    assert_int_equal(file_count(f), 0);
}

static void equal_bakes_have_equal_ids_whatever_the_tiles_threads_and_notes(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    uint8_t first[UMB_ID_BYTES];
    static char other_notes[] = "time=later\n";
    for (uint32_t tile_log2 = 6; tile_log2 <= LOG2_SIZE; tile_log2++) {
        struct umb__octree octree;
        struct umbb_publish publish;
        soup_bake(&f->soup, 0, tile_log2, tile_log2 - 5, &octree);
        assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
        assert_int_equal(umbb_publish_write(&publish, &f->content, &octree, &error), UMB_OK);
        if (tile_log2 == 6) {
            memcpy(first, publish.id, sizeof first);
            f->content.notes = other_notes;
        }
        assert_memory_equal(first, publish.id, sizeof first);
        umbb_publish_abandon(&publish);
        umb__octree_finish(&octree);
    }
    assert_int_equal(file_count(f), 0);
}

static void an_unwritable_place_shows_at_once(void **state)
{
    (void)state;
    struct umbb_publish publish;
    struct umb_error error;
    assert_int_equal(umbb_publish_begin(&publish, "/nonexistent-folder/x.umb", &error),
                     UMB_E_CANNOT_CREATE);
    umbb_publish_abandon(&publish);
}

static void a_write_that_fails_names_the_file_and_the_cause(void **state)
{
    struct fixture *f = *state;
    struct umbb_publish publish;
    struct umb_error error;
    struct rlimit limit, small;
    assert_int_equal(umbb_publish_begin(&publish, f->path, &error), UMB_OK);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    signal(SIGXFSZ, SIG_IGN);
    small = limit;
    small.rlim_cur = 100;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    const enum umb_status status = umbb_publish_write(&publish, &f->content, &f->octree, &error);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
    assert_int_equal(status, UMB_E_IO);
    assert_int_equal(error.system_error, EFBIG);
    assert_non_null(strstr(error.message, f->path));
    assert_non_null(strstr(error.message, strerror(EFBIG)));
    umbb_publish_abandon(&publish);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_right_asset_is_published_under_its_name, setup, teardown),
        cmocka_unit_test_setup_teardown(a_wrong_octree_is_found_by_rays_and_not_published, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(a_file_that_is_not_of_the_octree_is_found, setup, teardown),
        cmocka_unit_test_setup_teardown(a_file_with_one_wrong_bit_is_found, setup, teardown),
        cmocka_unit_test_setup_teardown(a_check_that_lacks_memory_asks_for_more, setup, teardown),
        cmocka_unit_test_setup_teardown(
            equal_bakes_have_equal_ids_whatever_the_tiles_threads_and_notes, setup, teardown),
        cmocka_unit_test_setup_teardown(a_write_that_fails_names_the_file_and_the_cause, setup,
                                        teardown),
        cmocka_unit_test(an_unwritable_place_shows_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
