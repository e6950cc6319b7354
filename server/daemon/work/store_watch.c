/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The store's own thread: it rescans, checks and frees assets, so that the loops do not.
 *
 * It sleeps in one poll, on the folders' events and on a counter by which other threads wake it.
 */
#define _GNU_SOURCE /* eventfd and inotify are Linux's */
#include "daemon/work/store_watch.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/clock.h"

#define FOLDER_EVENTS                                                                              \
    (IN_CLOSE_WRITE | IN_MOVED_TO | IN_MOVED_FROM | IN_DELETE | IN_CREATE | IN_ATTRIB |            \
     IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR)

struct umbd_store_watch {
    pthread_mutex_t mutex;
    pthread_cond_t ended;
    /* Set first, then wake is raised: no thread waits for another. */
    atomic_int kicked, retired, stopping;
    int finished; /* 1 when the thread touches nothing any more; under mutex */
    int running;
    pthread_t thread;
    int wake;    /* eventfd */
    int folders; /* inotify, or -1 */
    struct umbs_store *store;
    const char *const *paths; /* the store's folders, up to a NULL */
    atomic_uint_fast64_t scrub_interval_ms;
    uint64_t rescan_at_ms, scrub_at_ms; /* touched by the thread only */
    struct umbd_metrics *metrics;
    const struct umbs_log *log;
};

/* Watches a folder of the store and its subfolders. Folders that are already watched stay so. */
static void watch_folder(struct umbd_store_watch *watch, const char *path)
{
    int bad = inotify_add_watch(watch->folders, path, FOLDER_EVENTS) < 0;
    int code = errno;
    DIR *folder = opendir(path);
    struct dirent *item;
    while (folder != NULL && (item = readdir(folder)) != NULL) {
        char below[4096];
        int length = snprintf(below, sizeof below, "%s/%s", path, item->d_name);
        if (item->d_name[0] != '.' &&
            (item->d_type == DT_DIR || item->d_type == DT_LNK || item->d_type == DT_UNKNOWN) &&
            length < (int)sizeof below &&
            inotify_add_watch(watch->folders, below, FOLDER_EVENTS) < 0 && errno != ENOTDIR &&
            errno != ENOENT) {
            bad = 1;
            code = errno;
        }
    }
    if (folder != NULL) {
        closedir(folder);
    }
    if (bad) {
        umbs_log_event(watch->log, UMB_LOG_WARN, "watch_unavailable", "reason=\"%s\" rescan_s=%d",
                       strerror(code), UMBD_RESCAN_S);
    }
}

static void watch_folders(struct umbd_store_watch *watch)
{
    for (size_t i = 0; watch->folders >= 0 && i < UMBS_STORE_FOLDERS_MAX && watch->paths[i]; i++) {
        watch_folder(watch, watch->paths[i]);
    }
}

static void scan(struct umbd_store_watch *watch)
{
    struct umbs_store_report report;
    struct umb_error error;
    char quoted[UMBS_LOG_QUOTE_SIZE];
    enum umb_status status = umbs_store_rescan(watch->store, &report, &error);
    umbd_metrics_scanned(watch->metrics, &report);
    if (status != UMB_OK) {
        umbs_log_event(watch->log, UMB_LOG_ERROR, "rescan_failed", "status=%s reason=%s",
                       umb_status_name(status), umbs_log_quote(error.message, quoted));
    } else if (report.loaded + report.failed + report.removed > 0) {
        umbs_log_event(watch->log, UMB_LOG_INFO, "rescanned",
                       "loaded=%zu failed=%zu removed=%zu unchanged=%zu", report.loaded,
                       report.failed, report.removed, report.unchanged);
    }
    watch->rescan_at_ms = (uint64_t)umbu_clock_ms() +
                          (report.unsettled ? UMBS_STORE_SETTLE_MS : UMBD_RESCAN_S * 1000);
}

/* Checks one asset if one is due, and schedules the next check so that the disk has pauses. */
static void scrub(struct umbd_store_watch *watch)
{
    uint64_t bytes = 0;
    uint64_t pause_ms = UMBD_SCRUB_PAUSE_MS;
    uint64_t interval_ms = atomic_load(&watch->scrub_interval_ms);
    if (interval_ms > 0 && umbs_store_scrub(watch->store, interval_ms, &bytes)) {
        pause_ms = 1 + bytes / UMBD_SCRUB_BYTES_PER_MS;
    }
    watch->scrub_at_ms = (uint64_t)umbu_clock_ms() + pause_ms;
}

/* Sleeps until it is woken, a folder changes, or an action is due. Returns 1 if a folder
 * changed. */
