/* SPDX-License-Identifier: Apache-2.0 */
/* Threads for files must be fair between owners, independent of the table, and quick to stop. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "jobs/folder.h"
#include "jobs/service_internal.h"

#define STEP_MS 2
#define STEPS   5000 /* ten seconds */

/* Work that waits until the test lets it go on. */
struct work {
    struct umbj_request request;
    sem_t go;
    atomic_int began, done, skipped, ran;
};

static void stand_still(struct umbj_request *request)
{
    struct work *work = (struct work *)request;
    atomic_store(&work->began, 1);
    sem_wait(&work->go);
}

static void run_nothing(struct umbj_request *request, struct umbj_service *service)
{
    (void)service;
    atomic_store(&((struct work *)request)->ran, 1);
}

static void note_done(struct umbj_request *request)
{
    struct work *work = (struct work *)request;
    atomic_store(&work->skipped, request->skipped);
    atomic_store(&work->done, 1);
}

static void make_work(struct work *work, const char *owner)
{
    memset(work, 0, sizeof *work);
    assert_int_equal(sem_init(&work->go, 0, 0), 0);
    work->request = (struct umbj_request){.files = stand_still, .done = note_done, .owner = owner};
}

/* Stands in for the service: a request without `run` ends after its files. */
static void finish(struct umbj_service *service, struct umbj_request *request)
{
    (void)service;
    request->done(request);
}

static int becomes_true(atomic_int *flag)
{
    for (int i = 0; i < STEPS && !atomic_load(flag); i++) {
        (void)poll(NULL, 0, STEP_MS);
    }
    return atomic_load(flag);
}

static void one_owner_leaves_a_thread_to_the_others(void **state)
{
    static struct work ann[6], bob, eve;
    struct umbj_file_threads *threads = NULL;
    struct umb_error error;
    (void)state;
    assert_int_equal(umbj_file_threads_create(4, finish, NULL, &threads, &error), UMB_OK);
    for (int i = 0; i < 6; i++) {
        make_work(&ann[i], "ann");
        umbj_file_threads_post(threads, &ann[i].request);
    }
    make_work(&bob, "bob");
    make_work(&eve, "eve");
    for (int i = 0; i < 3; i++) {
        assert_true(becomes_true(&ann[i].began));
    }
    (void)poll(NULL, 0, 50); /* time in which a fourth one of ann would begin */
    umbj_file_threads_post(threads, &bob.request);
    assert_true(becomes_true(&bob.began)); /* while all of ann's stand still */
    assert_false(atomic_load(&ann[3].began));
    umbj_file_threads_post(threads, &eve.request);
    sem_post(&ann[0].go);
    assert_true(becomes_true(&eve.began)); /* not ann's fourth, which came before */
    assert_false(atomic_load(&ann[3].began));
    sem_post(&bob.go);
    assert_true(becomes_true(&ann[3].began));
    sem_post(&eve.go);
    for (int i = 1; i < 4; i++) {
        sem_post(&ann[i].go);
    }
    assert_true(becomes_true(&ann[4].began) && becomes_true(&ann[5].began));
    sem_post(&ann[4].go);
    sem_post(&ann[5].go);
    umbj_file_threads_destroy(threads);
    umbj_file_threads_destroy(NULL);
}

static void a_single_thread_takes_owners_in_turn(void **state)
{
    static struct work ann[3], bob;
    struct umbj_file_threads *threads = NULL;
    struct umb_error error;
    (void)state;
    assert_int_equal(umbj_file_threads_create(1, finish, NULL, &threads, &error), UMB_OK);
    for (int i = 0; i < 3; i++) {
        make_work(&ann[i], "ann");
        umbj_file_threads_post(threads, &ann[i].request);
    }
    make_work(&bob, "bob");
    umbj_file_threads_post(threads, &bob.request);
    assert_true(becomes_true(&ann[0].began));
    sem_post(&ann[0].go);
    const int in_turn = becomes_true(&bob.began) && !atomic_load(&ann[1].began);
    sem_post(&bob.go);
    sem_post(&ann[1].go);
    sem_post(&ann[2].go);
    assert_true(becomes_true(&ann[2].began));
    umbj_file_threads_destroy(threads);
    assert_true(in_turn);
}

