/* SPDX-License-Identifier: Apache-2.0 */
/* The store: adding, replacing, damage, retirement, cache, sweep. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include <sys/resource.h>

#include "base/compat.h"
#include "format/layout.h"
#include "store_fixture.h"

struct fixture {
    struct folder folder;
    struct umbs_store *store;
    struct umbs_store_report report;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    struct umbs_store_options options = {.folders = {f->folder.path}};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbs_store_close(f->store);
    folder_remove(&f->folder);
    free(f);
    return 0;
}

static void rescan(struct fixture *f)
{
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
}

static void cache_name(const uint8_t id[UMB_ID_BYTES], char name[128])
{
    char text[UMB_ID_TEXT_SIZE];
    umb_id_to_text(id, text);
    snprintf(name, 128, ".umbrage-cache/%s.umbm", text);
}

static void store_finds_an_asset_by_name_and_by_id(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    uint8_t id[UMB_ID_BYTES];
    char text[UMB_ID_TEXT_SIZE];
    struct umb_error error;
    folder_asset(&f->folder, "city.umb", 20, id);
    umb_id_to_text(id, text);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_E_NOT_FOUND);
    rescan(f);
    assert_int_equal(f->report.loaded, 1);
    const char *const names[2] = {"city", text};
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(umbs_store_acquire(f->store, names[i], &entry, &error), UMB_OK);
        assert_memory_equal(umbs_entry_item(entry)->id, id, UMB_ID_BYTES);
        assert_string_equal(umbs_entry_item(entry)->name, "city");
        assert_true(is_lit(umbs_entry_asset(entry), 10));
        assert_false(is_lit(umbs_entry_asset(entry), 40));
        umbs_entry_release(entry);
    }
    assert_int_equal(umbs_store_acquire(f->store, "town", &entry, &error), UMB_E_NOT_FOUND);
    assert_non_null(strstr(error.message, "town"));
    assert_null(entry);
}

static void store_queries_the_mapped_cache(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_asset_info info;
    uint8_t id[UMB_ID_BYTES];
    char name[128];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    cache_name(id, name);
    assert_true(folder_size(&f->folder, name) > 0);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_OK);
    umb_asset_get_info(umbs_entry_asset(entry), &info);
    assert_int_equal(info.encoding, UMB_ENCODING_MAPPED);
    umbs_entry_release(entry);
}

static void store_second_scan_keeps_the_same_version(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *first;
    struct umbs_entry *second;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &first, NULL), UMB_OK);
    rescan(f);
    assert_int_equal(f->report.unchanged, 1);
    assert_int_equal(f->report.loaded, 0);
    assert_int_equal(umbs_store_acquire(f->store, "city", &second, NULL), UMB_OK);
    assert_ptr_equal(first, second);
    umbs_entry_release(first);
    umbs_entry_release(second);
}

static void store_swap_leaves_the_held_version_alone(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *old;
    struct umbs_entry *fresh;
    uint8_t old_id[UMB_ID_BYTES];
    uint8_t new_id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, old_id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &old, NULL), UMB_OK);
    folder_asset(&f->folder, "city.umb", 50, new_id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &fresh, NULL), UMB_OK);
    assert_memory_equal(umbs_entry_item(old)->id, old_id, UMB_ID_BYTES);
    assert_memory_equal(umbs_entry_item(fresh)->id, new_id, UMB_ID_BYTES);
    assert_false(is_lit(umbs_entry_asset(old), 40));
    assert_true(is_lit(umbs_entry_asset(fresh), 40));
    umbs_entry_release(old);
    umbs_entry_release(fresh);
}

static void store_removed_file_is_not_found_but_a_holder_goes_on(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *held;
    struct umbs_entry *gone;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &held, NULL), UMB_OK);
    unlink(folder_file(&f->folder, "city.umb"));
    rescan(f);
    assert_int_equal(f->report.removed, 1);
    assert_int_equal(umbs_store_acquire(f->store, "city", &gone, NULL), UMB_E_NOT_FOUND);
    assert_true(is_lit(umbs_entry_asset(held), 10));
    umbs_entry_release(held);
}

static void store_damaged_file_fails_alone_and_says_why(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    struct umbs_store_counts counts;
    uint8_t bad_id[UMB_ID_BYTES];
    char text[UMB_ID_TEXT_SIZE];
    folder_asset(&f->folder, "bad.umb", 20, bad_id);
    folder_asset(&f->folder, "good.umb", 30, id);
    folder_flip(&f->folder, "bad.umb", folder_size(&f->folder, "bad.umb") - 5);
    rescan(f);
    assert_int_equal(f->report.loaded, 1);
    assert_int_equal(f->report.failed, 1);
    assert_int_equal(umbs_store_acquire(f->store, "bad", &entry, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "bad"));
    assert_null(entry);
    umb_id_to_text(bad_id, text); /* who asks by id hears the same */
    assert_int_equal(umbs_store_acquire(f->store, text, &entry, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "bad"));
    text[0] = text[0] == '0' ? '1' : '0';
    assert_int_equal(umbs_store_acquire(f->store, text, &entry, &error), UMB_E_NOT_FOUND);
    assert_int_equal(umbs_store_acquire(f->store, "good", &entry, &error), UMB_OK);
    umbs_entry_release(entry);
    umbs_store_count(f->store, &counts);
    assert_int_equal(counts.healthy, 1);
    assert_int_equal(counts.damaged, 1);
}

