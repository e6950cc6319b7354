/* SPDX-License-Identifier: Apache-2.0 */
/* The local executor, with a program in this file in place of umbrage-bake: the meaning of each way
 * to end, the reports in between, and that no process or file of a try stays. */
#define _GNU_SOURCE /* struct rlimit on old headers */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/staging.h"
#include "jobs/executor.h"
#include "jobs/worker_process.h"
#include "make_asset.h"

#define STEP_MS 5
#define STEPS   4000 /* twenty seconds */

/* The imitated bake; the name of its scene says what it does. */
static const char program_text[] =
    "#!/bin/sh\n"
    "for word; do case $word in --output=*) out=${word#--output=} ;; esac; scene=$word; done\n"
    "echo 'phase analyse' >&3; echo 'plan {\"tiles\":4}' >&3; echo 'progress 1 4 tiles' >&3\n"
    "echo 'tiles 2 4 1' >&3; echo 'nonsense' >&3; echo 'progress x' >&3\n"
    "echo 'umbrage-bake: notice: \033[1mthis is told\033[0m' >&2\n"
    "echo \"$*\" >words\n"
    "case $scene in\n"
    "./ok.obj) cp asset.umb \"$out\" ;;\n"
    "./garbage.obj) echo no asset >\"$out\" ;;\n"
    "./nothing.obj) ;;\n"
    "./exit*.obj) code=${scene#./exit}; exit \"${code%.obj}\" ;;\n"
    "./says*.obj) code=${scene#./says}; echo 'umbrage-bake: the cause' >&2; exit \"${code%.obj}\" "
    ";;\n"
    "./signal*.obj) code=${scene#./signal}; kill -\"${code%.obj}\" $$; sleep 20 ;;\n"
    "./hang.obj) exec sleep 100 ;;\n"
    "./deaf.obj) trap '' TERM; while :; do sleep 1; done ;;\n"
    "./large.obj) echo 'umbrage-bake: cannot write: File too large' >&2; exit 74 ;;\n"
    "./long.obj) head -c 9000 /dev/zero | tr '\\0' x >&2; echo >&2; echo >&2; exit 65 ;;\n"
    "./loud.obj) yes | head -c 3000000 >&2; cp asset.umb \"$out\" ;;\n"
    "esac\n";

struct fixture {
    char folder[64], program[96], bundle[96], assets[96], work[96], cache[96];
    struct umbj_executor *executor;
    struct umb_error error;
    pthread_mutex_t mutex;
    struct umbj_report ended;
    int has_ended;
    unsigned told[UMBJ_REPORT_ENDED + 1];
    char notice[UMBJ_CAUSE_SIZE], plan[UMBJ_CAUSE_SIZE];
};

static void take(void *user, const struct umbj_report *report)
{
    struct fixture *f = user;
    pthread_mutex_lock(&f->mutex);
    f->told[report->kind]++;
    if (report->kind == UMBJ_REPORT_NOTICE) {
        memcpy(f->notice, report->text, sizeof f->notice);
    } else if (report->kind == UMBJ_REPORT_PLAN) {
        memcpy(f->plan, report->text, sizeof f->plan);
    } else if (report->kind == UMBJ_REPORT_ENDED) {
        f->ended = *report;
        f->has_ended = 1;
    }
    pthread_mutex_unlock(&f->mutex);
}

static void put(const char *path, const void *bytes, size_t size, mode_t mode)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, mode);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, bytes, size), size);
    assert_int_equal(close(fd), 0);
}

static void make_asset_in(const char *folder)
{
    static const double origin[3] = {0, 0, 0};
    static const uint32_t log2_size = 6;
    const struct voxels voxels = {
        .lit = random_voxel, .user = &log2_size, .log2_size = 6, .frustum_count = 1};
    struct bytes packed = {0};
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    char path[128];
    struct umb_sink sink = bytes_sink(&packed);
    make_octree(&voxels, &octree);
    make_content(&voxels, 1.0, origin, &content);
    assert_int_equal(umb__pack_write(&content, &octree, &umbs_sha256, &sink, id, NULL), UMB_OK);
    umb__octree_finish(&octree);
    snprintf(path, sizeof path, "%s/asset.umb", folder);
    put(path, packed.data, packed.size, 0600);
    bytes_finish(&packed);
}

