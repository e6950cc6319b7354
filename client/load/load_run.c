/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One run of a load test, see load_run.h.
 *
 * A lane is the part of the test on one connection: it has slots, a share of the schedule, and
 * figures of its own. A slot holds a call under way. Call number n of lane k of L lanes is due at
 * start + (n * L + k) / rate. Two threads start calls, under the lane's lock: the pacer when a call
 * becomes due, and the callback that has just freed a slot.
 */
#include "load/load_run.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>
#include "tool/clock.h"
#include "tool/tool_try.h"

#define SECOND_NS    1000000000U
#define PIECE_S      0.1     /* shortest piece of a run */
#define PIECES       400     /* most pieces of a run */
#define PACE_IDLE_NS 500000U /* sleep of the pacer while all lanes wait for slots */
#define SCRAPE_S     0.5     /* shortest time between requests for the daemon's figures */
#define LEAD_S       0.02    /* time for threads to start before the first call is due */

struct slot {
    struct lane *lane;
    uint64_t due_ns; /* time at which the call was due; in a closed loop, at which it started */
    struct slot *next_free;
};

/* Settings and times that all lanes share; constant while they run. */
struct plan {
    const struct umbc_load_settings *settings;
    const struct umbc_load_pool *pool;
    /* Begin of the warm-up, begin and end of the window, by umbu_clock_ns. */
    uint64_t start_ns, window_ns, end_ns;
};

struct lane {
    const struct plan *plan;
    unsigned index;
    struct umb_client *client;
    struct umb_client_stream *stream; /* NULL: a call for each batch */
    struct slot *slots;               /* [settings->in_flight] */
    pthread_mutex_t lock;
    struct slot *free_slots;
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

/* --- a lane --- */

/* Time at which call `number` of the lane is due; 0 in a closed loop. */
static uint64_t due_of(const struct lane *lane, uint64_t number)
{
    const struct umbc_load_settings *settings = lane->plan->settings;
    if (settings->rate <= 0) {
        return 0;
    }
    double place = (double)number * settings->connections + lane->index;
    return lane->plan->start_ns + (uint64_t)(place / settings->rate * 1e9);
}

static bool in_window(const struct lane *lane, uint64_t at_ns)
{
    return at_ns >= lane->plan->window_ns && at_ns < lane->plan->end_ns;
}

static void count_failure(struct lane *lane, enum umb_status status, const struct umb_error *error,
                          uint64_t due_ns)
{
    size_t index = (size_t) - (int)status;
    lane->last_error = *error;
    lane->piece_errors++;
    if (in_window(lane, due_ns)) {
        lane->errors[index < UMBC_LOAD_STATUSES ? index : UMBC_LOAD_STATUSES - 1]++;
        lane->error_count++;
    }
}

static void count_answer(struct lane *lane, uint64_t due_ns, uint64_t now_ns)
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

static void release(struct lane *lane, struct slot *slot)
{
    slot->next_free = lane->free_slots;
    lane->free_slots = slot;
    lane->under_way--;
}

static uint64_t start_calls(struct lane *lane);

static void on_answer(void *user, enum umb_status status,
                      const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct slot *slot = user;
    struct lane *lane = slot->lane;
    uint64_t now_ns = umbu_clock_ns();
    (void)reply;
    pthread_mutex_lock(&lane->lock);
    if (status == UMB_OK) {
        count_answer(lane, slot->due_ns, now_ns);
    } else if (status != UMB_E_CANCELLED || !lane->over) {
        count_failure(lane, status, error, slot->due_ns);
    }
    release(lane, slot);
    pthread_mutex_unlock(&lane->lock);
    (void)start_calls(lane);
}

/* Sends call `number`. */
static enum umb_status send_call(struct lane *lane, struct slot *slot, uint64_t number,
                                 struct umb_error *error)
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
static struct slot *take_slot(struct lane *lane, uint64_t *number, uint64_t *next_ns)
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
    struct slot *slot = lane->free_slots;
    lane->free_slots = slot->next_free;
    slot->due_ns = due_ns != 0 ? due_ns : now_ns;
    *number = lane->issued++;
    lane->under_way++;
    return slot;
}

/* Starts all calls that are due. Returns the time of the next call, or UINT64_MAX if the lane waits
 * for a slot, is a closed loop, or is over. */
