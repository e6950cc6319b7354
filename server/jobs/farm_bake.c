/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A bake on a farm. The daemon's machine reads the scene in its sandbox, so no other machine parses
 * foreign formats. Then each task of an array bakes a tile into the shared folder of tiles, and one
 * more task merges the tiles. Only the end files in the try's folder count (farm.h). A task is
 * submitted again if it left no end file and the farm no longer knows it. A task that ran twice
 * wrote the same bytes twice.
 *
 * The loops end: a task has a limited number of submissions, each stage has the try's time limit
 * (waiting in the queue does not count), and a farm that stays silent is abandoned.
 */
#include "jobs/bake_try.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tool/clock.h"
#include "jobs/folder.h"

#define LOOK_MS     500    /* between reads of the stage's folder, at most */
#define ORPHANS_MS  60000  /* between searches for orphaned tasks */
#define PATIENCE_MS 120000 /* until a farm that is silent, or takes no tasks, is abandoned */
#define LOST_LOOKS  3      /* status calls without the task, and no end file: it is lost */
#define TASK_TRIES  4      /* submissions of one task */
#define ROUNDS      3      /* rounds of array and merge: the cache may drop tiles in between */

/* A stage under way. */
struct stage {
    struct umbj_try *try;
    struct umbj_farm_stage farm;
    const char *kind; /* "tile", "merge" */
    int is_array;
    uint8_t *done, *wanted, *known, *tries, *unknown, *asked; /* [count] of one block */
    uint32_t done_count, found_count;
    uint64_t texels; /* texels of one task */
    int64_t ask_ms, answered_ms, orphans_ms;
    int64_t ran_ms;     /* milliseconds in which some of its tasks ran */
    int64_t refused_ms; /* time since which it refuses tasks; 0: it takes them */
    int heard;          /* the farm answered the last call */
    char folder[4300], name[80];
};

/* Reads the beginning or the end of a small file; text ends with a 0. */
static void read_part(int folder, const char *name, int from_end, char *text, size_t size)
{
    ssize_t count = -1;
    int fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd >= 0) {
        const off_t length = lseek(fd, 0, SEEK_END);
        const off_t most = (off_t)size - 1;
        count = pread(fd, text, size - 1, from_end && length > most ? length - most : 0);
        close(fd);
    }
    text[count > 0 ? count : 0] = '\0';
}

/* Keeps the last line of a log as the try's last words. */
static void take_last_line(struct umbj_try *try, int folder, const char *name)
{
    static const char program[] = "umbrage-bake: ";
    char text[2048];
    read_part(folder, name, 1, text, sizeof text);
    size_t length = strlen(text);
    while (length > 0 && text[length - 1] == '\n') {
        text[--length] = '\0';
    }
    const char *line = strrchr(text, '\n');
    line = line != NULL ? line + 1 : text;
    line += strncmp(line, program, sizeof program - 1) == 0 ? sizeof program - 1 : 0;
    umbj_try_text(try->said, line);
}

/* Reports a task that failed or was lost. */
static void tell_task(const struct stage *stage, uint32_t number, enum umbj_failure failure,
                      const char *cause)
{
    struct umbj_report report = umbj_try_report(stage->try, UMBJ_REPORT_TASK);
    report.failure = failure;
    report.done = number;
    report.total = stage->farm.count;
    snprintf(report.text, sizeof report.text, "%s %u: %.400s", stage->kind, number, cause);
    umbj_try_tell(stage->try, &report);
}

static void tell_count(const struct stage *stage)
{
    struct umbj_report report = umbj_try_report(stage->try, UMBJ_REPORT_TILES);
    report.done = stage->done_count;
    report.total = stage->farm.count;
    report.found = stage->found_count;
    if (stage->is_array) {
        umbj_try_tell(stage->try, &report);
        report.kind = UMBJ_REPORT_PROGRESS;
        report.done = (stage->done_count - stage->found_count) * stage->texels;
        report.total = (stage->farm.count - stage->found_count) * stage->texels;
        snprintf(report.text, sizeof report.text, "texel");
        umbj_try_tell(stage->try, &report);
    } else {
        umbj_try_tell_phase(stage->try, "merge"); /* a sign of life */
    }
}