static void store_finds_each_of_many_damaged_files_by_its_id(void **state)
{
    struct fixture *f = *state;
    uint8_t ids[20][UMB_ID_BYTES];
    uint8_t again[UMB_ID_BYTES];
    char name[32];
    char text[UMB_ID_TEXT_SIZE];
    struct umbs_entry *entry;
    struct umb_error error;
    for (uint32_t i = 0; i < 20; i++) {
        snprintf(name, sizeof name, "a%u.umb", i);
        folder_asset(&f->folder, name, 10 + i, ids[i]);
        folder_flip(&f->folder, name, folder_size(&f->folder, name) - 5);
    }
    folder_asset(&f->folder, "a7-whole.umb", 17, again); /* a whole file of an id goes first */
    folder_asset(&f->folder, "z.umb", 13, again);        /* and of damaged ones the first name */
    folder_flip(&f->folder, "z.umb", folder_size(&f->folder, "z.umb") - 5);
    rescan(f);
    for (uint32_t i = 0; i < 20; i++) {
        umb_id_to_text(ids[i], text);
        const enum umb_status status = umbs_store_acquire(f->store, text, &entry, &error);
        assert_int_equal(status, i == 7 ? UMB_OK : UMB_E_CORRUPT);
        snprintf(name, sizeof name, "'a%u'", i);
        assert_true(i == 7 || strstr(error.message, name) != NULL);
        umbs_entry_release(entry);
    }
}

static void store_file_of_another_version_is_not_called_damaged(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "later.umb", 20, id);
    folder_flip(&f->folder, "later.umb", UMB__HEAD_VERSION);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "later", &entry, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "'later' cannot be read: version: 2.0"));
    assert_null(strstr(error.message, "damaged"));
}

static void store_partial_file_has_the_status_of_damage_and_its_own_reason(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "part.umb", 20, id);
    FILE *file = fopen(folder_file(&f->folder, "part.umb"), "r+b");
    assert_non_null(file);
    assert_int_equal(fwrite(UMB__MAGIC_PARTIAL, 1, 8, file), 8);
    assert_int_equal(fclose(file), 0);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "part", &entry, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "'part' cannot be read: magic: a partial file"));
}

struct look {
    const struct umb_asset *asset;
    int lit;
};

static void look_at(void *user)
{
    struct look *look = user;
    look->lit = is_lit(look->asset, 5);
}

static void count_fault(void *user)
{
    ++*(int *)user;
}

