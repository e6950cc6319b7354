/* SPDX-License-Identifier: Apache-2.0 */
/* Mapped files that are cut, overwritten, deleted and replaced while they are read. */
#define _GNU_SOURCE /* MAP_ANONYMOUS */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/mman.h>
#include <sys/wait.h>

#include "store/asset_map.h"
#include "store/fault_guard.h"
#include "format/asset_parts.h"
#include "store_fixture.h"

#define SIDE 32 /* points a side: every second of 64 voxels, so all nodes and bricks are read */

struct fixture {
    struct folder folder;
    struct bytes mapped;
    struct umbs_asset_map_options options;
    struct umbs_asset_map *map;
    uint8_t truth[SIDE * SIDE * SIDE];
};

static int scattered(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    uint32_t h = (x * 73856093U) ^ (y * 19349663U) ^ (z * 83492791U);
    return (h ^ h >> 13) % 7 < 3;
}

/* With an old time, so that a later one differs: where files' times tick, for milliseconds the
 * same. */
static void put_file(struct fixture *f)
{
    FILE *file = fopen(folder_file(&f->folder, "a.umbm"), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(f->mapped.data, 1, f->mapped.size, file), f->mapped.size);
    assert_int_equal(fclose(file), 0);
    folder_age(&f->folder, "a.umbm", 100);
}

/* Queries the points into values. */
struct sweep {
    const struct umb_asset *asset;
    uint8_t values[SIDE * SIDE * SIDE];
};

static float positions[3 * SIDE * SIDE * SIDE];

static void run_sweep(void *user)
{
    struct sweep *sweep = user;
    struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    struct umb_query query;
    struct umb_points points = {
        .positions = positions, .format = UMB_POINT_F32, .count = SIDE * SIDE * SIDE};
    struct umb_answers answers = {.values = sweep->values};
    if (umb_query_prepare(sweep->asset, &settings, &query, NULL) == UMB_OK) {
        umb_query_run(&query, &points, 0, points.count, &answers);
    }
}

static enum umb_status sweep_map(struct fixture *f, struct sweep *sweep)
{
    struct umb_error error;
    sweep->asset = umbs_asset_map_asset(f->map);
    return umbs_asset_map_read(f->map, run_sweep, sweep, &error);
}

static void open_map(struct fixture *f)
{
    struct umb_error error = {0};
    if (umbs_asset_map_open(folder_file(&f->folder, "a.umbm"), &f->options, &f->map, &error) !=
        UMB_OK) {
        fail_msg("%s", error.message);
    }
}

static int setup(void **state)
{
    static const double origin[3] = {0, 0, 0};
    struct voxels voxels = {.lit = scattered, .log2_size = 6, .frustum_count = 1};
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    struct bytes packed = make_packed(&voxels, 1.0, origin);
    f->mapped = make_mapped(&packed);
    memcpy(f->options.id, packed.data + 48, UMB_ID_BYTES); /* umb-format.md: the head */
    bytes_finish(&packed);
    put_file(f);
    size_t i = 0;
    for (uint32_t z = 0; z < SIDE; z++) {
        for (uint32_t y = 0; y < SIDE; y++) {
            for (uint32_t x = 0; x < SIDE; x++, i++) {
                positions[3 * i] = 2 * (float)x + 0.5F;
                positions[3 * i + 1] = 2 * (float)y + 0.5F;
                positions[3 * i + 2] = 2 * (float)z + 0.5F;
                f->truth[i] = scattered(NULL, 0, 2 * x, 2 * y, 2 * z) ? 255 : 0;
            }
        }
    }
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbs_asset_map_close(f->map);
    bytes_finish(&f->mapped);
    folder_remove(&f->folder);
    free(f);
    return 0;
}

static void asset_map_answers_as_the_voxels_are(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    open_map(f);
    assert_int_equal(sweep_map(f, &sweep), UMB_OK);
    assert_memory_equal(sweep.values, f->truth, sizeof f->truth);
    assert_int_equal(umbs_asset_map_check(f->map, NULL), UMB_OK);
}

/* Every page edge, one byte to each side of it, and odd sizes within pages. */
static void asset_map_cut_anywhere_fails_the_read_and_nothing_else(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    for (size_t page = 0; page * 4096 <= f->mapped.size; page++) {
        for (long beside = -1; beside <= 1; beside++) {
            long size = (long)page * 4096 + beside;
            if (size < 0 || (size_t)size >= f->mapped.size) {
                continue;
            }
            put_file(f);
            open_map(f);
            assert_int_equal(truncate(folder_file(&f->folder, "a.umbm"), size), 0);
            assert_int_equal(sweep_map(f, &sweep), UMB_E_CORRUPT);
            assert_int_equal(umbs_asset_map_check(f->map, NULL), UMB_E_CORRUPT);
            umbs_asset_map_close(f->map);
            f->map = NULL;
        }
    }
}

