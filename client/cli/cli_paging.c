/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage stream: fetches the part of an asset that a box, a camera, a path or some points need,
 * from a file, a web server or a daemon, and shows how it sharpens.
 */
#include "cli_common.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli_http.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/clock.h"
#include "cli_paging_options.h"
#include "tool/tool_try.h"

#define CALL_TIMEOUT_S 60 /* of the client library, for a part of a round */

/* One line of the figures. */
struct step {
    double seconds; /* without the time for figures and pictures */
    size_t view;    /* number on the path */
    struct umb_region_stats stats;
    struct umbc_paging_figures figures;
};

struct stream {
    struct umbc_paging_options o;
    struct umb_client *client; /* of a daemon's asset */
    struct umb_region_source source;
    struct umb_region *region;
    struct step *steps; /* [step_count] */
    size_t step_count, step_capacity;
    size_t view;               /* being fetched */
    double started_s, aside_s; /* clock; spent on figures and pictures */
    struct umb_error error;    /* of a progress callback */
};

/* Returns -1 to go on, else the exit code. */
static int open_source(struct stream *s)
{
    struct umb_error error;
    enum umb_status status;
    if (s->o.url) {
        status = umbc_http_open(s->o.url, &s->source, &error);
        if (status == UMB_OK && s->o.timeout_s > 0) {
            umbc_http_stop_at(&s->source, umbu_clock_s() + s->o.timeout_s);
        }
    } else if (s->o.file) {
        status = umb_region_file_open(s->o.file, &s->source, &error);
    } else {
        struct umbu_session session = s->o.session;
        if (s->o.timeout_s > 0 && s->o.timeout_s < CALL_TIMEOUT_S) {
            session.options.call_timeout_ms = s->o.timeout_s * 1000;
        }
        status = umbu_connect(&session, &s->client, &error);
        if (status == UMB_OK) {
            status = umb_region_daemon_open(s->client, s->o.asset, &s->source, &error);
        }
    }
    return status == UMB_OK ? -1 : umbc_complain(&error);
}

static void print_step(const struct stream *s, const struct step *step)
{
    char bytes[32];
    umbc_format_bytes(step->stats.received_bytes, bytes);
    (void)fprintf(stderr, "%7.2f s  %10s  %6" PRIu32 " of %" PRIu32 " pages  %3" PRIu64 " rounds",
                  step->seconds, bytes, step->stats.partial.pages_held,
                  step->stats.partial.page_count, step->stats.rounds);
    if (s->o.points.count > 0) {
        (void)fprintf(stderr, "  exact %6.2f %%  bound %.3g m",
                      100.0 * (double)step->figures.exact / (double)s->o.points.count,
                      step->figures.worst_m);
    }
    (void)fputc('\n', stderr);
}

static enum umb_status draw_step(struct stream *s, struct umb_error *error)
{
    char path[1024];
    struct umb_light_info light;
    const struct umb_asset *asset = umb_partial_lower(umb_region_partial(s->region));
    if (umb_asset_get_light(asset, s->o.settings.light, &light) != UMB_OK) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, not in the asset", s->o.settings.light);
    }
    (void)snprintf(path, sizeof path, "%s/%04zu.ppm", s->o.frames, s->step_count);
    return umbc_paging_points_draw(&s->o.points, &s->o.views.list[s->view], light.direction,
                                   s->o.size, path, error);
}