/* Handles a task's failure: the task is tried again, or the try ends. */
static enum umbj_failure take_failure(struct stage *stage, int folder, const char *name,
                                      uint32_t number, int code)
{
    struct umbj_try *try = stage->try;
    const struct umbj_process_end end = {.exit_code = code <= 128 ? code : -1,
                                         .signal = code > 128 ? code - 128 : 0};
    take_last_line(try, folder, name);
    (void)unlinkat(folder, name, 0);
    const enum umbj_failure failure = umbj_try_judge(try, &end);
    tell_task(stage, number, failure, try->cause);
    if (stage->is_array && (failure == UMBJ_TEMPORARY || failure == UMBJ_IO) &&
        stage->tries[number] < TASK_TRIES) {
        stage->wanted[number] = 1;
        return UMBJ_NO_FAILURE;
    }
    return failure;
}

static void take_done(struct stage *stage, int folder, const char *name, uint32_t number)
{
    char text[512];
    if (!stage->done[number]) {
        stage->done[number] = 1;
        stage->wanted[number] = 0;
        stage->done_count++;
        read_part(folder, name, 0, text, sizeof text);
        stage->found_count += strstr(text, "\"tiles_found\":1,") != NULL;
    }
}

/* Reading of a stage's folder. */
struct ends {
    struct stage *stage;
    enum umbj_failure failure;
};

static void read_end(void *user, int folder, const char *name)
{
    struct ends *ends = user;
    struct stage *stage = ends->stage;
    unsigned number = 0, code = 0;
    if (ends->failure != UMBJ_NO_FAILURE) {
        return;
    }
    if (sscanf(name, "done.%u", &number) == 1 && number < stage->farm.count) {
        take_done(stage, folder, name, number);
    } else if (sscanf(name, "fail.%u.%u.", &number, &code) == 2 && number < stage->farm.count &&
               code < 256 && !stage->done[number]) { /* else the end file of a duplicate */
        ends->failure = take_failure(stage, folder, name, number, (int)code);
    }
}

/* Reads the end files in the stage's folder. If the folder cannot be read, the next round tries
 * again. */
static enum umbj_failure read_ends(struct stage *stage)
{
    struct ends ends = {.stage = stage};
    (void)umbj_folder_each(open(stage->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC), read_end,
                           &ends);
    return ends.failure;
}

/* Notes which of the submitted tasks the farm took. */
static void note_taken(struct stage *stage)
{
    for (uint32_t i = 0; i < stage->farm.count; i++) {
        if (stage->asked[i] && !stage->wanted[i]) {
            stage->tries[i]++;
            stage->unknown[i] = 0;
        }
    }
}

/* 1 if the farm knows a task of the stage, whether it waits or runs. */
static int has_any(const struct stage *stage)
{
    return memchr(stage->known, UMBJ_TASK_WAITS, stage->farm.count) != NULL ||
           memchr(stage->known, UMBJ_TASK_RUNS, stage->farm.count) != NULL;
}

/* Notes that the farm refused `first` and maybe more tasks, or that its answer was lost. The
 * submission is repeated in later rounds. Refusals fail the stage only after a long time, and never
 * while tasks of this stage are queued or running: the farm may be waiting for their places. */
static enum umbj_failure note_refusal(struct stage *stage, uint32_t first, enum umb_status status,
                                      const struct umb_error *error)
{
    if (stage->refused_ms == 0) {
        stage->refused_ms = umbu_clock_ms();
        tell_task(stage, first, UMBJ_TEMPORARY, error->message);
    }
    return !has_any(stage) && umbu_clock_ms() - stage->refused_ms > PATIENCE_MS
               ? umbj_try_fail_status(stage->try, status, error)
               : UMBJ_NO_FAILURE;
}

static int is_stopped(const struct stage *stage, int wait_ms)
{
    struct pollfd stop = {.fd = stage->try->stop, .events = POLLIN};
    return poll(&stop, 1, wait_ms) > 0;
}

