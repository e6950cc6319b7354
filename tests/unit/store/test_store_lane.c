/* SPDX-License-Identifier: Apache-2.0 */
/* Large files are loaded beside the scan, by the "lane", within a limit of memory. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "store/store_internal.h"
#include "store_fixture.h"

struct fixture {
    struct folder folder;
    struct umbs_store *store;
    struct umbs_store_report report;
};

/* Large files load while it is open. */
static struct {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    int open, waiting, loads;
    int told; /* the owner was asked to rescan so often */
} gate = {.mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};

static struct umbs_entry *gated_load(struct umbs_store *store, const struct umbs_name *name,
                                     int rebuild)
{
    pthread_mutex_lock(&gate.mutex);
    gate.waiting++;
    pthread_cond_broadcast(&gate.changed);
    while (!gate.open) {
        pthread_cond_wait(&gate.changed, &gate.mutex);
    }
    gate.waiting--;
    gate.loads++;
    pthread_mutex_unlock(&gate.mutex);
    return umbs__entry_load(store, name, rebuild);
}

static void set_open(int open)
{
    pthread_mutex_lock(&gate.mutex);
    gate.open = open;
    pthread_cond_broadcast(&gate.changed);
    pthread_mutex_unlock(&gate.mutex);
}

static void wait_until_one_loads(void)
{
    pthread_mutex_lock(&gate.mutex);
    while (gate.waiting == 0) {
        pthread_cond_wait(&gate.changed, &gate.mutex);
    }
    pthread_mutex_unlock(&gate.mutex);
}

static void asked_to_rescan(void *user)
{
    (void)user;
    pthread_mutex_lock(&gate.mutex);
    gate.told++;
    pthread_cond_broadcast(&gate.changed);
    pthread_mutex_unlock(&gate.mutex);
}

static void wait_until_told(int times)
{
    pthread_mutex_lock(&gate.mutex);
    while (gate.told < times) {
        pthread_cond_wait(&gate.changed, &gate.mutex);
    }
    pthread_mutex_unlock(&gate.mutex);
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    struct umbs_store_options options = {.folders = {f->folder.path}, .faulted = asked_to_rescan};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    f->store->lane.load = gated_load;
    gate.open = gate.waiting = gate.loads = gate.told = 0;
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    set_open(1);
    assert_int_equal(umbs_store_lane_stop(f->store, 60000), 1);
    umbs_store_close(f->store);
    folder_remove(&f->folder);
    free(f);
    return 0;
}

static void rescan(struct fixture *f)
{
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
}

/* Returns the height up to which the asset is lit, out of those that tests use; 0: there is no
 * asset. */
static int height_of(struct fixture *f, const char *name)
{
    struct umbs_entry *entry;
    int height = 0;
    if (umbs_store_acquire(f->store, name, &entry, NULL) == UMB_OK) {
        for (int z = 8; z < 64 && is_lit(umbs_entry_asset(entry), (float)z); z += 8) {
            height = z;
        }
        umbs_entry_release(entry);
    }
    return height;
}

static void put(struct fixture *f, const char *name, uint32_t height)
{
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, name, height, id);
}

#define SMALL_BYTES 100

/* From here on all files except small ones are for the lane. */
static void start_lane(struct fixture *f)
{
    assert_int_equal(umbs_store_lane_start(f->store, SMALL_BYTES + 1, NULL), UMB_OK);
}

/* A file that the scan loads itself: the beginning of an asset, which counts as damage. */
static void put_small(struct fixture *f, const char *name)
{
    put(f, name, 20);
    assert_int_equal(truncate(folder_file(&f->folder, name), SMALL_BYTES), 0);
}

static void scan_goes_on_while_a_large_file_loads(void **state)
{
    struct fixture *f = *state;
    put(f, "large.umb", 20);
    rescan(f);
    assert_int_equal(height_of(f, "large"), 16);
    start_lane(f);
    put(f, "large.umb", 44);
    rescan(f);
    wait_until_one_loads();
    assert_int_equal(height_of(f, "large"), 16); /* the old version answers meanwhile */
    put_small(f, "small.umb");
    rescan(f); /* would not come back if it waited */
    assert_int_equal(f->report.failed, 1);
    struct umbs_entry *entry;
    assert_int_equal(umbs_store_acquire(f->store, "small", &entry, NULL), UMB_E_CORRUPT);
    set_open(1);
    wait_until_told(1);
    rescan(f);
    assert_int_equal(f->report.loaded, 1);
    assert_int_equal(height_of(f, "large"), 40);
    assert_int_equal(gate.loads, 1);
}

