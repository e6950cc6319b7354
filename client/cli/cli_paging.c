/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage stream: fetches the part of an asset that a box, a camera, a path or some points need,
 * from a file, a web server or a daemon, and shows how it sharpens. With --follow it then moves to
 * each new version and reads the pages that changed.
 */
#include "cli/shared/cli_common.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "tool/base.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/clock.h"
#include "cli/shared/cli_points.h"
#include "cli_origin.h"
#include "cli_paging_view.h"
#include "tool/tool_try.h"
#include "umbrage/region.h"

#define POINTS_MAX (16U << 20)

/* Points that are asked after each step. */
struct points {
    struct umbc_batch list;
    float *values, *error_m; /* [count] answers of the last step, and their errors in metres */
};

/* Accuracy of a region's answers. */
struct figures {
    /* Numbers of points whose answers are exact, right within 1 m, and right within 10 cm */
    uint64_t exact, within_1m, within_10cm;
    double worst_m; /* largest error of a point in metres; 0: all exact */
};

struct options {
    const char *target; /* Argument, or NULL */
    struct umbc_origin origin;
    const char *camera, *path, *points_file; /* Values of the options, or NULL */
    const char *resume, *output, *frames;
    enum umbc_points_format format; /* Format of points_file */
    bool with_normals;
    bool only_points, json, quiet;
    bool follow;
    uint32_t versions; /* Number of new versions after which --follow ends; 0: never */
    struct umb_region_options region;
    uint8_t id[UMB_ID_BYTES];
    struct umb_partial_view base; /* Settings that all views share */
    struct umbc_views views;      /* One or more */
    struct umb_query_settings settings;
    uint32_t size[2];      /* Width and height of pictures in pixels */
    unsigned up;           /* 0 y, 1 z */
    uint64_t limit, round; /* Bytes to receive in all, and at once; 0 = no limit */
    struct points points;
};

#define AT(field) UMBU_AT(struct options, field)
#define BYTES     UMBU_BYTES(1, (uint64_t)1 << 62)

static enum umb_status read_box(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error)
{
    return umbc_parse_box(text, field) ? UMB_OK : umbu_refuse(option, text, error);
}

