/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage frames: a frame loop against a daemon. Each frame is a camera and its depth picture; the
 * answers come over one stream, packed, and as changes to the frame before where the daemon has it.
 */
#include "cli_common.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "cli_json.h"
#include "cli_output.h"
#include "cli_session.h"
#include "cli_paging_options.h"
#include "cli_paging_view.h"

enum frames_option {
    OPTION_PATH,
    OPTION_DEPTH,
    OPTION_SIZE,
    OPTION_UP,
    OPTION_LIGHT,
    OPTION_TAPS,
    OPTION_FORMAT,
    OPTION_PLAIN,
    OPTION_OUTPUT,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_PATH] = {"path", "FILE", "a camera a line: eye=X,Y,Z,target=X,Y,Z[,fov=DEG]", 0},
    [OPTION_DEPTH] = {"depth", "FILE", "a float a pixel and frame, metres along the view", 0},
    [OPTION_SIZE] = {"size", "WxH", "pixels of a frame (default 1280x720)", 0},
    [OPTION_UP] = {"up", "y|z", "the scene's up axis (default y)", 0},
    [OPTION_LIGHT] = {"light", "N", "the asset's light (default 0)", 0},
    [OPTION_TAPS] = {"taps", "N", "width of the filter, odd (default 1)", 0},
    [OPTION_FORMAT] = {"format", "FORMAT", "of answers: bit, u8 or f32 (default bit)", 0},
    [OPTION_PLAIN] = {"plain", NULL, "answers unpacked and whole, for comparison", 0},
    [OPTION_OUTPUT] = {"output", "FILE",
                       "the answers of all frames, one behind the other; - is stdout", 'o'},
    [OPTION_JSON] = {"json", NULL, "print one JSON object, with every frame", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage frames ASSET --path FILE --depth FILE [options]",
    .summary = "Asks a daemon for the shadows of one frame after the other, as a game would: a\n"
               "camera and its depth picture go there, answers come back packed, and where little\n"
               "changed, only that. A pixel of depth 0, or not finite, has nothing in it.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

/* A loop under way. */
struct frames {
    const struct umbc_parsed *parsed;
    struct umbc_views views;
    size_t size[2];
    char up;
    struct umb_client *client;
    struct umb_client_query_request request;
    struct umb_picture picture;
    FILE *depth_file;
    float *depth;       /* a frame's */
    uint8_t *values[2]; /* of this frame and the one before */
    size_t value_bytes;
    struct umbc_output output;
    struct umbc_json json;
    uint64_t received, plain; /* bytes of answers, as they came and unpacked */
};

static double seconds(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static bool parse_format(const char *text, enum umb_answer_format *format)
{
    static const struct {
        const char *name;
        enum umb_answer_format format;
    } FORMATS[] = {{"bit", UMB_ANSWER_BIT}, {"u8", UMB_ANSWER_U8}, {"f32", UMB_ANSWER_F32}};
    for (size_t i = 0; i < sizeof FORMATS / sizeof FORMATS[0]; i++) {
        if (strcmp(text, FORMATS[i].name) == 0) {
            *format = FORMATS[i].format;
            return true;
        }
    }
    return false;
}

/* Returns -1 to go on, else the exit code. */
static int read_options(struct frames *f)
{
    const char *const *v = f->parsed->values;
    unsigned long long light = 0, taps = 1;
    f->size[0] = 1280;
    f->size[1] = 720;
    f->up = 'y';
    f->request.settings.format = UMB_ANSWER_BIT;
    if (!v[OPTION_PATH] || !v[OPTION_DEPTH]) {
        return umbc_usage_error("frames: --path and --depth are needed");
    }
    const int code = umbc_check_stdout("frames", v[OPTION_OUTPUT], v[OPTION_JSON] != NULL);
    if (code >= 0) {
        return code;
    }
    if (v[OPTION_SIZE] && !umbc_parse_size(v[OPTION_SIZE], f->size)) {
        return umbc_usage_error("--size: '%s' is not WIDTHxHEIGHT", v[OPTION_SIZE]);
    }
    if (v[OPTION_UP]) {
        f->up = v[OPTION_UP][0];
        if ((f->up != 'y' && f->up != 'z') || v[OPTION_UP][1] != '\0') {
            return umbc_usage_error("--up: '%s' is not y or z", v[OPTION_UP]);
        }
    }
    if (v[OPTION_LIGHT] && !umbc_parse_count(v[OPTION_LIGHT], UINT32_MAX, &light)) {
        return umbc_usage_error("--light: '%s' is not a number", v[OPTION_LIGHT]);
    }
    if (v[OPTION_TAPS] && (!umbc_parse_count(v[OPTION_TAPS], UMB_TAPS_MAX, &taps) || !(taps & 1))) {
        return umbc_usage_error("--taps: '%s' is not odd and within 1..%d", v[OPTION_TAPS],
                                UMB_TAPS_MAX);
    }
    if (v[OPTION_FORMAT] && !parse_format(v[OPTION_FORMAT], &f->request.settings.format)) {
        return umbc_usage_error("--format: '%s' is not bit, u8 or f32", v[OPTION_FORMAT]);
    }
    f->request.asset = f->parsed->words[0];
    f->request.settings.light = (uint32_t)light;
    f->request.settings.taps = (uint32_t)taps;
    f->request.pack = v[OPTION_PLAIN] == NULL;
    f->request.want_stats = 1;
    return -1;
}

static enum umb_status prepare(struct frames *f, struct umb_error *error)
{
    const char *const *v = f->parsed->values;
    const struct umb_partial_view none = {0};
    const size_t pixels = f->size[0] * f->size[1];
    enum umb_status status = umbc_read_path(v[OPTION_PATH], (double)f->size[0] / (double)f->size[1],
                                            f->up, &none, &f->views, error);
    if (status != UMB_OK) {
        return status;
    }
    status = umbc_open_input(v[OPTION_DEPTH], &f->depth_file, error);
    if (status != UMB_OK) {
        return status;
    }
    f->value_bytes = umb_answer_bytes(f->request.settings.format, pixels);
    f->depth = malloc(pixels * sizeof *f->depth);
    f->values[0] = malloc(f->value_bytes);
    f->values[1] = malloc(f->value_bytes);
    if (!f->depth || !f->values[0] || !f->values[1]) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frames: no memory for %zu pixels", pixels);
    }
    f->picture = (struct umb_picture){
        .width = (uint32_t)f->size[0], .height = (uint32_t)f->size[1], .depth = f->depth};
    f->request.picture = &f->picture;
    status = umbc_connect(f->parsed->session, &f->client, error);
    if (status == UMB_OK) {
        status = umb_client_stream_open(f->client, &f->request.stream, error);
    }
    return status == UMB_OK && v[OPTION_OUTPUT]
               ? umbc_output_begin(v[OPTION_OUTPUT], &f->output, error)
               : status;
}

/* One frame's figures. */
static void report(struct frames *f, size_t frame, const struct umb_client_query_reply *reply,
                   double took)
{
    const uint64_t bytes = reply->packed_bytes ? reply->packed_bytes : reply->value_bytes;
    f->received += bytes;
    f->plain += reply->value_bytes;
    if (f->parsed->values[OPTION_JSON]) {
        umbc_json_begin(&f->json, NULL, '{');
        umbc_json_integer(&f->json, "bytes", bytes);
        umbc_json_bool(&f->json, "changes_only", reply->changes_only != 0);
        umbc_json_number(&f->json, "ms", took * 1e3);
        umbc_json_number(&f->json, "server_ms", (double)reply->nanoseconds * 1e-6);
        umbc_json_end(&f->json, '}');
    } else if (!f->parsed->values[OPTION_QUIET]) {
        (void)fprintf(f->output.file == stdout ? stderr : stdout,
                      "frame %4zu  %8" PRIu64 " bytes%s  %7.2f ms, of the server's %7.2f\n", frame,
                      bytes, reply->changes_only ? " of changes" : "           ", took * 1e3,
                      (double)reply->nanoseconds * 1e-6);
    }
}

static enum umb_status run_frame(struct frames *f, size_t frame, struct umb_error *error)
{
    const struct umb_partial_view *view = &f->views.list[frame];
    const size_t pixels = f->size[0] * f->size[1];
    struct umb_client_query_reply reply;
    if (fread(f->depth, sizeof *f->depth, pixels, f->depth_file) != pixels) {
        return ferror(f->depth_file)
                   ? umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'",
                                    f->parsed->values[OPTION_DEPTH])
                   : umb_fail(error, UMB_E_TRUNCATED,
                              "'%.160s' ends within frame %zu; %zu frames of %zu x %zu floats are "
                              "needed, as many as --path has cameras",
                              f->parsed->values[OPTION_DEPTH], frame, f->views.count, f->size[0],
                              f->size[1]);
    }
    f->picture.camera = view->camera;
    f->request.base = f->request.pack && frame > 0 ? f->values[(frame + 1) % 2] : NULL;
    uint8_t *values = f->values[frame % 2];
    const double start = seconds();
    enum umb_status status = umb_client_query(f->client, &f->request, values, &reply, error);
    if (status != UMB_OK) {
        return status;
    }
    report(f, frame, &reply, seconds() - start);
    if (f->output.file && fwrite(values, 1, f->value_bytes, f->output.file) != f->value_bytes) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot write the answers");
    }
    return UMB_OK;
}

