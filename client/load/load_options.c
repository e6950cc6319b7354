/* SPDX-License-Identifier: Apache-2.0 */
/* The options of `umbrage load`, see load_options.h. */
#include "load/load_options.h"

#include <string.h>

#define CONNECTIONS      4
#define IN_FLIGHT_CLOSED 8
#define IN_FLIGHT_OPEN   256
#define BATCH            64
#define BATCH_MAX        (1U << 22)
#define RATE_MAX         1e6
#define RATE_MIN         1e-3 /* above; far less, and when calls are due has no number */
#define TIME_MAX_S       86400
#define TIMEOUT_MS       10000
#define DURATION_S       10
#define SWEEP_STEP_S     2
#define BOUND_MS         10

enum load_option {
    OPTION_RATE,
    OPTION_CLOSED,
    OPTION_CONNECTIONS,
    OPTION_IN_FLIGHT,
    OPTION_STREAM,
    OPTION_BATCH,
    OPTION_POINTS,
    OPTION_TRACE,
    OPTION_FORMAT,
    OPTION_NORMALS,
    OPTION_LIGHT,
    OPTION_TAPS,
    OPTION_ENCODING,
    OPTION_SEED,
    OPTION_WARM_UP,
    OPTION_DURATION,
    OPTION_TIMEOUT,
    OPTION_SWEEP,
    OPTION_BOUND,
    OPTION_ADMIN,
    OPTION_REPORT,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_RATE] = {"rate", "R",
                     "open loop: R calls a second, whatever the daemon does; else "
                     "each connection keeps --in-flight calls under way",
                     0},
    [OPTION_CLOSED] = {"closed", NULL, "closed loop, which is the default without --rate", 0},
    [OPTION_CONNECTIONS] = {"connections", "N", "default 4", 'c'},
    [OPTION_IN_FLIGHT] = {"in-flight", "N",
                          "calls of a connection: default 8, with --rate at most "
                          "256",
                          0},
    [OPTION_STREAM] = {"stream", NULL, "one QueryStream a connection instead of a call each", 0},
    [OPTION_BATCH] = {"batch", "N", "points a call, default 64", 'b'},
    [OPTION_POINTS] = {"points", "KIND",
                       "camera (default): frames on a path over the asset; random: "
                       "in its bounds; boundary: at borders of shadow",
                       0},
    [OPTION_TRACE] = {"trace", "FILE", "recorded points instead, as of `umbrage query --points`",
                      0},
    [OPTION_FORMAT] = {"format", "FORMAT", "of the trace: text (default), f32 or f64", 0},
    [OPTION_NORMALS] = {"normals", NULL, "raw traces: six numbers a point", 0},
    [OPTION_LIGHT] = {"light", "N", "index of the light, default 0", 0},
    [OPTION_TAPS] = {"taps", "N", "width of the filter window: odd, 1 (default) to 17", 0},
    [OPTION_ENCODING] = {"encoding", "NAME", "of the answers: u8 (default), f32, bit", 0},
    [OPTION_SEED] = {"seed", "N", "of random and boundary points, default 1", 0},
    [OPTION_WARM_UP] = {"warm-up", "S",
                        "seconds before the measured ones, default 1, in a sweep 0.5", 0},
    [OPTION_DURATION] = {"duration", "S",
                         "time that is measured (ms, s, m), default 10; of a sweep's step "
                         "2",
                         'd'},
    [OPTION_TIMEOUT] = {"timeout", "MS", "deadline of a call, default 10000", 0},
    [OPTION_SWEEP] = {"sweep", NULL,
                      "find the highest rate that keeps the bound; --rate is the "
                      "first that is tried, default 100",
                      0},
    [OPTION_BOUND] = {"bound", "MS", "of a sweep: for the 99th percentile, default 10", 0},
    [OPTION_ADMIN] = {"admin", "HOST:PORT", "the daemon's metrics: its processor time and memory",
                      0},
    [OPTION_REPORT] = {"report", "FILE", "a page with plots that needs nothing else", 0},
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "no live line", 'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage load ASSET [options]",
    .summary =
        "Loads a daemon with queries and measures it: throughput, latencies to the 99.99th\n"
        "percentile (never told too small, at most 0.8 % too large), errors by status, and with\n"
        "--admin what it cost the daemon. With --rate a latency counts from when the call was "
        "due,\n"
        "not from when it could be sent. Nothing is sent twice. A run in which this program used\n"
        "more than 70 % of a processor says so: it may have measured itself.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

