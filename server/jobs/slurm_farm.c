/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Slurm as a farm, see farm.h. Tasks are found by their name, umbrage-TAG-JOB.EPOCH.KIND.OFFSET.
 * Slurm's job numbers are not stored, so they cannot get lost.
 */
#include "jobs/farm.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/sha256.h"
#include "jobs/worker_process.h"

#define ARRAY_MOST 1000 /* tasks of one submission: below Slurm's default MaxArraySize, 1001 */
/* Most job ids in one command, because a command line's length and CALL_MS are limited. */
#define IDS_MOST 500
#define CALL_MS  30000 /* time limit of a Slurm command: several times its MessageTimeout */
/* Time limit in milliseconds of a command that cancels a try's tasks; a stopping daemon waits for
 * it. */
#define LAST_MS   5000
#define BLOCK     512 /* unit in bytes of the shell's ulimit */
#define TAG_SIZE  24
#define NAME_SIZE 128
#define ID_SIZE   64
#define WORD_MOST 4096

/* Script that Slurm copies to the nodes. Its environment is Slurm's; its arguments are the
 * command. */
static const char script[] =
    "#!/bin/sh\n"
    "# A task of a bake that umbraged submitted: FOLDER OFFSET ARRAY BLOCKS COMMAND...\n"
    "# Its end is a file in FOLDER (server/jobs/farm.h); it ends itself when that is gone.\n"
    "set -u\n"
    "folder=$1 offset=$2 array=$3 blocks=$4\n"
    "shift 4\n"
    "number=$((offset + ${SLURM_ARRAY_TASK_ID:-0}))\n"
    "serial=${SLURM_JOB_ID:-0}-${SLURM_RESTART_COUNT:-0}\n"
    "[ -d \"$folder\" ] && [ ! -e \"$folder/done.$number\" ] || exit 0\n"
    "[ \"$array\" = 0 ] || set -- \"$@\" \"--only=$number\"\n"
    "log=$folder/log.$number.$serial\n"
    "(ulimit -f \"$blocks\"; exec \"$@\") >\"$log\" 2>&1 </dev/null &\n"
    "child=$!\n"
    "(\n"
    "    while [ -d \"$folder\" ]; do sleep 1; done\n"
    "    kill -9 \"$child\" 2>/dev/null\n"
    ") &\n"
    "watcher=$!\n"
    "wait \"$child\"\n"
    "code=$?\n"
    "kill \"$watcher\" 2>/dev/null\n"
    "[ -d \"$folder\" ] || exit 0\n"
    "end=done.$number\n"
    "[ \"$code\" -eq 0 ] || end=fail.$number.$code.$serial\n"
    "exec mv -f \"$log\" \"$folder/$end\"\n";

struct slurm {
    struct umbj_farm interface;
    struct umbj_slurm_options options;
    char tag[TAG_SIZE]; /* "umbrage-TAG-" */
};

/* Limits of a command: a time, and a descriptor that ends the command early, with the try or the
 * daemon. */
struct patience {
    uint64_t ms;
    int stop; /* Descriptor as in umbj_process.stop */
};

/* Output of a command: its last words, and a callback for each line of standard output. */
struct talk {
    char last[UMBJ_CAUSE_SIZE];
    void (*line)(void *user, const char *line); /* may be NULL */
    void *user;
};

static void on_said(void *user, const char *line)
{
    struct talk *talk = user;
    snprintf(talk->last, sizeof talk->last, "%s", line);
}

static void on_line(void *user, const char *line)
{
    struct talk *talk = user;
    if (talk->line != NULL) {
        talk->line(talk->user, line);
    }
}

/* Adds the first words of a Slurm command. The command's standard output goes to the progress
 * descriptor. */
static void begin_words(const struct slurm *slurm, const char *command, struct umbj_words *words)
{
    const char *search = slurm->options.search, *configuration = slurm->options.configuration;
    umbj_words_add_all(words, "/bin/sh", "-c", NULL);
    umbj_words_add(words,
                   "PATH=$0; export PATH\n[ -z \"$1\" ] || { SLURM_CONF=$1; export SLURM_CONF; }\n"
                   "shift\nexec \"$@\" >&%d 3>&-",
                   UMBJ_WORKER_FD_PROGRESS);
    umbj_words_add_all(words, search != NULL ? search : "/usr/local/bin:/usr/bin:/bin",
                       configuration != NULL ? configuration : "", command, NULL);
}

