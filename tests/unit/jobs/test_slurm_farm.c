/* SPDX-License-Identifier: Apache-2.0 */
/* Slurm as a farm, with Slurm's commands imitated by a few lines of shell: the calls that are made,
 * and what the farm concludes from refusals. The whole executor:
 * tests/system/test_slurm_executor.py. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "jobs/folder.h"
#include "jobs/farm.h"

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

/* Counts the calls whose words contain a text. */
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
    f->stage = (struct umbj_farm_stage){.name = NAME ".tile",
                                        .folder = f->folder,
                                        .words = words,
                                        .threads = 1,
                                        .count = COUNT,
                                        .max_output_bytes = 1 << 20,
                                        .stop = -1};
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
    assert_int_equal(f->farm->submit(f->farm, &f->stage, f->wanted, &f->error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "no room"));
    assert_int_equal(count_calls(f, "--array="), 2);
    for (size_t i = 0; i < COUNT; i++) {
        assert_int_equal(f->wanted[i], i >= 1000);
    }
    assert_int_equal(f->farm->submit(f->farm, &f->stage, f->wanted, &f->error), UMB_OK);
    assert_int_equal(count_calls(f, "--array="), 4);
    assert_int_equal(count_calls(f, ".tile.0 "), 1);
    assert_int_equal(count_calls(f, "--array=0-499 "), 1);
    for (size_t i = 0; i < COUNT; i++) {
        assert_int_equal(f->wanted[i], 0);
    }
}

/* Prints what a queue of all tasks would show, with the tag that sbatch was given. */
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
    assert_int_equal(f->farm->submit(f->farm, &f->stage, f->wanted, &f->error), UMB_OK);
}

static void the_tasks_of_a_try_are_ended_by_the_number_of_their_array(void **state)
{
    struct fixture *f = *state;
    put_full_queue(f, "Resources");
    put_command(f, "scancel", "");
    f->farm->cancel(f->farm, "00ff.11"); /* not its tasks */
    assert_int_equal(count_calls(f, "scancel"), 0);
    f->farm->cancel(f->farm, NAME);
    assert_int_equal(count_calls(f, "scancel --quiet 7\n"), 1);
}

static void tasks_that_are_held_back_are_started_together(void **state)
{
    struct fixture *f = *state;
    put_full_queue(f, "BeginTime");
    put_command(f, "scontrol", "");
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_OK);
    assert_int_equal(count_calls(f, "scontrol update JobId="), COUNT / 500);
    assert_int_equal(count_calls(f, "JobId=7_0,7_1,"), 1);
    assert_int_equal(count_calls(f, ",7_2499 StartTime=now"), 1);
}

static void tasks_that_wait_are_told_from_those_that_run(void **state)
{
    struct fixture *f = *state;
    put_full_queue(f, "Resources");
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_OK);
    assert_int_equal(f->known[5], UMBJ_TASK_WAITS);
    put_command(
        f, "squeue",
        "tag=$(sed -n 's/.*--job-name=\\(umbrage-[0-9a-f]*-\\).*/\\1/p' calls | head -n 1)\n"
        "echo 7_5 5 R ${tag}" NAME ".tile.0 None\n"
        "echo 8_5 5 PD ${tag}" NAME ".tile.0 Resources");
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_OK);
    assert_int_equal(f->known[5], UMBJ_TASK_RUNS); /* one of two that are the same */
    assert_int_equal(f->known[6], UMBJ_TASK_UNKNOWN);
}

static void commands_are_left_when_the_try_shall_end(void **state)
{
    struct fixture *f = *state;
    const uint64_t one = 1;
    put_command(f, "sbatch", "exec sleep 600");
    put_command(f, "squeue", "exec sleep 600");
    f->stage.stop = eventfd(0, EFD_CLOEXEC);
    assert_true(f->stage.stop >= 0);
    assert_int_equal(write(f->stage.stop, &one, sizeof one), sizeof one);
    assert_int_equal(f->farm->submit(f->farm, &f->stage, f->wanted, &f->error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "sbatch was stopped"));
    assert_int_equal(f->wanted[0], 1);
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "squeue was stopped"));
    assert_int_equal(f->farm->reconcile(f->farm, f->folder, f->stage.stop, &f->error),
                     UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, "was stopped"));
    close(f->stage.stop);
}