/* A whole number within low..high; *value stays if the option was not given. */
static int take_count(const struct umbc_parsed *parsed, enum load_option option,
                      unsigned long long low, unsigned long long high, unsigned long long *value)
{
    const char *text = parsed->values[option];
    if (text == NULL) {
        return -1;
    }
    if (!umbc_parse_count(text, high, value) || *value < low) {
        return umbc_usage_error("load: --%s '%s' is not within %llu..%llu", OPTIONS[option].name,
                                text, low, high);
    }
    return -1;
}

/* A number above `above` and at most high; *value stays if the option was not given. */
static int take_number(const struct umbc_parsed *parsed, enum load_option option, double above,
                       double high, double *value)
{
    const char *text = parsed->values[option];
    if (text == NULL) {
        return -1;
    }
    if (!umbc_parse_number(text, value) || !(*value > above && *value <= high)) {
        return umbc_usage_error("load: --%s '%s' is not above %g and at most %g",
                                OPTIONS[option].name, text, above < 0 ? 0 : above, high);
    }
    return -1;
}

/* Seconds, or with a suffix ms, s or m; otherwise as take_number. */
static int take_seconds(const struct umbc_parsed *parsed, enum load_option option, double above,
                        double *value)
{
    static const struct {
        const char *suffix;
        double seconds;
    } units[] = {{"ms", 0.001}, {"s", 1}, {"m", 60}};
    const char *text = parsed->values[option];
    char number[40];
    double unit = 1;
    size_t length = text != NULL ? strspn(text, "0123456789.eE+-") : 0;
    if (text == NULL) {
        return -1;
    }
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        if (strcmp(text + length, units[i].suffix) == 0) {
            unit = units[i].seconds;
            text = length < sizeof number ? number : text;
        }
    }
    if (text == number) {
        memcpy(number, parsed->values[option], length);
        number[length] = '\0';
    }
    if (!umbc_parse_number(text, value) ||
        !(*value * unit > above && *value * unit <= TIME_MAX_S)) {
        return umbc_usage_error("load: --%s '%s' is not above %g and at most %g seconds (ms, s, m)",
                                OPTIONS[option].name, parsed->values[option], above < 0 ? 0 : above,
                                (double)TIME_MAX_S);
    }
    *value *= unit;
    return -1;
}

static int take_points(const struct umbc_parsed *parsed, struct umbc_load_options *options)
{
    static const char *const kinds[] = {"camera", "random", "boundary"};
    static const char *const formats[] = {"text", "f32", "f64"};
    const char *kind = parsed->values[OPTION_POINTS];
    const char *format = parsed->values[OPTION_FORMAT];
    struct umbc_load_source *source = &options->source;
    int found = kind == NULL ? 0 : umbc_find_word(kind, kinds, 3);
    if (found < 0) {
        return umbc_usage_error("load: --points '%s' is not camera, random or boundary", kind);
    }
    source->kind = (enum umbc_load_kind)found;
    source->trace = parsed->values[OPTION_TRACE];
    if (source->trace != NULL && kind != NULL) {
        return umbc_usage_error("load: --points and --trace exclude each other");
    }
    if (source->trace != NULL) {
        source->kind = UMBC_LOAD_TRACE;
    } else if (format != NULL || parsed->values[OPTION_NORMALS] != NULL) {
        return umbc_usage_error("load: --format and --normals belong to --trace");
    }
    found = format == NULL ? 0 : umbc_find_word(format, formats, 3);
    if (found < 0) {
        return umbc_usage_error("load: --format '%s' is not text, f32 or f64", format);
    }
    source->format = (enum umbc_points_format)found;
    source->with_normals = parsed->values[OPTION_NORMALS] != NULL;
    if (source->with_normals && source->format == UMBC_POINTS_TEXT) {
        return umbc_usage_error("load: --normals belongs to --format f32 or f64");
    }
    return -1;
}

