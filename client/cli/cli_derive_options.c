/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_derive_options.h. */
#include "cli_derive_options.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "cli_paging_view.h"

enum derive_option {
    OPTION_TECHNIQUE,
    OPTION_FORMAT,
    OPTION_LIGHT,
    OPTION_SIZE,
    OPTION_RECT,
    OPTION_MIPS,
    OPTION_BLUR,
    OPTION_EXPONENT,
    OPTION_NEGATIVE,
    OPTION_DEPTH_PLANE,
    OPTION_MOMENT_BIAS,
    OPTION_CASCADES,
    OPTION_CAMERA,
    OPTION_ASPECT,
    OPTION_NEAR,
    OPTION_UP,
    OPTION_WEIGHT,
    OPTION_FIT,
    OPTION_OUTPUT,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_TECHNIQUE] = {"technique", "NAME", "depth (default), vsm, esm, evsm or msm", 0},
    [OPTION_FORMAT] = {"format", "FORMAT", "f32 (default), f16 (esm, evsm) or u16 (the others)", 0},
    [OPTION_LIGHT] = {"light", "N", "the asset's light (default 0)", 0},
    [OPTION_SIZE] = {"size", "W[xH]", "texels of each map (default 1024)", 0},
    [OPTION_RECT] = {"rect", "X0,Y0,X1,Y1", "voxels of the light's frustum (default: all)", 0},
    [OPTION_MIPS] = {"mips", NULL, "with mip levels; sides must be powers of two; not depth", 0},
    [OPTION_BLUR] = {"blur", "N", "filter by N x N texels, odd; not depth", 0},
    [OPTION_EXPONENT] = {"exponent", "C", "of esm and evsm (default: what the format allows)", 0},
    [OPTION_NEGATIVE] = {"negative-exponent", "C", "of evsm's second warp (default likewise)", 0},
    [OPTION_DEPTH_PLANE] = {"depth-plane", NULL, "vsm: add the moment of the slope", 0},
    [OPTION_MOMENT_BIAS] = {"moment-bias", "B", "msm: 0..1 (default: what the format needs)", 0},
    [OPTION_CASCADES] = {"cascades", "N", "a map for each of N slices of --camera's view", 0},
    [OPTION_CAMERA] = {"camera", "WHERE", "eye=X,Y,Z,target=X,Y,Z,far=M[,fov=DEG]", 0},
    [OPTION_ASPECT] = {"aspect", "A", "width by height of its picture (default 16/9)", 0},
    [OPTION_NEAR] = {"near", "M", "where its view begins (default 0.1)", 0},
    [OPTION_UP] = {"up", "y|z", "the scene's up axis (default y)", 0},
    [OPTION_WEIGHT] = {"weight", "W", "0 uniform .. 1 logarithmic slices (default 0.7)", 0},
    [OPTION_FIT] = {"fit", "HOW", "slice (default), scene or lispsm", 0},
    [OPTION_OUTPUT] = {"output", "FILE",
                       "the KTX 2.0 file (the asset's name with .ktx2); - is stdout", 'o'},
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage derive FILE|ASSET [-o OUT.ktx2] [options]",
    .summary =
        "Makes shadow maps for a GPU from an asset alone: a rectangle of a light's voxels, or the\n"
        "cascades of a camera. docs/guide/gpu-maps.md tells how to sample them. Closed assets\n"
        "need to be baked with --effect front=on.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
    .connects = true,
};

/* Place of a word in a list; SIZE_MAX if it is not in it. */
static size_t place_of(const char *word, const char *const *list, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(word, list[i]) == 0) {
            return i;
        }
    }
    return SIZE_MAX;
}

/* Options that another technique, or a map without cascades, would leave unread. */
static int check_unread(const char *const *v, enum umb_map_technique technique,
                        enum umb_map_format format)
{
    const bool esm = technique == UMB_MAP_ESM, evsm = technique == UMB_MAP_EVSM;
    const struct {
        enum derive_option option;
        bool read;
        const char *where;
    } options[] = {
        {OPTION_EXPONENT, esm || evsm, "esm and evsm"},
        {OPTION_NEGATIVE, evsm, "evsm"},
        {OPTION_DEPTH_PLANE, technique == UMB_MAP_VSM, "vsm"},
        {OPTION_MOMENT_BIAS, technique == UMB_MAP_MSM, "msm"},
        {OPTION_ASPECT, v[OPTION_CAMERA] != NULL, "--camera"},
        {OPTION_NEAR, v[OPTION_CAMERA] != NULL, "--camera"},
        {OPTION_UP, v[OPTION_CAMERA] != NULL, "--camera"},
        {OPTION_WEIGHT, v[OPTION_CAMERA] != NULL, "--camera"},
        {OPTION_FIT, v[OPTION_CAMERA] != NULL, "--camera"},
    };
    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++) {
        if (v[options[i].option] && !options[i].read) {
            return umbc_usage_error("derive: --%s is of %s", OPTIONS[options[i].option].name,
                                    options[i].where);
        }
    }
    if ((format == UMB_MAP_F16 && !esm && !evsm) || (format == UMB_MAP_U16 && (esm || evsm))) {
        return umbc_usage_error("derive: --format %s is not of %s: f16 is of esm and evsm, u16 of "
                                "the others",
                                v[OPTION_FORMAT],
                                v[OPTION_TECHNIQUE] ? v[OPTION_TECHNIQUE] : "depth");
    }
    return -1;
}

