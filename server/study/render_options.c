/* SPDX-License-Identifier: Apache-2.0 */
/* The command line of `render`. */
#include "study/render_options.h"

#include <stdbool.h>
#include <string.h>
#include "study/output_guard.h"
#include "study/parallel_for.h"
#include "study/shadow_source.h"
#include "study/study_args.h"

#define FOG_MAX   100.0 /* 1/m: the view ends after some centimetres */
#define RAD_A_DEG 0.017453292519943295

const char umbt_render_help[] =
    "usage: umbrage render SCENE --asset FILE|ASSET -o OUT.png [options]\n"
    "\n"
    "Makes a picture of a scene with the shadows of an asset that was baked from it.\n"
    "\n"
    "  --asset FILE|ASSET   asset file, or the name or id of a daemon's asset\n"
    "  --address ADDRESS    the daemon: tcp:HOST:PORT, tls:HOST:PORT or unix:PATH\n"
    "                       (else UMBRAGE_ADDRESS, else tcp:127.0.0.1:7420)\n"
    "  --tls-ca, --tls-cert, --tls-key, --tls-name, --token-file\n"
    "                       as `umbrage query` takes them (token: else UMBRAGE_TOKEN)\n"
    "  -o, --output FILE    the picture, PNG; - is stdout\n"
    "  --camera WHERE       eye=X,Y,Z[,target=X,Y,Z][,fov=DEG], or [az=DEG][,el=DEG][,fov=DEG]:\n"
    "                       fitted to the scene from a compass direction. Default: fitted, from\n"
    "                       80 degrees beside the sun, 35 above the horizon, fov 35\n"
    "  --up y|z             the scene's up axis (default: by its format)\n"
    "  --size WxH           pixels (default 1280x720)\n"
    "  --aa N               N x N samples a pixel, 1 to 3 (default 2; 1 with traced windows)\n"
    "  --light N            the asset's light (default 0)\n"
    "  --taps N             filter width in texels, odd, 1 to 17 (default 9; of penumbras and\n"
    "                       footprints 1)\n"
    "  --filter NAME        box (default), tent, penumbra (half shadows of a light with an\n"
    "                       extent), or footprint (what each pixel covers of a surface)\n"
    "  --light-size DEG     for penumbras: the light's angular diameter (default: the asset's)\n"
    "  --bias B             auto, none, 1.5vox or 0.02m (default auto)\n"
    "  --fog D              sunlit fog of extinction D per metre: light shafts, by segment "
    "queries\n"
    "\n"
    "  --traced             shadows by rays instead of the asset: the reference; rays pass\n"
    "                       through translucent casters if the asset knows of any\n"
    "  --compare            both; prints how they differ where the surface faces the light\n"
    "                       (of opaque casters)\n"
    "  --difference FILE    with --compare: a picture, red where the asset is lighter, blue "
    "darker\n"
    "  --reference FILE     with --compare: the traced picture\n"
    "  --truth KIND         what is traced: texels: a ray from each texel centre of the filter's\n"
    "                       window, at the moved point's depth (default for more than one tap);\n"
    "                       area: --samples N squared rays over the window's area around the "
    "moved\n"
    "                       point; surface: one ray from the surface (default for one tap);\n"
    "                       disc: as many rays over the light's disc (default for penumbras)\n"
    "  --samples N          rays a side for --truth area and disc, 1 to 64 (default 16; implies\n"
    "                       area, of penumbras disc)\n"
    "\n"
    "  --threads N          default: all processors\n"
    "  --force              even if the asset was baked from another scene\n"
    "  --json               print one JSON object\n"
    "  -q, --quiet          no progress, no summary\n"
    "  --help\n"
    "\n"
    "Exit codes: 0 ok, 2 usage, 65 bad data, 66 no input, 69 unavailable, 73 cannot create, 74 "
    "I/O,\n"
    "75 temporary.\n";

/* Values that the option table cannot hold directly. */
struct raw {
    const char *camera, *size, *bias, *truth, *up, *fog, *filter, *light_size;
    uint64_t taps, light, aa, threads, samples;
};

/* Kind of traced truth without an option. */
static enum umbt_truth_kind truth_default(const struct raw *raw,
                                          const struct umbt_render_options *options)
{
    if (options->settings.filter == UMB_FILTER_PENUMBRA) {
        return UMBT_TRUTH_DISC;
    }
    return raw->samples > 0             ? UMBT_TRUTH_AREA
           : options->settings.taps > 1 ? UMBT_TRUTH_TEXELS
                                        : UMBT_TRUTH_SURFACE;
}