static int wait_for_work(struct umbd_store_watch *watch)
{
    char events[4096];
    struct pollfd sources[2] = {{.fd = watch->wake, .events = POLLIN},
                                {.fd = watch->folders, .events = POLLIN}};
    uint64_t next_ms =
        watch->rescan_at_ms < watch->scrub_at_ms ? watch->rescan_at_ms : watch->scrub_at_ms;
    uint64_t at_ms = (uint64_t)umbu_clock_ms();
    int changed = 0;
    if (poll(sources, 2, next_ms > at_ms ? (int)(next_ms - at_ms) : 0) <= 0) {
        return 0;
    }
    (void)!read(watch->wake, events, sizeof events);
    while (watch->folders >= 0 && read(watch->folders, events, sizeof events) > 0) {
        changed = 1;
    }
    return changed;
}

static void *watch_thread(void *argument)
{
    struct umbd_store_watch *watch = argument;
    int stopping = 0;
    while (!stopping) {
        int changed = wait_for_work(watch);
        int retired = atomic_exchange(&watch->retired, 0);
        int rescan = changed || atomic_load(&watch->kicked) ||
                     (uint64_t)umbu_clock_ms() >= watch->rescan_at_ms;
        stopping = atomic_load(&watch->stopping);
        if (stopping) {
            break;
        }
        if (retired) {
            umbs_store_reap(watch->store);
        }
        if (rescan) {
            struct timespec pause = {.tv_nsec = UMBD_RESCAN_PAUSE_MS * 1000000L};
            nanosleep(&pause, NULL);
            /* A kick from here on asks for another scan, because this scan may already have passed
             * the changed folder. */
            atomic_store(&watch->kicked, 0);
            watch_folders(watch); /* before the scan, which then sees files in new folders */
            scan(watch);
        } else if ((uint64_t)umbu_clock_ms() >= watch->scrub_at_ms) {
            scrub(watch);
        }
    }
    pthread_mutex_lock(&watch->mutex);
    watch->finished = 1;
    pthread_cond_broadcast(&watch->ended);
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
    watch->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (watch->wake < 0) {
        free(watch);
        return umb_fail_errno(error, UMB_E_LIMIT, errno, "no descriptor for the store's thread");
    }
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&watch->ended, &attributes);
    pthread_condattr_destroy(&attributes);
    pthread_mutex_init(&watch->mutex, NULL);
    watch->folders = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    watch->metrics = metrics;
    watch->log = log;
    *out = watch;
    return UMB_OK;
}

void umbd_store_watch_set_scrub(struct umbd_store_watch *watch, uint64_t interval_ms)
{
    atomic_store(&watch->scrub_interval_ms, interval_ms);
}

enum umb_status umbd_store_watch_start(struct umbd_store_watch *watch, struct umbs_store *store,
                                       const char *const *folders, uint64_t scrub_interval_ms,
                                       struct umb_error *error)
{
    watch->store = store;
    watch->paths = folders;
    umbd_store_watch_set_scrub(watch, scrub_interval_ms);
    watch->rescan_at_ms =
        (uint64_t)umbu_clock_ms(); /* at once: for changes between the first scan and now */
    watch->scrub_at_ms = (uint64_t)umbu_clock_ms() + UMBD_SCRUB_PAUSE_MS;
    UMB__TRY(umbs_store_lane_start(store, UMBD_LANE_BYTES, error));
    int code = pthread_create(&watch->thread, NULL, watch_thread, watch);
    if (code != 0) {
        (void)umbs_store_lane_stop(store, UMBD_WATCH_END_MS); /* it has no file to load yet */
        return umb_fail_errno(error, UMB_E_LIMIT, code, "cannot start the store's thread");
    }
    watch->running = 1;
    return UMB_OK;
}

/* Sets a flag and wakes the thread. */
static void tell(struct umbd_store_watch *watch, atomic_int *flag)
{
    const uint64_t one = 1;
    atomic_store(flag, 1);
    /* The counter is full: the thread is awake anyway. */
    (void)!write(watch->wake, &one, sizeof one);
}

void umbd_store_watch_kick(struct umbd_store_watch *watch)
{
    tell(watch, &watch->kicked);
}

void umbd_store_watch_retired(void *user)
{
    struct umbd_store_watch *watch = user;
    tell(watch, &watch->retired);
}

void umbd_store_watch_faulted(void *user)
{
    umbd_store_watch_kick(user);
}

/* Tells the thread to end and waits for it up to a limit. */
static int end_thread(struct umbd_store_watch *watch)
{
    const struct timespec until = umbu_clock_deadline(UMBD_WATCH_END_MS);
    tell(watch, &watch->stopping);
    pthread_mutex_lock(&watch->mutex);
    while (!watch->finished &&
           pthread_cond_timedwait(&watch->ended, &watch->mutex, &until) != ETIMEDOUT) {
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
    if (watch->running &&
        (!end_thread(watch) || !umbs_store_lane_stop(watch->store, UMBD_WATCH_END_MS))) {
        return 0;
    }
    if (watch->folders >= 0) {
        close(watch->folders);
    }
    close(watch->wake);
    pthread_cond_destroy(&watch->ended);
    pthread_mutex_destroy(&watch->mutex);
    free(watch);
    return 1;
}
