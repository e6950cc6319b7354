/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage stream: fetches the part of an asset that a box, a camera, a path or some points need,
 * from a file or a web server, and shows how it sharpens.
 */
#include "cli_common.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli_http.h"
#include "cli_json.h"
#include "cli_output.h"
#include "cli_progress.h"
#include "cli_stream_points.h"
#include "cli_stream_view.h"
#include "format/content.h"

enum stream_option {
    OPTION_FROM_FILE,
    OPTION_FROM_URL,
    OPTION_BOX,
    OPTION_CAMERA,
    OPTION_PATH,
    OPTION_POINTS,
    OPTION_FORMAT,
    OPTION_NORMALS,
    OPTION_ONLY_POINTS,
    OPTION_SIZE,
    OPTION_UP,
    OPTION_LIGHT,
    OPTION_TAPS,
    OPTION_MAX_ERROR,
    OPTION_MAX_PIXELS,
    OPTION_LIMIT,
    OPTION_MEMORY,
    OPTION_ID,
    OPTION_RESUME,
    OPTION_OUTPUT,
    OPTION_FRAMES,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_FROM_FILE] = {"from-file", "FILE", "the packed asset (.umb)", 0},
    [OPTION_FROM_URL] = {"from-url", "URL", "the same on any web server that serves ranges", 0},
    [OPTION_BOX] = {"box", "X0,Y0,Z0,X1,Y1,Z1", "what answers points in this box, metres", 0},
    [OPTION_CAMERA] = {"camera", "WHERE", "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]", 0},
    [OPTION_PATH] = {"path", "FILE", "a camera a line, one after the other", 0},
    [OPTION_POINTS] = {"points", "FILE", "points to ask while it sharpens; for the figures", 0},
    [OPTION_FORMAT] = {"format", "FORMAT", "of the points: text, f32 or f64 (default f32)", 0},
    [OPTION_NORMALS] = {"normals", NULL, "raw points have normals: six numbers each", 0},
    [OPTION_ONLY_POINTS] = {"only-points", NULL, "fetch just what the points need", 0},
    [OPTION_SIZE] = {"size", "WxH", "pixels of the camera's picture (default 1280x720)", 0},
    [OPTION_UP] = {"up", "y|z", "the scene's up axis (default y)", 0},
    [OPTION_LIGHT] = {"light", "N", "the asset's light (default 0)", 0},
    [OPTION_TAPS] = {"taps", "N", "widest filter that will be asked, odd (default 9)", 0},
    [OPTION_MAX_ERROR] = {"max-error", "M", "cells of this many metres are fine enough", 0},
    [OPTION_MAX_PIXELS] = {"max-pixels", "N", "so are cells of this many pixels", 0},
    [OPTION_LIMIT] = {"limit", "BYTES", "stop after receiving so many (64K, 2M)", 0},
    [OPTION_MEMORY] = {"memory", "BYTES", "what the client may use in all (default 1G)", 0},
    [OPTION_ID] = {"id", "ID", "insist on this asset, 64 hexadecimal digits", 0},
    [OPTION_RESUME] = {"resume", "PART", "go on from a file that -o wrote", 0},
    [OPTION_OUTPUT] = {"output", "PART", "keep what is here as a partial file", 'o'},
    [OPTION_FRAMES] = {"frames", "DIR", "a picture (PPM) of the points at each step", 0},
    [OPTION_JSON] = {"json", NULL, "print one JSON object, with every step", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command STREAM = {
    .usage = "umbrage stream (FILE | --from-file FILE | --from-url URL) [options]",
    .summary =
        "Fetches the part of an asset that is needed, coarse first, and shows how it sharpens.\n"
        "Without --box, --camera, --path or --points it fetches everything.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 0,
    .max_words = 1,
};

/* One line of the figures. */
struct step {
    double seconds; /* without the time for figures and pictures */
    size_t view;    /* number on the path */
    struct umb_region_stats stats;
    struct umbc_stream_figures figures;
};

struct stream {
    struct umbc_parsed parsed;
    struct umb_region_source source;
    bool is_http;
    struct umb_region_options options;
    uint8_t id[UMB_ID_BYTES];
    struct umb_partial_view base; /* what all views share */
    struct umbc_views views;
    struct umb_query_settings settings;
    size_t size[2];
    char up;
    uint64_t limit;
    struct umbc_stream_points points;
    struct umb_region *region;
    struct step *steps; /* [step_count] */
    size_t step_count, step_capacity;
    size_t view;               /* being fetched */
    double started_s, aside_s; /* clock; spent on figures and pictures */
    struct umb_error error;    /* of a progress callback */
};

/* "64K", "2M", "1G" or plain bytes. */
static bool parse_bytes(const char *text, uint64_t *bytes)
{
    char digits[24];
    unsigned long long value;
    const size_t length = strlen(text);
    if (length == 0 || length >= sizeof digits) {
        return false;
    }
    const char *units = "KMG", *unit = strchr(units, text[length - 1]);
    memcpy(digits, text, length + 1);
    if (unit) {
        digits[length - 1] = '\0';
    }
    const unsigned shift = unit ? 10 * (unsigned)(unit - units + 1) : 0;
    if (!umbc_parse_count(digits, UINT64_MAX >> 34, &value) || value == 0) {
        return false;
    }
    *bytes = (uint64_t)value << shift;
    return true;
}

static bool parse_size(const char *text, size_t size[2])
{
    unsigned width, height;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &width, &height, &end) != 2 || text[end] != '\0' || width == 0 ||
        height == 0 || width > 16384 || height > 16384) {
        return false;
    }
    size[0] = width;
    size[1] = height;
    return true;
}