/* Submits the wanted tasks. */
static enum umbj_failure submit(struct stage *stage)
{
    struct umbj_try *try = stage->try;
    struct umbj_farm *farm = try->options->farm;
    struct umb_error error = {0};
    const uint8_t *first = memchr(stage->wanted, 1, stage->farm.count);
    for (uint32_t i = 0; i < stage->farm.count; i++) {
        if (stage->wanted[i] && stage->tries[i] >= TASK_TRIES) {
            return umbj_try_fail(try, UMBJ_LOST, "%s %u was lost %d times", stage->kind, i,
                                 TASK_TRIES);
        }
    }
    if (first == NULL) {
        return UMBJ_NO_FAILURE;
    }
    memcpy(stage->asked, stage->wanted, stage->farm.count);
    const enum umb_status status =
        farm->submit(farm, &stage->farm, stage->is_array ? stage->wanted : NULL, &error);
    if (status == UMB_OK) {
        memset(stage->wanted, 0, stage->farm.count);
        stage->answered_ms = umbu_clock_ms();
        stage->refused_ms = 0;
    }
    note_taken(stage);
    return status == UMB_OK || is_stopped(stage, 0)
               ? UMBJ_NO_FAILURE
               : note_refusal(stage, (uint32_t)(first - stage->wanted), status, &error);
}

/* Asks the farm for the tasks' states. A task is wanted again if the farm does not know it and it
 * left no end file. */
static enum umbj_failure ask(struct stage *stage)
{
    struct umbj_farm *farm = stage->try->options->farm;
    struct umb_error error = {0};
    const enum umb_status status = farm->status(farm, &stage->farm, stage->known, &error);
    stage->heard = status == UMB_OK;
    if (status != UMB_OK) {
        return umbu_clock_ms() - stage->answered_ms > PATIENCE_MS
                   ? umbj_try_fail_status(stage->try, status, &error)
                   : UMBJ_NO_FAILURE;
    }
    if (memchr(stage->known, UMBJ_TASK_RUNS, stage->farm.count) != NULL) {
        stage->ran_ms += umbu_clock_ms() - stage->answered_ms;
    }
    stage->answered_ms = umbu_clock_ms();
    tell_count(stage);
    for (uint32_t i = 0; i < stage->farm.count; i++) {
        if (stage->refused_ms != 0 && stage->wanted[i] && stage->known[i]) {
            stage->wanted[i] = 0; /* the farm took it, and its answer was lost */
            stage->tries[i]++;
        }
        const int missing = !stage->done[i] && !stage->known[i] && !stage->wanted[i];
        stage->unknown[i] = (uint8_t)(missing ? stage->unknown[i] + 1 : 0);
        if (stage->unknown[i] >= LOST_LOOKS) {
            tell_task(stage, i, UMBJ_LOST, "the farm does not know it any more");
            stage->wanted[i] = 1;
        }
    }
    return UMBJ_NO_FAILURE;
}

/* Cancels orphaned tasks every ORPHANS_MS; a failed attempt is repeated in the next round. */
static void end_orphans(struct stage *stage)
{
    const struct umbj_try_options *options = stage->try->options;
    struct umb_error ignored;
    if (umbu_clock_ms() >= stage->orphans_ms &&
        options->farm->reconcile(options->farm, options->work, stage->try->stop, &ignored) ==
            UMB_OK) {
        stage->orphans_ms = umbu_clock_ms() + ORPHANS_MS;
    }
}

/* Does one round of the loop. Returns 1 if the stage is over: it has failed (*failure) or all tasks
 * are done. */
static int step(struct stage *stage, enum umbj_failure *failure)
{
    struct umbj_try *try = stage->try;
    const uint32_t before = stage->done_count;
    *failure = read_ends(stage);
    if (stage->done_count != before) {
        tell_count(stage);
    }
    if (*failure != UMBJ_NO_FAILURE || stage->done_count == stage->farm.count) {
        return 1;
    }
    if (stage->ran_ms > (int64_t)try->options->timeout_ms) {
        *failure = umbj_try_fail(try, UMBJ_TIMEOUT,
                                 "the bake took longer than the server allows (--job-time)");
        return 1;
    }
    if (umbu_clock_ms() >= stage->ask_ms) {
        *failure = ask(stage);
        /* Else some tasks may be there already. */
        if (*failure == UMBJ_NO_FAILURE && stage->heard) {
            *failure = submit(stage);
        }
        end_orphans(stage);
        stage->ask_ms = umbu_clock_ms() + (int64_t)try->options->interval_ms;
    }
    return *failure != UMBJ_NO_FAILURE;
}

