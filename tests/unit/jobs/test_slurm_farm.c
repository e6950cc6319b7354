/* SPDX-License-Identifier: Apache-2.0 */
/* Slurm as a farm, with a Slurm of a few lines of shell: what is asked of it, and what is believed
 * when it refuses. The whole executor: tests/system/test_slurm_executor.py. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "jobs/folder.h"
#include "jobs/slurm_farm.h"

#define NAME  "00ff.1"
#define COUNT 2500

struct fixture {
    char folder[64], search[128];
    struct umb_error error;
    struct umbj_farm *farm;
    uint8_t wanted[COUNT], known[COUNT];
    struct umbj_farm_stage stage;
};

/* A command of Slurm. It runs in the folder; each line of `calls` is one call's words. */
static void put_command(const struct fixture *f, const char *name, const char *script)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", f->folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fprintf(file, "#!/bin/sh\ncd %s\necho %s $* >>calls\n%s\n", f->folder, name, script);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(chmod(path, 0700), 0);
}

/* Calls whose words have that text. */
static size_t count_calls(const struct fixture *f, const char *text)
{
    static char line[1 << 17];
    char path[128];
    size_t count = 0;
    snprintf(path, sizeof path, "%s/calls", f->folder);
    FILE *file = fopen(path, "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        count += strstr(line, text) != NULL;
    }
    if (file != NULL) {
        fclose(file);
    }
    return count;
}

static int setup(void **state)
{
    static char command[] = "bake";
    static char *words[] = {command, NULL};
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-slurm-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->search, sizeof f->search, "%s:/usr/bin:/bin", f->folder);
    const struct umbj_slurm_options options = {.tag_of = "/jobs", .search = f->search};
    assert_int_equal(umbj_slurm_farm_create(&options, &f->farm, &f->error), UMB_OK);
    f->stage = (struct umbj_farm_stage){
        .name = NAME ".tile", .folder = f->folder, .words = words, .threads = 1, .count = COUNT};
    memset(f->wanted, 1, sizeof f->wanted);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    f->farm->destroy(f->farm);
    umbj_folder_remove(AT_FDCWD, f->folder);
    free(f);
    return 0;
}

static void what_was_taken_before_a_refusal_is_not_wanted_any_more(void **state)
{
    struct fixture *f = *state;
    put_command(f, "sbatch", "[ $(wc -l <calls) -ne 2 ] || { echo 'no room' >&2; exit 1; }");
    assert_int_equal(f->farm->submit_array(f->farm, &f->stage, f->wanted, &f->error),
                     UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "no room"));
    assert_int_equal(count_calls(f, "--array="), 2);
    for (size_t i = 0; i < COUNT; i++) {
        assert_int_equal(f->wanted[i], i >= 1000);
    }
    assert_int_equal(f->farm->submit_array(f->farm, &f->stage, f->wanted, &f->error), UMB_OK);
    assert_int_equal(count_calls(f, "--array="), 4);
    assert_int_equal(count_calls(f, ".tile.0 "), 1);
    assert_int_equal(count_calls(f, "--array=0-499 "), 1);
    for (size_t i = 0; i < COUNT; i++) {
        assert_int_equal(f->wanted[i], 0);
    }
}

/* Says what a queue of all tasks would, with the tag that sbatch was given. */
static void put_full_queue(struct fixture *f, const char *reason)
{
    char script[600];
    snprintf(script, sizeof script,
             "tag=$(sed -n 's/.*--job-name=\\(umbrage-[0-9a-f]*-\\).*/\\1/p' calls | head -n 1)\n"
             "i=0\nwhile [ $i -lt %d ]; do\n"
             "echo 7_$i $i PD ${tag}%s.tile.0 %s\ni=$((i+1))\ndone",
             COUNT, NAME, reason);
    put_command(f, "sbatch", "");
    put_command(f, "squeue", script);
    assert_int_equal(f->farm->submit_array(f->farm, &f->stage, f->wanted, &f->error), UMB_OK);
}

static void many_tasks_are_ended_some_at_a_time(void **state)
{
    struct fixture *f = *state;
    put_full_queue(f, "Resources");
    put_command(f, "scancel", "");
    f->farm->cancel(f->farm, NAME);
    assert_int_equal(count_calls(f, "scancel"), 5);
    assert_int_equal(count_calls(f, "7_0 7_1 "), 1);
    assert_int_equal(count_calls(f, "7_2499"), 1);
    f->farm->cancel(f->farm, "00ff.11"); /* not its tasks */
    assert_int_equal(count_calls(f, "scancel"), 5);
}

static void a_controller_that_is_gone_is_not_asked_for_each_task(void **state)
{
    struct fixture *f = *state;
    put_full_queue(f, "BeginTime");
    put_command(f, "scontrol", "exit 1");
    put_command(f, "scancel", "exit 1");
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_OK);
    assert_int_equal(f->known[COUNT - 1], 1);
    assert_int_equal(count_calls(f, "scontrol"), 1);
    f->farm->cancel(f->farm, NAME);
    assert_int_equal(count_calls(f, "scancel"), 1);
}

int main(void)
{
#define SLURM_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        SLURM_TEST(what_was_taken_before_a_refusal_is_not_wanted_any_more),
        SLURM_TEST(many_tasks_are_ended_some_at_a_time),
        SLURM_TEST(a_controller_that_is_gone_is_not_asked_for_each_task),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