static void what_waits_at_the_end_is_skipped(void **state)
{
    static struct work first, second, late;
    struct umbj_file_threads *threads = NULL;
    struct umb_error error;
    (void)state;
    assert_int_equal(umbj_file_threads_create(1, finish, NULL, &threads, &error), UMB_OK);
    make_work(&first, "ann");
    make_work(&second, "ann");
    make_work(&late, "ann");
    umbj_file_threads_post(threads, &first.request);
    umbj_file_threads_post(threads, &second.request);
    assert_true(becomes_true(&first.began));
    assert_false(atomic_load(umbj_file_threads_stop(threads)));
    sem_post(&first.go);
    sem_post(&second.go);
    umbj_file_threads_end(threads);
    assert_true(atomic_load(umbj_file_threads_stop(threads)));
    assert_true(atomic_load(&first.done) && !atomic_load(&first.skipped));
    assert_true(atomic_load(&second.done));
    umbj_file_threads_post(threads, &late.request);
    assert_true(atomic_load(&late.done) && atomic_load(&late.skipped));
    umbj_file_threads_destroy(threads);
}

struct fixture {
    char folder[64];
    struct umbj_service *service;
    struct umb_error error;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-threads-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    const struct umbj_service_options options = {
        .folder = f->folder,
        .tries.program = "/bin/false",
        .tries.workers = 1,
        .tries.threads = 1,
        .tries.timeout_ms = 10000,
        .tries.max_output_bytes = 1000,
        .max_bundle_bytes = 1000,
        .keep_ms = 1000000,
        .limits = {.owner_jobs = 8, .owner_bytes = 1000, .total_bytes = 4000, .lease_ms = 100000},
    };
    assert_int_equal(umbj_service_create(&options, &f->service, &f->error), UMB_OK);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    umbj_service_destroy(f->service);
    umbj_folder_remove(-1, f->folder);
    free(f);
    return 0;
}

/* A list, as a call asks for one. */
struct listing {
    struct work work; /* first */
    struct umbj_service *service;
    enum umb_status status;
    size_t count;
};

static void read_list(struct umbj_request *request)
{
    struct listing *listing = (struct listing *)request;
    struct umbj_job *jobs = NULL;
    struct umb_error error;
    listing->status =
        umbj_service_list(listing->service, "bob", 10, &jobs, &listing->count, &error);
    free(jobs);
}

static void hold_the_table(struct umbj_request *request, struct umbj_service *service)
{
    (void)service;
    stand_still(request);
}

static void a_list_waits_for_no_file_and_no_commit(void **state)
{
    struct fixture *f = *state;
    static struct work ann[8], holder; /* of ann and eve */
    static struct listing listing;
    for (int i = 0; i < 8; i++) {
        make_work(&ann[i], i % 2 ? "ann" : "eve"); /* together they have all threads */
        ann[i].request.run = run_nothing;
        umbj_service_post(f->service, &ann[i].request);
    }
    make_work(&holder, "ann"); /* on the service's own thread: a commit that takes its time */
    holder.request.files = NULL;
    holder.request.run = hold_the_table;
    umbj_service_post(f->service, &holder.request);
    assert_true(becomes_true(&holder.began));
    for (int i = 0; i < 4; i++) {
        assert_true(becomes_true(&ann[i].began));
    }
    make_work(&listing.work, "bob");
    listing.service = f->service;
    listing.work.request.files = read_list;
    listing.work.request.reads = 1;
    umbj_service_post(f->service, &listing.work.request);
    const int has_listed = becomes_true(&listing.work.done);
    const int has_waited = atomic_load(&holder.done) || atomic_load(&ann[0].done);
    sem_post(&holder.go);
    for (int i = 0; i < 8; i++) {
        sem_post(&ann[i].go);
    }
    assert_true(has_listed && !has_waited);
    assert_int_equal(listing.status, UMB_OK);
    for (int i = 0; i < 8; i++) {
        assert_true(becomes_true(&ann[i].done) && atomic_load(&ann[i].ran));
    }
}

static void what_is_posted_when_the_service_ends_is_done_all_the_same(void **state)
{
    struct fixture *f = *state;
    static struct work work[12];
    for (int i = 0; i < 12; i++) {
        make_work(&work[i], i % 2 ? "ann" : "bob");
        work[i].request.run = run_nothing;
        sem_post(&work[i].go);
        umbj_service_post(f->service, &work[i].request);
    }
    umbj_service_destroy(f->service);
    for (int i = 0; i < 12; i++) {
        assert_true(atomic_load(&work[i].done));
        assert_true(atomic_load(&work[i].ran) || atomic_load(&work[i].skipped));
    }
    f->service = NULL;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_owner_leaves_a_thread_to_the_others),
        cmocka_unit_test(a_single_thread_takes_owners_in_turn),
        cmocka_unit_test(what_waits_at_the_end_is_skipped),
        cmocka_unit_test_setup_teardown(a_list_waits_for_no_file_and_no_commit, setup, teardown),
        cmocka_unit_test_setup_teardown(what_is_posted_when_the_service_ends_is_done_all_the_same,
                                        setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
