/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The lane for large files: a thread beside the scan, so that small files do not wait for a large
 * one. It loads one file at a time; the scan takes the result and gives it the next file.
 *
 * Invariants: only the lane's thread loads while it is UMBS_LANE_LOADING; only a scan, under
 * store->scan, gives it a file and takes the result.
 */
#include <errno.h>
#include <string.h>
#include <time.h>

#include "store/store_internal.h"

#include "tool/clock.h"

static void *run_lane(void *user)
{
    struct umbs_store *store = user;
    struct umbs_lane *lane = &store->lane;
    pthread_mutex_lock(&lane->mutex);
    while (!lane->stopping) {
        if (lane->state != UMBS_LANE_LOADING) {
            pthread_cond_wait(&lane->changed, &lane->mutex);
            continue;
        }
        pthread_mutex_unlock(&lane->mutex);
        const uint64_t from_ms = (uint64_t)umbu_clock_ms();
        struct umbs_entry *entry = lane->load(store, &lane->name, lane->rebuild);
        pthread_mutex_lock(&lane->mutex);
        lane->entry = entry;
        lane->load_ms = (uint64_t)umbu_clock_ms() - from_ms;
        lane->state = UMBS_LANE_DONE;
        if (store->options.faulted != NULL && !lane->stopping) {
            store->options.faulted(store->options.owner);
        }
    }
    lane->ended = 1;
    pthread_cond_broadcast(&lane->changed);
    pthread_mutex_unlock(&lane->mutex);
    return NULL;
}

void umbs__lane_init(struct umbs_lane *lane)
{
    pthread_condattr_t monotonic;
    pthread_mutex_init(&lane->mutex, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&lane->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    lane->load = umbs__entry_load;
}

void umbs__lane_finish(struct umbs_lane *lane)
{
    pthread_cond_destroy(&lane->changed);
    pthread_mutex_destroy(&lane->mutex);
}

enum umb_status umbs_store_lane_start(struct umbs_store *store, uint64_t from_bytes,
                                      struct umb_error *error)
{
    struct umbs_lane *lane = &store->lane;
    lane->from_bytes = from_bytes;
    const int code = pthread_create(&lane->thread, NULL, run_lane, store);
    if (code != 0) {
        return umb_fail_errno(error, UMB_E_LIMIT, code, "cannot start the store's second thread");
    }
    lane->running = 1;
    return UMB_OK;
}

int umbs_store_lane_stop(struct umbs_store *store, uint32_t wait_ms)
{
    struct umbs_lane *lane = &store->lane;
    if (!lane->running) {
        return 1;
    }
    const struct timespec until = umbu_clock_deadline(wait_ms);
    pthread_mutex_lock(&lane->mutex);
    lane->stopping = 1;
    pthread_cond_broadcast(&lane->changed);
    while (!lane->ended &&
           pthread_cond_timedwait(&lane->changed, &lane->mutex, &until) != ETIMEDOUT) {
    }
    const int ended = lane->ended;
    pthread_mutex_unlock(&lane->mutex);
    if (!ended || pthread_join(lane->thread, NULL) != 0) {
        return 0;
    }
    lane->running = 0;
    umbs_entry_release(lane->entry);
    lane->entry = NULL;
    return 1;
}

/* Returns 1 if the file is unchanged and is the one that the lane is loading or loaded last. Under
 * the lane's mutex. */
static int is_its_file(const struct umbs_lane *lane, const struct umbs_name *name,
                       const struct umbs_stamp *stamp)
{
    const struct umbs_stamp *was =
        lane->entry != NULL && lane->entry->asset != NULL ? &lane->entry->stamp : &lane->stamp;
    return lane->name.folder == name->folder && strcmp(lane->name.text, name->text) == 0 &&
           umbs_stamp_equal(was, stamp);
}

/* Returns 1 if the free lane may take this file. The file that the lane loaded last must ask twice,
 * so that a file that changes after every load does not keep the others out. Under the lane's
 * mutex. */
static int is_its_turn(struct umbs_lane *lane, const struct umbs_name *name)
{
    const int had_it =
        lane->name.folder == name->folder && strcmp(lane->name.text, name->text) == 0;
    const int waited = lane->yielded;
    lane->yielded = had_it && !waited;
    return !lane->yielded;
}

enum umbs_lane_answer umbs__lane_ask(struct umbs_store *store, const struct umbs_name *name,
                                     const struct umbs_stamp *stamp, int rebuild,
                                     struct umbs_entry **entry, uint64_t *load_ms)
{
    struct umbs_lane *lane = &store->lane;
    enum umbs_lane_answer answer = UMBS_LANE_WAIT;
    if (!lane->running || stamp->size < lane->from_bytes) {
        return UMBS_LANE_NOT_FOR_IT;
    }
    pthread_mutex_lock(&lane->mutex);
    if (lane->state == UMBS_LANE_DONE && is_its_file(lane, name, stamp)) {
        *entry = lane->entry;
        *load_ms = lane->load_ms;
        lane->entry = NULL;
        lane->state = UMBS_LANE_IDLE;
        answer = UMBS_LANE_TAKE;
    } else if (lane->state == UMBS_LANE_IDLE && is_its_turn(lane, name)) {
        lane->name = *name;
        lane->stamp = *stamp;
        lane->rebuild = rebuild;
        lane->state = UMBS_LANE_LOADING;
        pthread_cond_broadcast(&lane->changed);
    }
    pthread_mutex_unlock(&lane->mutex);
    return answer;
}

int umbs__lane_has_done(struct umbs_store *store)
{
    pthread_mutex_lock(&store->lane.mutex);
    const int done = store->lane.state == UMBS_LANE_DONE;
    pthread_mutex_unlock(&store->lane.mutex);
    return done;
}

int umbs__lane_clear(struct umbs_store *store, int was_done)
{
    struct umbs_lane *lane = &store->lane;
    struct umbs_entry *stale = NULL;
    pthread_mutex_lock(&lane->mutex);
    if (was_done && lane->state == UMBS_LANE_DONE) {
        stale = lane->entry;
        lane->entry = NULL;
        lane->state = UMBS_LANE_IDLE;
    }
    const int idle = lane->state == UMBS_LANE_IDLE;
    pthread_mutex_unlock(&lane->mutex);
    umbs_entry_release(stale);
    return idle;
}
