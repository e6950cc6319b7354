/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The local executor. A slot is free, or belongs to one try and its thread until the service's
 * thread has seen that it ended and joined it; only that thread changes who a slot belongs to.
 */
#include "jobs/local_executor.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/scene_text.h"
#include "jobs/command_words.h"
#include "jobs/folder.h"
#include "jobs/staging.h"
#include "jobs/worker_process.h"

struct slot {
    struct local *owner;
    int taken;        /* the service thread's */
    atomic_int ended; /* set by the try's thread as its last act */
    pthread_t thread;
    int stop; /* eventfd */
    struct umbj_work work;
    char *bundle, *folder, *scene, *settings, *cache; /* cache may be NULL */
    char cause[UMBJ_CAUSE_SIZE];                      /* what it said last */
};

struct local {
    struct umbj_executor interface;
    struct umbj_local_options options;
    atomic_int closing;
    struct slot slots[]; /* [options.workers] */
};

static int64_t now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static struct umbj_report report_of(const struct slot *slot, enum umbj_report_kind kind)
{
    struct umbj_report report = {.kind = kind, .epoch = slot->work.epoch, .staged = {.fd = -1}};
    memcpy(report.job, slot->work.job, sizeof report.job);
    return report;
}

static void tell(const struct slot *slot, const struct umbj_report *report)
{
    slot->owner->options.report(slot->owner->options.user, report);
}

/* Takes text from a process that read a stranger's scene. */
static void copy_text(char out[UMBJ_CAUSE_SIZE], const char *text)
{
    umbs_text_clean(out, UMBJ_CAUSE_SIZE, text, strlen(text));
}

static void on_said(void *user, const char *line)
{
    static const char name[] = "umbrage-bake: ", notice[] = "notice: ";
    struct slot *slot = user;
    if (strncmp(line, name, sizeof name - 1) == 0) {
        line += sizeof name - 1;
    }
    if (strncmp(line, notice, sizeof notice - 1) == 0) {
        struct umbj_report report = report_of(slot, UMBJ_REPORT_NOTICE);
        copy_text(report.text, line + sizeof notice - 1);
        tell(slot, &report);
    } else {
        copy_text(slot->cause, line);
    }
}

static void on_progress(void *user, const char *line)
{
    struct slot *slot = user;
    struct umbj_report report = report_of(slot, UMBJ_REPORT_PHASE);
    unsigned long long done = 0, total = 0, found = 0;
    char unit[UMBJ_PHASE_SIZE] = "";
    if (strncmp(line, "phase ", 6) == 0) {
        copy_text(report.text, line + 6);
    } else if (strncmp(line, "plan ", 5) == 0) {
        report.kind = UMBJ_REPORT_PLAN;
        copy_text(report.text, line + 5);
    } else if (sscanf(line, "progress %llu %llu %31s", &done, &total, unit) == 3) {
        report.kind = UMBJ_REPORT_PROGRESS;
        report.done = done;
        report.total = total;
        copy_text(report.text, unit);
    } else if (sscanf(line, "tiles %llu %llu %llu", &done, &total, &found) == 3) {
        report.kind = UMBJ_REPORT_TILES;
        report.done = done;
        report.total = total;
        report.found = found;
    } else {
        return;
    }
    tell(slot, &report);
}

static void make_command(struct slot *slot, struct umbj_words *words)
{
    const struct umbj_local_options *options = &slot->owner->options;
    umbj_words_add(words, "%s", options->program);
    umbj_words_add(words, "--output=%s/out.umb", slot->folder);
    umbj_words_add(words, "--memory=%llu", (unsigned long long)options->memory_bytes);
    umbj_words_add(words, "--threads=%u", options->threads);
    umbj_words_add(words, "--progress-fd=%d", UMBJ_WORKER_FD_PROGRESS);
    /* Embree does not tell which triangles reach a tile, so that its tiles cannot be kept. */
    if (slot->cache != NULL && !umbj_settings_have(slot->settings, "--depth=embree")) {
        umbj_words_add(words, "--cache=%s", slot->cache);
        umbj_words_add(words, "--cache-size=%llu", (unsigned long long)options->cache_bytes);
    }
    umbj_words_add_settings(words, slot->settings, options->tile);
    umbj_words_add(words, "./%s", slot->scene);
}

