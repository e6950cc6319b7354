/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures the rows unary-1, unary-65536, stream-1 and stream-64: the server's CPU time for a
 * request, as ratios of runs made right after one another. All points lie at the top of the light's
 * frustum, above all casters. A look-up ends at once there, so most of the time measured is that of
 * the protocol.
 */
#include "bench_protocol.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bench_caller.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "peer_work.h"
#include "wire/messages.h"

#define BENCH      "service"
#define POINTS_MAX 65536U
#define STEPS      4000 /* of the search for the top, along the light */

struct server {
    pid_t process;
    unsigned port;
};

static struct server raw = {.process = -1}, grpcpp = {.process = -1};

static void stop_peers(void)
{
    const struct server *servers[] = {&raw, &grpcpp};
    for (size_t i = 0; i < 2; i++) {
        if (servers[i]->process > 0) {
            (void)kill(servers[i]->process, SIGKILL);
            (void)waitpid(servers[i]->process, NULL, 0);
        }
    }
}

/* Starts a peer. Its port stays 0 if the peer was not built. */
static void start_peer(struct server *server, const char *folder, const char *name,
                       const char *asset)
{
    int ends[2];
    char text[16] = "";
    const char *path = bench_text("%s/%s", folder, name);
    if (access(path, X_OK) != 0) {
        bench_say("%s is not built (make deps-full): its rows are left out", name);
        return;
    }
    if (pipe(ends) != 0) {
        bench_fail("no pipe");
    }
    server->process = fork();
    if (server->process == 0) {
        (void)bench_pin(0);
        (void)dup2(ends[1], STDOUT_FILENO);
        (void)execl(path, path, asset, (char *)NULL);
        _exit(127);
    }
    (void)close(ends[1]);
    if (server->process < 0 || read(ends[0], text, sizeof text - 1) <= 0) {
        bench_fail("%s did not start", name);
    }
    (void)close(ends[0]);
    server->port = (unsigned)strtoul(text, NULL, 10);
}

static double process_cpu_s(pid_t process)
{
    clockid_t clock;
    struct timespec now;
    if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &now) != 0) {
        bench_fail("no CPU time of process %ld", (long)process);
    }
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Returns the microseconds of server CPU time for a call. */
static double cost_us(const struct server *server, struct caller_job job,
                      enum caller_protocol protocol)
{
    job.protocol = protocol;
    job.port = (uint16_t)server->port;
    const double before = process_cpu_s(server->process);
    caller_run(&job);
    return 1e6 * (process_cpu_s(server->process) - before) / (double)job.calls;
}

static void make_job(const struct protocol_race *race, const float *points, size_t count,
                     struct umbw_buffer *buffer, struct caller_job *job)
{
    static uint8_t values[POINTS_MAX];
    struct umbw_query_request request = {
        .settings = {.taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8},
        .points = {.positions = points, .format = UMB_POINT_F32, .count = count},
    };
    struct umb_error error;
    (void)snprintf(request.asset, sizeof request.asset, "%s", race->name);
    bench_must(umbw_encode_query_request(&request, buffer, &error), &error, "request");
    memset(values, 255, sizeof values);
    *job = (struct caller_job){
        .message = buffer->bytes + UMBW_PREFIX_BYTES,
        .message_size = buffer->size - UMBW_PREFIX_BYTES,
        .values = values,
        .value_bytes = count,
        .calls = count > 10000 ? 160 : 10000,
    };
}

/* One case against one peer. */
static void race_one(const char *name, const char *figure, const struct server *ours,
                     const struct server *peer, const struct caller_job *job, int is_stream)
{
    const enum caller_protocol protocol = is_stream ? CALLER_STREAM : CALLER_UNARY;
    const enum caller_protocol theirs = peer == &raw ? CALLER_RAW : CALLER_UNARY;
    struct bench_samples ratios = {0}, mine = {0}, other = {0};
    if (peer->port == 0) {
        return;
    }
    (void)cost_us(ours, *job, protocol);
    (void)cost_us(peer, *job, theirs);
    while (ratios.count < BENCH_RUNS ||
           (ratios.count < BENCH_RUNS_MAX && bench_spread(&ratios) > BENCH_SPREAD)) {
        const double a = cost_us(ours, *job, protocol);
        const double b = cost_us(peer, *job, theirs);
        bench_add(&mine, a);
        bench_add(&other, b);
        bench_add(&ratios, a / b);
    }
    bench_say("%s: umbraged %.2f us, peer %.2f us of server CPU a request", name,
              bench_median(&mine), bench_median(&other));
    bench_row(BENCH, name, figure, "lower", &ratios);
}

/* Returns a point between the scene's middle and the light, as far out as the frustum reaches. */
static void fill_points(const char *path, float points[3 * POINTS_MAX])
{
    struct umb_asset *asset = peer_asset(path);
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_error error;
    const struct umb_query_settings settings = {
        .taps = 1, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
    struct umb_query query;
    float top[3] = {0}, at[3];
    int found = 0;
    umb_asset_get_info(asset, &info);
    bench_must(umb_asset_get_light(asset, 0, &light), NULL, "light");
    bench_must(umb_query_prepare(asset, &settings, &query, &error), &error, "query");
    for (int step = 0; step < STEPS; step++) {
        uint8_t lit = 0;
        const struct umb_points one = {.positions = at, .format = UMB_POINT_F32, .count = 1};
        struct umb_answers answers = {.values = &lit};
        for (size_t axis = 0; axis < 3; axis++) {
            const double middle = (info.bounds.min[axis] + info.bounds.max[axis]) / 2;
            const double length = info.bounds.max[0] - info.bounds.min[0];
            at[axis] = (float)(middle - light.direction[axis] * length * step / STEPS);
        }
        umb_query_run(&query, &one, 0, 1, &answers);
        if (lit == 255 && answers.stats.before + answers.stats.outside == 0) {
            memcpy(top, at, sizeof top);
            found = 1;
        }
    }
    if (!found) {
        bench_fail("the frustum has no lit point above the scene's middle");
    }
    for (size_t i = 0; i < 3 * POINTS_MAX; i++) {
        points[i] = top[i % 3];
    }
    umb_asset_close(asset);
}

void protocol_races_run(const struct protocol_race *race)
{
    const struct server ours = {.process = race->daemon, .port = race->daemon_port};
    static float points[3 * POINTS_MAX];
    struct umbw_buffer one = {0}, some = {0}, many = {0};
    struct caller_job job_1, job_64, job_65536;
    fill_points(race->asset, points);
    (void)atexit(stop_peers);
    start_peer(&raw, race->peers, "peer_raw", race->asset);
    start_peer(&grpcpp, race->peers, "peer_grpcpp", race->asset);
    make_job(race, points, 1, &one, &job_1);
    make_job(race, points, 64, &some, &job_64);
    make_job(race, points, POINTS_MAX, &many, &job_65536);
    (void)bench_pin(1);
    race_one("unary-1", "server_cpu_vs_grpcpp", &ours, &grpcpp, &job_1, 0);
    race_one("unary-65536", "server_cpu_vs_grpcpp", &ours, &grpcpp, &job_65536, 0);
    race_one("stream-1", "server_cpu_vs_raw_frames", &ours, &raw, &job_1, 1);
    race_one("stream-64", "server_cpu_vs_raw_frames", &ours, &raw, &job_64, 1);
    race_one("unary-65536", "server_cpu_vs_raw_frames", &ours, &raw, &job_65536, 0);
    umbw_buffer_finish(&one);
    umbw_buffer_finish(&some);
    umbw_buffer_finish(&many);
}