static void store_sets_a_cut_cache_aside_and_makes_it_anew(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    uint8_t other[UMB_ID_BYTES];
    char cache[128];
    struct umbs_store_counts counts;
    struct umbs_entry *entry;
    struct umbs_entry *late;
    struct umb_error error;
    int faults = 0;
    umbs_store_close(f->store);
    struct umbs_store_options options = {
        .folders = {f->folder.path}, .faulted = count_fault, .owner = &faults};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    folder_asset(&f->folder, "city.umb", 20, id);
    folder_asset(&f->folder, "other.umb", 30, other);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_OK);
    struct look look = {.asset = umbs_entry_asset(entry)};
    assert_int_equal(umbs_entry_read(entry, look_at, &look, &error), UMB_OK);
    assert_int_equal(look.lit, 1);
    cache_name(id, cache);
    assert_int_equal(umbs_entry_read_optimistic(entry, look_at, &look, &error), UMB_OK);
    assert_int_equal(umbs_entry_revalidate(entry, &error), UMB_OK);
    assert_int_equal(umbs_entry_read_optimistic(entry, look_at, &look, &error), UMB_OK);
    assert_int_equal(truncate(folder_file(&f->folder, cache), 100), 0);
    assert_int_equal(umbs_entry_revalidate(entry, &error), UMB_E_CORRUPT); /* of the peek before */
    assert_non_null(strstr(error.message, "city"));
    for (int i = 0; i < 2; i++) {
        assert_int_equal(umbs_entry_read(entry, look_at, &look, &error), UMB_E_CORRUPT);
        assert_non_null(strstr(error.message, "city"));
    }
    assert_int_equal(faults, 1);
    assert_int_equal(umbs_store_acquire(f->store, "city", &late, &error), UMB_E_CORRUPT);
    assert_int_equal(umbs_store_acquire(f->store, "other", &late, &error), UMB_OK);
    umbs_entry_release(late);
    umbs_store_count(f->store, &counts);
    assert_int_equal(counts.healthy, 1);
    assert_int_equal(counts.faults, 1);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &late, &error), UMB_OK);
    look.asset = umbs_entry_asset(late);
    assert_int_equal(umbs_entry_read(late, look_at, &look, &error), UMB_OK);
    assert_int_equal(look.lit, 1);
    umbs_entry_release(late);
    umbs_entry_release(entry);
}

static void store_young_damaged_replacement_keeps_the_old_version_until_settled(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    FILE *half = fopen(folder_file(&f->folder, "city.umb"), "wb");
    assert_non_null(half);
    fputs("half a copy", half);
    fclose(half);
    rescan(f);
    assert_int_equal(f->report.unsettled, 1);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_OK);
    umbs_entry_release(entry);
    folder_age(&f->folder, "city.umb", 10);
    rescan(f);
    assert_int_equal(f->report.unsettled, 0);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_E_CORRUPT);
    folder_asset(&f->folder, "city.umb", 30, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_OK);
    umbs_entry_release(entry);
}

static void store_short_of_memory_keeps_the_old_version(void **state)
{
    struct fixture *f = *state;
#if UMB__SANITIZED
    (void)f;
    skip(); /* a sanitizer needs its terabytes of address space */
#else
    struct umbs_entry *entry;
    struct umb_error error;
    struct rlimit limit;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    assert_int_equal(truncate(folder_file(&f->folder, "city.umb"), (off_t)8 << 30), 0); /* a hole */
    folder_age(&f->folder, "city.umb", 10);
    assert_int_equal(getrlimit(RLIMIT_AS, &limit), 0);
    struct rlimit less = {.rlim_cur = (rlim_t)4 << 30, .rlim_max = limit.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_AS, &less), 0);
    rescan(f);
    assert_int_equal(setrlimit(RLIMIT_AS, &limit), 0);
    assert_int_equal(f->report.failed, 1);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, &error), UMB_OK);
    assert_true(is_lit(umbs_entry_asset(entry), 10));
    umbs_entry_release(entry);
    folder_asset(&f->folder, "city.umb", 50, id);
    rescan(f);
    assert_int_equal(f->report.loaded, 1);
#endif
}