static void a_task_writes_no_longer_files_than_it_may(void **state)
{
    struct fixture *f = *state;
    static char shell[] = "/bin/sh", option[] = "-c";
    char command[200], path[128];
    struct stat facts;
    char *words[] = {shell, option, command, NULL};
    snprintf(command, sizeof command, "head -c 100000 /dev/zero >%s/big", f->folder);
    f->stage.words = words;
    f->stage.max_output_bytes = 5000;
    /* Runs at once what sbatch would run elsewhere. */
    put_command(f, "sbatch",
                "while [ \"${1#--}\" != \"$1\" ]; do shift; done\nSLURM_JOB_ID=3 sh \"$@\"");
    assert_int_equal(f->farm->submit(f->farm, &f->stage, NULL, &f->error), UMB_OK);
    snprintf(path, sizeof path, "%s/big", f->folder);
    assert_int_equal(stat(path, &facts), 0);
    assert_in_range(facts.st_size, 5000, 5000 + 512);
    snprintf(path, sizeof path, "%s/done.0", f->folder);
    assert_int_not_equal(stat(path, &facts), 0);
    f->stage.max_output_bytes = 100000;
    assert_int_equal(f->farm->submit(f->farm, &f->stage, NULL, &f->error), UMB_OK);
    assert_int_equal(stat(path, &facts), 0);
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

/* Begins a script with the tag that sbatch was given. */
#define TAG "tag=$(sed -n 's/.*--job-name=\\(umbrage-[0-9a-f]*-\\).*/\\1/p' calls | head -n 1)\n"

static void lines_of_a_queue_that_are_not_ours_or_not_whole_are_left_out(void **state)
{
    static const char *const lines[] = {
        "7_1 1 R",                              /* no name */
        "--all 1 R ${tag}" NAME ".tile.0 None", /* an option in place of an id */
        ": 1 R ${tag}" NAME ".tile.0 None",
        "7_1 1 R umbrage-00000000-" NAME ".tile.0 None", /* another daemon's */
        "7_1 1 R other None",
        "7_1 1 R ${tag}00ff.2.tile.0 None", /* another try's */
        "7_1 1 R ${tag}" NAME ".tile None", /* no offset */
        "7_1 1 R ${tag}" NAME ".tile.x None",
        "7_1 2500 R ${tag}" NAME ".tile.0 None", /* numbers that no task has */
        "7_1 1 R ${tag}" NAME ".tile.2500 None",
        "7_1 4294967295 R ${tag}" NAME ".tile.4294967295 None",
        "7_1 501 R ${tag}" NAME ".tile.2000 None",
    };
    struct fixture *f = *state;
    char script[4096];
    size_t used = (size_t)snprintf(script, sizeof script, TAG);
    put_command(f, "sbatch", "");
    put_command(f, "scontrol", "");
    put_command(f, "scancel", "");
    assert_int_equal(f->farm->submit(f->farm, &f->stage, NULL, &f->error), UMB_OK);
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        used += (size_t)snprintf(script + used, sizeof script - used, "echo \"%s\"\n", lines[i]);
    }
    /* Adds a line of the queue for the merge stage, with neither an index nor a reason. */
    snprintf(script + used, sizeof script - used, "echo \"9 N/A PD ${tag}" NAME ".tile.3\"\n");
    put_command(f, "squeue", script);
    assert_int_equal(f->farm->status(f->farm, &f->stage, f->known, &f->error), UMB_OK);
    for (size_t i = 0; i < COUNT; i++) {
        assert_int_equal(f->known[i], i == 3 ? UMBJ_TASK_WAITS : UMBJ_TASK_UNKNOWN);
    }
    assert_int_equal(count_calls(f, "scontrol"), 0);
    f->farm->cancel(f->farm, "00"); /* the beginning of a try's name is not its name */
    assert_int_equal(count_calls(f, "scancel"), 0);
    f->farm->cancel(f->farm, NAME);
    assert_int_equal(count_calls(f, "scancel --quiet 7 9\n"), 1);
}