/* Why a try failed: what the program said last, or what its end tells. */
static void take_cause(const struct slot *slot, const struct umbj_process_end *end,
                       enum umbj_failure failure, char text[UMBJ_CAUSE_SIZE])
{
    if (failure == UMBJ_TIMEOUT) {
        snprintf(text, UMBJ_CAUSE_SIZE, "the bake took longer than the server allows (--job-time)");
    } else if (end->signal != 0) {
        snprintf(text, UMBJ_CAUSE_SIZE, "signal %d (%s) ended the bake", end->signal,
                 umbj_failure_name(failure));
    } else if (slot->cause[0] != '\0') {
        snprintf(text, UMBJ_CAUSE_SIZE, "%s", slot->cause);
    } else {
        snprintf(text, UMBJ_CAUSE_SIZE, "the bake ended with %d", end->exit_code);
    }
}

/* A failure of ours as one of a try. */
static enum umbj_failure failure_of(enum umb_status status)
{
    switch (status) {
    case UMB_E_NO_MEMORY:
    case UMB_E_LIMIT:
    case UMB_E_BUSY:
        return UMBJ_TEMPORARY;
    case UMB_E_IO:
    case UMB_E_CANNOT_CREATE:
        return UMBJ_IO;
    default:
        return UMBJ_INTERNAL;
    }
}

static enum umb_status run_process(struct slot *slot, struct umbj_process_end *end,
                                   struct umb_error *error)
{
    const struct umbj_local_options *options = &slot->owner->options;
    struct umbj_words words = {0};
    if (mkdir(slot->folder, 0700) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot make a folder for the bake");
    }
    make_command(slot, &words);
    const struct umbj_process process = {
        .program = options->program,
        .arguments = words.list,
        .folder = slot->bundle,
        .max_output_bytes = options->max_output_bytes,
        .timeout_ms = options->timeout_ms,
        .stop = slot->stop,
        .said = on_said,
        .progress = on_progress,
        .user = slot,
    };
    const enum umb_status status =
        words.failed ? umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a command line")
                     : umbj_process_run(&process, end, error);
    umbj_words_finish(&words);
    return status;
}

static void bake(struct slot *slot, struct umbj_report *ended)
{
    struct umbj_process_end end = {.exit_code = -1};
    struct umb_error error = {0};
    char output[4200];
    enum umb_status status = run_process(slot, &end, &error);
    if (status == UMB_OK) {
        ended->failure = umbj_process_judge(&end);
        if (ended->failure != UMBJ_NO_FAILURE) {
            take_cause(slot, &end, ended->failure, ended->text);
            return;
        }
        struct umbj_report phase = report_of(slot, UMBJ_REPORT_PHASE);
        snprintf(phase.text, sizeof phase.text, "publish");
        tell(slot, &phase);
        snprintf(output, sizeof output, "%s/out.umb", slot->folder);
        status =
            umbj_stage(output, slot->owner->options.assets, &ended->staged, ended->asset, &error);
    }
    if (status != UMB_OK) {
        ended->failure = failure_of(status);
        snprintf(ended->text, sizeof ended->text, "%s", error.message);
    }
}

/* Takes as long as the bake took that gave the asset. */
static void wait_as_known(struct slot *slot, struct umbj_report *ended)
{
    const int64_t start = now_ms();
    int64_t passed = 0;
    struct umbj_report report = report_of(slot, UMBJ_REPORT_PHASE);
    snprintf(report.text, sizeof report.text, "bake");
    while (passed < slot->work.known_ms) {
        tell(slot, &report); /* a sign of life: the lease may be shorter than the bake was */
        struct pollfd stop = {.fd = slot->stop, .events = POLLIN};
        const int64_t left = slot->work.known_ms - passed;
        (void)poll(&stop, 1, left < 500 ? (int)left : 500);
        if (stop.revents != 0) {
            ended->failure = UMBJ_CANCELLED;
            snprintf(ended->text, sizeof ended->text, "stopped");
            return;
        }
        passed = now_ms() - start;
    }
    memcpy(ended->asset, slot->work.known_asset, sizeof ended->asset);
}