static void store_refuses_a_file_whose_id_is_not_its_content(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_error error;
    /* test_digest is not SHA-256: the checksums are right, but the id is wrong. */
    uint32_t height = 20;
    struct voxels voxels = {.lit = slab_lit, .user = &height, .log2_size = 6, .frustum_count = 1};
    const double origin[3] = {0, 0, 0};
    struct bytes packed = make_packed(&voxels, 1.0, origin);
    FILE *file = fopen(folder_file(&f->folder, "liar.umb"), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(packed.data, 1, packed.size, file), packed.size);
    fclose(file);
    bytes_finish(&packed);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "liar", &entry, &error), UMB_E_CORRUPT);
}

static void store_rebuilds_a_damaged_or_foreign_cache(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    uint8_t id[UMB_ID_BYTES];
    uint8_t other[UMB_ID_BYTES];
    char name[128];
    char other_name[128];
    char from[512];
    folder_asset(&f->folder, "city.umb", 20, id);
    folder_asset(&f->folder, "town.umb", 40, other);
    rescan(f);
    cache_name(id, name);
    cache_name(other, other_name);
    for (int round = 0; round < 2; round++) {
        umbs_store_close(f->store);
        if (round == 0) {
            folder_flip(&f->folder, name, folder_size(&f->folder, name) - 9);
        } else {
            snprintf(from, sizeof from, "%s/%s", f->folder.path, other_name);
            assert_int_equal(rename(from, folder_file(&f->folder, name)), 0);
        }
        struct umbs_store_options options = {.folders = {f->folder.path}};
        assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
        rescan(f);
        assert_int_equal(f->report.loaded, 2);
        assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_OK);
        assert_memory_equal(umbs_entry_item(entry)->id, id, UMB_ID_BYTES);
        assert_true(is_lit(umbs_entry_asset(entry), 10));
        assert_false(is_lit(umbs_entry_asset(entry), 30));
        umbs_entry_release(entry);
    }
}

static void store_without_a_writable_cache_expands_in_memory(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    struct umb_asset_info info;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    /* There is a file where the cache folder should be: creating it fails for root, too. */
    remove_tree(folder_file(&f->folder, ".umbrage-cache"));
    FILE *file = fopen(folder_file(&f->folder, ".umbrage-cache"), "wb");
    assert_non_null(file);
    fclose(file);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_OK);
    umb_asset_get_info(umbs_entry_asset(entry), &info);
    assert_int_equal(info.encoding, UMB_ENCODING_PACKED);
    assert_true(is_lit(umbs_entry_asset(entry), 10));
    umbs_entry_release(entry);
    /* Once the file is gone, the next asset has a mapped form again. */
    assert_int_equal(unlink(folder_file(&f->folder, ".umbrage-cache")), 0);
    folder_asset(&f->folder, "town.umb", 30, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "town", &entry, NULL), UMB_OK);
    umb_asset_get_info(umbs_entry_asset(entry), &info);
    assert_int_equal(info.encoding, UMB_ENCODING_MAPPED);
    umbs_entry_release(entry);
}

static void store_skips_names_and_kinds_that_are_no_assets(void **state)
{
    struct fixture *f = *state;
    struct umbs_store_item *items;
    size_t count;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "bad name.umb", 20, id);
    folder_asset(&f->folder, ".umb", 20, id);
    folder_asset(&f->folder, "city.umbx", 20, id);
    folder_asset(&f->folder, ".hidden.umb", 20, id);
    assert_int_equal(mkdir(folder_file(&f->folder, "folder.umb"), 0755), 0);
    assert_int_equal(mkfifo(folder_file(&f->folder, "fifo.umb"), 0644), 0);
    folder_asset(&f->folder, "b.umb", 21, id);
    folder_asset(&f->folder, "a-1_x.umb", 20, id);
    rescan(f);
    assert_int_equal(f->report.skipped, 1);
    assert_int_equal(umbs_store_list(f->store, &items, &count, NULL), UMB_OK);
    assert_int_equal(count, 2);
    assert_string_equal(items[0].name, "a-1_x");
    assert_string_equal(items[1].name, "b");
    assert_int_equal(items[0].light_count, 1);
    free(items);
}

