/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-service races the daemon with other protocols (bench_protocol.h), and with the library in
 * process.
 *
 * The row pcf9-65536, points_vs_in_process is a ratio. The numerator is the points a second that
 * umbraged answers over loopback TCP, with its loop and its one worker on one core and the client
 * on the other. The denominator is the points a second of the same batches in this process on one
 * core. Batches of 65536 points, 9 taps, one byte an answer; a few calls are under way at a time,
 * as any client that wants throughput does. Wall time on both sides. The first answers of both are
 * compared, byte for byte.
 */
#define _XOPEN_SOURCE 700 /* nftw */
#include <ftw.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bench_arguments.h"
#include "bench_machine.h"
#include "bench_points.h"
#include "bench_protocol.h"
#include "bench_report.h"
#include "bench_scene.h"
#include "umbrage/client.h"

#define BENCH     "service"
#define BATCH     65536U
#define CALLS     48U
#define UNDER_WAY 4U
#define TAPS      9U
#define PCF9      1 /* in bench_points.at */
#define START_S   10.0
#define PATH_SIZE 512

struct daemon {
    char folder[PATH_SIZE], asset[PATH_SIZE + 32], address_file[PATH_SIZE + 32];
    char address[128];
    pid_t process;
};

/* The daemon, global so that it is stopped in whatever way the program ends. */
static struct daemon daemon_run = {.process = -1};

/* A run of calls; the client's thread writes to it, the main thread reads it. */
struct flight {
    atomic_uint done, failed;
    uint8_t *answers; /* [BATCH], of the last reply */
};

static void wait_a_little(void)
{
    const struct timespec pause = {.tv_nsec = 100000};
    (void)nanosleep(&pause, NULL);
}

static void asset_store(struct daemon *daemon, const struct bench_asset *asset)
{
    const char *base = getenv("TMPDIR");
    (void)snprintf(daemon->folder, sizeof daemon->folder, "%s/umbrage-bench-XXXXXX",
                   base != NULL ? base : "/tmp");
    if (mkdtemp(daemon->folder) == NULL) {
        bench_fail("cannot make the folder %s", daemon->folder);
    }
    (void)snprintf(daemon->asset, sizeof daemon->asset, "%s/city.umb", daemon->folder);
    (void)snprintf(daemon->address_file, sizeof daemon->address_file, "%s/address", daemon->folder);
    FILE *file = fopen(daemon->asset, "wb");
    if (file == NULL ||
        fwrite(asset->packed, 1, asset->packed_bytes, file) != asset->packed_bytes ||
        fclose(file) != 0) {
        bench_fail("cannot write %s", daemon->asset);
    }
}

static void daemon_exec(const struct daemon *daemon, const char *program)
{
    (void)bench_pin(0);
    (void)execl(program, program, "--store", daemon->folder, "--listen", "tcp:127.0.0.1:0",
                "--workers", "1", "--drain-delay", "0s", "--log-level", "error", "--address-file",
                daemon->address_file, (char *)NULL);
    _exit(127);
}

/* Reads the first address; 0 if it is not there yet. */
static int address_read(struct daemon *daemon)
{
    FILE *file = fopen(daemon->address_file, "r");
    if (file == NULL) {
        return 0;
    }
    const int found = fgets(daemon->address, sizeof daemon->address, file) != NULL &&
                      strchr(daemon->address, '\n') != NULL;
    (void)fclose(file);
    daemon->address[strcspn(daemon->address, "\n")] = '\0';
    return found;
}

static void daemon_start(struct daemon *daemon, const char *program)
{
    daemon->process = fork();
    if (daemon->process < 0) {
        bench_fail("cannot start a process");
    }
    if (daemon->process == 0) {
        daemon_exec(daemon, program);
    }
    const double start = bench_wall_s();
    while (!address_read(daemon)) {
        if (waitpid(daemon->process, NULL, WNOHANG) != 0 || bench_wall_s() - start > START_S) {
            bench_fail("%s did not open its address", program);
        }
        wait_a_little();
    }
}

/* Removes one entry of the daemon's store, for nftw: the store has a cache folder, too. */
static int entry_remove(const char *path, const struct stat *info, int kind, struct FTW *at)
{
    (void)info;
    (void)kind;
    (void)at;
    if (remove(path) != 0) {
        bench_say("cannot remove %s", path);
    }
    return 0;
}

static void daemon_stop(void)
{
    const struct daemon *daemon = &daemon_run;
    if (daemon->process > 0) {
        (void)kill(daemon->process, SIGTERM);
        (void)waitpid(daemon->process, NULL, 0);
    }
    if (daemon->folder[0] == '\0') {
        return;
    }
    (void)nftw(daemon->folder, entry_remove, 8, FTW_DEPTH | FTW_PHYS);
}

static void reply_take(void *user, enum umb_status status,
                       const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct flight *flight = user;
    if (status != UMB_OK || reply->value_bytes != BATCH) {
        fprintf(stderr, "bench: query: %s\n", status != UMB_OK ? error->message : "short reply");
        atomic_fetch_add(&flight->failed, 1U);
    } else {
        memcpy(flight->answers, reply->values, BATCH);
    }
    atomic_fetch_add(&flight->done, 1U);
}

static struct umb_client_query_request request_of(const struct bench_points *points,
                                                  const double origin[3], size_t first)
{
    struct umb_client_query_request request = {
        .asset = "city",
        .settings = {.taps = TAPS, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8},
        .points = {.positions = points->at[PCF9] + 3 * first,
                   .format = UMB_POINT_F32,
                   .count = BATCH},
    };
    memcpy(request.points.origin, origin, sizeof request.points.origin);
    return request;
}

