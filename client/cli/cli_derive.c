/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage derive: shadow maps for a GPU, from a file or a daemon's asset. */
#include "cli/shared/cli_common.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "cli_paging_view.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/clock.h"
#include "tool/tool_try.h"
#include "umbrage/derive.h"

struct options {
    const char *target; /* File or daemon's asset */
    struct umbu_session session;
    const char *output;
    char named[4096]; /* Default of `output`; a longer path is cut and fails to open */
    struct umb_derive_settings settings; /* Without `camera`: that is set before use */
    struct umb_camera camera;
    const char *view; /* Value of --camera, or NULL */
    double aspect;    /* Width by height of the camera's picture */
    unsigned up;      /* 0 y, 1 z */
    bool json, quiet;
};

#define CAMERA_FORM "eye=X,Y,Z,target=X,Y,Z,far=M[,fov=DEG]"
#define AT(field)   UMBU_AT(struct options, field)
#define KEYS_OFFSET 56 /* of the keys' offset and length in a KTX 2.0 file */
#define ANY         UMBU_NUMBER(-HUGE_VAL, HUGE_VAL)

/* W or WxH. */
static enum umb_status read_size(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error)
{
    struct umb_derive_settings *settings = field;
    const char *at = text;
    uint64_t width, height;
    bool good = umbu_read_count(&at, &width);
    height = width;
    if (good && *at == 'x') {
        at++;
        good = umbu_read_count(&at, &height);
    }
    if (!good || *at != '\0' || width < 1 || height < 1 || width > UMB_MAP_SIDE_MAX ||
        height > UMB_MAP_SIDE_MAX) {
        return umbu_refuse(option, text, error);
    }
    settings->width = (uint32_t)width;
    settings->height = (uint32_t)height;
    return UMB_OK;
}

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct options, "FILE|ASSET", "asset file, or asset of the daemon")},
    {"technique", "NAME", "technique of the maps: depth, vsm, esm, evsm or msm",
     UMBU_CHOICE("depth|vsm|||esm|evsm|msm"), AT(settings.map.technique), .standard = "depth"},
    {"format", "FORMAT", "format of the texels: f32; f16 for esm and evsm; u16 for the others",
     UMBU_CHOICE("f32|f16||u16"), AT(settings.map.format), .standard = "f32"},
    {.setting = "light", AT(settings.light), .max = UMB_LIGHTS_MAX - 1, .standard = "0"},
    {"size", "W[xH]", "width and height of each map in texels, 1 to 16384; one number for both",
     UMBU_READ(read_size, "W or WxH, sides from 1 to 16384"), AT(settings), .standard = "1024"},
    {"rect", "X0,Y0,X1,Y1", "rectangle of the light's voxels that the map covers", UMBU_NUMBERS(4),
     AT(settings.rect), .otherwise = "all", .excludes = "cascades"},
    {"mips", NULL, "adds mip levels; the sides must be powers of two; not for depth", UMBU_FLAG,
     AT(settings.map.access), .excludes = "technique=depth"},
    {"blur", "N", "width in texels of a box filter over the map; not for depth", UMBU_ODD(1, 63),
     AT(settings.map.blur), .excludes = "technique=depth"},
    {"exponent", "C", "exponent of esm and evsm", ANY, AT(settings.map.exponent),
     .otherwise = "what the format allows", .needs = "technique=esm|evsm"},
    {"negative-exponent", "C", "exponent of the second warp of evsm", ANY,
     AT(settings.map.negative_exponent), .otherwise = "what the format allows",
     .needs = "technique=evsm"},
    {"depth-plane", NULL, "adds the slope of the depth to the second moment of vsm", UMBU_FLAG,
     AT(settings.map.depth_plane), .needs = "technique=vsm"},
    {"moment-bias", "B", "bias of the moments of msm, 0 to 1", ANY, AT(settings.map.moment_bias),
     .otherwise = "what the format needs", .needs = "technique=msm"},
    {"cascades", "N", "number of slices of the view of --camera, with a map each, 1 to 8",
     UMBU_COUNT(1, UMB_CASCADES_MAX), AT(settings.cascades.count), .needs = "camera"},
    {"camera", "WHERE", "camera of the cascades, in metres: " CAMERA_FORM, UMBU_TEXT, AT(view),
     .needs = "cascades"},
    {"aspect", "A", "width of the camera's picture divided by its height", UMBU_ABOVE(0, HUGE_VAL),
     AT(aspect), .otherwise = "16/9", .needs = "camera"},
    {"near", "M", "metres from the camera to the near end of the view", ANY, AT(camera.near_m),
     .standard = "0.1", .needs = "camera"},
    {"up", NULL, "the scene's up axis", UMBU_CHOICE("y|z"), AT(up), .standard = "y",
     .needs = "camera"},
    {"weight", "W", "weight of logarithmic against uniform slices, 0 to 1", ANY,
     AT(settings.cascades.weight), .standard = "0.7", .needs = "camera"},
    {"fit", NULL, "space that the frustum of a cascade encloses", UMBU_CHOICE("slice|scene|lispsm"),
     AT(settings.cascades.fit), .standard = "slice", .needs = "camera"},
    {"blend", "B",
     "share of a cascade's far end that fades into the next, 0 to 0.5; the file states it", ANY,
     AT(settings.cascades.blend), .standard = "0", .needs = "camera"},
    {"contrast", "C",
     "contrast C of vsm and evsm, 1e-6 to 1e6, for sampling; with --match-contrast of the first "
     "map",
     UMBU_NUMBER(1e-6, 1e6), AT(settings.contrast), .otherwise = "1",
     .needs = "technique=vsm|evsm"},
    {"match-contrast", NULL,
     "finds the contrast of each later cascade that hides the seam before it", UMBU_FLAG,
     AT(settings.match_contrast), .needs = "cascades technique=vsm|evsm"},
    {"output", "FILE", "KTX 2.0 file; - is stdout", UMBU_TEXT, AT(output),
     .otherwise = "the asset's name with .ktx2", .letter = 'o'},
    {"json", NULL, "print one JSON object", UMBU_FLAG, AT(json), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct options, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage derive",
    .usage = "umbrage derive FILE|ASSET [-o OUT.ktx2] [options]",
    .summary = "Makes shadow maps for a GPU from an asset alone: a rectangle of a light's\n"
               "voxels, or the cascades of a camera. docs/guide/gpu-maps.md tells how to sample\n"
               "them. Closed assets need to be baked with --effect front=on.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct options, session)},
};