static void store_sweeps_only_old_strays(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    char used[128];
    char unused[128];
    const uint8_t nobody[UMB_ID_BYTES] = {1, 2, 3};
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    cache_name(id, used);
    cache_name(nobody, unused);
    const char *const strays[] = {".tmp.old", ".tmp.young", unused, "notes.txt"};
    for (size_t i = 0; i < 4; i++) {
        FILE *file = fopen(folder_file(&f->folder, strays[i]), "wb");
        assert_non_null(file);
        fclose(file);
        if (i != 1) {
            folder_age(&f->folder, strays[i], 2 * UMBS_STORE_TEMPORARY_AGE_S);
        }
    }
    folder_age(&f->folder, used, 2 * UMBS_STORE_TEMPORARY_AGE_S);
    rescan(f);
    assert_int_equal(f->report.swept, 2);
    assert_int_equal(folder_size(&f->folder, ".tmp.old"), -1);
    assert_int_equal(folder_size(&f->folder, unused), -1);
    assert_int_equal(folder_size(&f->folder, ".tmp.young"), 0);
    assert_int_equal(folder_size(&f->folder, "notes.txt"), 0);
    assert_true(folder_size(&f->folder, used) > 0);
}

static void store_entry_outlives_the_store(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_OK);
    umbs_store_close(f->store);
    f->store = NULL;
    assert_true(is_lit(umbs_entry_asset(entry), 10));
    umbs_entry_release(entry);
}

static void count_call(void *user)
{
    atomic_fetch_add((atomic_int *)user, 1);
}

static void store_retired_version_waits_for_the_reaper(void **state)
{
    struct fixture *f = *state;
    struct umbs_entry *entry;
    atomic_int calls = 0;
    uint8_t id[UMB_ID_BYTES];
    umbs_store_close(f->store);
    struct umbs_store_options options = {
        .folders = {f->folder.path}, .retired = count_call, .owner = &calls};
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    assert_int_equal(umbs_store_acquire(f->store, "city", &entry, NULL), UMB_OK);
    unlink(folder_file(&f->folder, "city.umb"));
    rescan(f);
    assert_int_equal(atomic_load(&calls), 0);
    umbs_entry_release(entry);
    assert_int_equal(atomic_load(&calls), 1);
    umbs_store_reap(f->store);
}

struct reader {
    struct umbs_store *store;
    atomic_int *stop;
    atomic_uint answered;
    atomic_int failed;
};

/* An answer must be of exactly one of the two versions, and its id must be that version's. */
static void *read_on(void *argument)
{
    struct reader *reader = argument;
    while (!reader->failed && !atomic_load(reader->stop)) {
        struct umbs_entry *entry;
        if (umbs_store_acquire(reader->store, "city", &entry, NULL) != UMB_OK) {
            reader->failed = 1;
            break;
        }
        struct umb_asset_info info;
        umb_asset_get_info(umbs_entry_asset(entry), &info);
        reader->failed = memcmp(info.id, umbs_entry_item(entry)->id, UMB_ID_BYTES) != 0;
        umbs_entry_release(entry);
        reader->answered++;
    }
    return NULL;
}

static void store_swaps_under_readers_never_fail_a_look_up(void **state)
{
    struct fixture *f = *state;
    pthread_t threads[2];
    struct reader readers[2];
    atomic_int stop = 0;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "city.umb", 20, id);
    rescan(f);
    for (size_t i = 0; i < 2; i++) {
        readers[i] = (struct reader){.store = f->store, .stop = &stop};
        assert_int_equal(pthread_create(&threads[i], NULL, read_on, &readers[i]), 0);
    }
    for (uint32_t round = 0; round < 10; round++) {
        folder_asset(&f->folder, "city.umb", 20 + round % 2 * 20, id);
        for (size_t i = 0; i < 2; i++) { /* between two swaps, and on through this one */
            for (unsigned seen = readers[i].answered;
                 readers[i].answered == seen && !readers[i].failed;) {
                (void)sched_yield();
            }
        }
        rescan(f);
        assert_int_equal(f->report.loaded, 1);
    }
    atomic_store(&stop, 1);
    for (size_t i = 0; i < 2; i++) {
        pthread_join(threads[i], NULL);
        assert_false(readers[i].failed);
    }
}