static void make_executor(struct fixture *f, uint64_t timeout_ms, unsigned workers)
{
    const struct umbj_try_options options = {.program = f->program,
                                             .assets = f->assets,
                                             .work = f->work,
                                             .workers = workers,
                                             .threads = 1,
                                             .tile = 2048,
                                             .memory_bytes = 1000,
                                             .cache_bytes = 1000,
                                             .timeout_ms = timeout_ms,
                                             .max_output_bytes = 1 << 22,
                                             .report = take,
                                             .user = f};
    assert_int_equal(umbj_try_executor_create(&options, &f->executor, &f->error), UMB_OK);
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    pthread_mutex_init(&f->mutex, NULL);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-tries-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->program, sizeof f->program, "%s/program", f->folder);
    snprintf(f->bundle, sizeof f->bundle, "%s/bundle", f->folder);
    snprintf(f->assets, sizeof f->assets, "%s/assets", f->folder);
    snprintf(f->work, sizeof f->work, "%s/work", f->folder);
    snprintf(f->cache, sizeof f->cache, "%s/cache", f->folder);
    assert_int_equal(mkdir(f->bundle, 0700) + mkdir(f->assets, 0700) + mkdir(f->work, 0700), 0);
    put(f->program, program_text, sizeof program_text - 1, 0700);
    make_asset_in(f->bundle);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    if (f->executor != NULL) {
        f->executor->destroy(f->executor);
    }
    umbj_folder_remove(-1, f->folder);
    pthread_mutex_destroy(&f->mutex);
    free(f);
    return 0;
}

static enum umb_status start(struct fixture *f, const char *scene, const char *settings)
{
    char folder[128];
    static int64_t epoch;
    snprintf(folder, sizeof folder, "%s/%s.%lld", f->work, scene, (long long)++epoch);
    const struct umbj_work work = {.job = "0123456789abcdef0123456789abcdef",
                                   .epoch = epoch,
                                   .bundle = f->bundle,
                                   .folder = folder,
                                   .scene = scene,
                                   .settings = settings,
                                   .cache = f->cache};
    f->has_ended = 0;
    memset(f->told, 0, sizeof f->told);
    return f->executor->start(f->executor, &work, &f->error);
}

static int wait_for_end(struct fixture *f)
{
    int has_ended = 0;
    for (int i = 0; i < STEPS && !has_ended; i++) {
        (void)poll(NULL, 0, STEP_MS);
        pthread_mutex_lock(&f->mutex);
        has_ended = f->has_ended;
        pthread_mutex_unlock(&f->mutex);
    }
    return has_ended;
}

static size_t names_in(const char *path)
{
    struct umbj_names names;
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    assert_int_equal(umbj_names_read(fd, &names), 0);
    const size_t count = names.count;
    umbj_names_finish(&names);
    close(fd);
    return count;
}

static void each_end_has_its_meaning(void **state)
{
    static const struct {
        const char *scene;
        enum umbj_failure failure;
        const char *cause; /* in it */
    } cases[] = {
        {"garbage.obj", UMBJ_INTERNAL, ""},
        {"nothing.obj", UMBJ_IO, "cannot read"},
        {"exit2.obj", UMBJ_REJECTED, "ended with 2"},
        {"says65.obj", UMBJ_REJECTED, "the cause"},
        {"says66.obj", UMBJ_REJECTED, "the cause"},
        {"says69.obj", UMBJ_INTERNAL, "the cause"},
        {"says70.obj", UMBJ_INTERNAL, "the cause"},
        {"says73.obj", UMBJ_IO, "the cause"},
        {"says74.obj", UMBJ_IO, "the cause"},
        {"says75.obj", UMBJ_TEMPORARY, "the cause"},
        {"exit1.obj", UMBJ_INTERNAL, "ended with 1"},
        {"signalKILL.obj", UMBJ_MEMORY, "signal 9 (memory)"},
        {"signalSEGV.obj", UMBJ_CRASH, "signal 11 (crash)"},
        {"signalSYS.obj", UMBJ_SANDBOX, "(sandbox)"},
        {"large.obj", UMBJ_REJECTED, "--max-asset"},
        {"long.obj", UMBJ_REJECTED, "xxxx"},
    };
    struct fixture *f = *state;
    make_executor(f, 60000, 1);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(start(f, cases[i].scene, "--resolution=64\n"), UMB_OK);
        assert_true(wait_for_end(f));
        if (f->ended.failure != cases[i].failure || strstr(f->ended.text, cases[i].cause) == NULL) {
            fail_msg("%s: %s, '%s'", cases[i].scene, umbj_failure_name(f->ended.failure),
                     f->ended.text);
        }
        assert_null(f->ended.staged.temporary);
        assert_int_equal(f->executor->free_slots(f->executor), 1);
        assert_int_equal(names_in(f->work), 0);
    }
    assert_int_equal(names_in(f->assets), 0);
}

