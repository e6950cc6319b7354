/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The executor. A slot is free, or belongs to one try and its thread. It becomes free when the
 * service's thread has handled the end of the try and joined the try's thread. Only the service's
 * thread assigns slots.
 */
#include "jobs/executor.h"

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
#include <unistd.h>

#include "common/file_system.h"
#include "tool/clock.h"
#include "jobs/bake_try.h"
#include "jobs/folder.h"
#include "jobs/staging.h"

struct slot {
    struct executor *owner;
    int taken;        /* touched by the service's thread only */
    atomic_int ended; /* set by the try's thread as its last action */
    pthread_t thread;
    int stop;              /* eventfd */
    struct umbj_work work; /* Work with copies of its texts */
};

struct executor {
    struct umbj_executor interface;
    struct umbj_try_options options;
    atomic_int closing;
    struct slot slots[]; /* [options.workers] */
};

static enum umbj_failure bake(struct umbj_try *try, struct umbj_report *ended)
{
    const struct umbj_try_options *options = try->options;
    const char *folder = try->work->folder;
    char output[4200];
    struct umb_error error = {0};
    if (mkdir(folder, 0700) != 0) {
        (void)umb_fail_errno(&error, UMB_E_IO, errno, "cannot make a folder for the bake");
        return umbj_try_fail_status(try, UMB_E_IO, &error);
    }
    const enum umbj_failure failure =
        options->farm != NULL ? umbj_bake_on_farm(try) : umbj_bake_here(try);
    if (failure != UMBJ_NO_FAILURE) {
        return failure;
    }
    umbj_try_tell_phase(try, "publish");
    snprintf(output, sizeof output, "%s/out.umb", folder);
    const enum umb_status status = umbj_stage(output, options->max_output_bytes, options->assets,
                                              &ended->staged, ended->asset, &error);
    return status == UMB_OK ? UMBJ_NO_FAILURE : umbj_try_fail_status(try, status, &error);
}

/* Waits as long as the bake took that gave the asset. */
static enum umbj_failure wait_as_known(struct umbj_try *try)
{
    const int64_t start = umbu_clock_ms();
    int64_t passed = 0;
    while (passed < try->work->known_ms) {
        umbj_try_tell_phase(try, "bake"); /* a sign of life: the lease may be shorter */
        struct pollfd stop = {.fd = try->stop, .events = POLLIN};
        const int64_t left = try->work->known_ms - passed;
        (void)poll(&stop, 1, left < 500 ? (int)left : 500);
        if (stop.revents != 0) {
            return umbj_try_fail(try, UMBJ_CANCELLED, "stopped");
        }
        passed = umbu_clock_ms() - start;
    }
    return UMBJ_NO_FAILURE;
}

static void *run_try(void *user)
{
    struct slot *slot = user;
    struct umbj_try try = {
        .options = &slot->owner->options, .work = &slot->work, .stop = slot->stop};
    const int64_t start = umbu_clock_ms();
    struct umbj_report ended = umbj_try_report(&try, UMBJ_REPORT_ENDED);
    if (slot->work.is_known) {
        ended.failure = wait_as_known(&try);
        ended.bake_ms = slot->work.known_ms;
        memcpy(ended.asset, slot->work.known_asset, sizeof ended.asset);
    } else {
        ended.failure = bake(&try, &ended);
        ended.bake_ms = umbu_clock_ms() - start;
        umbj_folder_drop(AT_FDCWD, slot->work.folder); /* its farm's tasks then end (farm.h) */
    }
    memcpy(ended.text, try.cause, sizeof ended.text);
    const int closing = atomic_load(&slot->owner->closing);
    if (closing) {
        umbu_output_abandon(&ended.staged);
    }
    /* Before the report: its receiver may start the next try at once. */
    atomic_store(&slot->ended, 1);
    if (!closing) {
        umbj_try_tell(&try, &ended);
    }
    return NULL;
}

static void free_texts(struct umbj_work *work)
{
    free((void *)work->bundle);
    free((void *)work->folder);
    free((void *)work->scene);
    free((void *)work->settings);
    free((void *)work->cache);
}

/* Replaces a borrowed text by a copy. If memory is short, the text becomes NULL and the result is
 * 0. */