static enum umb_status truth_parse(const struct raw *raw, struct umbt_render_options *options,
                                   struct umb_error *error)
{
    static const char *const names[] = {"texels", "area", "surface", "disc"};
    size_t found = 0;
    options->truth = truth_default(raw, options);
    if (raw->truth != NULL) {
        while (found < sizeof names / sizeof names[0] && strcmp(raw->truth, names[found]) != 0) {
            found++;
        }
        if (found == sizeof names / sizeof names[0]) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--truth: '%.60s' is none of texels, area, surface, disc", raw->truth);
        }
        options->truth = (enum umbt_truth_kind)found;
    }
    if (raw->samples > 0 && options->truth != UMBT_TRUTH_AREA &&
        options->truth != UMBT_TRUTH_DISC) {
        return umb_fail(error, UMB_E_ARGUMENT, "--samples: only --truth area and disc take it");
    }
    options->samples = raw->samples > 0 ? (uint32_t)raw->samples : 16;
    return UMB_OK;
}

/* Reads the filter, its least width, and the light's extent. */
static enum umb_status filter_parse(const struct raw *raw, struct umb_query_settings *settings,
                                    struct umb_error *error)
{
    enum umb_filter found = UMB_FILTER_BOX;
    while (raw->filter != NULL && found < UMB_FILTERS &&
           strcmp(raw->filter, umb_filter_name(found)) != 0) {
        found++;
    }
    if (found == UMB_FILTERS) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--filter: '%.60s' is none of box, tent, penumbra, footprint", raw->filter);
    }
    settings->filter = found;
    /* The width grows from its taps on. */
    const bool grows = settings->filter >= UMB_FILTER_PENUMBRA;
    settings->taps = raw->taps > 0 ? (uint32_t)raw->taps : grows ? 1 : 9;
    if (settings->taps % 2 == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--taps: %u is not odd", settings->taps);
    }
    if (raw->light_size != NULL) {
        const char *end = raw->light_size;
        double degrees;
        if (!umbt_number_read(&end, &degrees) || (*end != '\0' && strcmp(end, "deg") != 0) ||
            !(degrees > 0.0 && degrees * RAD_A_DEG <= UMB_EXTENT_MAX)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--light-size: '%.60s' is not above 0 and at most %g degrees",
                            raw->light_size, UMB_EXTENT_MAX / RAD_A_DEG);
        }
        settings->light_extent = degrees * RAD_A_DEG;
    }
    return UMB_OK;
}

static enum umb_status fog_parse(const char *text, double *fog, struct umb_error *error)
{
    const char *end = text;
    if (!umbt_number_read(&end, fog) || *end != '\0' || !(*fog > 0.0 && *fog <= FOG_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--fog: '%.60s' is not above 0 and at most %g", text,
                        FOG_MAX);
    }
    return UMB_OK;
}

static enum umb_status raw_convert(const struct raw *raw, struct umbt_render_options *options,
                                   struct umb_error *error)
{
    enum umb_status status = filter_parse(raw, &options->settings, error);
    options->settings.light = (uint32_t)raw->light;
    options->settings.format = UMB_ANSWER_F32;
    options->width = 1280;
    options->height = 720;
    options->threads = raw->threads > 0 ? (unsigned)raw->threads : umbt_processor_count();
    if (status == UMB_OK && raw->camera != NULL) {
        status = umbt_camera_parse(raw->camera, &options->camera, error);
    }
    if (status == UMB_OK && raw->size != NULL) {
        status = umbt_size_parse(raw->size, &options->width, &options->height, error);
    }
    if (status == UMB_OK && raw->bias != NULL) {
        status = umbt_bias_parse(raw->bias, &options->settings, error);
    }
    if (status == UMB_OK && raw->up != NULL) {
        options->up_given = 1;
        status = umbt_up_parse(raw->up, &options->z_up, error);
    }
    if (status == UMB_OK && raw->fog != NULL) {
        status = fog_parse(raw->fog, &options->fog, error);
    }
    if (status == UMB_OK) {
        status = truth_parse(raw, options, error);
    }
    const int windows =
        (options->traced || options->compare) && options->truth != UMBT_TRUTH_SURFACE;
    options->aa = raw->aa > 0 ? (uint32_t)raw->aa : windows ? 1 : 2;
    return status;
}

/* Refuses a second output to stdout. */
static enum umb_status stdout_check(struct umbt_render_options *options, struct umb_error *error)
{
    const int pictures = umbt_output_is_stdout(options->output) +
                         umbt_output_is_stdout(options->reference) +
                         umbt_output_is_stdout(options->difference);
    options->to_stdout = pictures > 0;
    return pictures > 0 && pictures + options->json > 1
               ? umb_fail(error, UMB_E_ARGUMENT,
                          "-o, --reference, --difference, --json: only one of them can have stdout")
               : UMB_OK;
}

