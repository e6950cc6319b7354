/* SPDX-License-Identifier: Apache-2.0 */
/* --check: each file, folder and program that an option names must be looked at, and none
 * changed. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../store/store_fixture.h"
#include "daemon/daemon.h"

struct fixture {
    struct folder folder; /* with a store below it */
    char store[160], below[256];
    struct umbd_options options;
    struct umb_error error;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    folder_make(&f->folder);
    snprintf(f->store, sizeof f->store, "%.120s/store", f->folder.path);
    assert_int_equal(mkdir(f->store, 0755), 0);
    f->options.stores[0] = f->store;
    f->options.bakes.slurm = 0;
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    folder_remove(&f->folder);
    free(f);
    return 0;
}

static const char *below(struct fixture *f, const char *name)
{
    snprintf(f->below, sizeof f->below, "%.120s/%.100s", f->folder.path, name);
    return f->below;
}

static void make_file(const char *path, mode_t mode, const char *text)
{
    const int fd = open(path, O_CREAT | O_WRONLY | O_EXCL, 0600);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
    assert_int_equal(fchmod(fd, mode), 0);
    close(fd);
}

static size_t items_of(const char *path)
{
    size_t count = 0;
    DIR *folder = opendir(path);
    assert_non_null(folder);
    while (readdir(folder) != NULL) {
        count++;
    }
    closedir(folder);
    return count;
}

static void what_is_there_or_can_be_made_passes_and_stays_as_it_is(void **state)
{
    struct fixture *f = *state;
    char jobs[256], cache[256], tokens[256];
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    memcpy(jobs, below(f, "jobs//"), sizeof jobs);
    memcpy(cache, below(f, "cache"), sizeof cache);
    memcpy(tokens, below(f, "tokens"), sizeof tokens);
    make_file(tokens, 0600, "ann query 0123456789abcdef\n");
    f->options.bakes.folder = jobs;
    f->options.cache = cache;
    f->options.token_file = tokens;
    f->options.bakes.tries.program = "/bin/true";
    const size_t before = items_of(f->folder.path);
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_int_equal(items_of(f->folder.path), before); /* neither was made */
    assert_int_equal(mkdir(jobs, 0700) | mkdir(cache, 0700), 0);
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_int_equal(items_of(jobs), 2);
}

static void a_store_that_is_not_there_is_named(void **state)
{
    struct fixture *f = *state;
    f->options.stores[1] = below(f, "nowhere");
    assert_int_not_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_non_null(strstr(f->error.message, "nowhere"));
}

static void folders_that_cannot_be_used_are_named(void **state)
{
    struct fixture *f = *state;
    static char deep[5000];
    char plain[256], inside[300];
    memset(deep, 'd', sizeof deep - 1);
    memcpy(plain, below(f, "plain"), sizeof plain);
    make_file(plain, 0600, "");
    snprintf(inside, sizeof inside, "%s/jobs", plain);
    const char *const bad[] = {plain, inside, "/nowhere/at/all", deep};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        f->options.bakes.folder = bad[i];
        assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_CANNOT_CREATE);
        assert_non_null(strstr(f->error.message, "--jobs"));
        f->options.bakes.folder = NULL;
        f->options.cache = bad[i];
        assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_CANNOT_CREATE);
        assert_non_null(strstr(f->error.message, "--cache"));
        f->options.cache = NULL;
    }
}

static void a_relative_folder_is_made_where_the_daemon_starts(void **state)
{
    struct fixture *f = *state;
    f->options.bakes.folder = "umbrage-check-jobs";
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_int_equal(access(f->options.bakes.folder, F_OK), -1);
}

static void a_cache_that_others_can_write_to_is_refused(void **state)
{
    struct fixture *f = *state;
    char cache[256];
    memcpy(cache, below(f, "cache"), sizeof cache);
    assert_int_equal(mkdir(cache, 0700), 0);
    assert_int_equal(chmod(cache, 0777), 0);
    f->options.cache = cache;
    assert_int_not_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_non_null(strstr(f->error.message, "--cache"));
}

static void tokens_and_certificates_are_read(void **state)
{
    struct fixture *f = *state;
    char tokens[256];
    memcpy(tokens, below(f, "tokens"), sizeof tokens);
    make_file(tokens, 0600, "ann nothing 0123456789abcdef\n");
    f->options.token_file = tokens;
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "line 1"));
    f->options.token_file = NULL;
    f->options.tls_cert = "/nowhere/cert";
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK); /* nothing uses it */
    f->options.tls_key = "/nowhere/key";
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_NO_INPUT);
    assert_non_null(strstr(f->error.message, "--tls-cert"));
}

static void jobs_are_no_store_and_have_their_programs(void **state)
{
    struct fixture *f = *state;
    char jobs[256];
    memcpy(jobs, below(f, "jobs"), sizeof jobs);
    f->options.bakes.folder = f->store;
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "is a --store too"));
    f->options.bakes.folder = jobs;
    f->options.bakes.tries.program = "/nowhere/umbrage-bake";
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "/nowhere/umbrage-bake"));
}

static void each_program_of_slurm_is_looked_for_in_path(void **state)
{
    static const char *const names[] = {"sbatch", "squeue", "scancel", "scontrol"};
    struct fixture *f = *state;
    char jobs[256], bin[256], program[300], paths[8 * 256];
    static char deep[5000];
    const char *path = getenv("PATH");
    char *kept = path != NULL ? strdup(path) : NULL;
    memcpy(jobs, below(f, "jobs"), sizeof jobs);
    memcpy(bin, below(f, "bin"), sizeof bin);
    assert_int_equal(mkdir(bin, 0755), 0);
    memset(deep, 'd', sizeof deep - 1);
    f->options.bakes.folder = jobs;
    f->options.bakes.slurm = 1;
    assert_int_equal(unsetenv("PATH"), 0);
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_UNAVAILABLE);
    assert_int_equal(setenv("PATH", deep, 1), 0);
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_UNAVAILABLE);
    snprintf(paths, sizeof paths, "::/nowhere:%s", bin);
    assert_int_equal(setenv("PATH", paths, 1), 0);
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_E_UNAVAILABLE);
        assert_non_null(strstr(f->error.message, names[i]));
        snprintf(program, sizeof program, "%s/%s", bin, names[i]);
        make_file(program, 0755, "");
    }
    assert_int_equal(umbd_daemon_check(&f->options, &f->error), UMB_OK);
    assert_int_equal(kept != NULL ? setenv("PATH", kept, 1) : unsetenv("PATH"), 0);
    free(kept);
}

int main(void)
{
#define WITH_STORE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_STORE(what_is_there_or_can_be_made_passes_and_stays_as_it_is),
        WITH_STORE(a_store_that_is_not_there_is_named),
        WITH_STORE(folders_that_cannot_be_used_are_named),
        WITH_STORE(a_relative_folder_is_made_where_the_daemon_starts),
        WITH_STORE(a_cache_that_others_can_write_to_is_refused),
        WITH_STORE(tokens_and_certificates_are_read),
        WITH_STORE(jobs_are_no_store_and_have_their_programs),
        WITH_STORE(each_program_of_slurm_is_looked_for_in_path),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