static int own(const char **text)
{
    const int given = *text != NULL; /* there may be no cache */
    *text = given ? strdup(*text) : NULL;
    return !given || *text != NULL;
}

/* Copies a work; returns 0 if out of memory: some texts are then NULL. */
static int copy_work(struct umbj_work *copy, const struct umbj_work *work)
{
    *copy = *work;
    return own(&copy->bundle) & own(&copy->folder) & own(&copy->scene) & own(&copy->settings) &
           own(&copy->cache);
}

static void release(struct slot *slot)
{
    pthread_join(slot->thread, NULL);
    close(slot->stop);
    free_texts(&slot->work);
    slot->taken = 0;
}

/* Joins the threads of tries that ended. */
static void reap(struct executor *executor)
{
    for (unsigned i = 0; i < executor->options.workers; i++) {
        struct slot *slot = &executor->slots[i];
        if (slot->taken && atomic_load(&slot->ended)) {
            release(slot);
        }
    }
}

static int executor_free_slots(struct umbj_executor *self)
{
    struct executor *executor = (struct executor *)self;
    int count = 0;
    reap(executor);
    for (unsigned i = 0; i < executor->options.workers; i++) {
        count += !executor->slots[i].taken;
    }
    return count;
}

static enum umb_status executor_start(struct umbj_executor *self, const struct umbj_work *work,
                                      struct umb_error *error)
{
    struct executor *executor = (struct executor *)self;
    struct slot *slot = NULL;
    reap(executor);
    for (unsigned i = 0; i < executor->options.workers && slot == NULL; i++) {
        slot = executor->slots[i].taken ? NULL : &executor->slots[i];
    }
    if (slot == NULL) {
        return umb_fail(error, UMB_E_BUSY, "every worker is busy");
    }
    *slot = (struct slot){.owner = executor, .stop = eventfd(0, EFD_CLOEXEC)};
    if (slot->stop < 0 || !copy_work(&slot->work, work) ||
        pthread_create(&slot->thread, NULL, run_try, slot) != 0) {
        umbs_hang_up(&slot->stop);
        free_texts(&slot->work);
        return umb_fail(error, UMB_E_NO_MEMORY, "worker: no memory or no thread to be had");
    }
    slot->taken = 1;
    return UMB_OK;
}

static void stop(struct slot *slot)
{
    const uint64_t one = 1;
    (void)!write(slot->stop, &one, sizeof one); /* cannot fail: the counter never reaches 2^64 */
}

static void executor_cancel(struct umbj_executor *self, const char *job, int64_t epoch)
{
    struct executor *executor = (struct executor *)self;
    for (unsigned i = 0; i < executor->options.workers; i++) {
        struct slot *slot = &executor->slots[i];
        if (slot->taken && slot->work.epoch == epoch && strcmp(slot->work.job, job) == 0) {
            stop(slot);
        }
    }
}

/* The executor owns the farm, even if it could not be created. */
static void destroy_farm(const struct umbj_try_options *options)
{
    if (options->farm != NULL) {
        options->farm->destroy(options->farm);
    }
}

static void executor_destroy(struct umbj_executor *self)
{
    struct executor *executor = (struct executor *)self;
    atomic_store(&executor->closing, 1);
    for (unsigned i = 0; i < executor->options.workers; i++) {
        if (executor->slots[i].taken) {
            stop(&executor->slots[i]);
        }
    }
    for (unsigned i = 0; i < executor->options.workers; i++) {
        if (executor->slots[i].taken) {
            release(&executor->slots[i]);
        }
    }
    destroy_farm(&executor->options);
    free(executor);
}

enum umb_status umbj_try_executor_create(const struct umbj_try_options *options,
                                         struct umbj_executor **out, struct umb_error *error)
{
    *out = NULL;
    if (access(options->program, X_OK) != 0) {
        destroy_farm(options);
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "bake program '%.200s'",
                              options->program);
    }
    struct executor *executor =
        calloc(1, sizeof *executor + options->workers * sizeof executor->slots[0]);
    if (executor == NULL) {
        destroy_farm(options);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the workers");
    }
    executor->options = *options;
    executor->interface = (struct umbj_executor){.start = executor_start,
                                                 .cancel = executor_cancel,
                                                 .free_slots = executor_free_slots,
                                                 .destroy = executor_destroy};
    *out = &executor->interface;
    return UMB_OK;
}