static enum umbj_failure run_stage(struct stage *stage)
{
    enum umbj_failure failure = submit(stage);
    const int64_t interval = (int64_t)stage->try->options->interval_ms;
    const int look_ms = (int)(interval / 4 < LOOK_MS ? interval / 4 : LOOK_MS);
    stage->ask_ms = umbu_clock_ms() + interval;
    while (failure == UMBJ_NO_FAILURE && !step(stage, &failure)) {
        if (is_stopped(stage, look_ms)) {
            return umbj_try_fail(stage->try, UMBJ_CANCELLED, "stopped");
        }
    }
    if (stage->orphans_ms == 0) {
        /* A short stage may be over before its first round, and the next stage too; so orphans are
         * cancelled here. */
        end_orphans(stage);
    }
    return failure;
}

/* Runs a command as a stage of count tasks; finishes words. */
static enum umbj_failure do_stage(struct umbj_try *try, const char *kind, uint32_t count,
                                  uint64_t texels, struct umbj_words *words)
{
    const struct umbj_work *work = try->work;
    struct umb_error error = {0};
    struct stage stage = {.try = try,
                          .kind = kind,
                          .is_array = texels > 0,
                          .texels = texels,
                          .answered_ms = umbu_clock_ms()};
    uint8_t *block = calloc(count, 6);
    enum umbj_failure failure = UMBJ_NO_FAILURE;
    snprintf(stage.folder, sizeof stage.folder, "%s/%s", work->folder, kind);
    snprintf(stage.name, sizeof stage.name, "%s.%lld.%s", work->job, (long long)work->epoch, kind);
    umbj_folder_remove(AT_FDCWD, stage.folder); /* files of an earlier round */
    if (block == NULL || words->failed) {
        failure = umbj_try_fail(try, UMBJ_TEMPORARY, "out of memory for %u tasks", count);
    } else if (mkdir(stage.folder, 0700) != 0) {
        (void)umb_fail_errno(&error, UMB_E_IO, errno, "cannot make a folder for the tasks");
        failure = umbj_try_fail_status(try, UMB_E_IO, &error);
    } else {
        uint8_t **const arrays[6] = {&stage.done,  &stage.wanted,  &stage.known,
                                     &stage.tries, &stage.unknown, &stage.asked};
        for (size_t i = 0; i < 6; i++) {
            *arrays[i] = block + i * count;
        }
        memset(stage.wanted, 1, count);
        stage.farm = (struct umbj_farm_stage){.name = stage.name,
                                              .folder = stage.folder,
                                              .words = words->list,
                                              .threads = try->options->threads,
                                              .count = count,
                                              .max_output_bytes = try->options->max_output_bytes,
                                              .stop = try->stop};
        failure = run_stage(&stage);
    }
    umbj_words_finish(words);
    free(block);
    return failure;
}

/* Adds the words that all commands of a try have after their task. */
static void add_common(const struct umbj_try *try, struct umbj_words *words)
{
    umbj_words_add(words, "--memory=%llu", (unsigned long long)try->options->memory_bytes);
    umbj_words_add(words, "--threads=%u", try->options->threads);
    umbj_words_add(words, "--quiet");
    umbj_words_add_sandbox(words, try->options->sandbox);
    umbj_words_add_settings(words, try->work->settings, try->options->tile);
    umbj_words_add(words, "--scene-buffer=%s/scene", try->work->folder);
}

/* Reads the scene, once for all. */
static enum umbj_failure import(struct umbj_try *try)
{
    struct umbj_words words = {0};
    umbj_words_add_all(&words, try->options->program, "import", NULL);
    umbj_words_add(&words, "./%s", try->work->scene);
    umbj_words_add(&words, "--output=%s/scene", try->work->folder);
    umbj_words_add(&words, "--memory=%llu", (unsigned long long)try->options->memory_bytes);
    umbj_words_add(&words, "--progress-fd=%d", UMBJ_WORKER_FD_PROGRESS);
    umbj_words_add_sandbox(&words, try->options->sandbox);
    return umbj_try_run(try, &words, try->work->bundle);
}