static void tasks_of_tries_whose_folders_are_gone_are_ended(void **state)
{
    struct fixture *f = *state;
    char path[128];
    put_command(f, "sbatch", "");
    put_command(f, "scancel", "");
    assert_int_equal(f->farm->submit(f->farm, &f->stage, NULL, &f->error), UMB_OK);
    put_command(f, "squeue",
                TAG "echo 5_1 1 R ${tag}00aa.4.tile.0 None\n" /* its folder is there */
                    "echo 6_1 1 R ${tag}00aa.5.tile.0 None\n"
                    "echo 6_2 2 R ${tag}00aa.5.tile.0 None\n"
                    "echo 8_1 1 R ${tag}../../etc.5.tile.0 None\n" /* not the name of a try */
                    "echo 9_1 1 R ${tag}00aa.x.tile.0 None");
    snprintf(path, sizeof path, "%s/00aa.4", f->folder);
    assert_int_equal(mkdir(path, 0700), 0);
    assert_int_equal(f->farm->reconcile(f->farm, f->folder, -1, &f->error), UMB_OK);
    assert_int_equal(count_calls(f, "scancel"), 1);
    assert_int_equal(count_calls(f, "scancel --quiet 6\n"), 1);
}

static void options_of_the_operator_reach_sbatch_word_by_word(void **state)
{
    struct fixture *f = *state;
    const struct umbj_slurm_options options = {
        .tag_of = "/jobs", .search = f->search, .words = "  -p bake  --comment=a;b "};
    f->farm->destroy(f->farm);
    assert_int_equal(umbj_slurm_farm_create(&options, &f->farm, &f->error), UMB_OK);
    put_command(f, "sbatch", "for word; do echo \"word $word\" >>calls; done");
    f->wanted[1] = 0; /* a single task, then a run of others */
    assert_int_equal(f->farm->submit(f->farm, &f->stage, f->wanted, &f->error), UMB_OK);
    assert_int_equal(count_calls(f, "word -p\n"), 3);
    assert_int_equal(count_calls(f, "word bake\n"), 6); /* half of them are the command */
    assert_int_equal(count_calls(f, "word --comment=a;b\n"), 3);
    assert_int_equal(count_calls(f, "word --array=0,2-999\n"), 1);
}

static void a_stage_whose_folder_is_gone_submits_nothing(void **state)
{
    struct fixture *f = *state;
    put_command(f, "sbatch", "");
    f->stage.folder = "/nonexistent";
    assert_int_equal(f->farm->submit(f->farm, &f->stage, NULL, &f->error), UMB_E_IO);
    assert_non_null(strstr(f->error.message, "cannot write the script"));
    assert_int_equal(count_calls(f, "sbatch"), 0);
}

int main(void)
{
#define SLURM_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        SLURM_TEST(what_was_taken_before_a_refusal_is_not_wanted_any_more),
        SLURM_TEST(the_tasks_of_a_try_are_ended_by_the_number_of_their_array),
        SLURM_TEST(tasks_that_are_held_back_are_started_together),
        SLURM_TEST(tasks_that_wait_are_told_from_those_that_run),
        SLURM_TEST(commands_are_left_when_the_try_shall_end),
        SLURM_TEST(a_task_writes_no_longer_files_than_it_may),
        SLURM_TEST(a_controller_that_is_gone_is_not_asked_for_each_task),
        SLURM_TEST(lines_of_a_queue_that_are_not_ours_or_not_whole_are_left_out),
        SLURM_TEST(tasks_of_tries_whose_folders_are_gone_are_ended),
        SLURM_TEST(options_of_the_operator_reach_sbatch_word_by_word),
        SLURM_TEST(a_stage_whose_folder_is_gone_submits_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