/* Runs a command of Slurm; finishes words. In: line: as in struct talk. */
static enum umb_status call(const char *command, struct umbj_words *words, struct patience patience,
                            void (*line)(void *user, const char *line), void *user,
                            struct umb_error *error)
{
    struct talk talk = {.line = line, .user = user};
    struct umbj_process_end end;
    const struct umbj_process process = {
        .folder = "/",
        /* No limit here: sbatch would pass its own limits on to the tasks. */
        .max_output_bytes = (uint64_t)1 << 62,
        .timeout_ms = patience.ms,
        .stop = patience.stop,
        .said = on_said,
        .progress = on_line,
        .user = &talk,
    };
    UMB__TRY(umbj_process_run(&process, words, &end, error));
    if (end.stopped || end.timed_out) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "Slurm: %s %s", command,
                        end.stopped ? "was stopped" : "did not answer in time");
    }
    return end.exit_code == 0
               ? UMB_OK
               : umb_fail(error, UMB_E_UNAVAILABLE, "Slurm: %s ended with %d: %.300s", command,
                          end.exit_code, talk.last);
}

/* Writes the script into the try's folder, once; returns 0 or -1. */
static int write_script(const char *path)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0700);
    const int written =
        fd >= 0 && write(fd, script, sizeof script - 1) == (ssize_t)sizeof script - 1;
    return fd >= 0 && close(fd) == 0 && written ? 0 : -1;
}

/* Adds sbatch with all its options but the array. */
static void add_sbatch(const struct slurm *slurm, const struct umbj_farm_stage *stage,
                       uint32_t offset, struct umbj_words *words)
{
    const char *more = slurm->options.words;
    begin_words(slurm, "sbatch", words);
    umbj_words_add_all(words, "--parsable", "--requeue", "--output=/dev/null", "--chdir=/",
                       "--export=NONE", NULL);
    umbj_words_add(words, "--job-name=%s%s.%u", slurm->tag, stage->name, offset);
    umbj_words_add(words, "--cpus-per-task=%u", stage->threads);
    for (const char *at = more != NULL ? more : ""; *at != '\0';) {
        const size_t length = strcspn(at, " ");
        if (length > 0) {
            umbj_words_add(words, "%.*s", (int)length, at);
        }
        at += length + (at[length] != '\0');
    }
}

static enum umb_status submit(const struct slurm *slurm, const struct umbj_farm_stage *stage,
                              uint32_t offset, const char *array, struct umb_error *error)
{
    struct umbj_words words = {0};
    char path[4300];
    snprintf(path, sizeof path, "%s/task", stage->folder);
    if (write_script(path) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot write the script of a task");
    }
    add_sbatch(slurm, stage, offset, &words);
    if (array != NULL) {
        umbj_words_add(&words, "--array=%s", array);
    }
    umbj_words_add_all(&words, path, stage->folder, NULL);
    umbj_words_add(&words, "%u", offset);
    umbj_words_add(&words, "%d", array != NULL);
    umbj_words_add(&words, "%llu", (unsigned long long)(stage->max_output_bytes / BLOCK + 1));
    for (size_t i = 0; stage->words[i] != NULL; i++) {
        umbj_words_add_all(&words, stage->words[i], NULL);
    }
    return call("sbatch", &words, (struct patience){CALL_MS, stage->stop}, NULL, NULL, error);
}

/* Writes the wanted task numbers of one submission in Slurm's form: "0-15,17". Returns the first
 * number that did not fit, or `to`. */
static uint32_t write_array(const uint8_t *wanted, uint32_t from, uint32_t to, char *text,
                            size_t size)
{
    size_t used = 0;
    uint32_t number = from;
    text[0] = '\0';
    while (number < to && used + 32 < size) {
        uint32_t last = number;
        if (!wanted[number]) {
            number++;
            continue;
        }
        while (last + 1 < to && wanted[last + 1]) {
            last++;
        }
        used += (size_t)snprintf(text + used, size - used, last > number ? "%s%u-%u" : "%s%u",
                                 used > 0 ? "," : "", number - from, last - from);
        number = last + 1;
    }
    return number;
}

