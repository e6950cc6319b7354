/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_LANE_H
#define UMBRAGE_LOAD_LOAD_LANE_H
/*
 * One connection of a load test: its slots, its share of the schedule, its figures.
 *
 * A slot holds a call under way. Call number n of lane k of L lanes is due at start + (n * L + k) /
 * rate. Two threads start calls, under the lock: the pacer when a call becomes due, and the
 * callback that has just freed a slot.
 */
#include <pthread.h>
#include "load/load_run.h"

struct umbc_load_lane;

struct umbc_load_slot {
    struct umbc_load_lane *lane;
    uint64_t due_ns; /* time at which the call was due; in a closed loop, at which it started */
    struct umbc_load_slot *next_free;
};

/* Settings and times that all lanes share; constant while they run. */
struct umbc_load_plan {
    const struct umbc_load_settings *settings;
    const struct umbc_load_pool *pool;
    /* Begin of the warm-up, begin and end of the window, by umbu_clock_ns. */
    uint64_t start_ns, window_ns, end_ns;
};

struct umbc_load_lane {
    const struct umbc_load_plan *plan;
    unsigned index;
    struct umb_client *client;
    struct umb_client_stream *stream; /* NULL: a call for each batch */
    struct umbc_load_slot *slots;     /* [settings->in_flight] */
    pthread_mutex_t lock;
    struct umbc_load_slot *free_slots;
    uint64_t issued;    /* number of calls started, or due and given up */
    bool over;          /* true: no more calls start */
    unsigned under_way; /* number of calls under way */
    /* Numbers of calls and errors in the window. */
    uint64_t calls, errors[UMBC_LOAD_STATUSES], error_count;
    uint64_t ended;        /* number of calls that ended well, in the warm-up too */
    uint64_t piece_errors; /* number of errors since the last piece */
    struct umb_error last_error;
    struct umbc_histogram latency, piece;
};

/* Makes a lane; it connects with its first call. Fails: E_NO_MEMORY, and as umb_client_open. */
UMB_CHECKED enum umb_status umbc_load_lane_init(struct umbc_load_lane *lane,
                                                const struct umbc_load_plan *plan, unsigned index,
                                                struct umb_error *error);
void umbc_load_lane_finish(struct umbc_load_lane *lane); /* cancels the calls under way */

/* Starts all calls that are due. Returns the time of the next call, or UINT64_MAX if the lane waits
 * for a slot, is a closed loop, or is over. */
uint64_t umbc_load_lane_start(struct umbc_load_lane *lane);

/* Ends the schedule at now_ns. Returns the number of calls that were due and never sent. */
uint64_t umbc_load_lane_stop(struct umbc_load_lane *lane, uint64_t now_ns);

/* Number of calls under way. */
unsigned umbc_load_lane_under_way(struct umbc_load_lane *lane);

#endif
