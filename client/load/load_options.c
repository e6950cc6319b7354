/* SPDX-License-Identifier: Apache-2.0 */
/* The options of `umbrage load`, see load_print.h. */
#include "load/load_print.h"

#include <string.h>

#define BATCH_MAX  (1U << 22)
#define RATE_MAX   1e6
#define RATE_MIN   1e-3 /* calls a second; due times of much lower rates overflow */
#define TIME_MAX_S 86400
#define AT(field)  UMBU_AT(struct umbc_load_options, field)

static const struct umbu_option OPTIONS[] = {
    {"ASSET", NULL, "asset of the daemon", UMBU_TEXT, AT(settings.asset), .needed = true},
    {"rate", "R",
     "calls a second of an open loop, above 0.001 to 1000000, whatever the daemon does. Without it "
     "each connection keeps --in-flight calls under way",
     UMBU_ABOVE(RATE_MIN, RATE_MAX), AT(settings.rate)},
    {"closed", NULL, "closed loop, as without --rate", UMBU_FLAG, AT(closed),
     .excludes = "rate|sweep"},
    {"connections", "N", "number of connections to the daemon, 1 to 256",
     UMBU_COUNT(1, UMBC_LOAD_CONNS_MAX), AT(settings.connections), .standard = "4", .letter = 'c'},
    {"in-flight", "N", "most calls under way on a connection, 1 to 4096",
     UMBU_COUNT(1, UMBC_LOAD_FLIGHT_MAX), AT(settings.in_flight),
     .otherwise = "8, with --rate at most 256"},
    {"stream", NULL, "uses one QueryStream a connection instead of a call for each batch",
     UMBU_FLAG, AT(settings.stream)},
    {"batch", "N", "points in a call, 1 to 4194304", UMBU_COUNT(1, BATCH_MAX), AT(source.batch),
     .standard = "64", .letter = 'b'},
    {"points", "KIND",
     "place of the points. camera: frames on a path over the asset; random: in its bounds; "
     "boundary: at shadow boundaries",
     UMBU_CHOICE("camera|random|boundary"), AT(source.kind), .standard = "camera"},
    {"trace", "FILE", "file of recorded points, as for `umbrage query --points`", UMBU_TEXT,
     AT(source.trace), .excludes = "points"},
    {"format", NULL, "format of the trace: text, or raw little-endian numbers",
     UMBU_CHOICE("text|f32|f64"), AT(source.format), .standard = "text", .needs = "trace"},
    {"normals", NULL, "points of a raw trace have six numbers", UMBU_FLAG, AT(source.with_normals),
     .needs = "trace format=f32|f64"},
    {.setting = "light", AT(source.light), .standard = "0"},
    {.setting = "taps", AT(settings.query.taps), .standard = "1"},
    {"encoding", "NAME", "encoding of the answers: u8, f32 or bit", .setting = "format",
     AT(settings.query.format), .standard = "u8"},
    {"seed", "N", "seed of random and boundary points", UMBU_COUNT(0, UINT64_MAX), AT(source.seed),
     .standard = "1"},
    {"warm-up", "TIME", "time of the load before the measurement (ms, s, m)",
     UMBU_TIME(0, 1000 * TIME_MAX_S), AT(settings.warm_up_s), .otherwise = "1, in a sweep 0.5"},
    {"duration", "TIME", "time of the measurement (ms, s, m); in a sweep, of each step",
     UMBU_TIME(0, 1000 * TIME_MAX_S), .above = true, AT(settings.duration_s),
     .otherwise = "10, in a sweep 2", .letter = 'd'},
    {"timeout", "MS", "deadline of a call in milliseconds", UMBU_COUNT(1, 1000 * TIME_MAX_S),
     AT(settings.timeout_ms), .standard = "10000"},
    {"sweep", NULL, "finds the highest rate that keeps --bound; the first rate is --rate, else 100",
     UMBU_FLAG, AT(sweep)},
    {"bound", "MS", "bound of a sweep for the 99th percentile in milliseconds", UMBU_ABOVE(0, 1e6),
     AT(bound_ms), .standard = "10", .needs = "sweep"},
    {"admin", "HOST:PORT", "admin port of the daemon, for its processor time and memory", UMBU_TEXT,
     AT(settings.admin)},
    {"report", "FILE", "HTML page with plots, in one file",
     UMBU_NAME("a file name: stdout has the figures"), AT(report)},
    {UMBU_JSON_ROW(struct umbc_load_options)},
    {UMBU_QUIET_ROW(struct umbc_load_options, "no live line")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage load",
    .usage = "umbrage load ASSET [options]",
    .summary = "Loads a daemon with queries and measures it: throughput, latencies to the\n"
               "99.99th percentile (never too small, at most 0.8 % too large), errors by status,\n"
               "and with --admin the daemon's processor time. With --rate a latency counts from\n"
               "the time at which the call was due, not from the time at which it was sent. No\n"
               "call is sent twice. A run in which this program used more than 70 % of a\n"
               "processor says so: it may have measured itself.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct umbc_load_options, session)},
};

int umbc_load_options_parse(int argc, char **argv, struct umbc_load_options *options)
{
    struct umbc_load_settings *settings = &options->settings;
    struct umbu_parsed parsed;
    memset(options, 0, sizeof *options);
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, options);
    if (code >= 0) {
        return code;
    }
    const bool open = settings->rate > 0 || options->sweep;
    options->source.asset = settings->asset;
    settings->query.light = options->source.light;
    if (options->source.trace != NULL) {
        options->source.kind = UMBC_LOAD_TRACE;
    }
    if (settings->in_flight == 0) {
        settings->in_flight = open ? 256 : 8;
    }
    if (!umbu_given(&parsed, "warm-up")) {
        settings->warm_up_s = options->sweep ? 0.5 : 1;
    }
    if (!umbu_given(&parsed, "duration")) {
        settings->duration_s = options->sweep ? 2 : 10;
    }
    return -1;
}