static const struct umbu_option OPTIONS[] = {
    {"FILE|ASSET", NULL, "packed asset file (.umb), or asset of the daemon", UMBU_TEXT, AT(target)},
    {"from-file", "FILE", "packed asset file (.umb)", UMBU_TEXT, AT(origin.file),
     .excludes = "from-url"},
    {"from-url", "URL",
     "packed asset file on umbraged (--http) or a web server that serves byte ranges; a token is "
     "sent only with --token-file",
     UMBU_TEXT, AT(origin.url)},
    {"box", "X0,Y0,Z0,X1,Y1,Z1",
     "two corners, in metres, of the box that the queried points lie in",
     UMBU_READ(read_box, "X0,Y0,Z0,X1,Y1,Z1"), AT(base)},
    {"camera", "WHERE",
     "camera that sees the queried points: eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]", UMBU_TEXT,
     AT(camera)},
    {"path", "FILE", "file with a camera a line, fetched one after the other", UMBU_TEXT, AT(path)},
    {"points", "FILE", "points to query after each step, for the figures", UMBU_TEXT,
     AT(points_file)},
    {"format", NULL, "format of --points: text, or raw little-endian numbers",
     UMBU_CHOICE("text|f32|f64"), AT(format), .standard = "f32"},
    {"normals", NULL, "raw points have normals: six numbers a point", UMBU_FLAG, AT(with_normals)},
    {"only-points", NULL, "fetches only what the points need", UMBU_FLAG, AT(only_points),
     .needs = "points"},
    {"size", "WxH", "width and height of the camera's picture in pixels", UMBU_SIDES(16384),
     AT(size), .standard = "1280x720"},
    {"up", NULL, "the scene's up axis", UMBU_CHOICE("y|z"), AT(up), .standard = "y"},
    {.setting = "light", AT(base.light), .max = UMB_LIGHTS_MAX - 1, .standard = "0"},
    {.setting = "taps",
     AT(base.taps),
     .standard = "9",
     .help = "width in texels of the widest filter of the queries"},
    {"max-error", "M", "size in metres of cells that are fine enough; 0 = voxels",
     UMBU_NUMBER(0, HUGE_VAL), AT(base.max_error_m)},
    {"max-pixels", "N", "size in pixels of cells that are fine enough", UMBU_NUMBER(0, HUGE_VAL),
     AT(base.max_error_rad), .needs = "camera|path"},
    {"limit", "BYTES", "bytes to receive before the command stops, as 64K or 2M", BYTES, AT(limit)},
    {"timeout", "SECONDS", "seconds after which the command stops and keeps what came",
     UMBU_COUNT(1, UINT32_MAX / 1000), AT(origin.timeout_s), .otherwise = "no limit"},
    {"round", "BYTES", "bytes to request at once", BYTES, AT(round), .otherwise = "chosen"},
    {"memory", "BYTES", "memory that the client may use in bytes", BYTES,
     AT(region.max_memory_bytes), .otherwise = "1G"},
    {"id", "ID", "id that the asset must have, 64 hexadecimal digits", UMBC_ID, AT(id)},
    {"resume", "PART", "file of an earlier -o to continue from", UMBU_TEXT, AT(resume)},
    {"output", "PART", "partial file with all that was fetched; - is stdout", UMBU_TEXT, AT(output),
     .letter = 'o'},
    {"frames", "DIR", "folder for a PPM picture of the points after each step", UMBU_TEXT,
     AT(frames), .needs = "points camera|path"},
    {"follow", NULL,
     "stays, moves to each new version of the asset, reads the pages that changed, and prints a "
     "line a version",
     UMBU_FLAG, AT(follow), .excludes = "frames"},
    {"versions", "N", "new versions after which --follow ends", UMBU_COUNT(1, UINT32_MAX),
     AT(versions), .otherwise = "no end", .needs = "follow"},
    {"interval", "SECONDS",
     "seconds between two looks at a file or URL for a new version; a daemon tells by itself",
     UMBU_NUMBER(0.1, 86400), AT(origin.interval_s), .standard = "2"},
    {"json", NULL,
     "print one JSON object, with every step; with --follow another in a line for each version",
     UMBU_FLAG, AT(json), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct options, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage stream",
    .usage = "umbrage stream (FILE | ASSET | --from-file FILE | --from-url URL) [options]",
    .summary = "Fetches the part of an asset that is needed, coarse first, and shows how it\n"
               "sharpens. Without --box, --camera, --path or --points it fetches everything.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct options, origin.session)},
};

static void set_pixels(struct umb_partial_view *view, size_t height)
{
    view->max_error_rad *= view->camera.fov_y / (double)height;
}

/* Reads boxes and cameras. Returns -1 to go on, else the exit code. */
static int read_views(struct options *o)
{
    const double aspect = (double)o->size[0] / (double)o->size[1];
    struct umb_error error;
    if (o->path) {
        if (umbc_read_path(o->path, aspect, "yz"[o->up], &o -> base, &o -> views, &error) !=
            UMB_OK) {
            return umbc_complain(&error);
        }
        for (size_t i = 0; i < o->views.count; i++) {
            set_pixels(&o->views.list[i], o->size[1]);
        }
        return -1;
    }
    if (o->camera) {
        if (!umbc_parse_camera(o->camera, aspect, "yz"[o->up], &o -> base)) {
            return umbc_usage_error("stream",
                                    "--camera: '%.80s' is not valid; give "
                                    "eye=X,Y,Z,target=X,Y,Z[,fov=DEG][,far=M]",
                                    o->camera);
        }
        set_pixels(&o->base, o->size[1]);
    }
    o->views.list = malloc(sizeof *o->views.list);
    if (!o->views.list) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "out of memory");
    }
    o->views.list[0] = o->base;
    o->views.count = 1;
    return -1;
}

/* --- points --- */