/* Numbers and words of the command line. Returns -1 to go on, else the exit code. */
static int read_numbers(struct stream *s)
{
    const char *const *v = s->parsed.values;
    unsigned long long light = 0, taps = 9;
    double metres = 0, pixels = 0;
    s->size[0] = 1280;
    s->size[1] = 720;
    s->up = 'y';
    if (v[OPTION_SIZE] && !parse_size(v[OPTION_SIZE], s->size)) {
        return umbc_usage_error("stream: --size '%s', must be WxH", v[OPTION_SIZE]);
    }
    if (v[OPTION_UP]) {
        if (strcmp(v[OPTION_UP], "y") != 0 && strcmp(v[OPTION_UP], "z") != 0) {
            return umbc_usage_error("stream: --up '%s', must be y or z", v[OPTION_UP]);
        }
        s->up = v[OPTION_UP][0];
    }
    if (v[OPTION_LIGHT] && !umbc_parse_count(v[OPTION_LIGHT], UMB_LIGHTS_MAX - 1, &light)) {
        return umbc_usage_error("stream: --light '%s', no number of a light", v[OPTION_LIGHT]);
    }
    if (v[OPTION_TAPS] &&
        (!umbc_parse_count(v[OPTION_TAPS], UMB_TAPS_MAX, &taps) || taps % 2 == 0)) {
        return umbc_usage_error("stream: --taps '%s', must be odd and at most %d", v[OPTION_TAPS],
                                UMB_TAPS_MAX);
    }
    if (v[OPTION_MAX_ERROR] && !(umbc_parse_number(v[OPTION_MAX_ERROR], &metres) && metres >= 0)) {
        return umbc_usage_error("stream: --max-error '%s', no length", v[OPTION_MAX_ERROR]);
    }
    if (v[OPTION_MAX_PIXELS] &&
        !(umbc_parse_number(v[OPTION_MAX_PIXELS], &pixels) && pixels >= 0)) {
        return umbc_usage_error("stream: --max-pixels '%s', no number", v[OPTION_MAX_PIXELS]);
    }
    if (v[OPTION_LIMIT] && !parse_bytes(v[OPTION_LIMIT], &s->limit)) {
        return umbc_usage_error("stream: --limit '%s', no number of bytes", v[OPTION_LIMIT]);
    }
    if (v[OPTION_MEMORY] && !parse_bytes(v[OPTION_MEMORY], &s->options.max_memory_bytes)) {
        return umbc_usage_error("stream: --memory '%s', no number of bytes", v[OPTION_MEMORY]);
    }
    if (v[OPTION_ID]) {
        if (!umb_id_from_text(v[OPTION_ID], s->id)) {
            return umbc_usage_error("stream: --id '%s', must be 64 hexadecimal digits",
                                    v[OPTION_ID]);
        }
        s->options.id = s->id;
    }
    s->settings = (struct umb_query_settings){.light = (uint32_t)light, .taps = (uint32_t)taps};
    s->base = (struct umb_partial_view){
        .light = (uint32_t)light, .taps = (uint32_t)taps, .max_error_m = metres};
    s->base.max_error_rad = pixels; /* times a pixel's angle once the camera is known */
    return -1;
}

static void set_pixels(struct umb_partial_view *view, size_t height)
{
    view->max_error_rad *= view->fov_y / (double)height;
}