static int read_words(const struct umbc_parsed *parsed, struct umbc_derive_options *o)
{
    static const char *const techniques[] = {"depth", "vsm", "esm", "evsm", "msm"};
    static const enum umb_map_technique technique_of[] = {UMB_MAP_PCF, UMB_MAP_VSM, UMB_MAP_ESM,
                                                          UMB_MAP_EVSM, UMB_MAP_MSM};
    static const char *const formats[] = {"f32", "f16", "u16"};
    static const enum umb_map_format format_of[] = {UMB_MAP_F32, UMB_MAP_F16, UMB_MAP_U16};
    static const char *const fits[] = {"slice", "scene", "lispsm"};
    const char *const *v = parsed->values;
    size_t technique = 0, format = 0, fit = 0;
    if (v[OPTION_TECHNIQUE]) {
        technique = place_of(v[OPTION_TECHNIQUE], techniques, 5);
    }
    if (v[OPTION_FORMAT]) {
        format = place_of(v[OPTION_FORMAT], formats, 3);
    }
    if (v[OPTION_FIT]) {
        fit = place_of(v[OPTION_FIT], fits, 3);
    }
    if (technique == SIZE_MAX) {
        return umbc_usage_error("derive: --technique '%s', must be depth, vsm, esm, evsm or msm",
                                v[OPTION_TECHNIQUE]);
    }
    if (format == SIZE_MAX) {
        return umbc_usage_error("derive: --format '%s', must be f32, f16 or u16", v[OPTION_FORMAT]);
    }
    if (fit == SIZE_MAX) {
        return umbc_usage_error("derive: --fit '%s', must be slice, scene or lispsm",
                                v[OPTION_FIT]);
    }
    o->settings.map.technique = technique_of[technique];
    o->settings.map.format = format_of[format];
    o->settings.map.access = v[OPTION_MIPS] ? UMB_MAP_MIPS : UMB_MAP_BASE;
    o->settings.map.depth_plane = v[OPTION_DEPTH_PLANE] != NULL;
    o->settings.cascades.fit = (enum umb_cascade_fit)fit;
    if (technique == 0 && (v[OPTION_MIPS] || v[OPTION_BLUR])) {
        return umbc_usage_error("derive: --mips and --blur average, which depths must not be");
    }
    return check_unread(v, technique_of[technique], format_of[format]);
}

static bool parse_rect(const char *text, double rect[4])
{
    int end = 0;
    return sscanf(text, "%lf,%lf,%lf,%lf%n", &rect[0], &rect[1], &rect[2], &rect[3], &end) == 4 &&
           text[end] == '\0';
}

static bool parse_size(const char *text, uint32_t *width, uint32_t *height)
{
    unsigned w, h;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &w, &h, &end) == 2 && text[end] == '\0') {
        *width = w;
        *height = h;
        return true;
    }
    if (sscanf(text, "%5u%n", &w, &end) == 1 && text[end] == '\0') {
        *width = *height = w;
        return true;
    }
    return false;
}