/* Asks the region about all points. want: see umb_region_query. */
static enum umb_status ask_points(struct points *points, struct umb_region *region,
                                  const struct umb_query_settings *settings, bool want,
                                  struct figures *figures, struct umb_error *error)
{
    const struct umb_points batch = {.positions = points->list.wide,
                                     .format = UMB_POINT_F64,
                                     .normals =
                                         points->list.has_normals ? points->list.normals : NULL,
                                     .count = points->list.count};
    struct umb_partial_answers answers = {.values = points->values, .error_m = points->error_m};
    UMB__TRY(umb_region_query(region, settings, &batch, want, &answers, error));
    *figures = (struct figures){.exact = answers.exact, .worst_m = answers.worst_error_m};
    for (size_t i = 0; i < points->list.count; i++) {
        figures->within_1m += points->error_m[i] <= 1.0F;
        figures->within_10cm += points->error_m[i] <= 0.1F;
    }
    return UMB_OK;
}

/* Brightness of a point, 0..1: a quarter from the sky, the rest from the light that reaches it. */
static double shade(const struct points *points, size_t i, const double light[3])
{
    double cosine = 0;
    for (unsigned axis = 0; axis < 3 && points->list.has_normals; axis++) {
        cosine -= (double)points->list.normals[3 * i + axis] * light[axis];
    }
    cosine = points->list.has_normals ? fmax(cosine, 0) : 1;
    return 0.25 + 0.75 * cosine * (double)points->values[i];
}

/* Writes a PPM picture of the points that the camera sees, shaded by the last answers. Points that
 * are not exact yet are orange. In: light: unit vector along which the light travels. */
static enum umb_status draw_points(const struct points *points, const struct umb_partial_view *view,
                                   const double light[3], const uint32_t size[2], const char *path,
                                   struct umb_error *error)
{
    static const double orange[3] = {1.0, 0.72, 0.35};
    const size_t bytes = (size_t)3 * size[0] * size[1];
    struct umbu_output output;
    uint8_t *picture = malloc(bytes);
    if (!picture) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frames: no memory for %zu bytes", bytes);
    }
    for (size_t i = 0; i < bytes; i++) {
        picture[i] = i % 3 == 2 ? 235 : 205;
    }
    for (size_t i = 0; i < points->list.count; i++) {
        size_t pixel[2];
        if (umbc_project(view, points->list.wide + 3 * i, size[0], size[1], pixel)) {
            uint8_t *at = picture + 3 * (pixel[0] + size[0] * pixel[1]);
            const double light_here = shade(points, i, light);
            for (unsigned c = 0; c < 3; c++) {
                at[c] = (uint8_t)(255 * light_here * (points->error_m[i] > 0 ? orange[c] : 1.0));
            }
        }
    }
    enum umb_status status = umbu_output_begin(path, UMBU_OUTPUT_COMMAND, &output, error);
    if (status == UMB_OK) {
        (void)fprintf(output.file, "P6\n%u %u\n255\n", size[0], size[1]);
        (void)fwrite(picture, 1, bytes, output.file);
        status = umbu_output_commit(&output, error); /* fails if a write failed */
    }
    free(picture);
    return status;
}

static int read_points(struct options *o)
{
    struct points *points = &o->points;
    struct umb_error error;
    if (o->points_file == NULL) {
        return -1;
    }
    enum umb_status status = umbc_points_load(o->points_file, o->format, o->with_normals,
                                              POINTS_MAX + 1, &points->list, &error);
    if (status == UMB_OK) {
        points->values = calloc(points->list.count + 1, sizeof *points->values);
        points->error_m = calloc(points->list.count + 1, sizeof *points->error_m);
        status = points->list.count > POINTS_MAX
                     ? umb_fail(&error, UMB_E_TOO_LARGE, "points: more than %u", POINTS_MAX)
                 : points->values == NULL || points->error_m == NULL
                     ? umb_fail(&error, UMB_E_NO_MEMORY, "points: out of memory")
                     : UMB_OK;
    }
    return status == UMB_OK ? -1 : umbc_complain_file(o->points_file, &error);
}

/* Returns -1 if the command is to go on. Otherwise prints a message and returns the exit code. */
static int options_parse(struct options *o, int argc, char **argv)
{
    struct umbu_parsed parsed;
    memset(o, 0, sizeof *o);
    int code = umbu_start(&parsed, &COMMAND, argc, argv, o);
    if (code >= 0) {
        return code;
    }
    struct umbc_origin *origin = &o->origin;
    if ((o->target != NULL) + (origin->file != NULL) + (origin->url != NULL) != 1) {
        return umbc_usage_error("stream", "give one of FILE, ASSET, --from-file and --from-url");
    }
    if (o->target != NULL) {
        *(umbc_is_file(o->target) ? &origin->file : &origin->asset) = o->target;
    }
    o->region.id = umbu_given(&parsed, "id") ? o->id : NULL;
    o->settings = (struct umb_query_settings){.light = o->base.light, .taps = o->base.taps};
    code = read_views(o);
    return code >= 0 ? code : read_points(o);
}

