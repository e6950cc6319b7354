/* SPDX-License-Identifier: Apache-2.0 */
/* A batch that several threads share gives what one thread gives, bit for bit. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/query.h"

#define POINTS  20077U
#define THREADS 4

static const double origin[3] = {10, 20, 30};
static float positions[POINTS][3];
static _Alignas(64) uint8_t values[2][POINTS * sizeof(float)];

static int rough(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 40 + (x * 7 + y * 3) % 29 + x * y / 300;
}

static void make_points(void)
{
    uint64_t state = 20261121;
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        state = state * 6364136223846793005U + 1442695040888963407U;
        positions[i / 3][i % 3] = (float)(state >> 40) / (float)(1 << 24) * 80.0F - 8.0F;
    }
}

typedef void (*job_fn)(void *job_user, uint32_t number, unsigned worker);

/* One thread, last slice first. */
static void run_backwards(void *user, job_fn job, void *job_user, uint32_t jobs)
{
    *(uint32_t *)user += jobs;
    while (jobs > 0) {
        job(job_user, --jobs, 0);
    }
}

struct crew {
    job_fn job;
    void *job_user;
    uint32_t jobs;
    atomic_uint next, hired;
};

static void *work(void *user)
{
    struct crew *crew = user;
    unsigned worker = atomic_fetch_add(&crew->hired, 1);
    for (uint32_t k; (k = atomic_fetch_add(&crew->next, 1)) < crew->jobs;) {
        crew->job(crew->job_user, k, worker);
    }
    return NULL;
}

static void run_threads(void *user, job_fn job, void *job_user, uint32_t jobs)
{
    struct crew crew = {.job = job, .job_user = job_user, .jobs = jobs};
    pthread_t threads[THREADS];
    *(uint32_t *)user += jobs;
    for (size_t t = 0; t < THREADS; t++) {
        assert_int_equal(pthread_create(&threads[t], NULL, work, &crew), 0);
    }
    for (size_t t = 0; t < THREADS; t++) {
        assert_int_equal(pthread_join(threads[t], NULL), 0);
    }
}

static void check(const struct umb_asset *asset, uint32_t taps, enum umb_answer_format format)
{
    struct umb_query_settings settings = {.taps = taps, .format = format};
    struct umb_points points = {.positions = positions, .count = POINTS};
    struct umb_query query;
    uint32_t jobs = 0;
    const struct umb_workers workers[] = {{1, run_backwards, &jobs}, {THREADS, run_threads, &jobs}};
    memcpy(points.origin, origin, sizeof origin);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    assert_int_equal(umb_query_slice(&query) % 512, 0);
    struct umb_answers alone = {.values = values[0]};
    memset(values[0], 0xa5, sizeof values[0]);
    umb_query_run(&query, &points, 0, POINTS, &alone);
    for (size_t i = 0; i < 2; i++) {
        struct umb_answers split = {.values = values[1]};
        memset(values[1], 0xa5, sizeof values[1]);
        umb_query_run_split(&query, &points, &workers[i], &split);
        assert_memory_equal(values[1], values[0], sizeof values[0]);
        assert_memory_equal(&split.stats, &alone.stats, sizeof alone.stats);
    }
    assert_int_equal(jobs, 2 * ((POINTS - 1) / umb_query_slice(&query) + 1));
}

static void threads_that_share_a_batch_answer_as_one_does(void **state)
{
    struct voxels voxels = {rough, NULL, 7, 1};
    struct bytes file = make_packed(&voxels, 0.5, origin);
    struct umb_asset *asset;
    (void)state;
    make_points();
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    for (uint32_t taps = 1; taps <= UMB_TAPS_MAX; taps += 8) {
        for (int format = UMB_ANSWER_F32; format <= UMB_ANSWER_BIT; format++) {
            check(asset, taps, (enum umb_answer_format)format);
        }
    }
    umb_asset_close(asset);
    bytes_finish(&file);
}

static void a_batch_of_one_slice_needs_no_threads(void **state)
{
    struct voxels voxels = {rough, NULL, 7, 1};
    struct bytes file = make_packed(&voxels, 0.5, origin);
    struct umb_query_settings settings = {.taps = 1};
    struct umb_points points = {.positions = positions};
    struct umb_answers answers = {.values = values[0]};
    struct umb_asset *asset;
    struct umb_query query;
    uint32_t jobs = 0;
    const struct umb_workers workers = {1, run_backwards, &jobs};
    (void)state;
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
    umb_query_run_split(&query, &points, &workers, &answers); /* no points at all */
    assert_int_equal(answers.stats.points, 0);
    points.count = umb_query_slice(&query);
    umb_query_run_split(&query, &points, &workers, &answers);
    assert_int_equal(answers.stats.points, points.count);
    assert_int_equal(jobs, 0);
    umb_asset_close(asset);
    bytes_finish(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(threads_that_share_a_batch_answer_as_one_does),
        cmocka_unit_test(a_batch_of_one_slice_needs_no_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
