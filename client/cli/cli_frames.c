/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage frames: a frame loop against a daemon. Each frame is a camera and its depth picture. The
 * answers come packed over one stream, as changes to the frame before if the daemon still has it.
 */
#include "cli/shared/cli_common.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "tool/clock.h"
#include "tool/json.h"
#include "tool/output.h"
#include "cli_paging_view.h"
#include "tool/tool_try.h"

struct frames_settings {
    const char *target, *path, *depth, *output;
    struct umbu_session session;
    uint32_t size[2]; /* Pixels of a frame */
    unsigned up;      /* 0 y, 1 z */
    struct umb_query_settings query;
    bool plain, json, quiet;
};
#define AT(field) UMBU_AT(struct frames_settings, field)

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct frames_settings, "ASSET", "asset of the daemon")},
    {"path", "FILE", "file with a camera a line: eye=X,Y,Z,target=X,Y,Z[,fov=DEG]", UMBU_TEXT,
     AT(path), .needed = true},
    {"depth", "FILE", "file of depths: for each frame and pixel a float, metres along the view",
     UMBU_TEXT, AT(depth), .needed = true},
    {"size", "WxH", "width and height of a frame in pixels", UMBU_SIDES(16384), AT(size),
     .standard = "1280x720"},
    {"up", NULL, "the scene's up axis", UMBU_CHOICE("y|z"), AT(up), .standard = "y"},
    {.setting = "light", AT(query.light), .standard = "0"},
    {.setting = "taps", AT(query.taps), .standard = "1"},
    {"format", "FORMAT", "format of the answers: f32, u8 or bit", .setting = "format",
     AT(query.format), .standard = "bit"},
    {"plain", NULL, "asks for whole answers without packing, for comparison", UMBU_FLAG, AT(plain)},
    {"output", "FILE", "file of the answers, frame after frame; - is stdout", UMBU_TEXT, AT(output),
     .letter = 'o'},
    {"json", NULL, "print one JSON object, with every frame", UMBU_FLAG, AT(json),
     .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct frames_settings, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage frames",
    .usage = "umbrage frames ASSET --path FILE --depth FILE [options]",
    .summary = "Asks a daemon for the shadows of one frame after the other, as a game would. It\n"
               "sends a camera and its depth picture; the answers come back packed, and only the\n"
               "changes where few pixels changed. A pixel of depth 0, or not finite, is empty.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct frames_settings, session)},
};

/* State of the loop. */
struct frames {
    struct frames_settings o;
    struct umbc_views views;
    struct umb_client *client;
    struct umb_client_query_request request;
    struct umb_picture picture;
    FILE *depth_file;
    float *depth;       /* [pixels] depths of a frame in metres */
    uint8_t *values[2]; /* answers of this frame and the one before */
    size_t value_bytes;
    struct umbu_output output;
    struct umbu_json json;
    uint64_t received, plain; /* bytes of all answers, as received and unpacked */
};

static enum umb_status prepare(struct frames *f, struct umb_error *error)
{
    const struct umb_partial_view none = {0};
    const uint32_t *size = f->o.size;
    const size_t pixels = (size_t)size[0] * size[1];
    UMB__TRY(umbc_read_path(f->o.path, (double)size[0] / (double)size[1], "yz"[f->o.up], &none,
                            &f -> views, error));
    UMB__TRY(umbc_open_input(f->o.depth, &f->depth_file, error));
    f->value_bytes = umb_answer_bytes(f->request.settings.format, pixels);
    f->depth = malloc(pixels * sizeof *f->depth);
    f->values[0] = malloc(f->value_bytes);
    f->values[1] = malloc(f->value_bytes);
    if (!f->depth || !f->values[0] || !f->values[1]) {
        return umb_fail(error, UMB_E_NO_MEMORY, "frames: no memory for %zu pixels", pixels);
    }
    f->picture = (struct umb_picture){.width = size[0], .height = size[1], .depth = f->depth};
    f->request.picture = &f->picture;
    UMB__TRY(umbu_connect(&f->o.session, &f->client, error));
    UMB__TRY(umb_client_stream_open(f->client, &f->request.stream, error));
    return f->o.output ? umbu_output_begin(f->o.output, UMBU_OUTPUT_COMMAND, &f->output, error)
                       : UMB_OK;
}