static enum umb_status run_frames(struct frames *f, struct umb_error *error)
{
    const bool json = f->parsed->values[OPTION_JSON] != NULL;
    enum umb_status status = UMB_OK;
    if (json) {
        umbc_json_begin(&f->json, NULL, '{');
        umbc_json_begin(&f->json, "frames", '[');
    }
    for (size_t frame = 0; frame < f->views.count && status == UMB_OK; frame++) {
        status = run_frame(f, frame, error);
    }
    if (json) {
        umbc_json_end(&f->json, ']');
        umbc_json_integer(&f->json, "request_bytes_a_frame", f->size[0] * f->size[1] * 4);
        umbc_json_integer(&f->json, "bytes", f->received);
        umbc_json_integer(&f->json, "unpacked_bytes", f->plain);
        umbc_json_end(&f->json, '}');
        (void)putchar('\n');
    }
    return status == UMB_OK && f->output.file ? umbc_output_commit(&f->output, error) : status;
}

int umbc_frames(int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_error error = {.status = UMB_OK};
    struct frames f = {.parsed = &parsed, .json = {.file = stdout}};
    int code = umbc_parse(&COMMAND, argc, argv, &parsed);
    code = code < 0 ? read_options(&f) : code;
    if (code >= 0) {
        return code;
    }
    enum umb_status status = prepare(&f, &error);
    if (status == UMB_OK) {
        status = run_frames(&f, &error);
    }
    umbc_output_abandon(&f.output);
    umb_client_stream_close(f.request.stream);
    umb_client_close(f.client);
    umbc_views_finish(&f.views);
    free(f.depth);
    free(f.values[0]);
    free(f.values[1]);
    if (f.depth_file) {
        (void)fclose(f.depth_file);
    }
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain(&error);
}