static int take_query(const struct umbc_parsed *parsed, struct umbc_load_options *options)
{
    static const char *const encodings[] = {"u8", "f32", "bit"};
    static const enum umb_answer_format answers[] = {UMB_ANSWER_U8, UMB_ANSWER_F32, UMB_ANSWER_BIT};
    const char *encoding = parsed->values[OPTION_ENCODING];
    unsigned long long light = 0;
    unsigned long long taps = 1;
    unsigned long long batch = BATCH;
    unsigned long long seed = 1;
    int found = encoding == NULL ? 0 : umbc_find_word(encoding, encodings, 3);
    if (found < 0) {
        return umbc_usage_error("load: --encoding '%s' is not u8, f32 or bit", encoding);
    }
    int code = take_count(parsed, OPTION_LIGHT, 0, UINT32_MAX, &light);
    code = code < 0 ? take_count(parsed, OPTION_TAPS, 1, UMB_TAPS_MAX, &taps) : code;
    code = code < 0 ? take_count(parsed, OPTION_BATCH, 1, BATCH_MAX, &batch) : code;
    code = code < 0 ? take_count(parsed, OPTION_SEED, 0, UINT64_MAX, &seed) : code;
    if (code < 0 && taps % 2 == 0) {
        code = umbc_usage_error("load: --taps %llu is not odd", taps);
    }
    options->settings.query.format = answers[found];
    options->settings.query.light = options->source.light = (uint32_t)light;
    options->settings.query.taps = (uint32_t)taps;
    options->source.batch = (size_t)batch;
    options->source.seed = seed;
    return code;
}

static int take_load(const struct umbc_parsed *parsed, struct umbc_load_options *options)
{
    struct umbc_load_settings *settings = &options->settings;
    unsigned long long connections = CONNECTIONS;
    unsigned long long timeout = TIMEOUT_MS;
    int code = take_number(parsed, OPTION_RATE, RATE_MIN, RATE_MAX, &settings->rate);
    if (code < 0 && parsed->values[OPTION_CLOSED] != NULL &&
        (settings->rate > 0 || options->sweep)) {
        code = umbc_usage_error("load: --closed cannot be with --rate or --sweep");
    }
    unsigned long long in_flight =
        settings->rate > 0 || options->sweep ? IN_FLIGHT_OPEN : IN_FLIGHT_CLOSED;
    code = code < 0 ? take_count(parsed, OPTION_CONNECTIONS, 1, UMBC_LOAD_CONNS_MAX, &connections)
                    : code;
    code =
        code < 0 ? take_count(parsed, OPTION_IN_FLIGHT, 1, UMBC_LOAD_FLIGHT_MAX, &in_flight) : code;
    code = code < 0 ? take_count(parsed, OPTION_TIMEOUT, 1, 1000ULL * TIME_MAX_S, &timeout) : code;
    settings->warm_up_s = options->sweep ? 0.5 : 1;
    settings->duration_s = options->sweep ? SWEEP_STEP_S : DURATION_S;
    code = code < 0 ? take_seconds(parsed, OPTION_WARM_UP, -1e-9, &settings->warm_up_s) : code;
    code = code < 0 ? take_seconds(parsed, OPTION_DURATION, 0, &settings->duration_s) : code;
    options->bound_ms = BOUND_MS;
    code = code < 0 ? take_number(parsed, OPTION_BOUND, 0, 1e6, &options->bound_ms) : code;
    if (code < 0 && parsed->values[OPTION_BOUND] != NULL && !options->sweep) {
        code = umbc_usage_error("load: --bound belongs to --sweep");
    }
    settings->connections = (unsigned)connections;
    settings->in_flight = (unsigned)in_flight;
    settings->timeout_ms = (uint32_t)timeout;
    return code;
}

int umbc_load_options_parse(int argc, char **argv, struct umbc_load_options *options)
{
    struct umbc_parsed parsed;
    memset(options, 0, sizeof *options);
    int code = umbc_parse(&COMMAND, argc, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    memcpy(options->session, parsed.session, sizeof options->session);
    options->settings.asset = options->source.asset = parsed.words[0];
    options->settings.stream = parsed.values[OPTION_STREAM] != NULL;
    options->settings.admin = parsed.values[OPTION_ADMIN];
    options->sweep = parsed.values[OPTION_SWEEP] != NULL;
    options->report = parsed.values[OPTION_REPORT];
    if (options->report != NULL && strcmp(options->report, "-") == 0) {
        return umbc_usage_error("load: --report is a file, stdout has the figures");
    }
    options->json = parsed.values[OPTION_JSON] != NULL;
    options->quiet = parsed.values[OPTION_QUIET] != NULL;
    code = take_points(&parsed, options);
    code = code < 0 ? take_query(&parsed, options) : code;
    return code < 0 ? take_load(&parsed, options) : code;
}
