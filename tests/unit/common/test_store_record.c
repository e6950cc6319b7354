/* SPDX-License-Identifier: Apache-2.0 */
/* The list of proven files: kept as written, and believed only whole. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/store_record.h"
#include "store_fixture.h"

static struct umbs_record record_of(uint64_t n)
{
    struct umbs_record record = {
        .packed = {n, UINT64_MAX - n, n * n, {1700000000, (long)n}, {1700000001, 999999999}},
        .mapped = {3, n, 1 << 20, {0, 0}, {1, 1}},
    };
    for (size_t i = 0; i < UMB_ID_BYTES; i++) {
        record.id[i] = (uint8_t)(n * 31 + i);
    }
    return record;
}

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
        fill(&before, count);
        assert_int_equal(umbs__records_write(folder_file(&folder, "proven"), &before, &error),
                         UMB_OK);
        assert_int_equal(umbs__records_read(folder_file(&folder, "proven"), &after, &error),
                         UMB_OK);
        assert_true(umbs__records_equal(&before, &after));
        for (uint64_t n = 0; n < count; n++) {
            struct umbs_record record = record_of(n);
            const struct umbs_record *found = umbs__records_find(&after, &record.packed);
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
    assert_int_equal(umbs__records_read("/tmp/umbrage-no-such-file", &records, &error), UMB_OK);
    assert_int_equal(records.count, 0);
    assert_int_equal(umbs__records_read("/tmp", &records, &error), UMB_E_IO);
    assert_int_equal(records.count, 0);
}

static void records_with_any_byte_changed_or_missing_are_none(void **state)
{
    (void)state;
    struct folder folder;
    struct umbs_records records;
    struct umb_error error;
    folder_make(&folder);
    fill(&records, 2);
    assert_int_equal(umbs__records_write(folder_file(&folder, "proven"), &records, &error), UMB_OK);
    umbs__records_finish(&records);
    long size = folder_size(&folder, "proven");
    assert_true(size > 200);
    for (long at = 0; at < size; at++) {
        folder_flip(&folder, "proven", at);
        assert_int_equal(umbs__records_read(folder_file(&folder, "proven"), &records, &error),
                         UMB_E_CORRUPT);
        assert_int_equal(records.count, 0);
        folder_flip(&folder, "proven", at);
    }
    for (long cut = size - 1; cut >= 0; cut--) {
        assert_int_equal(truncate(folder_file(&folder, "proven"), cut), 0);
        assert_int_equal(umbs__records_read(folder_file(&folder, "proven"), &records, &error),
                         UMB_E_CORRUPT);
    }
    folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_come_back_as_they_were_written),
        cmocka_unit_test(records_missing_are_none),
        cmocka_unit_test(records_with_any_byte_changed_or_missing_are_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