/* False if the camera has no direction, or looks along its up axis. */
static bool looks_somewhere(const struct umb_camera *camera)
{
    const double *f = camera->forward, *u = camera->up;
    const double across[3] = {f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2],
                              f[0] * u[1] - f[1] * u[0]};
    const double along = hypot(f[0], hypot(f[1], f[2]));
    return along > 0 && hypot(across[0], hypot(across[1], across[2])) > 1e-9 * along;
}

static int read_view(struct options *o)
{
    struct umb_partial_view view = {0};
    if (o->view == NULL) {
        return -1;
    }
    if (!umbc_parse_camera(o->view, o->aspect, "yz"[o->up], &view) || !(view.camera.far_m > 0)) {
        return umbc_usage_error("derive", "--camera: '%.80s' is not valid; give " CAMERA_FORM,
                                o->view);
    }
    const double near_m = o->camera.near_m;
    o->camera = view.camera;
    o->camera.near_m = near_m;
    return looks_somewhere(&o->camera)
               ? -1
               : umbc_usage_error("derive",
                                  "--camera: '%.80s' has no direction, or looks along the up axis",
                                  o->view);
}

/* "store/city.umb" and "city" become "city.ktx2". */
static void name_output(struct options *options)
{
    const char *slash = strrchr(options->target, '/');
    const char *name = slash != NULL ? slash + 1 : options->target;
    const char *dot = strrchr(name, '.');
    const bool is_asset = dot != NULL && (strcmp(dot, ".umb") == 0 || strcmp(dot, ".umbm") == 0);
    const size_t stem = is_asset ? (size_t)(dot - name) : strlen(name);
    (void)snprintf(options->named, sizeof options->named, "%.*s.ktx2", (int)stem, name);
    options->output = options->named;
}

/* Returns -1 if the command is to go on. Otherwise prints a message and returns the exit code. */
static int options_parse(struct options *options, int argc, char **argv)
{
    struct umbu_parsed parsed;
    memset(options, 0, sizeof *options);
    options->aspect = 16.0 / 9.0;
    const int code = umbu_start(&parsed, &COMMAND, argc, argv, options);
    if (code >= 0) {
        return code;
    }
    const enum umb_map_technique technique = options->settings.map.technique;
    const enum umb_map_format format = options->settings.map.format;
    const bool warped = technique == UMB_MAP_ESM || technique == UMB_MAP_EVSM;
    if ((format == UMB_MAP_F16 && !warped) || (format == UMB_MAP_U16 && warped)) {
        return umbc_usage_error("derive", "--format: f16 goes with esm and evsm, u16 with the "
                                          "other techniques; give one that --technique takes");
    }
    if (options->output == NULL) {
        name_output(options);
    }
    return read_view(options);
}

