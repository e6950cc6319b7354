/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_JOB_TABLE_FIXTURE_H
#define UMBRAGE_TESTS_JOB_TABLE_FIXTURE_H
/* A job table in a folder of its own, and short ways to use it. Included after cmocka.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "jobs/job_table.h"

static const struct umbj_limits limits = {
    .owner_jobs = 8, .owner_bytes = 1000, .total_bytes = 4000, .lease_ms = 100};

struct fixture {
    char folder[64], path[96];
    struct umbj_table *table;
    struct umb_error error;
};

static void reopen(struct fixture *f)
{
    umbj_table_close(f->table);
    assert_int_equal(umbj_table_open(f->path, &limits, &f->table, &f->error), UMB_OK);
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-jobs-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->path, sizeof f->path, "%s/jobs.db", f->folder);
    reopen(f);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    static const char *const ends[] = {"", "-wal", "-shm"};
    struct fixture *f = *state;
    char path[128];
    umbj_table_close(f->table);
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", f->path, ends[i]);
        unlink(path);
    }
    rmdir(f->folder);
    free(f);
    return 0;
}

static inline void key_of(unsigned number, uint8_t key[UMBJ_HASH_BYTES])
{
    memset(key, 0, UMBJ_HASH_BYTES);
    memcpy(key, &number, sizeof number);
}

static inline enum umb_status submit_as(struct fixture *f, const char *owner, unsigned content,
                                        int priority, int64_t now, struct umbj_job *job,
                                        int *is_new)
{
    uint8_t key[UMBJ_HASH_BYTES];
    key_of(content, key);
    const struct umbj_submission submission = {.owner = owner,
                                               .key = key,
                                               .priority = priority,
                                               .scene = "a.glb",
                                               .settings = "--resolution=64\n",
                                               .bundle_bytes = 100};
    return umbj_table_submit(f->table, &submission, now, job, is_new, &f->error);
}

static inline void finish(struct fixture *f, const struct umbj_job *job, unsigned asset_number)
{
    uint8_t asset[UMBJ_HASH_BYTES];
    key_of(asset_number, asset);
    assert_int_equal(umbj_table_finish(f->table, job, asset, 5, 2000, &f->error), UMB_OK);
}

#define TABLE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

#endif