/* Boxes and cameras. Returns -1 to go on, else the exit code. */
static int read_views(struct stream *s)
{
    const char *const *v = s->parsed.values;
    const double aspect = (double)s->size[0] / (double)s->size[1];
    struct umb_error error;
    if (v[OPTION_BOX] && !umbc_parse_box(v[OPTION_BOX], &s->base)) {
        return umbc_usage_error("stream: --box '%s', must be X0,Y0,Z0,X1,Y1,Z1", v[OPTION_BOX]);
    }
    if (v[OPTION_MAX_PIXELS] && !v[OPTION_CAMERA] && !v[OPTION_PATH]) {
        return umbc_usage_error("stream: --max-pixels needs --camera or --path");
    }
    if (v[OPTION_PATH]) {
        if (umbc_read_path(v[OPTION_PATH], aspect, s->up, &s->base, &s->views, &error) != UMB_OK) {
            return umbc_complain(&error);
        }
        for (size_t i = 0; i < s->views.count; i++) {
            set_pixels(&s->views.list[i], s->size[1]);
        }
        return -1;
    }
    if (v[OPTION_CAMERA]) {
        if (!umbc_parse_camera(v[OPTION_CAMERA], aspect, s->up, &s->base)) {
            return umbc_usage_error(
                "stream: --camera '%s', must be eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]",
                v[OPTION_CAMERA]);
        }
        set_pixels(&s->base, s->size[1]);
    }
    s->views.list = malloc(sizeof *s->views.list);
    if (!s->views.list) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "out of memory");
    }
    s->views.list[0] = s->base;
    s->views.count = 1;
    return -1;
}

static int read_points(struct stream *s)
{
    const char *const *v = s->parsed.values;
    enum umbc_points_format format = UMBC_POINTS_F32;
    struct umb_error error;
    if (!v[OPTION_POINTS]) {
        return v[OPTION_ONLY_POINTS] || v[OPTION_FRAMES]
                   ? umbc_usage_error("stream: --only-points and --frames need --points")
                   : -1;
    }
    if (v[OPTION_FRAMES] && !s->views.list[0].has_camera) {
        return umbc_usage_error("stream: --frames needs --camera or --path");
    }
    if (v[OPTION_FORMAT]) {
        if (strcmp(v[OPTION_FORMAT], "text") == 0) {
            format = UMBC_POINTS_TEXT;
        } else if (strcmp(v[OPTION_FORMAT], "f64") == 0) {
            format = UMBC_POINTS_F64;
        } else if (strcmp(v[OPTION_FORMAT], "f32") != 0) {
            return umbc_usage_error("stream: --format '%s', must be text, f32 or f64",
                                    v[OPTION_FORMAT]);
        }
    }
    return umbc_stream_points_load(v[OPTION_POINTS], format, v[OPTION_NORMALS] != NULL, &s->points,
                                   &error) == UMB_OK
               ? -1
               : umbc_complain_file(v[OPTION_POINTS], &error);
}

/* Returns -1 to go on, else the exit code. */
static int open_source(struct stream *s)
{
    const char *file = s->parsed.values[OPTION_FROM_FILE], *url = s->parsed.values[OPTION_FROM_URL];
    struct umb_error error;
    if (s->parsed.word_count + (file != NULL) + (url != NULL) != 1) {
        return umbc_usage_error("stream: give one of FILE, --from-file and --from-url");
    }
    file = s->parsed.word_count ? s->parsed.words[0] : file;
    s->is_http = url != NULL;
    const enum umb_status status = url ? umbc_http_open(url, &s->source, &error)
                                       : umb_region_file_open(file, &s->source, &error);
    return status == UMB_OK ? -1 : umbc_complain(&error);
}

static void print_step(const struct stream *s, const struct step *step)
{
    char bytes[32];
    umbc_format_bytes(step->stats.received_bytes, bytes);
    (void)fprintf(stderr, "%7.2f s  %10s  %6" PRIu32 " of %" PRIu32 " pages  %3" PRIu64 " rounds",
                  step->seconds, bytes, step->stats.partial.pages_held,
                  step->stats.partial.page_count, step->stats.rounds);
    if (s->points.count > 0) {
        (void)fprintf(stderr, "  exact %6.2f %%  bound %.3g m",
                      100.0 * (double)step->figures.exact / (double)s->points.count,
                      step->figures.worst_m);
    }
    (void)fputc('\n', stderr);
}