static void what_a_bake_made_is_staged_and_what_it_said_is_told(void **state)
{
    struct fixture *f = *state;
    static const char *const scenes[] = {"ok.obj", "loud.obj"};
    make_executor(f, 60000, 1);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(start(f, scenes[i], "--resolution=64\n"), UMB_OK);
        assert_int_equal(f->executor->free_slots(f->executor) <= 1, 1);
        assert_true(wait_for_end(f));
        assert_int_equal(f->ended.failure, UMBJ_NO_FAILURE);
        assert_non_null(f->ended.staged.temporary);
        if (i == 0) { /* a second one is staged all the same, whether or not the first is there */
            assert_int_equal(umbu_output_commit(&f->ended.staged, &f->error), UMB_OK);
        }
        umbu_output_abandon(&f->ended.staged);
        assert_int_equal(names_in(f->assets), 1);
        assert_int_equal(f->told[UMBJ_REPORT_PLAN], 1);
        assert_int_equal(f->told[UMBJ_REPORT_TILES], 1);
        assert_int_equal(f->told[UMBJ_REPORT_PROGRESS], 1);
        assert_int_equal(f->told[UMBJ_REPORT_PHASE], 2); /* its own, and publish */
        assert_int_equal(f->told[UMBJ_REPORT_NOTICE], 1);
    }
    assert_non_null(strstr(f->notice, "this is told"));
    assert_null(strchr(f->notice, 27)); /* escapes of a stranger's process end here */
    assert_string_equal(f->plan, "{\"tiles\":4}");
}

static void read_words(const struct fixture *f, char words[2000])
{
    char path[128];
    snprintf(path, sizeof path, "%s/words", f->bundle);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    const size_t size = fread(words, 1, 1999, file);
    words[size] = '\0';
    fclose(file);
}

static void tiles_are_kept_unless_they_cannot_be(void **state)
{
    static const char *const without[] = {"--depth=embree\n", "--static\n", "--effect=static=on\n"};
    struct fixture *f = *state;
    char words[2000];
    make_executor(f, 60000, 1);
    assert_int_equal(start(f, "exit65.obj", "--resolution=64\n--sun=1,2\n"), UMB_OK);
    assert_true(wait_for_end(f));
    read_words(f, words);
    assert_non_null(strstr(words, "--cache="));
    assert_non_null(strstr(words, "--resolution=64 --sun=1,2 --tile=64 ./exit65.obj"));
    for (int i = 0; i < 3; i++) {
        assert_int_equal(start(f, "exit65.obj", without[i]), UMB_OK);
        assert_true(wait_for_end(f));
        read_words(f, words);
        assert_null(strstr(words, "--cache="));
        assert_non_null(strstr(words, "--tile=2048"));
    }
}

static void a_bake_that_takes_too_long_is_ended(void **state)
{
    struct fixture *f = *state;
    make_executor(f, 300, 1);
    assert_int_equal(start(f, "hang.obj", ""), UMB_OK);
    assert_true(wait_for_end(f));
    assert_int_equal(f->ended.failure, UMBJ_TIMEOUT);
    assert_non_null(strstr(f->ended.text, "--job-time"));
    assert_int_equal(names_in(f->work), 0);
}

static void a_try_is_ended_when_it_is_asked_to_also_if_it_does_not_listen(void **state)
{
    static const char *const scenes[] = {"hang.obj", "deaf.obj"};
    struct fixture *f = *state;
    make_executor(f, 60000, 2);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(start(f, scenes[i], ""), UMB_OK);
        for (int step = 0; step < STEPS && names_in(f->work) == 0; step++) {
            (void)poll(NULL, 0, STEP_MS);
        }
        f->executor->cancel(f->executor, "0123456789abcdef0123456789abcdef", 0); /* none */
        f->executor->cancel(f->executor, "another", 1);
        for (int64_t epoch = 1; epoch < 100; epoch++) {
            f->executor->cancel(f->executor, "0123456789abcdef0123456789abcdef", epoch);
        }
        assert_true(wait_for_end(f));
        assert_int_equal(f->ended.failure, UMBJ_CANCELLED);
    }
}