static enum umb_status slurm_submit(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    uint8_t *wanted, struct umb_error *error)
{
    char array[WORD_MOST];
    if (wanted == NULL) {
        return submit((struct slurm *)self, stage, 0, NULL, error);
    }
    enum umb_status status = UMB_OK;
    for (uint32_t from = 0; status == UMB_OK && from < stage->count;) {
        const uint32_t most = stage->count - from < ARRAY_MOST ? stage->count - from : ARRAY_MOST;
        const uint32_t next = write_array(wanted, from, from + most, array, sizeof array);
        if (array[0] != '\0') {
            status = submit((struct slurm *)self, stage, from, array, error);
        }
        if (status == UMB_OK) {
            memset(wanted + from, 0, next - from);
        }
        from = next;
    }
    return status;
}

/* A line of the queue. */
struct task {
    char id[ID_SIZE];     /* such as 17_3 */
    char index[16];       /* such as 3, or N/A */
    char state[16];       /* such as PD or R */
    char name[NAME_SIZE]; /* name without the tag */
    char reason[64];
};

/* State of one walk through Slurm's queue: its purpose, and the results. */
struct look {
    const struct slurm *slurm;
    struct patience patience;
    void (*task)(struct look *look, const struct task *task);
    const struct umbj_farm_stage *stage; /* for status */
    uint8_t *known;
    const char *name, *work;  /* for cancel; for reconcile */
    struct umbj_words ending; /* ids of arrays to be cancelled */
    struct umbj_words held;   /* ids of tasks that are only held back */
};

static void on_task(void *user, const char *line)
{
    struct look *look = user;
    struct task task = {.reason = ""};
    const size_t tag = strlen(look->slurm->tag);
    char name[NAME_SIZE];
    if (sscanf(line, "%63s %15s %15s %127s %63[^\n]", task.id, task.index, task.state, name,
               task.reason) >= 4 &&
        task.id[0] >= '0' && task.id[0] <= '9' && /* it becomes a word: no option */
        strncmp(name, look->slurm->tag, tag) == 0) {
        snprintf(task.name, sizeof task.name, "%s", name + tag);
        look->task(look, &task);
    }
}

static enum umb_status look_at_queue(struct look *look, struct umb_error *error)
{
    struct umbj_words words = {0};
    begin_words(look->slurm, "squeue", &words);
    umbj_words_add_all(&words, "--noheader", "--array", "--me", "--format=%i %K %t %j %r", NULL);
    return call("squeue", &words, look->patience, on_task, look, error);
}

/* Cancels tasks and finishes the ids. If Slurm does not answer, the tasks end by themselves. */
static void end_tasks(struct look *look)
{
    const struct umbj_words *ids = &look->ending;
    enum umb_status status = UMB_OK;
    struct umb_error ignored;
    for (size_t from = 0; status == UMB_OK && from < ids->count; from += IDS_MOST) {
        struct umbj_words words = {0};
        begin_words(look->slurm, "scancel", &words);
        umbj_words_add_all(&words, "--quiet", NULL);
        for (size_t i = from; i < ids->count && i < from + IDS_MOST; i++) {
            umbj_words_add_all(&words, ids->list[i], NULL);
        }
        status = call("scancel", &words, look->patience, NULL, NULL, &ignored);
    }
    umbj_words_finish(&look->ending);
}

/* Releases tasks that Slurm only holds back, and finishes the ids. If a task in the list has just
 * started, the command fails but releases the others. */
static void start_tasks(struct look *look)
{
    const struct umbj_words *ids = &look->held;
    struct umb_error ignored;
    char *list = malloc(IDS_MOST * ID_SIZE);
    for (size_t from = 0; list != NULL && from < ids->count; from += IDS_MOST) {
        struct umbj_words words = {0};
        size_t used = 0;
        for (size_t i = from; i < ids->count && i < from + IDS_MOST; i++) {
            used += (size_t)snprintf(list + used, IDS_MOST * ID_SIZE - used, "%s%s",
                                     used > 0 ? "," : "", ids->list[i]);
        }
        begin_words(look->slurm, "scontrol", &words);
        umbj_words_add(&words, "update");
        umbj_words_add(&words, "JobId=%s", list);
        umbj_words_add(&words, "StartTime=now");
        if (call("scontrol", &words, look->patience, NULL, NULL, &ignored) != UMB_OK && from == 0) {
            break; /* perhaps the controller is gone: it is not tried for each list */
        }
    }
    free(list);
    umbj_words_finish(&look->held);
}

