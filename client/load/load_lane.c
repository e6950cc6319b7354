/* SPDX-License-Identifier: Apache-2.0 */
/* One connection of a load test, see load_lane.h. */
#include "load/load_lane.h"

#include <stdlib.h>
#include <string.h>
#include "tool/clock.h"
#include "tool/tool_try.h"

/* Time at which call `number` of the lane is due; 0 in a closed loop. */
static uint64_t due_of(const struct umbc_load_lane *lane, uint64_t number)
{
    const struct umbc_load_settings *settings = lane->plan->settings;
    if (settings->rate <= 0) {
        return 0;
    }
    double place = (double)number * settings->connections + lane->index;
    return lane->plan->start_ns + (uint64_t)(place / settings->rate * 1e9);
}

static bool in_window(const struct umbc_load_lane *lane, uint64_t at_ns)
{
    return at_ns >= lane->plan->window_ns && at_ns < lane->plan->end_ns;
}

static void count_failure(struct umbc_load_lane *lane, enum umb_status status,
                          const struct umb_error *error, uint64_t due_ns)
{
    size_t index = (size_t) - (int)status;
    lane->last_error = *error;
    lane->piece_errors++;
    if (in_window(lane, due_ns)) {
        lane->errors[index < UMBC_LOAD_STATUSES ? index : UMBC_LOAD_STATUSES - 1]++;
        lane->error_count++;
    }
}

static void count_answer(struct umbc_load_lane *lane, uint64_t due_ns, uint64_t now_ns)
{
    uint64_t took_ns = now_ns > due_ns ? now_ns - due_ns : 0;
    lane->ended++;
    umbc_histogram_record(&lane->piece, took_ns);
    if (in_window(lane, due_ns)) {
        umbc_histogram_record(&lane->latency, took_ns);
    }
    if (in_window(lane, now_ns)) {
        lane->calls++;
    }
}

static void on_answer(void *user, enum umb_status status,
                      const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct umbc_load_slot *slot = user;
    struct umbc_load_lane *lane = slot->lane;
    uint64_t now_ns = umbu_clock_ns();
    (void)reply;
    pthread_mutex_lock(&lane->lock);
    if (status == UMB_OK) {
        count_answer(lane, slot->due_ns, now_ns);
    } else if (status != UMB_E_CANCELLED || !lane->over) {
        count_failure(lane, status, error, slot->due_ns);
    }
    slot->next_free = lane->free_slots;
    lane->free_slots = slot;
    lane->under_way--;
    pthread_mutex_unlock(&lane->lock);
    (void)umbc_load_lane_start(lane);
}

/* Sends call `number`. */
static enum umb_status send_call(struct umbc_load_lane *lane, struct umbc_load_slot *slot,
                                 uint64_t number, struct umb_error *error)
{
    const struct umbc_load_settings *settings = lane->plan->settings;
    const struct umb_client_query_request request = {
        .asset = settings->asset,
        .settings = settings->query,
        .points =
            umbc_load_pool_batch(lane->plan->pool, number * settings->connections + lane->index),
        .timeout_ms = settings->timeout_ms,
        .stream = lane->stream,
    };
    return umb_client_query_start(lane->client, &request, on_answer, slot, NULL, error);
}

/* Takes a free slot for the next call if one is due; NULL if not. */
static struct umbc_load_slot *take_slot(struct umbc_load_lane *lane, uint64_t *number,
                                        uint64_t *next_ns)
{
    uint64_t now_ns = umbu_clock_ns();
    uint64_t due_ns = due_of(lane, lane->issued);
    *next_ns = UINT64_MAX;
    if (lane->over || lane->free_slots == NULL || now_ns >= lane->plan->end_ns ||
        due_ns >= lane->plan->end_ns) {
        return NULL;
    }
    if (due_ns > now_ns) {
        *next_ns = due_ns;
        return NULL;
    }
    struct umbc_load_slot *slot = lane->free_slots;
    lane->free_slots = slot->next_free;
    slot->due_ns = due_ns != 0 ? due_ns : now_ns;
    *number = lane->issued++;
    lane->under_way++;
    return slot;
}

uint64_t umbc_load_lane_start(struct umbc_load_lane *lane)
{
    uint64_t next_ns;
    for (;;) {
        uint64_t number = 0;
        struct umb_error error;
        pthread_mutex_lock(&lane->lock);
        struct umbc_load_slot *slot = take_slot(lane, &number, &next_ns);
        pthread_mutex_unlock(&lane->lock);
        if (slot == NULL) {
            return next_ns;
        }
        enum umb_status status = send_call(lane, slot, number, &error);
        if (status != UMB_OK) {
            pthread_mutex_lock(&lane->lock);
            count_failure(lane, status, &error, slot->due_ns);
            slot->next_free = lane->free_slots;
            lane->free_slots = slot;
            lane->under_way--;
            lane->over = true; /* out of memory, or a request that no server accepts */
            pthread_mutex_unlock(&lane->lock);
        }
    }
}

uint64_t umbc_load_lane_stop(struct umbc_load_lane *lane, uint64_t now_ns)
{
    uint64_t unsent = 0;
    pthread_mutex_lock(&lane->lock);
    lane->over = true;
    while (lane->plan->settings->rate > 0) {
        uint64_t due_ns = due_of(lane, lane->issued);
        if (due_ns >= now_ns || due_ns >= lane->plan->end_ns) {
            break;
        }
        lane->issued++;
        if (in_window(lane, due_ns)) {
            umbc_histogram_record(&lane->latency, now_ns - due_ns);
            unsent++;
        }
    }
    pthread_mutex_unlock(&lane->lock);
    return unsent;
}

unsigned umbc_load_lane_under_way(struct umbc_load_lane *lane)
{
    pthread_mutex_lock(&lane->lock);
    unsigned count = lane->under_way;
    pthread_mutex_unlock(&lane->lock);
    return count;
}

enum umb_status umbc_load_lane_init(struct umbc_load_lane *lane, const struct umbc_load_plan *plan,
                                    unsigned index, struct umb_error *error)
{
    const struct umbc_load_settings *settings = plan->settings;
    struct umb_client_options options = settings->client;
    memset(lane, 0, sizeof *lane);
    lane->plan = plan;
    lane->index = index;
    if (pthread_mutex_init(&lane->lock, NULL) != 0) {
        return umb_fail(error, UMB_E_INTERNAL, "cannot make a lock");
    }
    lane->slots = calloc(settings->in_flight, sizeof *lane->slots);
    if (lane->slots == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u calls", settings->in_flight);
    }
    for (unsigned i = 0; i < settings->in_flight; i++) {
        lane->slots[i].lane = lane;
        lane->slots[i].next_free = lane->free_slots;
        lane->free_slots = &lane->slots[i];
    }
    options.max_calls = settings->in_flight + 1;
    options.max_request_bytes = UINT64_MAX;
    options.max_retries = UMB_CLIENT_NEVER;
    UMB__TRY(umb_client_open(settings->address, &options, &lane->client, error));
    return settings->stream ? umb_client_stream_open(lane->client, &lane->stream, error) : UMB_OK;
}

void umbc_load_lane_finish(struct umbc_load_lane *lane)
{
    if (lane->plan == NULL) {
        return;
    }
    umb_client_stream_close(lane->stream);
    umb_client_close(lane->client);
    (void)pthread_mutex_destroy(&lane->lock);
    free(lane->slots);
    lane->plan = NULL;
}
