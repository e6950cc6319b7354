/* SPDX-License-Identifier: Apache-2.0 */
/* The store: assets known from earlier runs, names in several folders, and repeated checks. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "store_fixture.h"

struct fixture {
    struct folder folder;
    struct umbs_store_options options;
    struct umbs_store_report report;
    struct umbs_store *store;
    struct umbs_log log; /* to a file */
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    int fd = open(folder_file(&f->folder, "log"), O_RDWR | O_CREAT | O_APPEND, 0600);
    assert_true(fd >= 0);
    umbs_log_init(&f->log, fd, UMB_LOG_INFO);
    f->options = (struct umbs_store_options){.folders = {f->folder.path}, .log = &f->log};
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbs_store_close(f->store);
    close(f->log.fd);
    folder_remove(&f->folder);
    free(f);
    return 0;
}

/* Opens the store anew and scans it, with an empty log. */
static void reopen(struct fixture *f)
{
    umbs_store_close(f->store);
    assert_int_equal(ftruncate(f->log.fd, 0), 0);
    assert_int_equal(umbs_store_open(&f->options, &f->store, NULL), UMB_OK);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
}

/* 1 if the log has a line with both words. */
static int logged(struct fixture *f, const char *word, const char *other)
{
    char line[UMBS_LOG_LINE_MAX];
    int found = 0;
    FILE *file = fopen(folder_file(&f->folder, "log"), "r");
    assert_non_null(file);
    while (!found && fgets(line, sizeof line, file) != NULL) {
        found = strstr(line, word) != NULL && strstr(line, other) != NULL;
    }
    fclose(file);
    return found;
}

