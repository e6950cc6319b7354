/* SPDX-License-Identifier: Apache-2.0 */
/* The list of proven files: it is kept as written, and a line counts only if its key is right. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "store/store_record.h"
#include "store_fixture.h"

static struct umbs_record record_of(uint64_t n)
{
    struct umbs_record record = {
        .packed = {n, UINT64_MAX - n, n * n, {1700000000, (long)n}, {1700000001, 999999999}},
        .mapped = {3, n, 1 << 20, {0, 0}, {1, 1}},
    };
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        record.id[i] = (uint8_t)(n * 31 + i);
        record.digest[i] = (uint8_t)(n * 17 + 3 * i);
    }
    return record;
}

static const uint8_t key[UMBS_KEY_BYTES] = "a key of the daemon's own, here";

static void fill(struct umbs_records *records, uint64_t count)
{
    memset(records, 0, sizeof *records);
    for (uint64_t n = 0; n < count; n++) {
        struct umbs_record record = record_of(n);
        assert_int_equal(umbs__records_add(records, &record), UMB_OK);
    }
}

static void records_come_back_as_they_were_written(void **state)
{
    (void)state;
    struct folder folder;
    folder_make(&folder);
    for (uint64_t count = 0; count < 400; count += 133) {
        struct umbs_records before;
        struct umbs_records after;
        struct umb_error error;
        size_t refused = 7;
        fill(&before, count);
        assert_int_equal(umbs__records_write(folder_file(&folder, "proven"), key, &before, &error),
                         UMB_OK);
        assert_int_equal(chmod(folder_file(&folder, "proven"), 0600), 0);
        assert_int_equal(
            umbs__records_read(folder_file(&folder, "proven"), key, &after, &refused, &error),
            UMB_OK);
        assert_int_equal(refused, 0);
        assert_true(umbs__records_equal(&before, &after));
        for (uint64_t n = 0; n < count; n++) {
            struct umbs_record record = record_of(n);
            const struct umbs_record *found = umbs__records_find(&after, &record.packed);
            assert_non_null(found);
            assert_memory_equal(found->id, record.id, UMB_ID_BYTES);
            assert_memory_equal(found->digest, record.digest, UMB_ID_BYTES);
            found = umbs__records_of_id(&after, record.id);
            assert_non_null(found);
            assert_memory_equal(found->id, record.id, UMB_ID_BYTES);
            record.packed.changed.tv_nsec--;
            assert_null(umbs__records_find(&after, &record.packed));
        }
        umbs__records_finish(&before);
        umbs__records_finish(&after);
    }
    folder_remove(&folder);
}

static void records_missing_are_none(void **state)
{
    (void)state;
    struct umbs_records records;
    struct umb_error error;
    size_t refused = 0;
    assert_int_equal(
        umbs__records_read("/tmp/umbrage-no-such-file", key, &records, &refused, &error), UMB_OK);
    assert_int_equal(records.count, 0);
    assert_int_equal(umbs__records_read("/tmp", key, &records, &refused, &error), UMB_E_PERMISSION);
    assert_int_equal(records.count, 0);
}

/* A list of two in a folder of its own. */
static struct umbs_records two_in(struct folder *folder)
{
    struct umbs_records records;
    struct umb_error error;
    folder_make(folder);
    fill(&records, 2);
    assert_int_equal(umbs__records_write(folder_file(folder, "proven"), key, &records, &error),
                     UMB_OK);
    return records;
}

/* Returns how many of the two lines a list still has; those must be as they were written. */
static size_t believed(struct folder *folder, const uint8_t *with, const struct umbs_records *two)
{
    struct umbs_records records;
    struct umb_error error;
    size_t refused = 0;
    const enum umb_status status =
        umbs__records_read(folder_file(folder, "proven"), with, &records, &refused, &error);
    assert_true(status == UMB_OK || status == UMB_E_CORRUPT);
    const size_t count = records.count;
    for (size_t i = 0; i < count; i++) {
        const struct umbs_record *was = umbs__records_find(two, &records.list[i].packed);
        assert_non_null(was);
        assert_memory_equal(was->id, records.list[i].id, UMB_ID_BYTES);
        assert_memory_equal(was->digest, records.list[i].digest, UMB_ID_BYTES);
        assert_true(umbs_stamp_equal(&was->mapped, &records.list[i].mapped));
    }
    assert_true(status == UMB_OK || count == 0);
    umbs__records_finish(&records);
    return count;
}

static void records_with_a_byte_changed_are_left_out(void **state)
{
    (void)state;
    struct folder folder;
    struct umbs_records two = two_in(&folder);
    long size = folder_size(&folder, "proven");
    assert_true(size > 400);
    assert_int_equal(believed(&folder, key, &two), 2);
    for (long at = 0; at < size; at++) {
        folder_flip(&folder, "proven", at);
        assert_true(believed(&folder, key, &two) < 2 || at == size - 1); /* the last line's end */
        folder_flip(&folder, "proven", at);
    }
    for (long cut = size - 2; cut >= 0; cut--) {
        assert_int_equal(truncate(folder_file(&folder, "proven"), cut), 0);
        assert_true(believed(&folder, key, &two) < 2);
    }
    umbs__records_finish(&two);
    folder_remove(&folder);
}

static void records_of_another_key_or_another_user_are_none(void **state)
{
    (void)state;
    struct folder folder;
    struct umbs_records two = two_in(&folder);
    struct umbs_records records;
    struct umb_error error;
    uint8_t other[UMBS_KEY_BYTES];
    size_t refused = 0;
    memcpy(other, key, sizeof other);
    other[31] ^= 1;
    assert_int_equal(believed(&folder, other, &two), 0);
    assert_int_equal(chmod(folder_file(&folder, "proven"), 0620), 0);
    assert_int_equal(
        umbs__records_read(folder_file(&folder, "proven"), key, &records, &refused, &error),
        UMB_E_PERMISSION);
    umbs__records_finish(&two);
    folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_come_back_as_they_were_written),
        cmocka_unit_test(records_missing_are_none),
        cmocka_unit_test(records_with_a_byte_changed_are_left_out),
        cmocka_unit_test(records_of_another_key_or_another_user_are_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
