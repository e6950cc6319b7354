/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage sample: points near shadow boundaries, from a file or a daemon's asset. */
#include "cli/shared/cli_common.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "tool/output.h"
#include "tool/tool_try.h"
#include "umbrage/sample.h"

struct options {
    const char *target; /* File or daemon's asset */
    struct umbu_session session;
    struct umb_sample_settings settings;
    const char *output;
    unsigned format; /* 0 text, 1 f64 */
    bool json, quiet;
};

#define AT(field) UMBU_AT(struct options, field)

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct options, "FILE|ASSET", "asset file, or asset of the daemon")},
    {"count", "N", "number of points, 1 to 65536; other seeds give further points",
     UMBU_COUNT(1, UMB_SAMPLE_MAX), AT(settings.count), .standard = "4096", .letter = 'n'},
    {"seed", "N", "seed of the points", UMBU_COUNT(0, UINT64_MAX), AT(settings.seed),
     .standard = "1"},
    {.setting = "light", AT(settings.light), .max = UMB_LIGHTS_MAX - 1, .standard = "0"},
    {"scattered", "SHARE",
     "share of the points that lie anywhere in the casters' bounds, 0 to 1; the others lie at "
     "shadow boundaries",
     UMBU_NUMBER(0, 1), AT(settings.scattered), .standard = "0"},
    {"output", "FILE", "file of the points, replaced as a whole; - is stdout", UMBU_TEXT,
     AT(output), .letter = 'o', .needed = true},
    {"format", NULL, "format of the points: text, or raw little-endian doubles",
     UMBU_CHOICE("text|f64"), AT(format), .standard = "text"},
    {UMBU_JSON_ROW(struct options), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct options, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage sample",
    .usage = "umbrage sample FILE|ASSET -o FILE [options]",
    .summary = "Draws points near the shadow boundaries of an asset, without its scene: for\n"
               "`umbrage query --points FILE` and `umbrage load --trace FILE`. The same asset,\n"
               "light, seed and count give the same points everywhere. They have no normals. If\n"
               "the light has no shadow boundary, nothing is written and the exit code is 1.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct options, session)},
};

/* Points drawn here or by a daemon. */
struct drawn {
    struct umb_sample sample;
    double *positions; /* [3 * settings.count] */
    bool bad_file;     /* true: the asset file could not be opened */
};

static enum umb_status draw_here(const struct options *options, struct drawn *drawn,
                                 struct umb_error *error)
{
    struct umb_asset *asset;
    enum umb_status status = umb_asset_open_file(options->target, NULL, &asset, error);
    if (status != UMB_OK) {
        drawn->bad_file = true;
        return status;
    }
    status = umb_asset_sample(asset, &options->settings, drawn->positions, &drawn->sample, error);
    umb_asset_close(asset);
    return status;
}

static enum umb_status draw_there(const struct options *options, struct drawn *drawn,
                                  struct umb_error *error)
{
    struct umb_client *client;
    UMB__TRY(umbu_connect(&options->session, &client, error));
    const enum umb_status status = umb_client_sample(client, options->target, &options->settings,
                                                     drawn->positions, &drawn->sample, NULL, error);
    umb_client_close(client);
    return status;
}

/* Writes the points in world space. A text begins with a comment that says what they are. */
static void write_points(FILE *file, const struct options *options, const struct drawn *drawn)
{
    const struct umb_sample *sample = &drawn->sample;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(sample->asset_id, id);
    if (options->format == 0) {
        (void)fprintf(file, "# asset %s light %u seed %" PRIu64 " count %u scattered %.17g\n", id,
                      options->settings.light, options->settings.seed, options->settings.count,
                      options->settings.scattered);
    }
    for (size_t i = 0; i < sample->count; i++) {
        double p[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            p[axis] = sample->origin[axis] + drawn->positions[3 * i + axis];
        }
        if (options->format == 0) {
            (void)fprintf(file, "%.17g %.17g %.17g\n", p[0], p[1], p[2]);
        } else {
            (void)fwrite(p, sizeof p, 1, file);
        }
    }
}

static enum umb_status save(const struct options *options, const struct drawn *drawn,
                            struct umb_error *error)
{
    struct umbu_output output;
    UMB__TRY(umbu_output_begin(options->output, UMBU_OUTPUT_COMMAND, &output, error));
    write_points(output.file, options, drawn);
    return umbu_output_commit(&output, error);
}

static void tell(const struct options *options, const struct umb_sample *sample)
{
    if (options->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", sample->asset_id);
        UMBU_JSON_COUNTS(&json, {"light", options->settings.light},
                         {"seed", options->settings.seed}, {"points", sample->count});
        umbu_json_text(&json, "note", sample->note);
        umbu_json_close(&json);
    }
    if (sample->note[0] != '\0' && (sample->count == 0 || !options->quiet)) {
        (void)fputs("umbrage: ", stderr);
        umbc_print_text(stderr, sample->note, strlen(sample->note));
        (void)fputs("\n", stderr);
    } else if (!options->quiet && !options->json) {
        (void)fprintf(stderr, "%zu points\n", sample->count);
    }
}

int umbc_sample(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct umb_error error = {.status = UMB_OK};
    struct options options = {.target = NULL};
    struct drawn drawn = {.positions = NULL};
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, &options);
    if (code >= 0) {
        return code;
    }
    drawn.positions = malloc(3 * sizeof *drawn.positions * options.settings.count);
    if (drawn.positions == NULL) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "sample: out of memory");
    }
    enum umb_status status = umbc_is_file(options.target) ? draw_here(&options, &drawn, &error)
                                                          : draw_there(&options, &drawn, &error);
    if (status == UMB_OK && drawn.sample.count > 0) {
        status = save(&options, &drawn, &error);
    }
    free(drawn.positions);
    if (status != UMB_OK) {
        return drawn.bad_file ? umbc_complain_file(options.target, &error) : umbc_complain(&error);
    }
    tell(&options, &drawn.sample);
    return umbc_finish_stdout(drawn.sample.count > 0 ? 0 : UMBC_EXIT_NEGATIVE);
}