/* Points a second of the service. */
static double service_rate(struct umb_client *client, const struct bench_points *points,
                           const double origin[3], struct flight *flight)
{
    const size_t batches = points->count / BATCH;
    struct umb_error error;
    atomic_store(&flight->done, 0U);
    const double start = bench_wall_s();
    for (unsigned call = 0; call < CALLS; call++) {
        const struct umb_client_query_request request =
            request_of(points, origin, (call % batches) * BATCH);
        while (call - atomic_load(&flight->done) >= UNDER_WAY) {
            wait_a_little();
        }
        bench_must(umb_client_query_start(client, &request, reply_take, flight, NULL, &error),
                   &error, "query");
    }
    while (atomic_load(&flight->done) < CALLS) {
        wait_a_little();
    }
    if (atomic_load(&flight->failed) > 0) {
        bench_fail("%u calls failed", atomic_load(&flight->failed));
    }
    return (double)CALLS * BATCH / (bench_wall_s() - start);
}

/* Points a second of the same batches in this process. */
static double process_rate(const struct umb_query *query, const struct bench_points *points,
                           const double origin[3], uint8_t *values)
{
    const size_t batches = points->count / BATCH;
    const double start = bench_wall_s();
    for (unsigned call = 0; call < CALLS; call++) {
        const struct umb_client_query_request request =
            request_of(points, origin, (call % batches) * BATCH);
        struct umb_answers answers = {.values = values};
        umb_query_run(query, &request.points, 0, BATCH, &answers);
    }
    return (double)CALLS * BATCH / (bench_wall_s() - start);
}

static void race_run(const struct bench_scene *scene, const struct bench_asset *asset,
                     const struct bench_points *points, const char *address)
{
    struct umb_client *client = NULL;
    struct umb_query query;
    struct umb_error error;
    struct bench_samples ratios = {0}, service = {0}, process = {0};
    struct flight flight = {.answers = calloc(BATCH, 1)};
    uint8_t *values = calloc(BATCH, 1);
    const struct umb_client_query_request request = request_of(points, scene->origin, 0);
    if (flight.answers == NULL || values == NULL || points->count < BATCH) {
        bench_fail("no memory, or fewer points than a batch");
    }
    bench_must(umb_query_prepare(asset->asset, &request.settings, &query, &error), &error, "query");
    (void)bench_pin(1);
    bench_must(umb_client_open(address, NULL, &client, &error), &error, "client");
    (void)service_rate(client, points, scene->origin, &flight);
    (void)process_rate(&query, points, scene->origin, values);
    if (memcmp(values, flight.answers, BATCH) != 0) {
        bench_fail("the service answers otherwise than the library");
    }
    while (ratios.count < BENCH_RUNS ||
           (ratios.count < BENCH_RUNS_MAX && bench_spread(&ratios) > BENCH_SPREAD)) {
        const double theirs = service_rate(client, points, scene->origin, &flight);
        const double ours = process_rate(&query, points, scene->origin, values);
        bench_add(&service, theirs);
        bench_add(&process, ours);
        bench_add(&ratios, theirs / ours);
    }
    bench_say("pcf9-65536: service %.2f, in process %.2f Mpoints/s", 1e-6 * bench_median(&service),
              1e-6 * bench_median(&process));
    bench_row(BENCH, "pcf9-65536", "points_vs_in_process", "higher", &ratios);
    umb_client_close(client);
    free(flight.answers);
    free(values);
}

static void usage_print(FILE *to)
{
    fputs(
        "usage: bench_service --umbraged PROGRAM [--size quick|full] [--assets DIR] [--peers DIR]\n"
        "  --umbraged  the daemon\n"
        "  --size      the bars that rows are held against; both run the same (quick)\n"
        "  --assets    read and keep bakes in this folder, which other benchmarks share\n"
        "  --peers     the folder that peer_raw and peer_grpcpp are in (.)\n",
        to);
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--umbraged", "--size", "--assets", "--peers", NULL};
    bench_arguments(argc, argv, options, usage_print);
    struct bench_scene scene;
    struct bench_asset asset;
    struct bench_points points;
    const char *size = bench_size(argc, argv);
    const char *program = bench_option(argc, argv, "--umbraged", NULL);
    if (program == NULL) {
        bench_misuse("--umbraged is missing");
    }
    bench_scene_make(&scene, "city", 14, bench_option(argc, argv, "--assets", NULL));
    bench_scene_trace(&scene);
    bench_points_gbuffer(&scene, BENCH_VIEW_OVERVIEW, &points);
    bench_asset_make(&scene, 1, 0, &asset);
    if (atexit(daemon_stop) != 0) {
        bench_fail("atexit refused");
    }
    asset_store(&daemon_run, &asset);
    daemon_start(&daemon_run, program);
    const struct protocol_race protocol = {
        .asset = daemon_run.asset,
        .name = "city",
        .peers = bench_option(argc, argv, "--peers", "."),
        .daemon = daemon_run.process,
        .daemon_port = (unsigned)strtoul(strrchr(daemon_run.address, ':') + 1, NULL, 10),
    };
    protocol_races_run(&protocol);
    race_run(&scene, &asset, &points, daemon_run.address);
    bench_points_finish(&points);
    bench_asset_finish(&asset);
    bench_scene_finish(&scene);
    bench_table(BENCH, size);
    return 0;
}