static void overwrite(struct fixture *f, uint8_t byte)
{
    FILE *file = fopen(folder_file(&f->folder, "a.umbm"), "r+b");
    assert_non_null(file);
    for (size_t i = 0; i < f->mapped.size; i++) {
        fputc(byte, file);
    }
    assert_int_equal(fclose(file), 0);
}

static void asset_map_overwritten_in_place_fails_the_read_and_nothing_else(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    static const uint8_t bytes[] = {0x00, 0x01, 0x7f, 0x80, 0xaa, 0xff};
    for (size_t i = 0; i < sizeof bytes; i++) {
        put_file(f);
        open_map(f);
        overwrite(f, bytes[i]);
        assert_int_equal(sweep_map(f, &sweep), UMB_E_CORRUPT);
        umbs_asset_map_close(f->map);
        f->map = NULL;
    }
}

/* The file's times are put back, so only the check can notice the change; reads must stay
 * harmless. */
static void asset_map_check_finds_what_the_times_hide(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    struct stat before;
    open_map(f);
    assert_int_equal(stat(folder_file(&f->folder, "a.umbm"), &before), 0);
    overwrite(f, 0xff);
    struct timespec times[2] = {before.st_atim, before.st_mtim};
    assert_int_equal(utimensat(AT_FDCWD, folder_file(&f->folder, "a.umbm"), times, 0), 0);
    (void)sweep_map(f, &sweep); /* any answer or none, but the process lives */
    assert_int_not_equal(umbs_asset_map_check(f->map, NULL), UMB_OK);
}

static void asset_map_deleted_or_replaced_goes_on(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    char other[512];
    open_map(f);
    snprintf(other, sizeof other, "%s", folder_file(&f->folder, "b.umbm"));
    assert_int_equal(rename(folder_file(&f->folder, "a.umbm"), other), 0);
    assert_int_equal(sweep_map(f, &sweep), UMB_OK);
    assert_int_equal(unlink(other), 0);
    assert_int_equal(sweep_map(f, &sweep), UMB_OK);
    assert_memory_equal(sweep.values, f->truth, sizeof f->truth);
}

static void asset_map_copy_does_not_care_about_the_file(void **state)
{
    struct fixture *f = *state;
    static struct sweep sweep;
    f->options.copy = 1;
    open_map(f);
    overwrite(f, 0xff);
    assert_int_equal(sweep_map(f, &sweep), UMB_OK);
    assert_memory_equal(sweep.values, f->truth, sizeof f->truth);
    assert_int_equal(truncate(folder_file(&f->folder, "a.umbm"), 1), 0);
    assert_int_equal(sweep_map(f, &sweep), UMB_OK);
    assert_int_equal(umbs_asset_map_check(f->map, NULL), UMB_OK);
}

static void asset_map_known_file_is_checked_again_when_it_changed(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    struct umb_error error;
    open_map(f);
    struct umbs_stamp known = *umbs_asset_map_stamp(f->map);
    umbs_asset_map_close(f->map);
    f->map = NULL;
    f->options.known = &known;
    open_map(f);
    umbs_asset_map_close(f->map);
    f->map = NULL;
    folder_flip(&f->folder, "a.umbm", (long)f->mapped.size - 10);
    assert_int_equal(
        umbs_asset_map_open(folder_file(&f->folder, "a.umbm"), &f->options, &f->map, &error),
        UMB_E_CORRUPT);
    assert_int_equal(stat(folder_file(&f->folder, "a.umbm"), &facts), 0);
    known = umbs_stamp_of(&facts); /* believed: the damage is in a brick, which opening leaves */
    open_map(f);
    assert_int_equal(umbs_asset_map_check(f->map, NULL), UMB_E_CORRUPT);
}

static void asset_map_refuses_what_is_not_that_asset(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    f->options.id[0] ^= 1;
    assert_int_equal(
        umbs_asset_map_open(folder_file(&f->folder, "a.umbm"), &f->options, &f->map, &error),
        UMB_E_CORRUPT);
    assert_null(f->map);
    assert_int_equal(
        umbs_asset_map_open(folder_file(&f->folder, "no.umbm"), &f->options, &f->map, &error),
        UMB_E_NO_INPUT);
    assert_int_equal(umbs_asset_map_open(f->folder.path, &f->options, &f->map, &error),
                     UMB_E_CORRUPT);
}

struct reader {
    struct fixture *f;
    struct sweep sweep;
    atomic_int stop;
    int good, bad, wrong;
};