static void slots_are_counted_and_the_end_ends_all(void **state)
{
    struct fixture *f = *state;
    make_executor(f, 60000, 2);
    assert_int_equal(f->executor->free_slots(f->executor), 2);
    assert_int_equal(start(f, "hang.obj", ""), UMB_OK);
    assert_int_equal(start(f, "hang.obj", ""), UMB_OK);
    assert_int_equal(f->executor->free_slots(f->executor), 0);
    assert_int_equal(start(f, "hang.obj", ""), UMB_E_BUSY);
    f->executor->destroy(f->executor);
    f->executor = NULL;
    assert_int_equal(f->has_ended, 0); /* they do not report any more */
    assert_int_equal(names_in(f->work), 0);
}

static void a_known_asset_takes_as_long_as_its_bake_did(void **state)
{
    struct fixture *f = *state;
    make_executor(f, 60000, 1);
    struct umbj_work work = {.job = "0123456789abcdef0123456789abcdef",
                             .epoch = 900,
                             .bundle = f->bundle,
                             .folder = f->work,
                             .scene = "ok.obj",
                             .settings = "",
                             .is_known = 1,
                             .known_ms = 30};
    memset(work.known_asset, 7, sizeof work.known_asset);
    f->has_ended = 0;
    assert_int_equal(f->executor->start(f->executor, &work, &f->error), UMB_OK);
    assert_true(wait_for_end(f));
    assert_int_equal(f->ended.failure, UMBJ_NO_FAILURE);
    assert_int_equal(f->ended.bake_ms, 30);
    assert_int_equal(f->ended.asset[5], 7);
    assert_null(f->ended.staged.temporary);
    work.known_ms = 1000000;
    f->has_ended = 0;
    assert_int_equal(f->executor->start(f->executor, &work, &f->error), UMB_OK);
    f->executor->cancel(f->executor, work.job, work.epoch);
    assert_true(wait_for_end(f));
    assert_int_equal(f->ended.failure, UMBJ_CANCELLED);
}

static void what_is_missing_is_told(void **state)
{
    struct fixture *f = *state;
    struct rlimit limit, few;
    struct umbj_try_options none = {.program = "/nonexistent", .workers = 1};
    assert_int_equal(umbj_try_executor_create(&none, &f->executor, &f->error), UMB_E_UNAVAILABLE);
    make_executor(f, 60000, 1);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    const int next = dup(0);
    close(next);
    for (rlim_t spare = 0; spare < 14; spare++) { /* descriptors: eventfd, pipes, folders */
        few = limit;
        few.rlim_cur = (rlim_t)next + spare;
        assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
        const enum umb_status status = start(f, "ok.obj", "");
        const int has_ended = status == UMB_OK && wait_for_end(f);
        assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
        assert_true(status == UMB_E_NO_MEMORY || has_ended);
        assert_true(!has_ended || f->ended.failure == UMBJ_NO_FAILURE ||
                    strlen(f->ended.text) > 5); /* the program itself may lack some */
        umbu_output_abandon(&f->ended.staged);
        f->ended.staged = (struct umbu_output){.fd = -1};
        (void)f->executor->free_slots(f->executor);
        umbj_folder_remove(-1, f->work);
        assert_int_equal(mkdir(f->work, 0700), 0);
    }
    rmdir(f->work); /* no folder for the try */
    assert_int_equal(start(f, "ok.obj", ""), UMB_OK);
    assert_true(wait_for_end(f));
    assert_int_equal(f->ended.failure, UMBJ_IO);
}

static void an_end_without_a_name_is_our_own_fault(void **state)
{
    const struct umbj_process_end end = {.exit_code = 127};
    (void)state;
    assert_int_equal(umbj_process_judge(&end), UMBJ_INTERNAL);
    assert_string_equal(umbj_failure_name((enum umbj_failure)99), "unknown");
    assert_string_equal(umbj_state_name((enum umbj_state)99), "unknown");
}

int main(void)
{
#define TRY_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TRY_TEST(each_end_has_its_meaning),
        TRY_TEST(what_a_bake_made_is_staged_and_what_it_said_is_told),
        TRY_TEST(tiles_are_kept_unless_they_cannot_be),
        TRY_TEST(a_bake_that_takes_too_long_is_ended),
        TRY_TEST(a_try_is_ended_when_it_is_asked_to_also_if_it_does_not_listen),
        TRY_TEST(slots_are_counted_and_the_end_ends_all),
        TRY_TEST(a_known_asset_takes_as_long_as_its_bake_did),
        TRY_TEST(what_is_missing_is_told),
        cmocka_unit_test(an_end_without_a_name_is_our_own_fault),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
