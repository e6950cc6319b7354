/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `aliasing`: how well the texels of a shadow map, of a camera's cascades, or of the maps around a
 * lamp fit the pixels of a view. It computes the pixels that a texel covers at each visible point,
 * and prints a histogram, the sufficient resolution, and a heat map.
 */
#include "study/setup.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "base/vec.h"
#include "study/gbuffer.h"
#include "study/picture.h"
#include "study/study_math.h"
#include "umbrage/aliasing.h"

#define BINS        12 /* bins of log2 of pixels a texel: below -4, .., 6 and above */
#define BIN_LOW     (-5)
#define SUN_WAYS    4
#define WAYS        6    /* SUN_WAYS and the ways of a lamp */
#define LAMP_AT_MAX 1e12 /* metres */
#define NEAR_MIN    1e-3 /* near plane of cascades, as a share of the farthest visible point */

static const char *const way_names[WAYS] = {"uniform", "slice", "scene",
                                            "lispsm",  "cube",  "paraboloid"};

/* Directions of the maps around a lamp: the six faces of a cube. The first two are also those of
 * the paraboloids. */
static const struct {
    const char *name;
    double forward[3], up[3];
} faces[] = {{"+z", {0, 0, 1}, {0, 1, 0}}, {"-z", {0, 0, -1}, {0, 1, 0}},
             {"+x", {1, 0, 0}, {0, 0, 1}}, {"-x", {-1, 0, 0}, {0, 0, 1}},
             {"+y", {0, 1, 0}, {0, 0, 1}}, {"-y", {0, -1, 0}, {0, 0, 1}}};

struct summary {
    size_t count;
    double under;                   /* share above 1 pixel a texel */
    double median, p95, p99;        /* pixels a texel */
    double perspective, projection; /* medians of the factors */
    size_t bins[BINS];
};

struct aliasing {
    struct umbt_common common;
    uint64_t resolution, cascades;
    unsigned way_index;
    double weight;
    double lamp[4];          /* position of a lamp, metres; [3]: 1 = given */
    int first_way, ways_end; /* ways that are compared */
    struct umbt_setup setup;
    struct umbt_gbuffer buffer;
    struct umb_camera camera;            /* camera of the view */
    struct umb_cascade_plan plans[WAYS]; /* [0]: one frustum of the scene */
    float *most;    /* [receivers] pixels a texel in the heat map's way; NaN: left out */
    double *sorted; /* [3][receivers] scratch */
    struct summary summaries[WAYS];
    struct summary slices[WAYS][UMB_CASCADES_MAX];
};

#define AT(field) UMBU_AT(struct aliasing, field)

static enum umb_status read_lamp(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error)
{
    double *lamp = field;
    lamp[3] = 1.0;
    return umbu_read_numbers(text, 3, lamp) && fabs(lamp[0]) <= LAMP_AT_MAX &&
                   fabs(lamp[1]) <= LAMP_AT_MAX && fabs(lamp[2]) <= LAMP_AT_MAX
               ? UMB_OK
               : umbu_refuse(option, text, error);
}