/* The derived file, made here or by a daemon. */
struct made {
    const uint8_t *bytes; /* bytes of `derived` or `received` */
    size_t size;
    uint8_t asset[UMB_ID_BYTES];
    struct umb_derived *derived; /* maps made here, or NULL */
    uint8_t *received;           /* bytes from a daemon, or NULL */
    bool bad_file;               /* true: the asset file could not be opened */
};

static enum umb_status derive_here(const struct options *options,
                                   const struct umb_derive_settings *settings, struct made *made,
                                   struct umb_error *error)
{
    struct umb_asset *asset;
    enum umb_status status = umb_asset_open_file(options->target, NULL, &asset, error);
    if (status != UMB_OK) {
        made->bad_file = true;
        return status;
    }
    status = umb_derive(asset, settings, NULL, &made->derived, error);
    umb_asset_close(asset);
    UMB__TRY(status);
    memcpy(made->asset, made->derived->asset_id, UMB_ID_BYTES);
    return umb_derived_ktx2(made->derived, &made->bytes, &made->size, error);
}

static enum umb_status derive_there(const struct options *options,
                                    const struct umb_derive_settings *settings, struct made *made,
                                    struct umb_error *error)
{
    struct umb_client *client;
    UMB__TRY(umbu_connect(&options->session, &client, error));
    const enum umb_status status = umb_client_derive(
        client, options->target, settings, &made->received, &made->size, made->asset, NULL, error);
    made->bytes = made->received;
    umb_client_close(client);
    return status;
}

/* Returns the number at an offset of a KTX file; 0 beyond its end. */
static size_t file_number(const struct made *made, size_t at)
{
    size_t value = 0;
    for (size_t i = 4; i-- > 0 && at + 4 <= made->size;) {
        value = value << 8 | made->bytes[at + i];
    }
    return value;
}

/* Writes the contrasts that the file's keys state, in the order of its maps. */
static void tell_contrasts(struct umbu_json *json, const struct made *made, unsigned maps)
{
    static const char key[] = ",\"contrast\":";
    const size_t length = sizeof key - 1;
    size_t at = file_number(made, KEYS_OFFSET), end = at + file_number(made, KEYS_OFFSET + 4);
    end = end < made->size ? end : made->size; /* A daemon's file may state anything */
    umbu_json_begin(json, "contrast", '[');
    for (; at + length < end && maps > 0; at++) {
        char number[32] = {0};
        if (memcmp(made->bytes + at, key, length) == 0) {
            const size_t rest = end - at - length;
            memcpy(number, made->bytes + at + length,
                   rest < sizeof number - 1 ? rest : sizeof number - 1);
            umbu_json_number(json, NULL, strtod(number, NULL));
            maps--;
        }
    }
    umbu_json_end(json, ']');
}

static void tell(const struct options *options, const struct made *made, double seconds)
{
    const struct umb_derive_settings *settings = &options->settings;
    const unsigned maps = settings->cascades.count > 0 ? settings->cascades.count : 1;
    char size[32];
    if (options->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", made->asset);
        UMBU_JSON_COUNTS(&json, {"light", settings->light}, {"maps", maps},
                         {"width", settings->width}, {"height", settings->height},
                         {"bytes", made->size});
        if (settings->contrast > 0 || settings->match_contrast) {
            tell_contrasts(&json, made, maps);
        }
        umbu_json_number(&json, "seconds", seconds);
        umbu_json_close(&json);
    } else if (!options->quiet) {
        umbc_format_bytes(made->size, size);
        (void)fprintf(stderr, "%u map%s of %u x %u texels, %s, in %.3f s\n", maps,
                      maps == 1 ? "" : "s", settings->width, settings->height, size, seconds);
    }
}

int umbc_derive(int argc, char **argv)
{
    struct options options;
    struct made made = {0};
    struct umb_error error = {.status = UMB_OK};
    const int code = options_parse(&options, argc, argv);
    if (code >= 0) {
        return code;
    }
    struct umb_derive_settings settings = options.settings;
    settings.camera = &options.camera;
    const double from = umbu_clock_s();
    enum umb_status status = umbc_is_file(options.target)
                                 ? derive_here(&options, &settings, &made, &error)
                                 : derive_there(&options, &settings, &made, &error);
    const double seconds = umbu_clock_s() - from;
    if (status == UMB_OK) {
        status =
            umbu_output_replace(options.output, UMBU_OUTPUT_COMMAND, made.bytes, made.size, &error);
    }
    umb_derived_destroy(made.derived);
    umb_free(made.received);
    if (status != UMB_OK) {
        return made.bad_file ? umbc_complain_file(options.target, &error) : umbc_complain(&error);
    }
    tell(&options, &made, seconds);
    return umbc_finish_stdout(0);
}