/* Prints the figures of one frame. */
static void report(struct frames *f, size_t frame, const struct umb_client_query_reply *reply,
                   double took)
{
    const uint64_t bytes = reply->packed_bytes ? reply->packed_bytes : reply->value_bytes;
    f->received += bytes;
    f->plain += reply->value_bytes;
    if (f->o.json) {
        umbu_json_begin(&f->json, NULL, '{');
        umbu_json_integer(&f->json, "bytes", bytes);
        umbu_json_bool(&f->json, "changes_only", reply->changes_only != 0);
        umbu_json_number(&f->json, "ms", took * 1e3);
        umbu_json_number(&f->json, "server_ms", (double)reply->nanoseconds * 1e-6);
        umbu_json_end(&f->json, '}');
    } else if (!f->o.quiet) {
        (void)fprintf(f->output.file == stdout ? stderr : stdout,
                      "frame %4zu  %8" PRIu64 " bytes%s  %7.2f ms, of these %7.2f in the server\n",
                      frame, bytes, reply->changes_only ? " of changes" : "           ", took * 1e3,
                      (double)reply->nanoseconds * 1e-6);
    }
}

static enum umb_status run_frame(struct frames *f, size_t frame, struct umb_error *error)
{
    const struct umb_partial_view *view = &f->views.list[frame];
    const size_t pixels = (size_t)f->o.size[0] * f->o.size[1];
    struct umb_client_query_reply reply;
    if (fread(f->depth, sizeof *f->depth, pixels, f->depth_file) != pixels) {
        return ferror(f->depth_file)
                   ? umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", f->o.depth)
                   : umb_fail(error, UMB_E_TRUNCATED,
                              "'%.160s' ends within frame %zu; %zu frames of %u x %u floats are "
                              "needed, as many as --path has cameras",
                              f->o.depth, frame, f->views.count, f->o.size[0], f->o.size[1]);
    }
    f->picture.camera = view->camera;
    f->request.base = f->request.pack && frame > 0 ? f->values[(frame + 1) % 2] : NULL;
    uint8_t *values = f->values[frame % 2];
    const double start = umbu_clock_s();
    UMB__TRY(umb_client_query(f->client, &f->request, values, &reply, error));
    report(f, frame, &reply, umbu_clock_s() - start);
    if (f->output.file && fwrite(values, 1, f->value_bytes, f->output.file) != f->value_bytes) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot write the answers");
    }
    return UMB_OK;
}

static enum umb_status run_frames(struct frames *f, struct umb_error *error)
{
    const bool json = f->o.json;
    enum umb_status status = UMB_OK;
    if (json) {
        umbu_json_begin(&f->json, NULL, '{');
        umbu_json_begin(&f->json, "frames", '[');
    }
    for (size_t frame = 0; frame < f->views.count && status == UMB_OK; frame++) {
        status = run_frame(f, frame, error);
    }
    if (json) {
        umbu_json_end(&f->json, ']');
        UMBU_JSON_COUNTS(&f->json,
                         {"request_bytes_a_frame", (uint64_t)f->o.size[0] * f->o.size[1] * 4},
                         {"bytes", f->received}, {"unpacked_bytes", f->plain});
        umbu_json_close(&f->json);
    }
    return status == UMB_OK && f->output.file ? umbu_output_commit(&f->output, error) : status;
}

int umbc_frames(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct umb_error error = {.status = UMB_OK};
    struct frames f = {.json = {.file = stdout}};
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &f.o);
    if (code >= 0) {
        return code;
    }
    f.request.asset = f.o.target;
    f.request.settings = f.o.query;
    f.request.pack = !f.o.plain;
    f.request.want_stats = 1;
    enum umb_status status = prepare(&f, &error);
    if (status == UMB_OK) {
        status = run_frames(&f, &error);
    }
    umbu_output_abandon(&f.output);
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