static const struct umbu_option OPTIONS[] = {
    {UMBT_SCENE_ROW},
    {"output", "FILE",
     "heat map, PNG: blue 1/16 pixel a texel and less, white 1, red 16; - is stdout", UMBU_TEXT,
     UMBT_AT(output), .letter = 'o'},
    {"lamp", "X,Y,Z", "a lamp there instead of the sun",
     UMBU_READ(read_lamp, "X,Y,Z in metres, at most 1e12 in magnitude"), AT(lamp),
     .excludes = "sun"},
    {"way", "WAY",
     "way of the heat map to spend texels: uniform, slice, scene or lispsm; of a lamp cube or "
     "paraboloid",
     UMBU_CHOICE("uniform|slice|scene|lispsm|cube|paraboloid"), AT(way_index),
     .otherwise = "uniform; cube of a lamp"},
    {"resolution", "N", "texels a side of each map, 16 to 16384", UMBU_COUNT(16, UMB_MAP_SIDE_MAX),
     AT(resolution), .standard = "1024"},
    {"cascades", "N", "number of slices of the view, 1 to 8; not of a lamp",
     UMBU_COUNT(1, UMB_CASCADES_MAX), AT(cascades), .standard = "4"},
    {"weight", "W", "weight of logarithmic against uniform splits, 0 to 1", UMBU_NUMBER(0, 1),
     AT(weight), .standard = "0.7"},
    {UMBT_SIZE_ROW(4096, "1280x720")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage aliasing",
    .usage = "umbrage aliasing SCENE [options]",
    .summary = "Says for every visible point how many pixels a texel of a light's shadow map\n"
               "covers there, in its longest direction: above 1 the map is undersampled, and\n"
               "edges show steps. Four ways to spend texels are compared: one map of the scene\n"
               "(uniform); and cascades around each slice (slice), around what slice and scene\n"
               "share (scene), and the same warped (lispsm). For a lamp: the six faces of a cube\n"
               "around it, and two paraboloids, along the world's axes.",
    .notes = "Points that face away from the light are left out. Exit codes: 0 ok, 2 usage, 65\n"
             "bad data, 66 no input, 73 cannot create, 74 I/O, 75 temporary.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBT_SETUP},
};

/* Makes the maps around a lamp, whose depth ranges over the scene. */
static enum umb_status lamp_plans_make(struct aliasing *a, struct umb_error *error)
{
    double far = 0.0;
    for (int k = 0; k < 3; k++) {
        const struct umb_box *box = &a->common.scene.box;
        const double away = fmax(fabs(box->min[k] - a->lamp[k]), fabs(box->max[k] - a->lamp[k]));
        far += away * away;
    }
    far = sqrt(far);
    for (int way = a->first_way; way < a->ways_end; way++) {
        const int is_cube = way == SUN_WAYS;
        struct umb_cascade_plan *plan = &a->plans[way];
        plan->count = is_cube ? 6 : 2;
        for (uint32_t i = 0; i < plan->count; i++) {
            struct umb_map_spot spot = {.tangent = 1,
                                        .near_m = far * NEAR_MIN,
                                        .far_m = far,
                                        .projection =
                                            is_cube ? UMB_MAP_PERSPECTIVE : UMB_MAP_PARABOLOID};
            memcpy(spot.position, a->lamp, sizeof spot.position);
            memcpy(spot.forward, faces[i].forward, sizeof spot.forward);
            memcpy(spot.up, faces[i].up, sizeof spot.up);
            UMB__TRY(umb_map_frustum_spot(&spot, (uint32_t)a->resolution, (uint32_t)a->resolution,
                                          &plan->frusta[i], error));
        }
    }
    return UMB_OK;
}

/* Returns the map of a plan that a visible point is looked up in. */
static int slice_of(const struct aliasing *a, const struct umb_cascade_plan *plan,
                    const double position[3])
{
    int slice = 0;
    if (a->lamp[3] > 0.0) {
        double from[3], most = -INFINITY;
        umb__subtract(position, a->lamp, from);
        for (int i = 0; i < (int)plan->count; i++) {
            const double along = umb__dot(faces[i].forward, from);
            slice = along > most ? i : slice;
            most = fmax(most, along);
        }
        return slice;
    }
    const double z = umbt_camera_depth(&a->setup.camera, position);
    while (slice + 1 < (int)plan->count && z >= plan->splits[slice + 1]) {
        slice++;
    }
    return slice;
}

static enum umb_status plans_make(struct aliasing *a, struct umb_error *error)
{
    const struct umbt_camera *camera = &a->setup.camera;
    double near = INFINITY, far = 0.0;
    for (size_t i = 0; i < a->buffer.receiver_count; i++) {
        const double z = umbt_camera_depth(camera, a->buffer.positions[i]);
        near = fmin(near, z);
        far = fmax(far, z);
    }
    a->camera =
        umbt_camera_view(camera, fmin(fmax(near, NEAR_MIN * far), 0.999 * far), far * (1.0 + 1e-9));
    if (a->lamp[3] > 0.0) {
        return lamp_plans_make(a, error);
    }
    struct umb_cascade_settings settings = {.count = (uint32_t)a->cascades, .weight = a->weight};
    for (uint32_t i = 0; i < UMB_CASCADES_MAX; i++) {
        settings.resolution[i] = (uint32_t)a->resolution;
    }
    for (int way = 1; way < SUN_WAYS; way++) {
        settings.fit = (enum umb_cascade_fit)(way - 1);
        UMB__TRY(umb_cascades_plan(&a->camera, a->setup.to_light, &a->common.scene.box, &settings,
                                   &a->plans[way], error));
    }
    a->plans[0] =
        (struct umb_cascade_plan){.count = 1, .splits = {a->camera.near_m, a->camera.far_m}};
    return umb_map_frustum_fit(a->setup.to_light, &a->common.scene.box, settings.resolution[0],
                               settings.resolution[0], &a->plans[0].frusta[0], error);
}

/* Value below which the given share of the sorted numbers lies. */
static double quantile(const double *sorted, size_t count, double share)
{
    const size_t at = (size_t)(share * (double)count);
    return count > 0 ? sorted[at < count ? at : count - 1] : 0.0;
}

/* Sorts three lists of `count` numbers and computes their statistics. */
static void summarise(double *lists[3], size_t count, struct summary *s)
{
    memset(s, 0, sizeof *s);
    s->count = count;
    for (size_t i = 0; i < count; i++) {
        const double pixels = lists[0][i];
        const double bin = pixels > 0.0 ? floor(log2(pixels)) - BIN_LOW : 0.0;
        s->bins[(size_t)fmin(fmax(bin, 0.0), BINS - 1)]++;
        s->under += pixels > 1.0;
    }
    s->under /= count > 0 ? (double)count : 1.0;
    for (int k = 0; k < 3; k++) {
        qsort(lists[k], count, sizeof(double), umbt_compare_doubles);
    }
    s->median = quantile(lists[0], count, 0.5);
    s->p95 = quantile(lists[0], count, 0.95);
    s->p99 = quantile(lists[0], count, 0.99);
    s->perspective = quantile(lists[1], count, 0.5);
    s->projection = quantile(lists[2], count, 0.5);
}

/* Analyses one way; only < 0: all its slices. */
static void way_run(struct aliasing *a, int way, int only, struct summary *summary)
{
    const struct umb_cascade_plan *plan = &a->plans[way];
    double *lists[3] = {a->sorted, a->sorted + a->buffer.receiver_count,
                        a->sorted + 2 * a->buffer.receiver_count};
    size_t count = 0;
    for (size_t i = 0; i < a->buffer.receiver_count; i++) {
        const double *position = a->buffer.positions[i];
        const int slice = slice_of(a, plan, position);
        double normal[3];
        struct umb_aliasing result;
        umbt_widen(a->buffer.normals[i], normal);
        const int known = umb_aliasing_at(&plan->frusta[slice], &a->camera, a->common.size[0],
                                          a->common.size[1], position, normal, &result) == UMB_OK;
        if (only < 0 && way == (int)a->way_index) {
            a->most[i] = known ? (float)fmin(result.most, 1e30) : NAN;
        }
        if (known && (only < 0 || slice == only)) {
            lists[0][count] = result.most;
            lists[1][count] = result.perspective;
            lists[2][count++] = result.projection;
        }
    }
    summarise(lists, count, summary);
}

static enum umb_status view_analyse(struct aliasing *a, struct umb_error *error)
{
    UMB__TRY(umbt_setup_open(&a->common, &a->setup, error));
    UMB__TRY(umbt_gbuffer_view(&a->buffer, &a->common.scene, &a->setup.camera, a->common.size,
                               a->common.threads, error));
    UMB__TRY(plans_make(a, error));
    const size_t count = a->buffer.receiver_count;
    a->most = malloc(count * sizeof *a->most);
    a->sorted = malloc(3 * count * sizeof *a->sorted);
    if (a->most == NULL || a->sorted == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu points do not fit in memory", count);
    }
    for (int way = a->first_way; way < a->ways_end; way++) {
        way_run(a, way, -1, &a->summaries[way]);
        for (int slice = 0; slice < (int)a->plans[way].count; slice++) {
            way_run(a, way, slice, &a->slices[way][slice]);
        }
    }
    return UMB_OK;
}

/* Returns the colour for a number of pixels per texel: blue below 1, white at 1, red above; full
 * colour at a factor of 16. NaN is grey. */
static void heat_color(float most, uint8_t out[3])
{
    if (isnan(most)) {
        memset(out, 90, 3);
        return;
    }
    const double heat = fmin(fmax(log2(fmax((double)most, 1e-9)) / 4.0, -1.0), 1.0);
    const double fade = 1.0 - fabs(heat);
    out[0] = umbt_srgb8(heat > 0.0 ? 0.9 : 0.9 * fade);
    out[1] = umbt_srgb8(0.9 * fade);
    out[2] = umbt_srgb8(heat < 0.0 ? 0.9 : 0.9 * fade);
}

static enum umb_status heat_write(const struct aliasing *a, struct umb_error *error)
{
    struct umbt_picture picture;
    UMB__TRY(umbt_picture_init(&picture, a->common.size[0], a->common.size[1], error));
    for (size_t i = 0; i < (size_t)picture.width * picture.height; i++) {
        const uint32_t slot = a->buffer.slots[i];
        memset(&picture.pixels[3 * i], 30, 3);
        if (slot != UMBT_SKY) {
            heat_color(a->most[slot], &picture.pixels[3 * i]);
        }
    }
    enum umb_status status = umbt_picture_write(&picture, a->common.output, error);
    umbt_picture_finish(&picture);
    return status;
}

static void line_text(FILE *to, const char *name, const struct summary *s, uint64_t resolution)
{
    fprintf(to, "%-11s %8zu %7.2f%% %8.3f %8.3f %8.3f %8.3f %8.3f %9.0f\n", name, s->count,
            100.0 * s->under, s->median, s->p95, s->p99, s->perspective, s->projection,
            ceil((double)resolution * s->p99));
}

static void report_text(FILE *to, const void *state)
{
    const struct aliasing *a = state;
    fprintf(to, "%s: %u x %u pixels, %zu points, maps of %" PRIu64 " texels a side\n",
            a->common.scene_path, a->common.size[0], a->common.size[1], a->buffer.receiver_count,
            a->resolution);
    fprintf(to, "%-11s %8s %8s %8s %8s %8s %8s %8s %9s\n", "way", "points", "above 1", "median",
            "95%", "99%", "persp.", "proj.", "texels*");
    for (int way = a->first_way; way < a->ways_end; way++) {
        line_text(to, way_names[way], &a->summaries[way], a->resolution);
        for (uint32_t i = 0; i < a->plans[way].count && a->plans[way].count > 1; i++) {
            char name[32];
            if (a->lamp[3] > 0.0) {
                (void)snprintf(name, sizeof name, "  %s", faces[i].name);
            } else {
                (void)snprintf(name, sizeof name, "  to %.4gm", a->plans[way].splits[i + 1]);
            }
            line_text(to, name, &a->slices[way][i], a->resolution);
        }
    }
    fprintf(to,
            "* a side, at which 99 of 100 points are no longer undersampled\n\npixels a texel:");
    for (int bin = 0; bin < BINS; bin++) {
        fprintf(to, " %s2^%d", bin == 0 ? "<" : "", BIN_LOW + bin + (bin == 0));
    }
    fprintf(to, "\n");
    for (int way = a->first_way; way < a->ways_end; way++) {
        fprintf(to, "%-15s", way_names[way]);
        for (int bin = 0; bin < BINS; bin++) {
            fprintf(to, " %zu", a->summaries[way].bins[bin]);
        }
        fprintf(to, "\n");
    }
}

/* Writes the summary. resolution_for_p99 is null where no resolution suffices, because the light
 * grazes more than 1 % of the points. */
static void put_summary(struct umbu_json *json, const struct summary *s, uint64_t resolution)
{
    umbu_json_integer(json, "points", s->count);
    UMBU_JSON_VALUES(json, 9, {"undersampled", s->under}, {"median", s->median}, {"p95", s->p95},
                     {"p99", s->p99}, {"perspective", s->perspective},
                     {"projection", s->projection},
                     {"resolution_for_p99", ceil((double)resolution * s->p99)});
}

static void put_way(struct umbu_json *json, const struct aliasing *a, int way)
{
    umbu_json_text(json, "way", way_names[way]);
    put_summary(json, &a->summaries[way], a->resolution);
    umbu_json_signed(json, "histogram_from_log2", BIN_LOW);
    umbu_json_begin(json, "histogram", '[');
    for (int bin = 0; bin < BINS; bin++) {
        umbu_json_integer(json, NULL, a->summaries[way].bins[bin]);
    }
    umbu_json_end(json, ']');
    umbu_json_begin(json, "slices", '[');
    for (uint32_t i = 0; i < a->plans[way].count; i++) {
        umbu_json_begin(json, NULL, '{');
        if (a->lamp[3] > 0.0) {
            umbu_json_text(json, "face", faces[i].name);
        } else {
            umbu_json_rounded(json, "to_m", a->plans[way].splits[i + 1], 9);
        }
        put_summary(json, &a->slices[way][i], a->resolution);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

static void report_json(struct umbu_json *json, const void *state)
{
    const struct aliasing *a = state;
    umbu_json_text(json, "scene", a->common.scene_path);
    UMBU_JSON_COUNTS(json, {"width", a->common.size[0]}, {"height", a->common.size[1]},
                     {"resolution", a->resolution});
    umbu_json_begin(json, "ways", '[');
    for (int way = a->first_way; way < a->ways_end; way++) {
        umbu_json_begin(json, NULL, '{');
        put_way(json, a, way);
        umbu_json_end(json, '}');
    }
}

static enum umb_status aliasing_run(void *state, const struct umbu_parsed *parsed,
                                    struct umb_error *error)
{
    struct aliasing *a = state;
    const int is_lamp = a->lamp[3] > 0.0;
    a->first_way = is_lamp ? SUN_WAYS : 0;
    a->ways_end = is_lamp ? WAYS : SUN_WAYS;
    if (!umbu_given(parsed, "way")) {
        a->way_index = (unsigned)a->first_way;
    }
    if ((int)a->way_index < a->first_way || (int)a->way_index >= a->ways_end) {
        return umb_fail(error, UMB_E_ARGUMENT, "--way: '%s' is one of %s; give %s",
                        way_names[a->way_index], is_lamp ? "suns" : "lamps (--lamp)",
                        is_lamp ? "cube or paraboloid" : "uniform, slice, scene or lispsm");
    }
    UMB__TRY(view_analyse(a, error));
    return a->common.output != NULL ? heat_write(a, error) : UMB_OK;
}

static void finish(void *state)
{
    struct aliasing *a = state;
    free(a->most);
    free(a->sorted);
    umbt_gbuffer_finish(&a->buffer);
}

const struct umbt_command umbt_aliasing = {
    &COMMAND, sizeof(struct aliasing), aliasing_run, report_text, report_json, finish};
