/* SPDX-License-Identifier: Apache-2.0 */
/* The store's own thread: rescans and frees, off the loops. */
#include "daemon/store_watch.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>

struct umbd_store_watch {
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    int kicked, retired, stopping; /* under mutex */
    int finished;                  /* the thread touches nothing any more; under mutex */
    int running;
    pthread_t thread;
    struct umbs_store *store;
    struct umbd_metrics *metrics;
    const struct umbs_log *log;
};

static struct timespec after_ms(uint64_t ms)
{
    struct timespec at;
    clock_gettime(CLOCK_MONOTONIC, &at);
    at.tv_sec += (time_t)(ms / 1000);
    at.tv_nsec += (long)(ms % 1000) * 1000000;
    if (at.tv_nsec >= 1000000000) {
        at.tv_nsec -= 1000000000;
        at.tv_sec++;
    }
    return at;
}

/* Returns 1 if a file should be looked at again soon. */
static int scan(struct umbd_store_watch *watch)
{
    struct umbs_store_report report;
    struct umb_error error;
    char quoted[UMBS_LOG_QUOTE_SIZE];
    enum umb_status status = umbs_store_rescan(watch->store, &report, &error);
    umbd_count(&watch->metrics->asset_errors, report.failed);
    if (status != UMB_OK) {
        umbs_log_event(watch->log, UMB_LOG_ERROR, "rescan_failed", "status=%s reason=%s",
                       umb_status_name(status), umbs_log_quote(error.message, quoted));
    } else if (report.loaded + report.failed + report.removed > 0) {
        umbs_log_event(watch->log, UMB_LOG_INFO, "rescanned",
                       "loaded=%zu failed=%zu removed=%zu unchanged=%zu", report.loaded,
                       report.failed, report.removed, report.unchanged);
    }
    return report.unsettled;
}

/* Waits, under the mutex, until there is something to do. Returns 1 if the time was up. */
static int wait_for_work(struct umbd_store_watch *watch, uint64_t wait_ms)
{
    struct timespec until = after_ms(wait_ms);
    while (!watch->kicked && !watch->retired && !watch->stopping) {
        if (pthread_cond_timedwait(&watch->wake, &watch->mutex, &until) == ETIMEDOUT) {
            return 1;
        }
    }
    return 0;
}

static void *watch_thread(void *argument)
{
    struct umbd_store_watch *watch = argument;
    uint64_t wait_ms = UMBD_RESCAN_S * 1000;
    pthread_mutex_lock(&watch->mutex);
    while (!watch->stopping) {
        int due = wait_for_work(watch, wait_ms);
        int kicked = watch->kicked;
        int retired = watch->retired;
        if (watch->stopping) {
            break;
        }
        watch->retired = 0;
        pthread_mutex_unlock(&watch->mutex);
        if (retired) {
            umbs_store_reap(watch->store);
        }
        if (kicked || due) {
            struct timespec pause = {.tv_nsec = UMBD_RESCAN_PAUSE_MS * 1000000L};
            nanosleep(&pause, NULL);
            pthread_mutex_lock(&watch->mutex);
            watch->kicked = 0; /* kicks from here on may be about what the scan has passed */
            pthread_mutex_unlock(&watch->mutex);
            wait_ms = scan(watch) ? UMBS_STORE_SETTLE_MS : UMBD_RESCAN_S * 1000;
        }
        pthread_mutex_lock(&watch->mutex);
    }
    watch->finished = 1;
    pthread_cond_broadcast(&watch->wake);
    pthread_mutex_unlock(&watch->mutex);
    return NULL;
}

enum umb_status umbd_store_watch_create(struct umbd_metrics *metrics, const struct umbs_log *log,
                                        struct umbd_store_watch **out, struct umb_error *error)
{
    *out = NULL;
    struct umbd_store_watch *watch = calloc(1, sizeof *watch);
    if (watch == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the store's thread");
    }
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&watch->wake, &attributes);
    pthread_condattr_destroy(&attributes);
    pthread_mutex_init(&watch->mutex, NULL);
    watch->metrics = metrics;
    watch->log = log;
    *out = watch;
    return UMB_OK;
}

enum umb_status umbd_store_watch_start(struct umbd_store_watch *watch, struct umbs_store *store,
                                       struct umb_error *error)
{
    watch->store = store;
    int code = pthread_create(&watch->thread, NULL, watch_thread, watch);
    if (code != 0) {
        return umb_fail_errno(error, UMB_E_LIMIT, code, "cannot start the store's thread");
    }
    watch->running = 1;
    return UMB_OK;
}

void umbd_store_watch_kick(struct umbd_store_watch *watch)
{
    pthread_mutex_lock(&watch->mutex);
    watch->kicked = 1;
    pthread_cond_signal(&watch->wake);
    pthread_mutex_unlock(&watch->mutex);
}

void umbd_store_watch_retired(void *user)
{
    struct umbd_store_watch *watch = user;
    pthread_mutex_lock(&watch->mutex);
    watch->retired = 1;
    pthread_cond_signal(&watch->wake);
    pthread_mutex_unlock(&watch->mutex);
}

void umbd_store_watch_faulted(void *user)
{
    umbd_store_watch_kick(user);
}

/* Tells the thread to end and waits for it, but not for long. */
static int end_thread(struct umbd_store_watch *watch)
{
    struct timespec until = after_ms(UMBD_WATCH_END_MS);
    pthread_mutex_lock(&watch->mutex);
    watch->stopping = 1;
    pthread_cond_broadcast(&watch->wake);
    while (!watch->finished &&
           pthread_cond_timedwait(&watch->wake, &watch->mutex, &until) != ETIMEDOUT) {
    }
    int finished = watch->finished;
    pthread_mutex_unlock(&watch->mutex);
    return finished && pthread_join(watch->thread, NULL) == 0;
}

int umbd_store_watch_destroy(struct umbd_store_watch *watch)
{
    if (watch == NULL) {
        return 1;
    }
    if (watch->running && !end_thread(watch)) {
        return 0;
    }
    pthread_cond_destroy(&watch->wake);
    pthread_mutex_destroy(&watch->mutex);
    free(watch);
    return 1;
}
