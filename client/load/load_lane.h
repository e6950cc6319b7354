/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_LANE_H
#define UMBRAGE_LOAD_LOAD_LANE_H
/*
 * One connection of a load test: its slots, its share of the schedule, its figures.
 *
 * A slot is a call under way. Call number n of lane k of L is due at start + (n * L + k) / rate.
 * A thread that holds the lock and finds a free slot and a due call starts the call: the pacer when
 * the time comes, or the callback that has just freed the slot.
 */
#include <pthread.h>
#include "load/load_run.h"

struct umbc_load_lane;

struct umbc_load_slot {
    struct umbc_load_lane *lane;
    uint64_t due_ns; /* open loop: when it was due; closed: when it was started */
    struct umbc_load_slot *next_free;
};

/* What all lanes look at; constant while they run, but for `over`, under each lane's lock. */
struct umbc_load_plan {
    const struct umbc_load_settings *settings;
    const struct umbc_load_pool *pool;
    uint64_t start_ns, window_ns, end_ns; /* warm-up, window, its end; CLOCK_MONOTONIC */
};

struct umbc_load_lane {
    const struct umbc_load_plan *plan;
    unsigned index;
    struct umb_client *client;
    struct umb_client_stream *stream; /* or NULL */
    struct umbc_load_slot *slots;     /* [settings->in_flight] */
    pthread_mutex_t lock;
    struct umbc_load_slot *free_slots;
    uint64_t issued; /* calls started, or due and given up */
    bool over;       /* nothing more is started */
    unsigned under_way;
    uint64_t calls, errors[UMBC_LOAD_STATUSES], error_count; /* in the window */
    uint64_t ended;                                          /* well, ever */
    uint64_t piece_errors;                                   /* since the last moment */
    struct umb_error last_error;
    struct umbc_histogram latency, piece;
};

/* Connects nothing yet. Fails: E_NO_MEMORY, and as umb_client_open. */
UMB_CHECKED enum umb_status umbc_load_lane_init(struct umbc_load_lane *lane,
                                                const struct umbc_load_plan *plan, unsigned index,
                                                struct umb_error *error);
void umbc_load_lane_finish(struct umbc_load_lane *lane); /* cancels what is under way */

/* Starts what is due. Returns when the next call is due, or UINT64_MAX if the lane has to wait for
 * a slot, is a closed loop, or is over. */
uint64_t umbc_load_lane_start(struct umbc_load_lane *lane);

/* Ends the schedule at now_ns; calls that were due and not sent are counted. Returns their number.
 */
uint64_t umbc_load_lane_stop(struct umbc_load_lane *lane, uint64_t now_ns);

/* Calls still under way. */
unsigned umbc_load_lane_under_way(struct umbc_load_lane *lane);

#endif
