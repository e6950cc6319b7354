/* SPDX-License-Identifier: Apache-2.0 */
/* The folder of mapped files: only files that the daemon wrote may be used. */
#define _GNU_SOURCE /* syncfs */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <poll.h>
#include <semaphore.h>
#include <sys/syscall.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "store/store_internal.h"
#include "store/store_record.h"
#include "format/layout.h"
#include "store_fixture.h"

struct fixture {
    struct folder folder; /* log, store, cache */
    char store_path[80], cache_path[80];
    struct umbs_store_options options;
    struct umbs_store_report report;
    struct umbs_store *store;
    struct umbs_log log;
    uint8_t city[UMB_ID_BYTES], other[UMB_ID_BYTES];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    int fd = open(folder_file(&f->folder, "log"), O_RDWR | O_CREAT | O_APPEND, 0600);
    assert_true(fd >= 0);
    umbs_log_init(&f->log, fd, UMB_LOG_INFO);
    snprintf(f->store_path, sizeof f->store_path, "%s/store", f->folder.path);
    snprintf(f->cache_path, sizeof f->cache_path, "%s/cache", f->folder.path);
    assert_int_equal(mkdir(f->store_path, 0755), 0);
    f->options = (struct umbs_store_options){
        .folders = {f->store_path}, .cache = f->cache_path, .log = &f->log};
    folder_asset(&f->folder, "store/city.umb", 20, f->city);
    folder_asset(&f->folder, "store/other.umb", 40, f->other);
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

static void reopen(struct fixture *f)
{
    struct umb_error error;
    umbs_store_close(f->store);
    assert_int_equal(ftruncate(f->log.fd, 0), 0);
    if (umbs_store_open(&f->options, &f->store, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
}

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

/* The asset "city" is lit up to 20, the other one up to 40. */
static void city_answers_as_it_should(struct fixture *f, enum umb_encoding encoding)
{
    struct umbs_entry *entry;
    struct umb_asset_info info;
    struct umb_error error;
    if (umbs_store_acquire(f->store, "city", &entry, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    assert_memory_equal(umbs_entry_item(entry)->id, f->city, UMB_ID_BYTES);
    assert_true(is_lit(umbs_entry_asset(entry), 10));
    assert_false(is_lit(umbs_entry_asset(entry), 30));
    umb_asset_get_info(umbs_entry_asset(entry), &info);
    assert_int_equal(info.encoding, encoding);
    umbs_entry_release(entry);
}

static const char *mapped_file(struct fixture *f, const uint8_t id[UMB_ID_BYTES])
{
    char text[UMB_ID_TEXT_SIZE];
    char name[128];
    umb_id_to_text(id, text);
    snprintf(name, sizeof name, "cache/%s.umbm", text);
    return folder_file(&f->folder, name);
}

static struct bytes read_file(const char *path)
{
    struct bytes bytes = {0};
    struct umb_sink sink = bytes_sink(&bytes);
    char piece[4096];
    size_t count;
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    while ((count = fread(piece, 1, sizeof piece, file)) > 0) {
        assert_int_equal(sink.write(sink.user, piece, count), UMB_OK);
    }
    fclose(file);
    return bytes;
}

static void write_file(const char *path, const struct bytes *bytes)
{
    FILE *file = fopen(path, "r+b"); /* in place, with the inode and the mode that it has */
    assert_non_null(file);
    assert_int_equal(fwrite(bytes->data, 1, bytes->size, file), bytes->size);
    assert_int_equal(ftruncate(fileno(file), (off_t)bytes->size), 0);
    assert_int_equal(fclose(file), 0);
}

/* The other asset's complete and valid mapped form, under the name of city's. */
static struct bytes forged_city(struct fixture *f)
{
    struct bytes bytes = read_file(mapped_file(f, f->other));
    uint64_t parts[2];
    uint8_t both[16];
    memcpy(bytes.data + UMB__HEAD_ID, f->city, UMB_ID_BYTES);
    parts[0] = XXH3_64bits(bytes.data, UMB__HEAD_CHECK);
    parts[1] = XXH3_64bits(bytes.data + UMB__HEAD_SIZE,
                           (size_t)(umb__load64(bytes.data + UMB__HEAD_LENGTH) - UMB__HEAD_SIZE));
    umb__store64(both, parts[0]);
    umb__store64(both + 8, parts[1]);
    umb__store64(bytes.data + UMB__HEAD_CHECK, XXH3_64bits(both, sizeof both));
    return bytes;
}

static void cache_of_its_own_is_private_and_opens_known_assets_at_once(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    const mode_t before = umask(0);
    reopen(f);
    (void)umask(before);
    assert_int_equal(stat(f->cache_path, &facts), 0);
    assert_int_equal(facts.st_mode & 07777, 0700);
    static const char *const names[] = {"cache/key", "cache/proven", "cache/lock"};
    for (size_t i = 0; i < 3; i++) {
        assert_int_equal(stat(folder_file(&f->folder, names[i]), &facts), 0);
        assert_int_equal(facts.st_mode & 07777, 0600);
    }
    assert_int_equal(stat(mapped_file(f, f->city), &facts), 0);
    assert_int_equal(facts.st_mode & 07777, 0600);
    assert_int_not_equal(access(folder_file(&f->folder, "store/.umbrage-cache"), F_OK), 0);
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=known"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
}

static void cache_file_of_another_asset_under_its_id_is_made_anew(void **state)
{
    struct fixture *f = *state;
    reopen(f);
    struct bytes forged = forged_city(f);
    struct umbs_asset_map_options options = {0};
    struct umbs_asset_map *map;
    umbs_store_close(f->store);
    f->store = NULL;
    write_file(mapped_file(f, f->city), &forged);
    /* By itself it is a whole mapped file of city. */
    memcpy(options.id, f->city, UMB_ID_BYTES);
    assert_int_equal(umbs_asset_map_open(mapped_file(f, f->city), &options, &map, NULL), UMB_OK);
    assert_true(is_lit(umbs_asset_map_asset(map), 30));
    umbs_asset_map_close(map);
    reopen(f);
    assert_true(logged(f, "cache_rebuilt", "not the one that was made for this asset"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    bytes_finish(&forged);
}

static void list_that_was_not_written_under_the_key_is_not_believed(void **state)
{
    struct fixture *f = *state;
    struct umbs_records records = {0};
    struct umbs_record record;
    struct umb_error error;
    struct stat facts;
    static const uint8_t guess[UMBS_KEY_BYTES] = {0};
    reopen(f);
    struct bytes forged = forged_city(f);
    umbs_store_close(f->store);
    f->store = NULL;
    write_file(mapped_file(f, f->city), &forged);
    assert_int_equal(stat(folder_file(&f->folder, "store/city.umb"), &facts), 0);
    record.packed = umbs_stamp_of(&facts);
    assert_int_equal(stat(mapped_file(f, f->city), &facts), 0);
    record.mapped = umbs_stamp_of(&facts);
    memcpy(record.id, f->city, UMB_ID_BYTES);
    umbs_sha256_bytes(forged.data, forged.size, record.digest);
    assert_int_equal(umbs__records_add(&records, &record), UMB_OK);
    assert_int_equal(
        umbs__records_write(folder_file(&f->folder, "cache/proven"), guess, &records, &error),
        UMB_OK);
    reopen(f);
    assert_true(logged(f, "proven_forgotten", "1 lines were not written under this key"));
    assert_true(logged(f, "cache_rebuilt", "no line under the cache's key"));
    assert_true(logged(f, "asset=city", "how=proven"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    umbs__records_finish(&records);
    bytes_finish(&forged);
}

static void scrub_holds_a_mapped_file_against_what_was_recorded(void **state)
{
    struct fixture *f = *state;
    struct stat before;
    uint64_t bytes;
    reopen(f);
    struct bytes forged = forged_city(f);
    reopen(f);
    assert_int_equal(stat(mapped_file(f, f->city), &before), 0);
    assert_int_equal(before.st_size, forged.size);
    write_file(mapped_file(f, f->city), &forged);
    struct timespec times[2] = {before.st_atim, before.st_mtim};
    assert_int_equal(utimensat(AT_FDCWD, mapped_file(f, f->city), times, 0), 0);
    for (int i = 0; i < 2; i++) {
        (void)umbs_store_scrub(f->store, 0, &bytes);
    }
    assert_true(logged(f, "asset_quarantined", "asset=city"));
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    bytes_finish(&forged);
}

static void cache_that_others_can_change_is_refused(void **state)
{
    struct fixture *f = *state;
    struct umb_error error;
    char real[100];
    assert_int_equal(mkdir(f->cache_path, 0700), 0);
    assert_int_equal(chmod(f->cache_path, 0770), 0);
    assert_int_equal(umbs_store_open(&f->options, &f->store, &error), UMB_E_PERMISSION);
    assert_non_null(strstr(error.message, "--cache"));
    assert_non_null(strstr(error.message, "0770"));
    /* Also refused: a cache below a folder that others can replace, and one behind a link to such a
     * folder. */
    assert_int_equal(chmod(f->cache_path, 0700), 0);
    assert_int_equal(chmod(f->folder.path, 0775), 0);
    assert_int_equal(umbs_store_open(&f->options, &f->store, &error), UMB_E_PERMISSION);
    assert_non_null(strstr(error.message, "0775"));
    assert_int_equal(chmod(f->folder.path, 0700), 0);
    snprintf(real, sizeof real, "%s.real", f->cache_path);
    assert_int_equal(rename(f->cache_path, real), 0);
    assert_int_equal(symlink(real, f->cache_path), 0);
    assert_int_equal(chmod(real, 0777), 0);
    assert_int_equal(umbs_store_open(&f->options, &f->store, &error), UMB_E_PERMISSION);
    assert_int_equal(chmod(real, 0700), 0);
    if (geteuid() == 0) {
        assert_int_equal(chown(real, 1234, 1234), 0);
        assert_int_equal(umbs_store_open(&f->options, &f->store, &error), UMB_E_PERMISSION);
        assert_non_null(strstr(error.message, "uid 1234"));
        assert_int_equal(chown(real, 0, 0), 0);
    }
    reopen(f); /* now it is ours alone */
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
}

static void cache_in_a_store_that_a_group_may_write_to_is_not_used(void **state)
{
    struct fixture *f = *state;
    f->options.cache = NULL;
    assert_int_equal(chmod(f->store_path, 02775), 0);
    reopen(f);
    assert_true(logged(f, "cache_refused", "other users can change"));
    city_answers_as_it_should(f, UMB_ENCODING_PACKED);
    assert_int_equal(chmod(f->store_path, 0755), 0);
    reopen(f);
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    /* The folder becomes unsafe while the store is open. */
    assert_int_equal(chmod(f->store_path, 0775), 0);
    folder_asset(&f->folder, "store/city.umb", 22, f->city);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    city_answers_as_it_should(f, UMB_ENCODING_PACKED);
}

static void links_in_the_cache_are_not_followed(void **state)
{
    struct fixture *f = *state;
    char path[512], aside[512];
    reopen(f);
    /* A second hard link: another process may hold the file by it. */
    snprintf(path, sizeof path, "%s", mapped_file(f, f->city));
    snprintf(aside, sizeof aside, "%s", folder_file(&f->folder, "aside"));
    assert_int_equal(link(path, aside), 0);
    reopen(f);
    assert_true(logged(f, "cache_rebuilt", "second name"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    /* A symbolic link to the same bytes. */
    assert_int_equal(unlink(aside), 0);
    assert_int_equal(rename(path, aside), 0);
    assert_int_equal(symlink(aside, path), 0);
    reopen(f);
    assert_true(logged(f, "asset=city", "how=proven"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    struct stat facts;
    assert_int_equal(lstat(path, &facts), 0);
    assert_true(S_ISREG(facts.st_mode));
    /* A file that others may write to. */
    assert_int_equal(chmod(path, 0620), 0);
    reopen(f);
    assert_true(logged(f, "cache_rebuilt", "other users may write to it"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
}

static void key_that_others_may_know_is_renewed(void **state)
{
    struct fixture *f = *state;
    static const mode_t modes[] = {0640, 0602, 0600};
    reopen(f);
    for (size_t i = 0; i < 3; i++) {
        assert_int_equal(chmod(folder_file(&f->folder, "cache/key"), modes[i]), 0);
        if (modes[i] == 0600) {
            assert_int_equal(truncate(folder_file(&f->folder, "cache/key"), 31), 0);
        }
        reopen(f);
        assert_true(logged(f, "cache_key_renewed", "is not a key of 32 bytes"));
        assert_true(logged(f, "asset=city", "how=proven"));
        city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
        assert_int_equal(folder_size(&f->folder, "cache/key"), 32);
    }
    reopen(f);
    assert_true(logged(f, "asset=city", "how=known"));
}

static void second_store_reads_what_the_first_wrote_and_writes_nothing(void **state)
{
    struct fixture *f = *state;
    struct umbs_store *first;
    uint8_t id[UMB_ID_BYTES];
    reopen(f);
    first = f->store;
    f->store = NULL;
    reopen(f);
    assert_true(logged(f, "cache_shared", "another daemon, pid "));
    assert_true(logged(f, "asset=city", "how=known"));
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    /* An asset that only the second store has seen stays in its memory. */
    folder_asset(&f->folder, "store/city.umb", 21, f->city);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    city_answers_as_it_should(f, UMB_ENCODING_PACKED);
    assert_int_not_equal(access(mapped_file(f, f->city), F_OK), 0);
    /* The first store writes the file. The second finds it there, and writes when the first is
     * gone. */
    assert_int_equal(umbs_store_rescan(first, &f->report, NULL), UMB_OK);
    struct umbs_store *second = f->store;
    f->store = NULL;
    reopen(f);
    city_answers_as_it_should(f, UMB_ENCODING_MAPPED);
    umbs_store_close(first);
    folder_asset(&f->folder, "store/town.umb", 33, id);
    assert_int_equal(umbs_store_rescan(second, &f->report, NULL), UMB_OK);
    assert_int_equal(access(mapped_file(f, id), F_OK), 0);
    umbs_store_close(second);
}

/* A thread of the lane that finds the cache's folder removed again and again. */
struct renewal {
    struct fixture *f;
    atomic_int stop;
    int renewed;
};

static void *renew_the_cache(void *user)
{
    struct renewal *renewal = user;
    struct umbs_cache *cache = &renewal->f->store->caches[0];
    char lock[120];
    struct umb_error error;
    snprintf(lock, sizeof lock, "%s/lock", renewal->f->cache_path);
    for (int i = 0; i < 300; i++) {
        (void)unlink(lock);
        renewal->renewed += umbs__cache_ready(cache, NULL, &error) == UMB_OK;
    }
    atomic_store(&renewal->stop, 1);
    return NULL;
}

/* Sees its fault with a sanitizer. */
static void cache_may_be_made_anew_while_a_scan_sweeps(void **state)
{
    struct fixture *f = *state;
    struct renewal renewal = {.f = f};
    pthread_t lane;
    reopen(f);
    folder_asset(&f->folder, "cache/.tmp.stray", 20, f->other);
    folder_age(&f->folder, "cache/.tmp.stray", 2 * UMBS_STORE_TEMPORARY_AGE_S);
    assert_int_equal(pthread_create(&lane, NULL, renew_the_cache, &renewal), 0);
    size_t swept = 0;
    while (!atomic_load(&renewal.stop)) {
        swept += umbs__store_sweep(f->store, f->store->table);
    }
    pthread_join(lane, NULL);
    swept += umbs__store_sweep(f->store, f->store->table);
    assert_int_equal(swept, 1);
    assert_int_equal(renewal.renewed, 300);
}

/* Imitates a slow disk during a sync of the cache: syncfs waits until the test lets it go on. */
static struct {
    atomic_int held, entered, failing, calls;
    sem_t go;
} disk;

/* In place of the C library's. */
int syncfs(int fd)
{
    atomic_fetch_add(&disk.calls, 1);
    if (atomic_load(&disk.held)) {
        atomic_store(&disk.entered, 1);
        sem_wait(&disk.go);
    }
    if (atomic_load(&disk.failing)) {
        errno = EIO;
        return -1;
    }
    return (int)syscall(SYS_syncfs, fd);
}

static void *rescan(void *user)
{
    struct fixture *f = user;
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    return NULL;
}

/* Imitates what the job thread does before it publishes an asset, and what the lane does to load
 * one. */
struct asking {
    struct fixture *f;
    atomic_int done;
};

static void *ask_the_cache(void *user)
{
    struct asking *asking = user;
    struct umbs_cache *cache = &asking->f->store->caches[0];
    struct umb_error error;
    char path[UMBS_PATH_SIZE];
    umbs_store_replacing(asking->f->store, asking->f->city, 0, 1);
    assert_int_equal(umbs__cache_ready(cache, NULL, &error), UMB_OK);
    assert_true(umbs__cache_own_folder(cache, path));
    umbs__cache_made(cache, 0); /* the lane made a file meanwhile */
    atomic_store(&asking->done, 1);
    return NULL;
}

static void many_assets(struct fixture *f, int from)
{
    uint8_t id[UMB_ID_BYTES];
    for (int i = 0; i < 10; i++) { /* more than are synced one by one */
        char name[40];
        snprintf(name, sizeof name, "store/asset%d.umb", from + i);
        folder_asset(&f->folder, name, (uint32_t)(from + i), id);
    }
}

static int comes_true(atomic_int *flag)
{
    for (int i = 0; i < 1000 && !atomic_load(flag); i++) {
        (void)poll(NULL, 0, 10);
    }
    return atomic_load(flag);
}

static void cache_answers_while_the_disk_syncs(void **state)
{
    struct fixture *f = *state;
    struct asking asking = {.f = f};
    struct stat before, after;
    pthread_t scan, asks;
    assert_int_equal(sem_init(&disk.go, 0, 0), 0);
    reopen(f);
    assert_int_equal(stat(folder_file(&f->folder, "cache/proven"), &before), 0);
    many_assets(f, 50);
    atomic_store(&disk.held, 1);
    assert_int_equal(pthread_create(&scan, NULL, rescan, f), 0);
    const int entered = comes_true(&disk.entered);
    assert_int_equal(pthread_create(&asks, NULL, ask_the_cache, &asking), 0);
    const int done = comes_true(&asking.done);
    /* No list may name files before they are durable. */
    assert_int_equal(stat(folder_file(&f->folder, "cache/proven"), &after), 0);
    atomic_store(&disk.held, 0);
    sem_post(&disk.go);
    pthread_join(asks, NULL);
    pthread_join(scan, NULL);
    sem_destroy(&disk.go);
    assert_true(entered && done);
    assert_int_equal(before.st_ino, after.st_ino);
    /* A file made during a sync must wait for the next sync. */
    assert_int_equal(f->store->caches[0].unsynced, 1);
    assert_int_equal(atomic_load(&disk.calls), 1);
    folder_asset(&f->folder, "store/city.umb", 23, f->city);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    assert_int_equal(f->store->caches[0].unsynced, 0);
    assert_int_equal(atomic_load(&disk.calls), 2);
    reopen(f);
    assert_true(logged(f, "asset=asset59", "how=known"));
}

static void list_is_not_written_after_a_failed_sync(void **state)
{
    struct fixture *f = *state;
    struct stat before, after;
    reopen(f);
    assert_int_equal(stat(folder_file(&f->folder, "cache/proven"), &before), 0);
    many_assets(f, 50);
    atomic_store(&disk.failing, 1);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    atomic_store(&disk.failing, 0);
    assert_true(logged(f, "proven_not_kept", "cannot sync"));
    /* A second sync would report no error: the list must stay as it is until the next start. */
    many_assets(f, 70);
    assert_int_equal(umbs_store_rescan(f->store, &f->report, NULL), UMB_OK);
    assert_int_equal(stat(folder_file(&f->folder, "cache/proven"), &after), 0);
    assert_int_equal(before.st_ino, after.st_ino);
    reopen(f);
    assert_true(logged(f, "asset=asset79", "how=proven"));
}

#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)

int main(void)
{
    const struct CMUnitTest tests[] = {
        WITH_STORE(cache_of_its_own_is_private_and_opens_known_assets_at_once),
        WITH_STORE(cache_file_of_another_asset_under_its_id_is_made_anew),
        WITH_STORE(list_that_was_not_written_under_the_key_is_not_believed),
        WITH_STORE(scrub_holds_a_mapped_file_against_what_was_recorded),
        WITH_STORE(cache_that_others_can_change_is_refused),
        WITH_STORE(cache_in_a_store_that_a_group_may_write_to_is_not_used),
        WITH_STORE(links_in_the_cache_are_not_followed),
        WITH_STORE(key_that_others_may_know_is_renewed),
        WITH_STORE(second_store_reads_what_the_first_wrote_and_writes_nothing),
        WITH_STORE(cache_may_be_made_anew_while_a_scan_sweeps),
        WITH_STORE(cache_answers_while_the_disk_syncs),
        WITH_STORE(list_is_not_written_after_a_failed_sync),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