/* Returns the surface height of the asset that a name answers with: 1 is lit at depth z. */
static int name_is_lit(struct fixture *f, const char *name, float z)
{
    struct umbs_entry *entry;
    struct umb_error error;
    if (umbs_store_acquire(f->store, name, &entry, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    int lit = is_lit(umbs_entry_asset(entry), z);
    umbs_entry_release(entry);
    return lit;
}

static void cache_name(const uint8_t id[UMB_ID_BYTES], char name[128])
{
    char text[UMB_ID_TEXT_SIZE];
    umb_id_to_text(id, text);
    snprintf(name, 128, ".umbrage-cache/%s.umbm", text);
}

static void store_opens_a_known_asset_without_proving_it(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
    for (int i = 0; i < 2; i++) {
        reopen(f);
        assert_int_equal(f->report.loaded, 1);
        assert_true(logged(f, "asset=city", "how=known"));
        assert_true(name_is_lit(f, "city", 5));
        assert_false(name_is_lit(f, "city", 40));
    }
}

static void store_proves_anew_what_changed_in_any_way(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    char cache[128];
    folder_asset(&f->folder, "city.umb", 20, id);
    reopen(f);
    folder_age(&f->folder, "city.umb", 100); /* a time alone */
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
    folder_asset(&f->folder, "city.umb", 40, id);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
    assert_true(name_is_lit(f, "city", 30));
    cache_name(id, cache);
    folder_flip(&f->folder, cache, folder_size(&f->folder, cache) - 100);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
    assert_true(logged(f, "cache_rebuilt", "asset=city"));
    assert_true(name_is_lit(f, "city", 30));
    assert_int_equal(unlink(folder_file(&f->folder, cache)), 0);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
}

static void store_with_a_damaged_list_proves_and_writes_it_anew(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    reopen(f);
    folder_flip(&f->folder, ".umbrage-cache/proven", 70);
    reopen(f);
    assert_true(logged(f, "proven_forgotten", "reason"));
    assert_true(logged(f, "asset=city", "how=proven"));
    reopen(f);
    assert_true(logged(f, "asset=city", "how=known"));
}

static void store_serves_folders_further_down_and_links_as_names(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    uint8_t newer[UMB_ID_BYTES];
    struct umbs_entry *entry;
    assert_int_equal(mkdir(folder_file(&f->folder, "city"), 0755), 0);
    assert_int_equal(mkdir(folder_file(&f->folder, "city/below"), 0755), 0);
    folder_asset(&f->folder, "city/v1.umb", 20, id);
    folder_asset(&f->folder, "city/v2.umb", 40, newer);
    folder_asset(&f->folder, "city/below/v3.umb", 50, newer);
    assert_int_equal(symlink("v1.umb", folder_file(&f->folder, "city/latest.umb")), 0);
    reopen(f);
    assert_int_equal(f->report.loaded, 3);
    assert_false(name_is_lit(f, "city/latest", 30));
    assert_int_equal(umbs_store_acquire(f->store, "v3", &entry, NULL), UMB_E_NOT_FOUND);
    assert_int_equal(umbs_store_acquire(f->store, "city/below/v3", &entry, NULL), UMB_E_NOT_FOUND);
    /* Only the first name of a file must be proven. */
    assert_true(logged(f, "asset=city/v1", "how=known") !=
                logged(f, "asset=city/latest", "how=known"));
    assert_int_equal(symlink("v2.umb", folder_file(&f->folder, "city/.next")), 0);
    char next[512];
    snprintf(next, sizeof next, "%s", folder_file(&f->folder, "city/.next"));
    assert_int_equal(rename(next, folder_file(&f->folder, "city/latest.umb")), 0);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    assert_int_equal(f->report.loaded, 1);
    assert_int_equal(f->report.unchanged, 2);
    assert_true(name_is_lit(f, "city/latest", 30));
}

static void store_of_two_folders_serves_the_first_of_a_name(void **state)
{
    struct fixture *f = *state;
    struct folder second;
    uint8_t id[UMB_ID_BYTES];
    folder_make(&second);
    folder_asset(&f->folder, "both.umb", 20, id);
    folder_asset(&second, "both.umb", 40, id);
    folder_asset(&second, "only.umb", 40, id);
    f->options.folders[1] = second.path;
    reopen(f);
    assert_int_equal(f->report.loaded, 2);
    assert_int_equal(f->report.shadowed, 1);
    assert_false(name_is_lit(f, "both", 30));
    assert_true(name_is_lit(f, "only", 30));
    assert_int_equal(unlink(folder_file(&f->folder, "both.umb")), 0);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    assert_true(name_is_lit(f, "both", 30));
    reopen(f);
    assert_true(logged(f, "asset=both", "how=known"));
    umbs_store_close(f->store);
    f->store = NULL;
    folder_remove(&second);
}

static void store_scrub_finds_what_times_hide_and_the_scan_heals_it(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    char cache[128];
    struct stat before;
    struct umbs_entry *entry;
    struct umbs_store_counts counts;
    uint64_t bytes;
    folder_asset(&f->folder, "city.umb", 20, id);
    cache_name(id, cache);
    reopen(f);
    assert_int_equal(umbs_store_scrub(f->store, 3600000, &bytes), 0); /* proven just now */
    reopen(f);                                                        /* known: not read yet */
    assert_int_equal(umbs_store_scrub(f->store, 3600000, &bytes), 1);
    assert_int_equal(bytes, folder_size(&f->folder, cache));
    assert_int_equal(umbs_store_scrub(f->store, 3600000, &bytes), 0);
    assert_int_equal(umbs_store_scrub(f->store, 0, &bytes), 1);
    umbs_store_count(f->store, &counts);
    assert_int_equal(counts.scrubbed, 2);
    assert_int_equal(counts.healthy, 1);
    assert_int_equal(stat(folder_file(&f->folder, cache), &before), 0);
    folder_flip(&f->folder, cache, folder_size(&f->folder, cache) - 100);
    struct timespec times[2] = {before.st_atim, before.st_mtim};
    assert_int_equal(utimensat(AT_FDCWD, folder_file(&f->folder, cache), times, 0), 0);
    assert_int_equal(umbs_store_scrub(f->store, 0, &bytes), 1);
    assert_true(logged(f, "asset_quarantined", "asset=city"));
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_E_CORRUPT);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    assert_int_equal(f->report.loaded, 1);
    assert_true(name_is_lit(f, "city", 5));
    f->options.copy = 1;
    reopen(f);
    assert_true(name_is_lit(f, "city", 5));
    assert_int_equal(umbs_store_scrub(f->store, 0, &bytes), 0); /* a copy needs none */
}

#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
    const struct CMUnitTest tests[] = {
        WITH_STORE(store_opens_a_known_asset_without_proving_it),
        WITH_STORE(store_proves_anew_what_changed_in_any_way),
        WITH_STORE(store_with_a_damaged_list_proves_and_writes_it_anew),
        WITH_STORE(store_serves_folders_further_down_and_links_as_names),
        WITH_STORE(store_of_two_folders_serves_the_first_of_a_name),
        WITH_STORE(store_scrub_finds_what_times_hide_and_the_scan_heals_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