static int read_numbers(const struct umbc_parsed *parsed, struct umbc_derive_options *o)
{
    const char *const *v = parsed->values;
    unsigned long long light = 0, blur = 0, cascades = 0;
    o->settings.width = o->settings.height = 1024;
    o->settings.cascades.weight = 0.7;
    o->camera.near_m = 0.1;
    const struct {
        enum derive_option option;
        double *out;
    } numbers[] = {
        {OPTION_EXPONENT, &o->settings.map.exponent},
        {OPTION_NEGATIVE, &o->settings.map.negative_exponent},
        {OPTION_MOMENT_BIAS, &o->settings.map.moment_bias},
        {OPTION_WEIGHT, &o->settings.cascades.weight},
        {OPTION_NEAR, &o->camera.near_m},
    };
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        const char *text = v[numbers[i].option];
        if (text && !umbc_parse_number(text, numbers[i].out)) {
            return umbc_usage_error("derive: --%s '%s', no number", OPTIONS[numbers[i].option].name,
                                    text);
        }
    }
    if (v[OPTION_LIGHT] && !umbc_parse_count(v[OPTION_LIGHT], UMB_LIGHTS_MAX - 1, &light)) {
        return umbc_usage_error("derive: --light '%s', no number of a light", v[OPTION_LIGHT]);
    }
    if (v[OPTION_BLUR] && !umbc_parse_count(v[OPTION_BLUR], 63, &blur)) {
        return umbc_usage_error("derive: --blur '%s', must be odd, 1 to 63", v[OPTION_BLUR]);
    }
    if (v[OPTION_CASCADES] &&
        (!umbc_parse_count(v[OPTION_CASCADES], UMB_CASCADES_MAX, &cascades) || cascades == 0)) {
        return umbc_usage_error("derive: --cascades '%s', must be 1 to %d", v[OPTION_CASCADES],
                                UMB_CASCADES_MAX);
    }
    if (v[OPTION_SIZE] && !parse_size(v[OPTION_SIZE], &o->settings.width, &o->settings.height)) {
        return umbc_usage_error("derive: --size '%s', must be W or WxH, sides are 1..16384",
                                v[OPTION_SIZE]);
    }
    if (v[OPTION_RECT] && !parse_rect(v[OPTION_RECT], o->settings.rect)) {
        return umbc_usage_error("derive: --rect '%s', must be X0,Y0,X1,Y1", v[OPTION_RECT]);
    }
    o->settings.light = (uint32_t)light;
    o->settings.map.blur = (uint32_t)blur;
    o->settings.cascades.count = (uint32_t)cascades;
    return -1;
}

/* False if the camera has no direction, or looks along its up axis. */
static bool looks_somewhere(const struct umb_camera *camera)
{
    const double *f = camera->forward, *u = camera->up;
    const double across[3] = {f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2],
                              f[0] * u[1] - f[1] * u[0]};
    const double along = hypot(f[0], hypot(f[1], f[2]));
    return along > 0 && hypot(across[0], hypot(across[1], across[2])) > 1e-9 * along;
}

static int read_view(const struct umbc_parsed *parsed, struct umbc_derive_options *o)
{
    const char *const *v = parsed->values;
    struct umb_partial_view view = {0};
    double aspect = 16.0 / 9.0;
    char up = 'y';
    if ((v[OPTION_CASCADES] != NULL) != (v[OPTION_CAMERA] != NULL)) {
        return umbc_usage_error("derive: --cascades and --camera need each other");
    }
    if (v[OPTION_CAMERA] == NULL) {
        return -1;
    }
    if (v[OPTION_RECT]) {
        return umbc_usage_error("derive: --rect is not for --cascades");
    }
    if (v[OPTION_UP]) {
        if (strcmp(v[OPTION_UP], "y") != 0 && strcmp(v[OPTION_UP], "z") != 0) {
            return umbc_usage_error("derive: --up '%s', must be y or z", v[OPTION_UP]);
        }
        up = v[OPTION_UP][0];
    }
    if (v[OPTION_ASPECT] && !(umbc_parse_number(v[OPTION_ASPECT], &aspect) && aspect > 0)) {
        return umbc_usage_error("derive: --aspect '%s', no ratio", v[OPTION_ASPECT]);
    }
    if (!umbc_parse_camera(v[OPTION_CAMERA], aspect, up, &view) || !(view.camera.far_m > 0)) {
        return umbc_usage_error(
            "derive: --camera '%s', must be eye=X,Y,Z,target=X,Y,Z,far=M[,fov=DEG]",
            v[OPTION_CAMERA]);
    }
    const double near_m = o->camera.near_m;
    o->camera = view.camera;
    o->camera.near_m = near_m;
    if (!looks_somewhere(&o->camera)) {
        return umbc_usage_error("derive: --camera '%s' looks nowhere, or along the up axis",
                                v[OPTION_CAMERA]);
    }
    return -1;
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
    struct umbc_parsed parsed;
    memset(options, 0, sizeof *options);
    int code = umbc_parse(&COMMAND, argc, argv, &parsed);
    if (code < 0) {
        code = read_words(&parsed, options);
    }
    if (code < 0) {
        code = read_numbers(&parsed, options);
    }
    if (code < 0) {
        code = read_view(&parsed, options);
    }
    if (code >= 0) {
        return code;
    }
    options->target = parsed.words[0];
    options->output = parsed.values[OPTION_OUTPUT];
    options->json = parsed.values[OPTION_JSON] != NULL;
    options->quiet = parsed.values[OPTION_QUIET] != NULL;
    memcpy(options->session, parsed.session, sizeof options->session);
    if (options->output == NULL) {
        name_output(options);
    }
    return umbc_check_stdout("derive", options->output, options->json);
}