static void *read_until_bad(void *argument)
{
    struct reader *reader = argument;
    while (!atomic_load(&reader->stop)) {
        if (sweep_map(reader->f, &reader->sweep) != UMB_OK) {
            reader->bad++;
            break;
        }
        reader->good++;
        reader->wrong += memcmp(reader->sweep.values, reader->f->truth, SIDE * SIDE * SIDE) != 0;
    }
    return NULL;
}

/* Readers on two threads while the file is cut short: answers must be right or refused, never
 * wrong. */
static void asset_map_cut_under_readers_gives_no_wrong_answer(void **state)
{
    struct fixture *f = *state;
    static struct reader readers[2];
    for (int round = 0; round < 12; round++) {
        pthread_t threads[2];
        put_file(f);
        open_map(f);
        for (int i = 0; i < 2; i++) {
            memset(&readers[i], 0, sizeof readers[i]);
            readers[i].f = f;
            assert_int_equal(pthread_create(&threads[i], NULL, read_until_bad, &readers[i]), 0);
        }
        struct timespec pause = {.tv_nsec = 3000000 + round * 700000};
        nanosleep(&pause, NULL);
        if (round % 2 == 0) {
            long size = (long)(f->mapped.size * (size_t)(12 - round) / 13);
            assert_int_equal(truncate(folder_file(&f->folder, "a.umbm"), size), 0);
        } else {
            overwrite(f, (uint8_t)(round * 37));
        }
        for (int i = 0; i < 2; i++) {
            pthread_join(threads[i], NULL);
            assert_int_equal(readers[i].bad, 1);
            assert_int_equal(readers[i].wrong, 0);
        }
        umbs_asset_map_close(f->map);
        f->map = NULL;
    }
}

/* Reads as a calibration does, which runs on any thread and may be left midway. */
static void *allocate(void *user)
{
    const struct umb_alloc *alloc = user;
    void *held[8] = {NULL};
    for (size_t i = 0; i < 300000; i++) {
        void **place = &held[i % 8];
        *place = alloc->resize(alloc->user, *place, i % 3 == 2 ? 0 : 16 + i % 64);
    }
    for (size_t i = 0; i < 7; i++) { /* the last one is left to the map */
        held[i] = alloc->resize(alloc->user, held[i], 0);
    }
    return NULL;
}

static void asset_map_memory_is_had_from_many_threads_at_once(void **state)
{
    struct fixture *f = *state;
    pthread_t threads[4];
    open_map(f);
    const struct umb_alloc *alloc = umbs_asset_map_asset(f->map)->alloc;
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(pthread_create(&threads[i], NULL, allocate, (void *)(uintptr_t)alloc), 0);
    }
    for (size_t i = 0; i < 4; i++) {
        pthread_join(threads[i], NULL);
    }
    umbs_asset_map_close(f->map);
    f->map = NULL;
}

static void touch(void *user)
{
    *(volatile char *)user;
}

/* A fault outside every mapped file must still end the process, guarded or not. */
static void fault_guard_lets_foreign_faults_through(void **state)
{
    (void)state;
    char *page = mmap(NULL, 4096, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    assert_ptr_not_equal(page, MAP_FAILED);
    umbs_fault_guard_install();
    assert_int_equal(umbs_fault_guarded(page, 4096, touch, page + 4095), 0);
    assert_int_equal(umbs_fault_guarded(page, 4096, touch, &page), 1);
    for (int guarded = 0; guarded < 2; guarded++) {
        pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            signal(SIGSEGV, SIG_DFL); /* not cmocka's, which would go on with the tests */
            umbs_fault_guard_install();
            if (guarded) {
                (void)umbs_fault_guarded(page, 16, touch, page + 16);
            } else {
                touch(page);
            }
            _exit(0);
        }
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_false(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    }
    munmap(page, 4096);
}

#define WITH_MAP(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
    const struct CMUnitTest tests[] = {
        WITH_MAP(asset_map_answers_as_the_voxels_are),
        WITH_MAP(asset_map_cut_anywhere_fails_the_read_and_nothing_else),
        WITH_MAP(asset_map_overwritten_in_place_fails_the_read_and_nothing_else),
        WITH_MAP(asset_map_check_finds_what_the_times_hide),
        WITH_MAP(asset_map_deleted_or_replaced_goes_on),
        WITH_MAP(asset_map_copy_does_not_care_about_the_file),
        WITH_MAP(asset_map_known_file_is_checked_again_when_it_changed),
        WITH_MAP(asset_map_refuses_what_is_not_that_asset),
        WITH_MAP(asset_map_cut_under_readers_gives_no_wrong_answer),
        WITH_MAP(asset_map_memory_is_had_from_many_threads_at_once),
        cmocka_unit_test(fault_guard_lets_foreign_faults_through),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