static void large_files_load_one_after_the_other(void **state)
{
    struct fixture *f = *state;
    put(f, "one.umb", 20);
    start_lane(f);
    put(f, "three.umb", 44);
    put(f, "two.umb", 36);
    rescan(f);
    wait_until_one_loads();
    assert_int_equal(gate.waiting, 1);
    set_open(1);
    for (int i = 1; i <= 3; i++) {
        wait_until_told(i);
        rescan(f);
    }
    assert_int_equal(height_of(f, "one"), 16);
    assert_int_equal(height_of(f, "two"), 32);
    assert_int_equal(height_of(f, "three"), 40);
}

static void file_that_went_or_changed_while_it_loaded_holds_up_no_other(void **state)
{
    struct fixture *f = *state;
    put(f, "gone.umb", 20);
    start_lane(f);
    put(f, "other.umb", 44);
    rescan(f);
    wait_until_one_loads();
    assert_int_equal(unlink(folder_file(&f->folder, "gone.umb")), 0);
    set_open(1);
    wait_until_told(1);
    rescan(f); /* drops what nothing asks for, and gives the lane the other one */
    wait_until_told(2);
    set_open(0);
    rescan(f);
    assert_int_equal(height_of(f, "gone"), 0);
    assert_int_equal(height_of(f, "other"), 40);
    put(f, "other.umb", 20);
    rescan(f);
    wait_until_one_loads();
    put(f, "other.umb", 28);
    set_open(1);
    wait_until_told(3);
    rescan(f);
    assert_int_equal(height_of(f, "other"), 24); /* read as it was when its turn came */
}

static void file_that_changes_without_end_leaves_the_lane_to_others(void **state)
{
    struct fixture *f = *state;
    put(f, "always.umb", 20);
    put(f, "other.umb", 44);
    start_lane(f);
    rescan(f);
    wait_until_one_loads();
    assert_string_equal(f->store->lane.name.text, "always");
    set_open(1);
    wait_until_told(1);
    put(f, "always.umb", 28); /* what was loaded is stale */
    set_open(0);
    rescan(f);
    wait_until_one_loads();
    assert_string_equal(f->store->lane.name.text, "other");
    set_open(1);
    wait_until_told(2);
    rescan(f);
    assert_int_equal(height_of(f, "other"), 40);
    wait_until_told(3); /* now it has its turn, and another when nothing else waits */
    put(f, "always.umb", 36);
    rescan(f);
    wait_until_told(4);
    rescan(f);
    assert_int_equal(height_of(f, "always"), 32);
}

static void lane_that_loads_is_not_waited_for_without_end(void **state)
{
    struct fixture *f = *state;
    put(f, "large.umb", 20);
    start_lane(f);
    rescan(f);
    wait_until_one_loads();
    assert_int_equal(umbs_store_lane_stop(f->store, 10), 0);
}

static void asset_beyond_the_memory_of_a_load_is_refused_with_the_option(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    put(f, "city.umb", 20);
    rescan(f);
    assert_int_equal(height_of(f, "city"), 16);
    const uint64_t packed = (uint64_t)folder_size(&f->folder, "city.umb");
    const uint64_t limits[] = {packed - 1, packed, packed + 100};
    for (size_t i = 0; i < 3; i++) {
        f->store->options.max_memory_bytes = limits[i];
        static const char *const names[] = {"file.umb", "beside.umb", "expanded.umb"};
        remove_tree(folder_file(&f->folder, ".umbrage-cache"));
        assert_int_equal(unlink(folder_file(&f->folder, i == 0 ? "city.umb" : names[i - 1])), 0);
        rescan(f);
        put(f, names[i], 20);
        rescan(f);
        char name[32];
        snprintf(name, sizeof name, "%.*s", (int)(strlen(names[i]) - 4), names[i]);
        assert_int_equal(umbs_store_acquire(f->store, name, &entry, &error), UMB_E_CORRUPT);
        assert_non_null(strstr(error.message, "--load-memory"));
    }
}

int main(void)
{
#define LANE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        LANE_TEST(scan_goes_on_while_a_large_file_loads),
        LANE_TEST(large_files_load_one_after_the_other),
        LANE_TEST(file_that_went_or_changed_while_it_loaded_holds_up_no_other),
        LANE_TEST(file_that_changes_without_end_leaves_the_lane_to_others),
        LANE_TEST(lane_that_loads_is_not_waited_for_without_end),
        LANE_TEST(asset_beyond_the_memory_of_a_load_is_refused_with_the_option),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
