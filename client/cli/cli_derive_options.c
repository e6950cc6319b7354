/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_derive_options.h. */
#include "cli_derive_options.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "cli_paging_view.h"

#define CAMERA_FORM "eye=X,Y,Z,target=X,Y,Z,far=M[,fov=DEG]"
#define AT(field)   UMBU_AT(struct umbc_derive_options, field)
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
    {UMBC_TARGET_ROW(struct umbc_derive_options, "FILE|ASSET",
                     "asset file, or asset of the daemon")},
    {"technique", "NAME", "depth, vsm, esm, evsm or msm", UMBU_CHOICE("depth|vsm|||esm|evsm|msm"),
     AT(settings.map.technique), .standard = "depth"},
    {"format", "FORMAT", "f32, f16 (esm, evsm) or u16 (the others)", UMBU_CHOICE("f32|f16||u16"),
     AT(settings.map.format), .standard = "f32"},
    {"light", "N", "the asset's light", UMBU_COUNT(0, UMB_LIGHTS_MAX - 1), AT(settings.light),
     .standard = "0"},
    {"size", "W[xH]", "texels of each map", UMBU_READ(read_size, "W or WxH, sides from 1 to 16384"),
     AT(settings), .standard = "1024"},
    {"rect", "X0,Y0,X1,Y1", "voxels of the light's frustum", UMBU_NUMBERS(4), AT(settings.rect),
     .otherwise = "all", .excludes = "cascades"},
    {"mips", NULL, "with mip levels; sides must be powers of two; not depth", UMBU_FLAG,
     AT(settings.map.access), .excludes = "technique=depth"},
    {"blur", "N", "filter by N x N texels; not depth", UMBU_ODD(1, 63), AT(settings.map.blur),
     .excludes = "technique=depth"},
    {"exponent", "C", "of esm and evsm", ANY, AT(settings.map.exponent),
     .otherwise = "what the format allows", .needs = "technique=esm|evsm"},
    {"negative-exponent", "C", "of evsm's second warp", ANY, AT(settings.map.negative_exponent),
     .otherwise = "what the format allows", .needs = "technique=evsm"},
    {"depth-plane", NULL, "vsm: add the moment of the slope", UMBU_FLAG,
     AT(settings.map.depth_plane), .needs = "technique=vsm"},
    {"moment-bias", "B", "msm: 0..1", ANY, AT(settings.map.moment_bias),
     .otherwise = "what the format needs", .needs = "technique=msm"},
    {"cascades", "N", "a map for each of N slices of --camera's view",
     UMBU_COUNT(1, UMB_CASCADES_MAX), AT(settings.cascades.count), .needs = "camera"},
    {"camera", "WHERE", CAMERA_FORM, UMBU_TEXT, AT(view), .needs = "cascades"},
    {"aspect", "A", "width by height of its picture", UMBU_ABOVE(0, HUGE_VAL), AT(aspect),
     .otherwise = "16/9", .needs = "camera"},
    {"near", "M", "where its view begins", ANY, AT(camera.near_m), .standard = "0.1",
     .needs = "camera"},
    {"up", NULL, "the scene's up axis", UMBU_CHOICE("y|z"), AT(up), .standard = "y",
     .needs = "camera"},
    {"weight", "W", "0 uniform .. 1 logarithmic slices", ANY, AT(settings.cascades.weight),
     .standard = "0.7", .needs = "camera"},
    {"fit", NULL, "frusta of the cascades", UMBU_CHOICE("slice|scene|lispsm"),
     AT(settings.cascades.fit), .standard = "slice", .needs = "camera"},
    {"output", "FILE", "the KTX 2.0 file; - is stdout", UMBU_TEXT, AT(output),
     .otherwise = "the asset's name with .ktx2", .letter = 'o'},
    {"json", NULL, "print one JSON object", UMBU_FLAG, AT(json), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct umbc_derive_options, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage derive",
    .usage = "umbrage derive FILE|ASSET [-o OUT.ktx2] [options]",
    .summary = "Makes shadow maps for a GPU from an asset alone: a rectangle of a light's\n"
               "voxels, or the cascades of a camera. docs/guide/gpu-maps.md tells how to sample\n"
               "them. Closed assets need to be baked with --effect front=on.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)},
                 UMBU_SESSION(struct umbc_derive_options, session)},
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

static int read_view(struct umbc_derive_options *o)
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
               : umbc_usage_error("derive", "--camera: '%.80s' looks nowhere, or along the up axis",
                                  o->view);
}

/* "store/city.umb" and "city" become "city.ktx2". */
static void name_output(struct umbc_derive_options *options)
{
    const char *slash = strrchr(options->target, '/');
    const char *name = slash != NULL ? slash + 1 : options->target;
    const char *dot = strrchr(name, '.');
    const bool is_asset = dot != NULL && (strcmp(dot, ".umb") == 0 || strcmp(dot, ".umbm") == 0);
    const size_t stem = is_asset ? (size_t)(dot - name) : strlen(name);
    (void)snprintf(options->named, sizeof options->named, "%.*s.ktx2", (int)stem, name);
    options->output = options->named;
}

int umbc_derive_options_parse(struct umbc_derive_options *options, int argc, char **argv)
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
        return umbc_usage_error("derive", "--format: f16 is of esm and evsm, u16 of the other "
                                          "techniques; give one that --technique takes");
    }
    if (options->output == NULL) {
        name_output(options);
    }
    return read_view(options);
}