static void remove_folder(const char *path)
{
    const char *slash = strrchr(path, '/');
    char parent[4200];
    if (slash != NULL && (size_t)(slash - path) < sizeof parent) {
        memcpy(parent, path, (size_t)(slash - path));
        parent[slash - path] = '\0';
        int fd = open(parent, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (fd >= 0) {
            umbj_folder_remove(fd, slash + 1);
            close(fd);
        }
    }
}

static void *run_try(void *user)
{
    struct slot *slot = user;
    const int64_t start = now_ms();
    struct umbj_report ended = report_of(slot, UMBJ_REPORT_ENDED);
    if (slot->work.is_known) {
        wait_as_known(slot, &ended);
        ended.bake_ms = slot->work.known_ms;
    } else {
        bake(slot, &ended);
        ended.bake_ms = now_ms() - start;
        remove_folder(slot->folder);
    }
    const int closing = atomic_load(&slot->owner->closing);
    if (closing) {
        umbs_file_abandon(&ended.staged);
    }
    atomic_store(&slot->ended, 1); /* before the report: who gets it may start the next at once */
    if (!closing) {
        tell(slot, &ended);
    }
    return NULL;
}

static void release(struct slot *slot)
{
    pthread_join(slot->thread, NULL);
    close(slot->stop);
    free(slot->bundle);
    free(slot->folder);
    free(slot->scene);
    free(slot->settings);
    free(slot->cache);
    slot->taken = 0;
}

/* Joins the threads of tries that ended. */
static void reap(struct local *local)
{
    for (unsigned i = 0; i < local->options.workers; i++) {
        struct slot *slot = &local->slots[i];
        if (slot->taken && atomic_load(&slot->ended)) {
            release(slot);
        }
    }
}

static int local_free_slots(struct umbj_executor *self)
{
    struct local *local = (struct local *)self;
    int count = 0;
    reap(local);
    for (unsigned i = 0; i < local->options.workers; i++) {
        count += !local->slots[i].taken;
    }
    return count;
}

static int copy_work(struct slot *slot, const struct umbj_work *work)
{
    slot->work = *work;
    slot->bundle = strdup(work->bundle);
    slot->folder = strdup(work->folder);
    slot->scene = strdup(work->scene);
    slot->settings = strdup(work->settings);
    slot->cache = work->cache != NULL ? strdup(work->cache) : NULL;
    return slot->bundle != NULL && slot->folder != NULL && slot->scene != NULL &&
           slot->settings != NULL && (work->cache == NULL || slot->cache != NULL);
}

static enum umb_status local_start(struct umbj_executor *self, const struct umbj_work *work,
                                   struct umb_error *error)
{
    struct local *local = (struct local *)self;
    struct slot *slot = NULL;
    reap(local);
    for (unsigned i = 0; i < local->options.workers && slot == NULL; i++) {
        slot = local->slots[i].taken ? NULL : &local->slots[i];
    }
    if (slot == NULL) {
        return umb_fail(error, UMB_E_BUSY, "every worker is busy");
    }
    *slot = (struct slot){.owner = local, .stop = eventfd(0, EFD_CLOEXEC)};
    if (slot->stop < 0 || !copy_work(slot, work) ||
        pthread_create(&slot->thread, NULL, run_try, slot) != 0) {
        if (slot->stop >= 0) {
            close(slot->stop);
        }
        free(slot->bundle);
        free(slot->folder);
        free(slot->scene);
        free(slot->settings);
        free(slot->cache);
        return umb_fail(error, UMB_E_NO_MEMORY, "worker: no memory or no thread to be had");
    }
    slot->taken = 1;
    return UMB_OK;
}

static void stop(struct slot *slot)
{
    const uint64_t one = 1;
    (void)!write(slot->stop, &one, sizeof one); /* cannot fail: nobody counts up to 2^64 */
}

static void local_cancel(struct umbj_executor *self, const char *job, int64_t epoch)
{
    struct local *local = (struct local *)self;
    for (unsigned i = 0; i < local->options.workers; i++) {
        struct slot *slot = &local->slots[i];
        if (slot->taken && slot->work.epoch == epoch && strcmp(slot->work.job, job) == 0) {
            stop(slot);
        }
    }
}

static void local_destroy(struct umbj_executor *self)
{
    struct local *local = (struct local *)self;
    atomic_store(&local->closing, 1);
    for (unsigned i = 0; i < local->options.workers; i++) {
        if (local->slots[i].taken) {
            stop(&local->slots[i]);
        }
    }
    for (unsigned i = 0; i < local->options.workers; i++) {
        if (local->slots[i].taken) {
            release(&local->slots[i]);
        }
    }
    free(local);
}

enum umb_status umbj_local_executor_create(const struct umbj_local_options *options,
                                           struct umbj_executor **out, struct umb_error *error)
{
    *out = NULL;
    if (access(options->program, X_OK) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "bake program '%.200s'",
                              options->program);
    }
    struct local *local = calloc(1, sizeof *local + options->workers * sizeof local->slots[0]);
    if (local == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the workers");
    }
    local->options = *options;
    local->interface = (struct umbj_executor){.start = local_start,
                                              .cancel = local_cancel,
                                              .free_slots = local_free_slots,
                                              .destroy = local_destroy};
    *out = &local->interface;
    return UMB_OK;
}