/* After new pages have been laid out: figures, a line, a picture. */
static enum umb_status on_progress(void *user, struct umb_region *region)
{
    struct stream *s = user;
    const double now = umbu_clock_s();
    struct step step = {.seconds = now - s->started_s - s->aside_s, .view = s->view};
    enum umb_status status = UMB_OK;
    umb_region_get_stats(region, &step.stats);
    if (s->o.points.count > 0) {
        status = umbc_paging_points_ask(&s->o.points, region, &s->o.settings, false, &step.figures,
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
        if (!s->o.quiet && !s->o.json) {
            print_step(s, &step);
        }
    }
    if (status == UMB_OK && s->o.frames) {
        status = draw_step(s, &s->error);
    }
    if (status == UMB_OK && s->o.timeout_s > 0 && now - s->started_s > s->o.timeout_s) {
        status =
            umb_fail(&s->error, UMB_E_DEADLINE, "--timeout: %u seconds are over", s->o.timeout_s);
    }
    s->aside_s += umbu_clock_s() - now;
    return status;
}

static enum umb_status open_region(struct stream *s, struct umb_error *error)
{
    const char *resume = s->o.resume;
    if (!resume) {
        return umb_region_open(&s->source, &s->o.region, &s->region, error);
    }
    struct umb_file file;
    enum umb_status status = umb_file_open(resume, &file, error);
    if (status == UMB_OK) {
        status =
            umb_region_resume(file.bytes, file.size, &s->source, &s->o.region, &s->region, error);
        umb_file_close(&file);
    }
    return status;
}

/* One update within what --limit leaves; nothing once that is used up. */
static enum umb_status update(struct stream *s, struct umb_region_request *request,
                              struct umb_error *error)
{
    struct umb_region_stats stats;
    umb_region_get_stats(s->region, &stats);
    if (s->o.limit > 0 && stats.received_bytes >= s->o.limit) {
        return UMB_OK;
    }
    request->max_bytes = s->o.limit > 0 ? s->o.limit - stats.received_bytes : 0;
    return umb_region_update(s->region, request, error);
}

/* What the points miss, until they miss nothing. */
static enum umb_status fetch_points(struct stream *s, struct umb_region_request *request,
                                    struct umb_error *error)
{
    struct umbc_paging_figures figures;
    uint64_t before = 0;
    for (;;) { /* ends: each time round pages came, or it stops */
        struct umb_region_stats stats;
        enum umb_status status = umb_partial_want(umb_region_partial(s->region), NULL, 0, error);
        if (status == UMB_OK) {
            status = umbc_paging_points_ask(&s->o.points, s->region, &s->o.settings, true, &figures,
                                            error);
        }
        umb_region_get_stats(s->region, &stats);
        if (status != UMB_OK || figures.exact == s->o.points.count ||
            (before > 0 && stats.received_bytes == before)) {
            return status;
        }
        before = stats.received_bytes;
        request->view_count = 0;
        UMB__TRY(update(s, request, error));
    }
}

static enum umb_status fetch(struct stream *s, struct umb_error *error)
{
    struct umb_region_request request = {
        .view_count = 1, .round_bytes = s->o.round, .progress = on_progress, .progress_user = s};
    enum umb_status status = on_progress(s, s->region); /* what the first read brought */
    if (status == UMB_OK && s->o.only_points) {
        status = fetch_points(s, &request, error);
    } else {
        for (s->view = 0; s->view < s->o.views.count && status == UMB_OK; s->view++) {
            request.views = &s->o.views.list[s->view];
            status = update(s, &request, error);
        }
    }
    if (status != UMB_OK && s->error.message[0] != '\0') {
        *error = s->error;
    }
    return status;
}

static void print_step_json(struct umbu_json *json, const struct step *step, size_t points)
{
    umbu_json_begin(json, NULL, '{');
    umbu_json_number(json, "seconds", step->seconds);
    umbu_json_integer(json, "view", step->view);
    umbu_json_integer(json, "bytes", step->stats.received_bytes);
    umbu_json_integer(json, "pages", step->stats.pages_received);
    umbu_json_integer(json, "requests", step->stats.requests);
    umbu_json_integer(json, "rounds", step->stats.rounds);
    umbu_json_integer(json, "memory_bytes", step->stats.partial.memory_bytes);
    if (points > 0) {
        umbu_json_integer(json, "exact", step->figures.exact);
        umbu_json_integer(json, "within_1m", step->figures.within_1m);
        umbu_json_integer(json, "within_10cm", step->figures.within_10cm);
        umbu_json_number(json, "worst_m", step->figures.worst_m);
    }
    umbu_json_end(json, '}');
}

static void print_json(const struct stream *s)
{
    struct umbu_json json = {.file = stdout};
    struct umb_asset_info info;
    struct umb_region_stats stats;
    char id[UMB_ID_TEXT_SIZE];
    umb_region_get_stats(s->region, &stats);
    umb_asset_get_info(umb_partial_lower(umb_region_partial(s->region)), &info);
    umb_id_to_text(info.id, id);
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "asset", id);
    umbu_json_integer(&json, "asset_bytes", stats.partial.asset_bytes);
    umbu_json_integer(&json, "head_bytes", stats.partial.head_bytes);
    umbu_json_integer(&json, "page_count", stats.partial.page_count);
    umbu_json_integer(&json, "pages_held", stats.partial.pages_held);
    umbu_json_integer(&json, "pages_dropped", stats.partial.pages_dropped);
    umbu_json_integer(&json, "memory_peak_bytes", stats.partial.memory_peak_bytes);
    umbu_json_integer(&json, "points", s->o.points.count);
    umbu_json_begin(&json, "steps", '[');
    for (size_t i = 0; i < s->step_count; i++) {
        print_step_json(&json, &s->steps[i], s->o.points.count);
    }
    umbu_json_close(&json);
}

static enum umb_status save(struct stream *s, struct umb_error *error)
{
    struct umbu_output output;
    UMB__TRY(umbu_output_begin(s->o.output, UMBU_OUTPUT_COMMAND, &output, error));
    const struct umb_sink sink = umbu_output_sink(&output);
    error->message[0] = '\0';
    enum umb_status status = umb_partial_save(umb_region_partial(s->region), &sink, error);
    if (status == UMB_OK) {
        return umbu_output_commit(&output, error);
    }
    status = umbu_output_explain(&output, status, error);
    umbu_output_abandon(&output);
    return status;
}

static int run(struct stream *s)
{
    struct umb_error error = {0};
    if (s->o.frames && mkdir(s->o.frames, 0777) != 0 && errno != EEXIST) {
        (void)umb_fail_errno(&error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                             s->o.frames);
        return umbc_complain(&error);
    }
    s->started_s = umbu_clock_s();
    enum umb_status status = open_region(s, &error);
    if (status == UMB_OK) {
        status = fetch(s, &error);
    }
    if (s->region && s->o.output) { /* after a failure too: --resume goes on from what came */
        struct umb_error unsaved = {0};
        const enum umb_status saved = save(s, &unsaved);
        if (saved != UMB_OK && status == UMB_OK) {
            return umbc_complain(&unsaved);
        }
    }
    if (status != UMB_OK) {
        return umbc_complain(&error);
    }
    if (s->o.json) {
        print_json(s);
    }
    return umbc_finish_stdout(0);
}

int umbc_paging(int argc, char **argv)
{
    struct stream s;
    memset(&s, 0, sizeof s);
    int code = umbc_paging_options_parse(&s.o, argc, argv);
    code = code >= 0 ? code : open_source(&s);
    code = code >= 0 ? code : run(&s);
    umb_region_close(s.region);
    if (s.o.url) {
        umbc_http_close(&s.source);
    } else if (s.o.file) {
        umb_region_file_close(&s.source);
    } else {
        umb_region_daemon_close(&s.source);
    }
    umb_client_close(s.client);
    umbc_paging_options_finish(&s.o);
    free(s.steps);
    return code;
}
