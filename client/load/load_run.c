/* SPDX-License-Identifier: Apache-2.0 */
/* One run of a load test, see load_run.h. */
#include "load/load_run.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>
#include "load/load_lane.h"
#include "tool/clock.h"
#include "tool/tool_try.h"

#define SECOND_NS    1000000000U
#define PIECE_S      0.1     /* shortest piece of a run */
#define PIECES       400     /* most pieces of a run */
#define PACE_IDLE_NS 500000U /* sleep of the pacer while all lanes wait for slots */
#define SCRAPE_S     0.5     /* shortest time between requests for the daemon's figures */
#define LEAD_S       0.02    /* time for threads to start before the first call is due */

struct run {
    struct umbc_load_plan plan;
    struct umbc_load_lane *lanes; /* [settings->connections] */
    unsigned lane_count;          /* number of lanes that were initialised */
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
            uint64_t due_ns = umbc_load_lane_start(&run->lanes[i]);
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
        struct umbc_load_lane *lane = &run->lanes[i];
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

/* Computes the daemon's processor time in the window. The run is valid without it. */
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
    const struct umbc_load_plan *plan = &run->plan;
    double whole_s = seconds_between(plan->start_ns, plan->end_ns);
    double piece_s = whole_s / PIECES > PIECE_S ? whole_s / PIECES : PIECE_S;
    uint64_t piece_ns = (uint64_t)(piece_s * 1e9);
    enum umb_status status = UMB_OK;
    bool in_window = false;
    for (uint64_t from_ns = plan->start_ns; status == UMB_OK;) {
        uint64_t goal_ns = in_window ? plan->end_ns : plan->window_ns;
        uint64_t to_ns = from_ns + piece_ns < goal_ns ? from_ns + piece_ns : goal_ns;
        sleep_until(to_ns);
        if (in_window && to_ns == goal_ns) {
            note_end(run, result);
        }
        if (to_ns > from_ns && result->moment_count < UMBC_LOAD_MOMENTS) {
            end_piece(run, from_ns, umbu_clock_ns(), result);
            if (watch != NULL) {
                watch(user, &result->moments[result->moment_count - 1], result);
            }
        }
        from_ns = to_ns;
        if (to_ns == goal_ns && in_window) {
            look_at_costs(run, result);
            return UMB_OK;
        }
        if (to_ns == goal_ns) {
            in_window = true;
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
        const struct umbc_load_lane *lane = &run->lanes[i];
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
        UMB__TRY(umbc_load_lane_init(&run->lanes[index], &run->plan, index, error));
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
        (void)umbc_load_lane_start(&run->lanes[i]);
    }
    return UMB_OK;
}

/* Starts no more calls, and waits until the calls under way end or meet their deadline. */
static void stop_lanes(struct run *run, struct umbc_load_result *result)
{
    uint64_t now_ns = umbu_clock_ns();
    uint64_t until_ns = now_ns + (uint64_t)run->plan.settings->timeout_ms * 1000000U;
    for (unsigned i = 0; i < run->lane_count; i++) {
        result->unsent += umbc_load_lane_stop(&run->lanes[i], now_ns);
    }
    if (run->paced) {
        atomic_store(&run->stop_pacing, true);
        (void)pthread_join(run->pacer, NULL);
    }
    for (unsigned i = 0; i < run->lane_count; i++) {
        while (umbc_load_lane_under_way(&run->lanes[i]) > 0 && umbu_clock_ns() < until_ns) {
            sleep_until(umbu_clock_ns() + PACE_IDLE_NS);
        }
    }
}

/* Closes all connections; afterwards no callback runs. */
static void finish_lanes(struct run *run)
{
    for (unsigned i = 0; i < run->lane_count; i++) {
        umbc_load_lane_finish(&run->lanes[i]);
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