/* Checks combinations of options. */
static enum umb_status options_check(const struct umbt_render_options *options,
                                     struct umb_error *error)
{
    if (options->asset == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "--asset: is needed; see --help");
    }
    if (options->output == NULL && !options->compare) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: is needed; see --help");
    }
    if (options->traced && options->compare) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--traced: --compare traces as well; give one of both");
    }
    if (options->fog > 0.0 && (options->traced || options->compare)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--fog: goes with neither --traced nor --compare");
    }
    if (options->fog > 0.0 && !umbt_source_is_file(options->asset)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--fog: segments are asked from files, %.80s is a daemon's asset",
                        options->asset);
    }
    if ((options->difference != NULL || options->reference != NULL) && !options->compare) {
        return umb_fail(error, UMB_E_ARGUMENT, "--difference and --reference need --compare");
    }
    if ((options->traced || options->compare) && options->truth != UMBT_TRUTH_SURFACE &&
        options->truth != UMBT_TRUTH_DISC && !umbt_source_is_file(options->asset)) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--truth: a window's rays need the asset as a file, %.80s is a daemon's; give "
            "--truth surface",
            options->asset);
    }
    return UMB_OK;
}

enum umb_status umbt_render_options_parse(int argc, char **argv,
                                          struct umbt_render_options *options,
                                          struct umb_error *error)
{
    memset(options, 0, sizeof *options);
    struct raw raw = {0};
    const struct umbt_option table[] = {
        {"SCENE", UMBT_WORD, &options->scene, 0, 0},
        {"--asset", UMBT_TEXT, &options->asset, 0, 0},
        {"--address", UMBT_TEXT, &options->daemon.address, 0, 0},
        {"--tls-ca", UMBT_TEXT, &options->daemon.ca_file, 0, 0},
        {"--tls-cert", UMBT_TEXT, &options->daemon.certificate_file, 0, 0},
        {"--tls-key", UMBT_TEXT, &options->daemon.key_file, 0, 0},
        {"--tls-name", UMBT_TEXT, &options->daemon.server_name, 0, 0},
        {"--token-file", UMBT_TEXT, &options->daemon.token_file, 0, 0},
        {"-o", UMBT_TEXT, &options->output, 0, 0},
        {"--output", UMBT_TEXT, &options->output, 0, 0},
        {"--camera", UMBT_TEXT, &raw.camera, 0, 0},
        {"--up", UMBT_TEXT, &raw.up, 0, 0},
        {"--size", UMBT_TEXT, &raw.size, 0, 0},
        {"--aa", UMBT_COUNT, &raw.aa, 1, 3},
        {"--light", UMBT_COUNT, &raw.light, 0, UMB_LIGHTS_MAX - 1},
        {"--taps", UMBT_COUNT, &raw.taps, 1, UMB_TAPS_MAX},
        {"--filter", UMBT_TEXT, &raw.filter, 0, 0},
        {"--light-size", UMBT_TEXT, &raw.light_size, 0, 0},
        {"--bias", UMBT_TEXT, &raw.bias, 0, 0},
        {"--fog", UMBT_TEXT, &raw.fog, 0, 0},
        {"--traced", UMBT_FLAG, &options->traced, 0, 0},
        {"--compare", UMBT_FLAG, &options->compare, 0, 0},
        {"--difference", UMBT_TEXT, &options->difference, 0, 0},
        {"--reference", UMBT_TEXT, &options->reference, 0, 0},
        {"--truth", UMBT_TEXT, &raw.truth, 0, 0},
        {"--samples", UMBT_COUNT, &raw.samples, 1, 64},
        {"--threads", UMBT_COUNT, &raw.threads, 1, 256},
        {"--force", UMBT_FLAG, &options->force, 0, 0},
        {"--json", UMBT_FLAG, &options->json, 0, 0},
        {"--quiet", UMBT_FLAG, &options->quiet, 0, 0},
        {"--help", UMBT_FLAG, &options->help, 0, 0},
    };
    enum umb_status status =
        umbt_args_parse(argc, argv, table, sizeof table / sizeof table[0], error);
    if (status != UMB_OK || options->help) {
        return status;
    }
    status = stdout_check(options, error);
    if (status == UMB_OK) {
        status = raw_convert(&raw, options, error);
    }
    return status == UMB_OK ? options_check(options, error) : status;
}