/* Makes a plan of the bake: refuses bad settings before the farm is used, reports the plan, and
 * counts the tiles. */
static enum umbj_failure plan(struct umbj_try *try, uint64_t *tiles)
{
    struct umbj_words words = {0};
    umbj_words_add_all(&words, try->options->program, "--plan", NULL);
    umbj_words_add(&words, "--progress-fd=%d", UMBJ_WORKER_FD_PROGRESS);
    add_common(try, &words);
    try->tiles = 0;
    const enum umbj_failure failure = umbj_try_run(try, &words, "/");
    *tiles = try->tiles;
    if (failure == UMBJ_NO_FAILURE && (*tiles == 0 || *tiles > UMBJ_TASKS_MAX)) {
        return umbj_try_fail(try, UMBJ_REJECTED,
                             "%llu tiles: a farm gets 1 to %d of them; use a smaller resolution or "
                             "fewer lights",
                             (unsigned long long)*tiles, UMBJ_TASKS_MAX);
    }
    return failure;
}

static enum umbj_failure bake_tiles(struct umbj_try *try, const char *folder, uint32_t count)
{
    struct umbj_words words = {0};
    const unsigned long edge = umbj_tile_edge(try->work->settings, try->options->tile);
    umbj_try_tell_phase(try, "bake");
    umbj_words_add_all(&words, try->options->program, "tile", "--json", NULL);
    umbj_words_add(&words, "--output=%s", folder);
    if (try->work->cache != NULL) {
        umbj_words_add(&words, "--cache-size=%llu", (unsigned long long)try->options->cache_bytes);
    }
    add_common(try, &words);
    return do_stage(try, "tile", count, (uint64_t)edge * edge, &words);
}

/* Runs the merge. folder: of tiles; NULL: the whole bake in one task. */
static enum umbj_failure merge(struct umbj_try *try, const char *folder)
{
    struct umbj_words words = {0};
    umbj_try_tell_phase(try, folder != NULL ? "merge" : "bake");
    umbj_words_add(&words, "%s", try->options->program);
    if (folder != NULL) {
        umbj_words_add(&words, "merge");
        umbj_words_add(&words, "--from=%s", folder);
    }
    umbj_words_add(&words, "--output=%s/out.umb", try->work->folder);
    add_common(try, &words);
    return do_stage(try, "merge", 1, 0, &words);
}

static enum umbj_failure bake(struct umbj_try *try)
{
    char folder[4300]; /* of the tiles: the owner's, or the try's */
    uint64_t tiles = 0;
    enum umbj_failure failure = import(try);
    if (failure == UMBJ_NO_FAILURE) {
        failure = plan(try, &tiles);
    }
    if (failure != UMBJ_NO_FAILURE) {
        return failure;
    }
    if (!umbj_try_keeps_tiles(try)) {
        return merge(try, NULL);
    }
    snprintf(folder, sizeof folder, "%s%s",
             try->work->cache != NULL ? try->work->cache : try->work->folder,
             try->work->cache != NULL ? "" : "/tiles");
    for (int round = 0; round < ROUNDS; round++) {
        failure = bake_tiles(try, folder, (uint32_t)tiles);
        if (failure != UMBJ_NO_FAILURE) {
            return failure;
        }
        failure = merge(try, folder);
        if (failure != UMBJ_TEMPORARY) { /* no tile was missing */
            return failure;
        }
    }
    return failure;
}

enum umbj_failure umbj_bake_on_farm(struct umbj_try *try)
{
    struct umbj_farm *farm = try->options->farm;
    char name[80];
    const enum umbj_failure failure = bake(try);
    snprintf(name, sizeof name, "%s.%lld", try->work->job, (long long)try->work->epoch);
    farm->cancel(farm, name); /* duplicates, and tasks that a failure left */
    return failure;
}