static enum umb_status draw_step(struct stream *s, struct umb_error *error)
{
    char path[1024];
    struct umb_light_info light;
    const struct umb_asset *asset = umb_partial_lower(umb_region_partial(s->region));
    if (umb_asset_get_light(asset, s->settings.light, &light) != UMB_OK) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, not in the asset", s->settings.light);
    }
    (void)snprintf(path, sizeof path, "%s/%04zu.ppm", s->parsed.values[OPTION_FRAMES],
                   s->step_count);
    return umbc_stream_points_draw(&s->points, &s->views.list[s->view], light.direction, s->size,
                                   path, error);
}

/* After new pages have been laid out: figures, a line, a picture. */
static enum umb_status on_progress(void *user, struct umb_region *region)
{
    struct stream *s = user;
    const double now = umbc_clock_s();
    struct step step = {.seconds = now - s->started_s - s->aside_s, .view = s->view};
    enum umb_status status = UMB_OK;
    umb_region_get_stats(region, &step.stats);
    if (s->points.count > 0) {
        status = umbc_stream_points_ask(&s->points, region, &s->settings, false, &step.figures,
                                        &s->error);
    }
    if (status == UMB_OK && s->step_count == s->step_capacity) {
        s->step_capacity = s->step_capacity ? 2 * s->step_capacity : 64;
        struct step *steps = realloc(s->steps, s->step_capacity * sizeof *steps);
        if (!steps) {
            return umb_fail(&s->error, UMB_E_NO_MEMORY, "out of memory");
        }
        s->steps = steps;
    }
    if (status == UMB_OK) {
        s->steps[s->step_count++] = step;
        if (!s->parsed.values[OPTION_QUIET] && !s->parsed.values[OPTION_JSON]) {
            print_step(s, &step);
        }
    }
    if (status == UMB_OK && s->parsed.values[OPTION_FRAMES]) {
        status = draw_step(s, &s->error);
    }
    s->aside_s += umbc_clock_s() - now;
    return status;
}

static enum umb_status open_region(struct stream *s, struct umb_error *error)
{
    const char *resume = s->parsed.values[OPTION_RESUME];
    if (!resume) {
        return umb_region_open(&s->source, &s->options, &s->region, error);
    }
    FILE *file = fopen(resume, "rb");
    struct stat stat;
    if (!file || fstat(fileno(file), &stat) != 0) {
        const int reason = errno;
        if (file) {
            (void)fclose(file);
        }
        return umb_fail_errno(error, UMB_E_NO_INPUT, reason, "cannot open '%.200s'", resume);
    }
    const size_t size = stat.st_size > 0 ? (size_t)stat.st_size : 0;
    void *bytes = malloc(size + 1);
    const size_t got = bytes ? fread(bytes, 1, size, file) : 0;
    (void)fclose(file);
    enum umb_status status =
        bytes ? umb_region_resume(bytes, got, &s->source, &s->options, &s->region, error)
              : umb_fail(error, UMB_E_NO_MEMORY, "'%.200s': out of memory", resume);
    free(bytes);
    return status;
}

/* What the points miss, until they miss nothing. */
static enum umb_status fetch_points(struct stream *s, struct umb_region_request *request,
                                    struct umb_error *error)
{
    struct umbc_stream_figures figures;
    uint64_t before = 0;
    for (;;) { /* ends: each time round pages came, or it stops */
        struct umb_region_stats stats;
        enum umb_status status = umb_partial_want(umb_region_partial(s->region), NULL, 0, error);
        if (status == UMB_OK) {
            status =
                umbc_stream_points_ask(&s->points, s->region, &s->settings, true, &figures, error);
        }
        umb_region_get_stats(s->region, &stats);
        if (status != UMB_OK || figures.exact == s->points.count ||
            (before > 0 && stats.received_bytes == before)) {
            return status;
        }
        before = stats.received_bytes;
        request->view_count = 0;
        status = umb_region_update(s->region, request, error);
        if (status != UMB_OK) {
            return status;
        }
    }
}

static enum umb_status fetch(struct stream *s, struct umb_error *error)
{
    struct umb_region_request request = {
        .view_count = 1, .max_bytes = s->limit, .progress = on_progress, .progress_user = s};
    enum umb_status status = on_progress(s, s->region); /* what the first read brought */
    if (status == UMB_OK && s->parsed.values[OPTION_ONLY_POINTS]) {
        status = fetch_points(s, &request, error);
    } else {
        for (s->view = 0; s->view < s->views.count && status == UMB_OK; s->view++) {
            request.views = &s->views.list[s->view];
            status = umb_region_update(s->region, &request, error);
        }
    }
    if (status != UMB_OK && s->error.message[0] != '\0') {
        *error = s->error;
    }
    return status;
}