static void note_known(struct look *look, const struct task *task)
{
    unsigned offset = 0, index = 0;
    const size_t length = strlen(look->stage->name);
    if (strncmp(task->name, look->stage->name, length) != 0 ||
        sscanf(task->name + length, ".%u", &offset) != 1) {
        return;
    }
    if (sscanf(task->index, "%u", &index) != 1) {
        index = 0; /* task 0, the merge */
    }
    if (offset < look->stage->count && index < look->stage->count - offset) {
        const int waits = strcmp(task->state, "PD") == 0;
        const uint8_t state = waits ? UMBJ_TASK_WAITS : UMBJ_TASK_RUNS;
        uint8_t *known = &look->known[offset + index];
        *known = state > *known ? state : *known; /* highest state of duplicates */
        if (waits && strcmp(task->reason, "BeginTime") == 0) {
            umbj_words_add(&look->held, "%s", task->id);
        }
    }
}

static enum umb_status slurm_status(struct umbj_farm *self, const struct umbj_farm_stage *stage,
                                    uint8_t *known, struct umb_error *error)
{
    struct look look = {.slurm = (struct slurm *)self,
                        .patience = {CALL_MS, stage->stop},
                        .task = note_known,
                        .stage = stage,
                        .known = known};
    memset(known, 0, stage->count);
    const enum umb_status status = look_at_queue(&look, error);
    start_tasks(&look);
    return status;
}

/* Marks the array of a task for cancelling. All tasks of an array belong to one try. */
static void end_array_of(struct look *look, const struct task *task)
{
    struct umbj_words *ids = &look->ending;
    char id[ID_SIZE];
    snprintf(id, sizeof id, "%.*s", (int)strcspn(task->id, "_"), task->id);
    if (ids->count == 0 || strcmp(ids->list[ids->count - 1], id) != 0) {
        umbj_words_add(ids, "%s", id);
    }
}

static void note_try(struct look *look, const struct task *task)
{
    const size_t length = strlen(look->name);
    if (strncmp(task->name, look->name, length) == 0 && task->name[length] == '.') {
        end_array_of(look, task);
    }
}

static void slurm_cancel(struct umbj_farm *self, const char *name)
{
    struct look look = {
        .slurm = (struct slurm *)self, .patience = {LAST_MS, -1}, .task = note_try, .name = name};
    struct umb_error ignored;
    (void)!look_at_queue(&look, &ignored);
    end_tasks(&look); /* the tasks that were listed */
}

static void note_orphan(struct look *look, const struct task *task)
{
    char path[4300], job[40];
    unsigned long long epoch;
    if (sscanf(task->name, "%39[0-9a-f].%llu.", job, &epoch) == 2) {
        snprintf(path, sizeof path, "%s/%s.%llu", look->work, job, epoch);
        if (access(path, F_OK) != 0 && errno == ENOENT) {
            end_array_of(look, task);
        }
    }
}

static enum umb_status slurm_reconcile(struct umbj_farm *self, const char *work, int stop,
                                       struct umb_error *error)
{
    struct look look = {.slurm = (struct slurm *)self,
                        .patience = {CALL_MS, stop},
                        .task = note_orphan,
                        .work = work};
    const enum umb_status status = look_at_queue(&look, error);
    end_tasks(&look);
    return status;
}

static void slurm_destroy(struct umbj_farm *self)
{
    free(self);
}

enum umb_status umbj_slurm_farm_create(const struct umbj_slurm_options *options,
                                       struct umbj_farm **out, struct umb_error *error)
{
    uint8_t hash[UMBJ_HASH_BYTES];
    *out = NULL;
    struct slurm *slurm = calloc(1, sizeof *slurm);
    if (slurm == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for Slurm");
    }
    slurm->options = *options;
    umbs_sha256_bytes(options->tag_of, strlen(options->tag_of), hash);
    snprintf(slurm->tag, sizeof slurm->tag, "umbrage-%02x%02x%02x%02x-", hash[0], hash[1], hash[2],
             hash[3]);
    slurm->interface = (struct umbj_farm){.submit = slurm_submit,
                                          .status = slurm_status,
                                          .cancel = slurm_cancel,
                                          .reconcile = slurm_reconcile,
                                          .destroy = slurm_destroy};
    *out = &slurm->interface;
    return UMB_OK;
}