static uint64_t start_calls(struct lane *lane)
{
    uint64_t next_ns;
    for (;;) {
        uint64_t number = 0;
        struct umb_error error;
        pthread_mutex_lock(&lane->lock);
        struct slot *slot = take_slot(lane, &number, &next_ns);
        pthread_mutex_unlock(&lane->lock);
        if (slot == NULL) {
            return next_ns;
        }
        enum umb_status status = send_call(lane, slot, number, &error);
        if (status != UMB_OK) {
            pthread_mutex_lock(&lane->lock);
            count_failure(lane, status, &error, slot->due_ns);
            release(lane, slot);
            lane->over = true; /* out of memory, or a request that no server accepts */
            pthread_mutex_unlock(&lane->lock);
        }
    }
}

/* Ends the schedule at now_ns. Returns the number of calls that were due and never sent. */
static uint64_t stop_lane(struct lane *lane, uint64_t now_ns)
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

static unsigned calls_under_way(struct lane *lane)
{
    pthread_mutex_lock(&lane->lock);
    unsigned count = lane->under_way;
    pthread_mutex_unlock(&lane->lock);
    return count;
}

/* Makes a lane; it connects with its first call. */
static enum umb_status open_lane(struct lane *lane, const struct plan *plan, unsigned index,
                                 struct umb_error *error)
{
    const struct umbc_load_settings *settings = plan->settings;
    struct umb_client_options options = settings->client;
    *lane = (struct lane){.plan = plan, .index = index, .lock = PTHREAD_MUTEX_INITIALIZER};
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

/* Closes a lane, also one that failed to open. Cancels the calls under way. */
static void close_lane(struct lane *lane)
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

/* --- a run --- */

struct run {
    struct plan plan;
    struct lane *lanes;  /* [settings->connections] */
    unsigned lane_count; /* number of lanes that were initialised */
    pthread_t pacer;
    bool paced;
    atomic_bool stop_pacing;
    double cpu_s;    /* processor time of this process at the begin of the window */
    bool has_server; /* true: the daemon sent figures at the begin of the window */
    struct umbc_server_figures server;
    uint64_t server_ns; /* time of the request for them */
    struct umbc_server_figures last_scrape;
    double last_scrape_s, last_server_cores;
    struct umbc_histogram piece; /* too large for the stack */
};

static void sleep_until(uint64_t at_ns)
{
    const struct timespec at = {.tv_sec = (time_t)(at_ns / SECOND_NS),
                                .tv_nsec = (long)(at_ns % SECOND_NS)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) {
    }
}

/* Starts calls when they are due. */
static void *pace(void *user)
{
    struct run *run = user;
    (void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL); /* the default adds 50 us to a sleep */
    while (!atomic_load(&run->stop_pacing)) {
        uint64_t next_ns = umbu_clock_ns() + PACE_IDLE_NS;
        for (unsigned i = 0; i < run->lane_count; i++) {
            uint64_t due_ns = start_calls(&run->lanes[i]);
            next_ns = due_ns < next_ns ? due_ns : next_ns;
        }
        sleep_until(next_ns);
    }
    return NULL;
}

static double seconds_between(uint64_t from_ns, uint64_t to_ns)
{
    return to_ns > from_ns ? 1e-9 * (double)(to_ns - from_ns) : -1e-9 * (double)(from_ns - to_ns);
}

/* Adds the daemon's figures to a piece; asks for them every SCRAPE_S. */
static void look_at_server(struct run *run, double now_s, struct umbc_load_moment *moment,
                           struct umbc_load_result *result)
{
    struct umbc_server_figures figures;
    const char *admin = run->plan.settings->admin;
    if (admin != NULL && run->has_server && now_s - run->last_scrape_s >= SCRAPE_S &&
        umbc_server_figures_get(admin, &figures, NULL) == UMB_OK) {
        run->last_server_cores =
            (figures.cpu_s - run->last_scrape.cpu_s) / (now_s - run->last_scrape_s);
        run->last_scrape = figures;
        run->last_scrape_s = now_s;
        if (figures.rss > result->server_rss_max) {
            result->server_rss_max = figures.rss;
        }
    }
    moment->server_rss = run->last_scrape.rss;
    moment->server_cores = run->last_server_cores;
}

/* Ends a piece: collects the figures of all lanes since the last one. */
static void end_piece(struct run *run, uint64_t from_ns, uint64_t now_ns,
                      struct umbc_load_result *result)
{
    uint64_t errors = 0;
    double seconds = seconds_between(from_ns, now_ns);
    struct umbc_load_moment *moment = &result->moments[result->moment_count++];
    memset(&run->piece, 0, sizeof run->piece);
    result->calls = result->error_count = 0;
    for (unsigned i = 0; i < run->lane_count; i++) {
        struct lane *lane = &run->lanes[i];
        pthread_mutex_lock(&lane->lock);
        umbc_histogram_merge(&run->piece, &lane->piece);
        memset(&lane->piece, 0, sizeof lane->piece);
        errors += lane->piece_errors;
        lane->piece_errors = 0;
        result->calls += lane->calls;
        result->error_count += lane->error_count;
        pthread_mutex_unlock(&lane->lock);
    }
    moment->at_s = seconds_between(run->plan.window_ns, now_ns);
    moment->calls_s = (double)run->piece.count / seconds;
    moment->errors_s = (double)errors / seconds;
    moment->p50_ms = 1e-6 * (double)umbc_histogram_percentile(&run->piece, 0.5);
    moment->p99_ms = 1e-6 * (double)umbc_histogram_percentile(&run->piece, 0.99);
    look_at_server(run, moment->at_s, moment, result);
}

/* Begins the window: stores the figures that are subtracted at its end. */
static enum umb_status begin_window(struct run *run, struct umb_error *error)
{
    run->cpu_s = umbu_process_cpu_s();
    run->last_scrape_s = 0;
    run->has_server = false;
    run->server_ns = umbu_clock_ns();
    if (run->plan.settings->admin == NULL) {
        return UMB_OK;
    }
    enum umb_status status =
        umbc_server_figures_get(run->plan.settings->admin, &run->server, error);
    run->has_server = status == UMB_OK;
    run->last_scrape = run->server;
    return run->plan.settings->admin_may_fail ? UMB_OK : status;
}

/* Ends the window. The daemon is asked for its figures afterwards, because that may take long. */
static void note_end(const struct run *run, struct umbc_load_result *result)
{
    double passed_s = seconds_between(run->plan.window_ns, umbu_clock_ns());
    result->seconds = seconds_between(run->plan.window_ns, run->plan.end_ns);
    result->generator_cores = (umbu_process_cpu_s() - run->cpu_s) / passed_s;
    result->counts = result->generator_cores <= UMBC_LOAD_BUSY;
}

/* Computes the daemon's processor time in the window. The run is valid without this figure. */
static void look_at_costs(const struct run *run, struct umbc_load_result *result)
{
    struct umbc_server_figures figures;
    result->server_s = seconds_between(run->server_ns, umbu_clock_ns());
    result->has_server = run->has_server && umbc_server_figures_get(run->plan.settings->admin,
                                                                    &figures, NULL) == UMB_OK;
    if (!result->has_server) {
        return;
    }
    result->server_cpu_s = figures.cpu_s - run->server.cpu_s;
    result->server_points = figures.points - run->server.points;
    result->server_shed = figures.shed - run->server.shed;
    if (figures.rss > result->server_rss_max) {
        result->server_rss_max = figures.rss;
    }
}

/* Collects pieces from the first call to the end of the window. */
static enum umb_status watch_run(struct run *run, umbc_load_watch_fn watch, void *user,
                                 struct umbc_load_result *result, struct umb_error *error)
{
    const struct plan *plan = &run->plan;
    double whole_s = seconds_between(plan->start_ns, plan->end_ns);
    double piece_s = whole_s / PIECES > PIECE_S ? whole_s / PIECES : PIECE_S;
    uint64_t piece_ns = (uint64_t)(piece_s * 1e9);
    enum umb_status status = UMB_OK;
    bool measured = false; /* true: in the window */
    for (uint64_t from_ns = plan->start_ns; status == UMB_OK;) {
        uint64_t goal_ns = measured ? plan->end_ns : plan->window_ns;
        uint64_t to_ns = from_ns + piece_ns < goal_ns ? from_ns + piece_ns : goal_ns;
        sleep_until(to_ns);
        if (measured && to_ns == goal_ns) {
            note_end(run, result);
        }
        if (to_ns > from_ns && result->moment_count < UMBC_LOAD_MOMENTS) {
            end_piece(run, from_ns, umbu_clock_ns(), result);
            if (watch != NULL) {
                watch(user, &result->moments[result->moment_count - 1], result);
            }
        }
        from_ns = to_ns;
        if (to_ns == goal_ns && measured) {
            look_at_costs(run, result);
            return UMB_OK;
        }
        if (to_ns == goal_ns) {
            measured = true;
            status = begin_window(run, error);
        }
    }
    return status;
}

static void collect(struct run *run, struct umbc_load_result *result)
{
    result->calls = result->error_count = 0;
    for (unsigned i = 0; i < run->lane_count; i++) {
        /* The threads that wrote the lanes have ended. */
        const struct lane *lane = &run->lanes[i];
        umbc_histogram_merge(&result->latency, &lane->latency);
        result->calls += lane->calls;
        result->error_count += lane->error_count;
        for (size_t k = 0; k < UMBC_LOAD_STATUSES; k++) {
            result->errors[k] += lane->errors[k];
        }
    }
    result->points = result->calls * run->plan.pool->batch;
}

/* Fails with the reason if no call was answered. */
static enum umb_status check_answered(const struct run *run, struct umb_error *error)
{
    const struct umb_error *last = NULL;
    for (unsigned i = 0; i < run->lane_count; i++) {
        if (run->lanes[i].ended > 0) {
            return UMB_OK;
        }
        if (run->lanes[i].last_error.status != UMB_OK) {
            last = &run->lanes[i].last_error;
        }
    }
    if (last == NULL) {
        return umb_fail(error, UMB_E_DEADLINE, "no call was answered within the run");
    }
    return umb_fail(error, last->status, "no call was answered: %.300s", last->message);
}

static enum umb_status open_lanes(struct run *run, struct umb_error *error)
{
    unsigned count = run->plan.settings->connections;
    run->lanes = calloc(count, sizeof *run->lanes);
    if (run->lanes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u connections", count);
    }
    while (run->lane_count < count) {
        unsigned index = run->lane_count++; /* a lane that failed is finished too */
        UMB__TRY(open_lane(&run->lanes[index], &run->plan, index, error));
    }
    return UMB_OK;
}

static enum umb_status start_lanes(struct run *run, struct umb_error *error)
{
    const struct umbc_load_settings *settings = run->plan.settings;
    run->plan.start_ns = umbu_clock_ns() + (uint64_t)(LEAD_S * 1e9);
    run->plan.window_ns = run->plan.start_ns + (uint64_t)(settings->warm_up_s * 1e9);
    run->plan.end_ns = run->plan.window_ns + (uint64_t)(settings->duration_s * 1e9);
    if (settings->rate > 0) {
        int code = pthread_create(&run->pacer, NULL, pace, run);
        run->paced = code == 0;
        return run->paced ? UMB_OK
                          : umb_fail_errno(error, UMB_E_INTERNAL, code, "cannot start a thread");
    }
    sleep_until(run->plan.start_ns);
    for (unsigned i = 0; i < run->lane_count; i++) {
        (void)start_calls(&run->lanes[i]);
    }
    return UMB_OK;
}

/* Starts no more calls, and waits until the calls under way end or meet their deadline. */
static void stop_lanes(struct run *run, struct umbc_load_result *result)
{
    uint64_t now_ns = umbu_clock_ns();
    uint64_t until_ns = now_ns + (uint64_t)run->plan.settings->timeout_ms * 1000000U;
    for (unsigned i = 0; i < run->lane_count; i++) {
        result->unsent += stop_lane(&run->lanes[i], now_ns);
    }
    if (run->paced) {
        atomic_store(&run->stop_pacing, true);
        (void)pthread_join(run->pacer, NULL);
    }
    for (unsigned i = 0; i < run->lane_count; i++) {
        while (calls_under_way(&run->lanes[i]) > 0 && umbu_clock_ns() < until_ns) {
            sleep_until(umbu_clock_ns() + PACE_IDLE_NS);
        }
    }
}

/* Closes all connections; afterwards no callback runs. */
static void finish_lanes(struct run *run)
{
    for (unsigned i = 0; i < run->lane_count; i++) {
        close_lane(&run->lanes[i]);
    }
}

static void close_run(struct run *run)
{
    finish_lanes(run);
    free(run->lanes);
    free(run);
}

enum umb_status umbc_load_run(const struct umbc_load_settings *settings,
                              const struct umbc_load_pool *pool, umbc_load_watch_fn watch,
                              void *user, struct umbc_load_result *result, struct umb_error *error)
{
    memset(result, 0, sizeof *result);
    result->rate = settings->rate;
    struct run *run = calloc(1, sizeof *run);
    if (run == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a run");
    }
    run->plan.settings = settings;
    run->plan.pool = pool;
    atomic_init(&run->stop_pacing, false);
    enum umb_status status = open_lanes(run, error);
    if (status == UMB_OK) {
        status = start_lanes(run, error);
    }
    if (status == UMB_OK) {
        status = watch_run(run, watch, user, result, error);
        stop_lanes(run, result);
    }
    finish_lanes(run);
    if (status == UMB_OK) {
        status = check_answered(run, error);
        collect(run, result);
    }
    close_run(run);
    return status;
}