/* Figures of one step. */
struct step {
    double seconds; /* time since the start, without figures and pictures */
    size_t view;    /* number of the camera on the path */
    struct umb_region_stats stats;
    struct figures figures;
};

struct stream {
    struct options o;
    struct umb_region_source source;
    struct umb_region *region;
    struct step *steps; /* [step_count] */
    size_t step_count, step_capacity;
    size_t view;               /* number of the camera that is being fetched */
    uint32_t version;          /* number of new versions that came */
    double started_s, aside_s; /* time of the start; time spent on figures and pictures */
    struct umb_error error;    /* error of the progress callback */
};

static void print_step(const struct stream *s, const struct step *step)
{
    char bytes[32];
    umbc_format_bytes(step->stats.received_bytes, bytes);
    (void)fprintf(stderr, "%7.2f s  %10s  %6" PRIu32 " of %" PRIu32 " pages  %3" PRIu64 " rounds",
                  step->seconds, bytes, step->stats.partial.pages_held,
                  step->stats.partial.page_count, step->stats.rounds);
    if (s->o.points.list.count > 0) {
        (void)fprintf(stderr, "  exact %6.2f %%  bound %.3g m",
                      100.0 * (double)step->figures.exact / (double)s->o.points.list.count,
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
    return draw_points(&s->o.points, &s->o.views.list[s->view], light.direction, s->o.size, path,
                       error);
}

/* Adds a step: figures, a line and a picture. */
static enum umb_status add_step(struct stream *s, struct umb_region *region, double now)
{
    struct step step = {.seconds = now - s->started_s - s->aside_s, .view = s->view};
    umb_region_get_stats(region, &step.stats);
    if (s->o.points.list.count > 0) {
        UMB__TRY(ask_points(&s->o.points, region, &s->o.settings, false, &step.figures, &s->error));
    }
    if (!umb__grow(NULL, &s->steps, &s->step_capacity, s->step_count + 1, sizeof *s->steps)) {
        return umb_fail(&s->error, UMB_E_NO_MEMORY, "out of memory");
    }
    s->steps[s->step_count++] = step;
    if (!s->o.quiet && !s->o.json) {
        print_step(s, &step);
    }
    if (s->o.frames) {
        UMB__TRY(draw_step(s, &s->error));
    }
    return UMB_OK;
}

/* Called after new pages were laid out. The time that this callback takes does not count as time
 * for fetching. */
static enum umb_status on_progress(void *user, struct umb_region *region)
{
    struct stream *s = user;
    const double now = umbu_clock_s();
    const uint32_t limit_s = s->o.origin.timeout_s;
    if (s->version == 0) { /* a new version has one line, and no steps */
        const enum umb_status status = add_step(s, region, now);
        s->aside_s += umbu_clock_s() - now;
        UMB__TRY(status);
    }
    return limit_s > 0 && now - s->started_s > limit_s
               ? umb_fail(&s->error, UMB_E_DEADLINE, "--timeout: %u seconds are over", limit_s)
               : UMB_OK;
}

static enum umb_status open_region(struct stream *s, struct umb_error *error)
{
    const char *resume = s->o.resume;
    if (!resume) {
        return umb_region_open(&s->source, &s->o.region, &s->region, error);
    }
    struct umb_file file;
    UMB__TRY(umb_file_open(resume, &file, error));
    const enum umb_status status =
        umb_region_resume(file.bytes, file.size, &s->source, &s->o.region, &s->region, error);
    umb_file_close(&file);
    return status;
}

/* Makes one update with the bytes that --limit still allows; makes none if no byte is left. */
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

/* Fetches the pages that the points need, until no point lacks a page. */
static enum umb_status fetch_points(struct stream *s, struct umb_region_request *request,
                                    struct umb_error *error)
{
    struct figures figures;
    uint64_t before = 0;
    for (;;) { /* The loop ends: pages came in each round, or it was the last */
        struct umb_region_stats stats;
        UMB__TRY(umb_partial_want(umb_region_partial(s->region), NULL, 0, error));
        UMB__TRY(ask_points(&s->o.points, s->region, &s->o.settings, true, &figures, error));
        umb_region_get_stats(s->region, &stats);
        if (figures.exact == s->o.points.list.count ||
            (before > 0 && stats.received_bytes == before)) {
            return UMB_OK;
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
    enum umb_status status = on_progress(s, s->region); /* figures of the first read */
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
    UMBU_JSON_COUNTS(json, {"view", step->view}, {"bytes", step->stats.received_bytes},
                     {"pages", step->stats.pages_received}, {"requests", step->stats.requests},
                     {"rounds", step->stats.rounds},
                     {"memory_bytes", step->stats.partial.memory_bytes});
    if (points > 0) {
        UMBU_JSON_COUNTS(json, {"exact", step->figures.exact},
                         {"within_1m", step->figures.within_1m},
                         {"within_10cm", step->figures.within_10cm});
        umbu_json_number(json, "worst_m", step->figures.worst_m);
    }
    umbu_json_end(json, '}');
}

static void print_json(const struct stream *s)
{
    struct umb_asset_info info;
    struct umb_region_stats stats;
    umb_region_get_stats(s->region, &stats);
    umb_asset_get_info(umb_partial_lower(umb_region_partial(s->region)), &info);
    struct umbu_json json = umbu_json_open(stdout);
    umbc_json_id(&json, "asset", info.id);
    UMBU_JSON_COUNTS(
        &json, {"asset_bytes", stats.partial.asset_bytes}, {"head_bytes", stats.partial.head_bytes},
        {"page_count", stats.partial.page_count}, {"pages_held", stats.partial.pages_held},
        {"pages_dropped", stats.partial.pages_dropped},
        {"memory_peak_bytes", stats.partial.memory_peak_bytes}, {"points", s->o.points.list.count});
    umbu_json_begin(&json, "steps", '[');
    for (size_t i = 0; i < s->step_count; i++) {
        print_step_json(&json, &s->steps[i], s->o.points.list.count);
    }
    umbu_json_close(&json);
}

static enum umb_status save(void *user, const struct umb_sink *sink, struct umb_error *error)
{
    const struct stream *s = user;
    return umb_partial_save(umb_region_partial(s->region), sink, error);
}

/* --- new versions --- */

/* Prints what the version cost. In: before: figures of the region before it came. */
static void print_version(const struct stream *s, const struct umb_region_stats *before,
                          double seconds)
{
    struct umb_region_stats now;
    struct umb_asset_info info;
    char id[UMB_ID_TEXT_SIZE], bytes[32];
    umb_region_get_stats(s->region, &now);
    umb_asset_get_info(umb_partial_lower(umb_region_partial(s->region)), &info);
    umb_id_to_text(info.id, id);
    const uint64_t received = now.received_bytes - before->received_bytes;
    const uint64_t fetched = now.pages_received - before->pages_received;
    if (s->o.json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", info.id);
        UMBU_JSON_COUNTS(&json, {"version", s->version}, {"asset_bytes", now.partial.asset_bytes},
                         {"page_count", now.partial.page_count},
                         {"pages_held", now.partial.pages_held},
                         {"pages_kept", now.partial.pages_inherited}, {"pages_fetched", fetched},
                         {"bytes", received}, {"requests", now.requests - before->requests},
                         {"rounds", now.rounds - before->rounds});
        umbu_json_number(&json, "seconds", seconds);
        umbu_json_close(&json);
        (void)fflush(stdout);
    } else if (!s->o.quiet) {
        umbc_format_bytes(received, bytes);
        (void)fprintf(stderr,
                      "version %" PRIu32 "  %.16s  %6" PRIu64 " pages kept  %6" PRIu64
                      " fetched  %10s  %.2f s\n",
                      s->version, id, now.partial.pages_inherited, fetched, bytes, seconds);
    }
}

/* Reads the id of the region's version, from its head. */
static enum umb_status read_version(const struct stream *s, struct umb_file_head *head,
                                    struct umb_error *error)
{
    struct umb_region_stats stats;
    umb_region_get_stats(s->region, &stats);
    return umb_file_read_head(umb_partial_head(umb_region_partial(s->region)),
                              (size_t)stats.partial.head_bytes, head, error);
}

/* Moves the region to the version that is there now, and fetches what changed. */
static enum umb_status move_on(struct stream *s, struct umb_error *error)
{
    struct umb_region_source source;
    UMB__TRY(umbc_origin_open(&s->o.origin, &source, error));
    const enum umb_status status = umb_region_retarget(s->region, &source, NULL, error);
    if (status != UMB_OK) {
        umbc_origin_close(&s->o.origin, &source);
        return status;
    }
    umbc_origin_close(&s->o.origin, &s->source);
    s->source = source;
    return fetch(s, error);
}

/* Returns true if the origin has another version than the region: what failed was reading one that
 * has been replaced. */
static bool is_replaced(struct stream *s)
{
    struct umb_file_head head;
    struct umb_region_source source;
    uint8_t id[UMB_ID_BYTES];
    if (read_version(s, &head, NULL) != UMB_OK ||
        umbc_origin_open(&s->o.origin, &source, NULL) != UMB_OK) {
        return false;
    }
    const bool read = umb_region_source_id(&source, id, NULL) == UMB_OK;
    umbc_origin_close(&s->o.origin, &source);
    return read && memcmp(id, head.id, UMB_ID_BYTES) != 0;
}

/* Follows the asset from version to version. */
static enum umb_status follow(struct stream *s, struct umb_error *error)
{
    struct umb_region_stats before;
    umb_region_get_stats(s->region, &before);
    if (s->o.json) {
        print_json(s);
        (void)fflush(stdout);
    }
    while (s->o.versions == 0 || s->version < s->o.versions) {
        struct umb_file_head head;
        UMB__TRY(read_version(s, &head, error));
        UMB__TRY(umbc_origin_wait(&s->o.origin, head.id, error));
        const double began_s = umbu_clock_s();
        s->version++;
        const enum umb_status status = move_on(s, error);
        if (status == UMB_OK) {
            print_version(s, &before, umbu_clock_s() - began_s);
            umb_region_get_stats(s->region, &before);
        } else if (status == UMB_E_DEADLINE || !is_replaced(s)) {
            return status;
        } else {
            s->version--;
        }
    }
    return UMB_OK;
}

/* Opens the source and the region, and fetches. */
static enum umb_status fetch_all(struct stream *s, struct umb_error *error)
{
    UMB__TRY(umbc_origin_open(&s->o.origin, &s->source, error));
    if (s->o.frames && mkdir(s->o.frames, 0777) != 0 && errno != EEXIST) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                              s->o.frames);
    }
    s->started_s = umbu_clock_s();
    UMB__TRY(open_region(s, error));
    UMB__TRY(fetch(s, error));
    return s->o.follow ? follow(s, error) : UMB_OK;
}

static int run(struct stream *s)
{
    struct umb_error error = {0};
    const enum umb_status status = fetch_all(s, &error);
    if (s->region && s->o.output) { /* after a failure too: --resume continues from it */
        struct umb_error unsaved = {0};
        const enum umb_status saved =
            umbu_output_write_by(s->o.output, UMBU_OUTPUT_COMMAND, save, s, &unsaved);
        if (saved != UMB_OK && status == UMB_OK) {
            return umbc_complain(&unsaved);
        }
    }
    if (status != UMB_OK) {
        return umbc_complain(&error);
    }
    if (s->o.json && !s->o.follow) {
        print_json(s);
    }
    return umbc_finish_stdout(0);
}

int umbc_paging(int argc, char **argv)
{
    struct stream s;
    memset(&s, 0, sizeof s);
    int code = options_parse(&s.o, argc, argv);
    code = code >= 0 ? code : run(&s);
    umb_region_close(s.region);
    umbc_origin_close(&s.o.origin, &s.source);
    umbc_origin_finish(&s.o.origin);
    umbc_batch_finish(&s.o.points.list);
    free(s.o.points.values);
    free(s.o.points.error_m);
    umbc_views_finish(&s.o.views);
    free(s.steps);
    return code;
}