static void print_step_json(struct umbc_json *json, const struct step *step, size_t points)
{
    umbc_json_begin(json, NULL, '{');
    umbc_json_number(json, "seconds", step->seconds);
    umbc_json_integer(json, "view", step->view);
    umbc_json_integer(json, "bytes", step->stats.received_bytes);
    umbc_json_integer(json, "pages", step->stats.pages_received);
    umbc_json_integer(json, "requests", step->stats.requests);
    umbc_json_integer(json, "rounds", step->stats.rounds);
    umbc_json_integer(json, "memory_bytes", step->stats.partial.memory_bytes);
    if (points > 0) {
        umbc_json_integer(json, "exact", step->figures.exact);
        umbc_json_integer(json, "within_1m", step->figures.within_1m);
        umbc_json_integer(json, "within_10cm", step->figures.within_10cm);
        umbc_json_number(json, "worst_m", step->figures.worst_m);
    }
    umbc_json_end(json, '}');
}

static void print_json(const struct stream *s)
{
    struct umbc_json json = {.file = stdout};
    struct umb_asset_info info;
    struct umb_region_stats stats;
    char id[UMB_ID_TEXT_SIZE];
    umb_region_get_stats(s->region, &stats);
    umb_asset_get_info(umb_partial_lower(umb_region_partial(s->region)), &info);
    umb_id_to_text(info.id, id);
    umbc_json_begin(&json, NULL, '{');
    umbc_json_text(&json, "asset", id);
    umbc_json_integer(&json, "asset_bytes", stats.partial.asset_bytes);
    umbc_json_integer(&json, "head_bytes", stats.partial.head_bytes);
    umbc_json_integer(&json, "page_count", stats.partial.page_count);
    umbc_json_integer(&json, "pages_held", stats.partial.pages_held);
    umbc_json_integer(&json, "pages_dropped", stats.partial.pages_dropped);
    umbc_json_integer(&json, "memory_peak_bytes", stats.partial.memory_peak_bytes);
    umbc_json_integer(&json, "points", s->points.count);
    umbc_json_begin(&json, "steps", '[');
    for (size_t i = 0; i < s->step_count; i++) {
        print_step_json(&json, &s->steps[i], s->points.count);
    }
    umbc_json_end(&json, ']');
    umbc_json_end(&json, '}');
    (void)fputc('\n', stdout);
}

static enum umb_status save(struct stream *s, struct umb_error *error)
{
    struct umbc_output output;
    enum umb_status status = umbc_output_begin(s->parsed.values[OPTION_OUTPUT], &output, error);
    if (status != UMB_OK) {
        return status;
    }
    const struct umb_sink sink = umbc_output_sink(&output);
    status = umb_partial_save(umb_region_partial(s->region), &sink, error);
    if (status == UMB_OK) {
        return umbc_output_commit(&output, error);
    }
    umbc_output_abandon(&output);
    return status;
}

static int run(struct stream *s)
{
    struct umb_error error = {0};
    s->started_s = umbc_clock_s();
    enum umb_status status = open_region(s, &error);
    if (status == UMB_OK) {
        status = fetch(s, &error);
    }
    if (status == UMB_OK && s->parsed.values[OPTION_OUTPUT]) {
        status = save(s, &error);
    }
    if (status != UMB_OK) {
        return umbc_complain(&error);
    }
    if (s->parsed.values[OPTION_JSON]) {
        print_json(s);
    }
    return umbc_finish_stdout(0);
}

int umbc_stream(int argc, char **argv)
{
    struct stream s;
    memset(&s, 0, sizeof s);
    int code = umbc_parse(&STREAM, argc, argv, &s.parsed);
    code = code >= 0 ? code : read_numbers(&s);
    code = code >= 0 ? code : read_views(&s);
    code = code >= 0 ? code : read_points(&s);
    code = code >= 0 ? code : open_source(&s);
    code = code >= 0 ? code : run(&s);
    umb_region_close(s.region);
    if (s.is_http) {
        umbc_http_close(&s.source);
    } else {
        umb_region_file_close(&s.source);
    }
    umbc_stream_points_finish(&s.points);
    umbc_views_finish(&s.views);
    free(s.steps);
    return code;
}