static void store_open_fails_without_a_folder(void **state)
{
    struct umbs_store *store;
    struct umb_error error;
    struct umbs_store_options options = {.folders = {"/tmp/umbrage-no-such-folder"}};
    (void)state;
    assert_int_equal(umbs_store_open(&options, &store, &error), UMB_E_NO_INPUT);
    assert_null(store);
    assert_non_null(strstr(error.message, "umbrage-no-such-folder"));
}

static int is_replaced(const struct fixture *f)
{
    struct umbs_entry *entry = NULL;
    assert_int_equal(umbs_store_acquire(f->store, "a", &entry, NULL), UMB_OK);
    const int replaced = umbs_entry_is_replaced(entry);
    umbs_entry_release(entry);
    return replaced;
}

static void store_takes_a_replacement_back_that_failed(void **state)
{
    struct fixture *f = *state;
    uint8_t id[UMB_ID_BYTES];
    folder_asset(&f->folder, "a.umb", 20, id);
    rescan(f);
    assert_false(is_replaced(f));
    umbs_store_replacing(f->store, id, 1, 1); /* another folder's */
    assert_false(is_replaced(f));
    umbs_store_replacing(f->store, id, 0, 1);
    assert_true(is_replaced(f));
    umbs_store_replacing(f->store, id, 0, 0);
    assert_false(is_replaced(f));
}

static void store_without_a_cache_can_replace_a_file(void **state)
{
    struct fixture *f = *state;
    struct umbs_store_options options = {.folders = {f->folder.path}, .no_cache = 1};
    uint8_t id[UMB_ID_BYTES];
    umbs_store_close(f->store);
    assert_int_equal(umbs_store_open(&options, &f->store, NULL), UMB_OK);
    folder_asset(&f->folder, "a.umb", 20, id);
    rescan(f);
    umbs_store_replacing(f->store, id, 0, 1);
    assert_true(is_replaced(f));
}

int main(void)
{
#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_STORE(store_finds_an_asset_by_name_and_by_id),
        WITH_STORE(store_queries_the_mapped_cache),
        WITH_STORE(store_second_scan_keeps_the_same_version),
        WITH_STORE(store_swap_leaves_the_held_version_alone),
        WITH_STORE(store_removed_file_is_not_found_but_a_holder_goes_on),
        WITH_STORE(store_damaged_file_fails_alone_and_says_why),
        WITH_STORE(store_finds_each_of_many_damaged_files_by_its_id),
        WITH_STORE(store_file_of_another_version_is_not_called_damaged),
        WITH_STORE(store_partial_file_has_the_status_of_damage_and_its_own_reason),
        WITH_STORE(store_young_damaged_replacement_keeps_the_old_version_until_settled),
        WITH_STORE(store_short_of_memory_keeps_the_old_version),
        WITH_STORE(store_refuses_a_file_whose_id_is_not_its_content),
        WITH_STORE(store_rebuilds_a_damaged_or_foreign_cache),
        WITH_STORE(store_without_a_writable_cache_expands_in_memory),
        WITH_STORE(store_skips_names_and_kinds_that_are_no_assets),
        WITH_STORE(store_sweeps_only_old_strays),
        WITH_STORE(store_entry_outlives_the_store),
        WITH_STORE(store_retired_version_waits_for_the_reaper),
        WITH_STORE(store_swaps_under_readers_never_fail_a_look_up),
        WITH_STORE(store_sets_a_cut_cache_aside_and_makes_it_anew),
        WITH_STORE(store_takes_a_replacement_back_that_failed),
        WITH_STORE(store_without_a_cache_can_replace_a_file),
        cmocka_unit_test(store_open_fails_without_a_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
