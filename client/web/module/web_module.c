/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The functions that the WebAssembly module exports: umbrage/partial.h and umbrage/query.h for one
 * asset. An instance of the module holds one asset; JavaScript (client/web/umbrage/asset.js) makes
 * an instance for each, and copies bytes and points into memory that it gets from umbx_room.
 *
 * Functions return an enum umb_status unless said otherwise. umbx_message returns the message of
 * the last failure. Lists of numbers, in and out, are passed in the array `numbers` (umbx_numbers).
 */
#include <stdlib.h>
#include <string.h>

#include "base/query_settings.h"
#include "umbrage/curve.h"
#include "umbrage/gpu.h"
#include "umbrage/partial.h"
#include "web/module/web_sha256.h"

#define EXPORT(name) __attribute__((export_name(#name))) name
#define NUMBERS      96

static struct {
    struct umb_partial *partial;
    struct umb_query_settings settings;
    struct umb_error error;
    struct umb_light_info light;
    int is_complete; /* 1: all pages are in the last build */
    double numbers[NUMBERS];
    struct umb_gpu_layout gpu; /* Layout of the array for a GPU; without entries before the first */
    struct umb_gpu_placement placement;
} here;

double *EXPORT(umbx_numbers)(void);
const char *EXPORT(umbx_message)(void);
const char *EXPORT(umbx_status_name)(int status);
void *EXPORT(umbx_room)(size_t bytes);
void EXPORT(umbx_release)(void *room);
int EXPORT(umbx_read_head)(const uint8_t *bytes, size_t size);
int EXPORT(umbx_open)(const uint8_t *front, size_t size, const uint8_t *id, double max_memory);
int EXPORT(umbx_build)(void);
int EXPORT(umbx_add)(uint32_t page, const uint8_t *bytes, size_t size);
int EXPORT(umbx_add_block)(uint32_t block, const uint8_t *bytes, size_t size);
void EXPORT(umbx_drop)(uint32_t page);
int EXPORT(umbx_locate)(uint32_t page);
void EXPORT(umbx_locate_block)(uint32_t block);
size_t EXPORT(umbx_missing)(uint32_t *list, size_t room, double budget);
size_t EXPORT(umbx_missing_blocks)(int all, uint32_t *list, size_t room);
int EXPORT(umbx_want)(int add);
void EXPORT(umbx_stats)(void);
const uint8_t *EXPORT(umbx_id)(void);
void EXPORT(umbx_info)(void);
const char *EXPORT(umbx_light)(uint32_t index);
void EXPORT(umbx_settings_clear)(void);
int EXPORT(umbx_set)(const char *name, uint32_t index, double value);
int EXPORT(umbx_set_word)(const char *name, const char *word);
int EXPORT(umbx_gpu_layout)(double spare);
uint32_t EXPORT(umbx_gpu_changes)(uint32_t *ranges, uint32_t room);
void EXPORT(umbx_gpu_write)(uint32_t first, uint32_t count, uint32_t *entries);
int EXPORT(umbx_gpu_place)(void);
const void *EXPORT(umbx_gpu_placement)(void);
int EXPORT(umbx_query)(const void *positions, int is_f64, size_t count, const float *normals,
                       const float *footprints, int want, void *values, float *room);
int EXPORT(umbx_explain)(double x, double y, double z, int has_normal);

double *umbx_numbers(void)
{
    return here.numbers;
}

const char *umbx_message(void)
{
    return here.error.message;
}

const char *umbx_status_name(int status)
{
    return umb_status_name((enum umb_status)status);
}

void *umbx_room(size_t bytes)
{
    return malloc(bytes);
}

void umbx_release(void *room)
{
    free(room);
}

/* Out: numbers: bytes that umbx_open needs, length of the file. */
int umbx_read_head(const uint8_t *bytes, size_t size)
{
    struct umb_file_head head;
    const enum umb_status status = umb_file_read_head(bytes, size, &head, &here.error);
    if (status == UMB_OK) {
        here.numbers[0] = (double)head.open_bytes;
        here.numbers[1] = (double)head.file_bytes;
    }
    return status;
}

int umbx_open(const uint8_t *front, size_t size, const uint8_t *id, double max_memory)
{
    const struct umb_partial_options options = {
        .sha256 = umbx_sha256(), .id = id, .max_memory_bytes = (uint64_t)max_memory};
    umb_partial_close(here.partial);
    return umb_partial_open(front, size, &options, &here.partial, &here.error);
}

int umbx_build(void)
{
    struct umb_partial_stats stats;
    const enum umb_status status = umb_partial_build(here.partial, &here.error);
    umb_partial_get_stats(here.partial, &stats);
    here.is_complete = status == UMB_OK && stats.pages_held == stats.page_count;
    return status;
}

int umbx_add(uint32_t page, const uint8_t *bytes, size_t size)
{
    return umb_partial_add(here.partial, page, bytes, size, &here.error);
}

int umbx_add_block(uint32_t block, const uint8_t *bytes, size_t size)
{
    return umb_partial_add_block(here.partial, block, bytes, size, &here.error);
}

void umbx_drop(uint32_t page)
{
    umb_partial_drop(here.partial, page);
}

static void put_place(uint64_t offset, uint32_t length)
{
    here.numbers[0] = (double)offset;
    here.numbers[1] = length;
}

/* Out: numbers: offset and length in bytes. */
int umbx_locate(uint32_t page)
{
    uint64_t offset;
    uint32_t length;
    const enum umb_status status = umb_partial_locate(here.partial, page, &offset, &length);
    put_place(offset, length);
    return status;
}

/* Out: numbers: offset and length in bytes. */
void umbx_locate_block(uint32_t block)
{
    uint64_t offset;
    uint32_t length;
    umb_partial_locate_block(here.partial, block, &offset, &length);
    put_place(offset, length);
}

/* Returns the number of listed pages. */
size_t umbx_missing(uint32_t *list, size_t room, double budget)
{
    return umb_partial_missing(here.partial, list, room, (uint64_t)budget);
}

/* Returns the number of listed blocks. */
size_t umbx_missing_blocks(int all, uint32_t *list, size_t room)
{
    return umb_partial_missing_blocks(here.partial, all, list, room);
}

/* Converts a number to an integer. A negative, NaN or too large number becomes UINT32_MAX - 1,
 * which no index or setting reaches. */
static uint32_t whole_of(double value)
{
    return value >= 0 && value < UINT32_MAX ? (uint32_t)value : UINT32_MAX - 1;
}

/* Sets the wanted view. In: numbers[0]: light, below 0 for all lights. [1]: 1 if there is a box;
 * [2..7]: its min and max. [8]: 1 if there is a camera; [9..20]: its eye, forward, up, fov_y,
 * aspect and far_m. [21..24]: max_error_m, max_error_rad, taps and bias_m. */
int umbx_want(int add)
{
    const double *in = here.numbers;
    struct umb_partial_view view = {.light = in[0] < 0 ? UINT32_MAX : whole_of(in[0]),
                                    .has_box = in[1] > 0,
                                    .has_camera = in[8] > 0,
                                    .max_error_m = in[21],
                                    .max_error_rad = in[22],
                                    .taps = whole_of(in[23]),
                                    .bias_m = in[24]};
    memcpy(&view.box, in + 2, sizeof view.box);
    memcpy(&view.camera, in + 9, 11 * sizeof *in); /* eye, forward, up, fov_y and aspect */
    view.camera.far_m = in[20];
    return umb_partial_want(here.partial, &view, add, &here.error);
}

/* Reports the state of the partial asset. Out: numbers: pages and pages held, bytes of the asset
 * and of the pages held, memory in use and at most, dropped pages, builds, blocks and blocks
 * held. */
void umbx_stats(void)
{
    struct umb_partial_stats stats;
    umb_partial_get_stats(here.partial, &stats);
    const double numbers[] = {stats.page_count,
                              stats.pages_held,
                              (double)stats.asset_bytes,
                              (double)stats.held_bytes,
                              (double)stats.memory_bytes,
                              (double)stats.memory_peak_bytes,
                              (double)stats.pages_dropped,
                              (double)stats.builds,
                              stats.block_count,
                              stats.blocks_held};
    memcpy(here.numbers, numbers, sizeof numbers);
}

/* Returns the asset's id: uint8[UMB_ID_BYTES]. */
const uint8_t *umbx_id(void)
{
    static struct umb_asset_info info;
    umb_asset_get_info(umb_partial_lower(here.partial), &info);
    return info.id;
}

/* Describes the asset. Out: numbers: number of lights, number of frusta, origin, min and max of the
 * casters' box. */
void umbx_info(void)
{
    struct umb_asset_info info;
    umb_asset_get_info(umb_partial_lower(here.partial), &info);
    here.numbers[0] = info.light_count;
    here.numbers[1] = info.frustum_count;
    memcpy(here.numbers + 2, info.origin, sizeof info.origin);
    memcpy(here.numbers + 5, &info.bounds, sizeof info.bounds);
}

/* Returns a light's name, or NULL. Out: numbers: kind, direction, position, extent, voxels a side
 * of its first frustum, number of its frusta. */
const char *umbx_light(uint32_t index)
{
    const struct umb_asset *asset = umb_partial_lower(here.partial);
    struct umb_frustum_info frustum;
    if (umb_asset_get_light(asset, index, &here.light) != UMB_OK ||
        umb_asset_get_frustum(asset, here.light.first_frustum, &frustum) != UMB_OK) {
        return NULL;
    }
    here.numbers[0] = here.light.kind;
    memcpy(here.numbers + 1, here.light.direction, sizeof here.light.direction);
    memcpy(here.numbers + 4, here.light.position, sizeof here.light.position);
    here.numbers[7] = here.light.extent;
    here.numbers[8] = 1U << frustum.log2_size;
    here.numbers[9] = here.light.frustum_count;
    return here.light.name;
}

/* Returns the row of a setting, or NULL. */
static const struct umb__setting *find_setting(const char *name)
{
    for (size_t i = 0; i < umb__setting_count; i++) {
        if (strcmp(umb__settings[i].name, name) == 0) {
            return &umb__settings[i];
        }
    }
    (void)umb_fail(&here.error, UMB_E_ARGUMENT, "%s: there is no such setting", name);
    return NULL;
}

/* Gives all settings of queries their defaults. */
void umbx_settings_clear(void)
{
    here.settings = (struct umb_query_settings){.light = 0};
}

/* Sets a setting of later queries. In: index: component of a setting that has three numbers, else
 * 0. */
int umbx_set(const char *name, uint32_t index, double value)
{
    const struct umb__setting *row = find_setting(name);
    if (row == NULL) {
        return UMB_E_ARGUMENT;
    }
    uint8_t *at = (uint8_t *)&here.settings + row->at;
    if (row->kind == UMB__SETTING_NUMBER || row->kind == UMB__SETTING_NUMBERS) {
        at += row->kind == UMB__SETTING_NUMBERS && index < 3 ? index * sizeof value : 0;
        memcpy(at, &value, sizeof value);
        return UMB_OK;
    }
    const uint32_t whole = value >= 0 && value <= UINT32_MAX ? (uint32_t)value : 0;
    if ((double)whole < value || (double)whole > value || value != value) {
        return umb_fail(&here.error, UMB_E_ARGUMENT, "%s: %g, must be a whole number", name, value);
    }
    memcpy(at, &whole, sizeof whole);
    return UMB_OK;
}

/* Sets a choice by its word. */
int umbx_set_word(const char *name, const char *word)
{
    const struct umb__setting *row = find_setting(name);
    if (row == NULL) {
        return UMB_E_ARGUMENT;
    }
    const size_t length = strlen(word);
    uint32_t value = 0;
    for (const char *at = row->words; at != NULL && *at != '\0'; value++) {
        const size_t each = strcspn(at, "|");
        if (each == length && memcmp(at, word, length) == 0) {
            memcpy((uint8_t *)&here.settings + row->at, &value, sizeof value);
            return UMB_OK;
        }
        at += each + (at[each] == '|' ? 1 : 0);
    }
    return umb_fail(&here.error, UMB_E_ARGUMENT, "%s: %s, must be %s%s", name, word,
                    row->words != NULL ? "one of " : "a number",
                    row->words != NULL ? row->words : "");
}

/* Reports on the last query. Out: numbers: count of exact answers, worst error in metres, bound in
 * metres, and the counts of struct umb_query_stats. */
static void put_counts(uint64_t exact, double worst_error_m, const struct umb_query_stats *stats)
{
    const double numbers[] = {(double)exact,
                              worst_error_m,
                              umb_query_bound_m(umb_partial_lower(here.partial), &here.settings),
                              (double)stats->points,
                              (double)stats->outside,
                              (double)stats->before,
                              (double)stats->behind,
                              (double)stats->facing_away,
                              (double)stats->undefined,
                              (double)stats->nodes,
                              (double)stats->bricks};
    memcpy(here.numbers, numbers, sizeof numbers);
}

/* Answers from the lower asset alone, in which the voxels of missing pages are shadowed. */
static enum umb_status query_lower(const struct umb_points *points, void *values,
                                   struct umb_query_stats *stats)
{
    struct umb_query query;
    struct umb_answers answers = {.values = values};
    enum umb_status status =
        umb_query_prepare(umb_partial_lower(here.partial), &here.settings, &query, &here.error);
    if (status == UMB_OK) {
        status = umb_points_check(points, &here.error);
    }
    if (status == UMB_OK) {
        umb_query_run(&query, points, 0, points->count, &answers);
        *stats = answers.stats;
    }
    return status;
}

/* Puts an estimate into packed answers. */
static void put_estimate(void *values, size_t i, float value)
{
    uint8_t *bytes = values;
    if (here.settings.format == UMB_ANSWER_U8) {
        bytes[i] = (uint8_t)(value * 255.0F + 0.5F);
    } else {
        bytes[i / 8] =
            (uint8_t)((bytes[i / 8] & ~(1U << i % 8)) | (value >= 0.5F ? 1U : 0U) << i % 8);
    }
}

/* Answers points with bounds. In: low: memory for low, high and error_m, float[count] each; for
 * packed answers float[count] more, for the estimates. */
static enum umb_status query_partial(const struct umb_points *points, int want, void *values,
                                     float *low)
{
    const size_t count = points->count;
    const int is_packed = here.settings.format != UMB_ANSWER_F32;
    float *estimates = is_packed ? low + 3 * count : values;
    struct umb_partial_answers answers = {
        .values = estimates, .low = low, .high = low + count, .error_m = low + 2 * count};
    struct umb_query_stats ignored;
    enum umb_status status =
        umb_partial_query(here.partial, &here.settings, points, want, &answers, &here.error);
    if (status == UMB_OK && is_packed) {
        status = query_lower(points, values, &ignored);
    }
    for (size_t i = 0; status == UMB_OK && is_packed && i < count; i++) {
        if (low[i] < low[count + i]) {
            put_estimate(values, i, estimates[i]);
        }
    }
    if (status == UMB_OK) {
        put_counts(answers.exact, answers.worst_error_m, &answers.stats);
    }
    return status;
}

/*
 * Answers points with the settings that were set before.
 *
 * In:  numbers: the origin. room: float[4 * count].
 * Out: values: by the format. room: low, high and error_m, unless all answers are exact. numbers:
 *      see put_counts.
 */
int umbx_query(const void *positions, int is_f64, size_t count, const float *normals,
               const float *footprints, int want, void *values, float *room)
{
    struct umb_points points = {.positions = positions,
                                .format = is_f64 ? UMB_POINT_F64 : UMB_POINT_F32,
                                .normals = normals,
                                .footprints = footprints,
                                .count = count};
    struct umb_query_stats stats = {0};
    memcpy(points.origin, here.numbers, sizeof points.origin);
    if (!here.is_complete) {
        return query_partial(&points, want, values, room);
    }
    const enum umb_status status = query_lower(&points, values, &stats);
    if (status == UMB_OK) {
        put_counts(count, 0, &stats);
    }
    return status;
}

/* Explains the answer of one point from the pages that are held. In: numbers: the normal. Out:
 * numbers: as asset.js names them. */
int umbx_explain(double x, double y, double z, int has_normal)
{
    const double position[3] = {x, y, z};
    const float normal[3] = {(float)here.numbers[0], (float)here.numbers[1],
                             (float)here.numbers[2]};
    const struct umb_points points = {.positions = position,
                                      .format = UMB_POINT_F64,
                                      .normals = has_normal ? normal : NULL,
                                      .count = 1};
    struct umb_explanation e = {.answer = 0};
    struct umb_query query;
    enum umb_status status =
        umb_query_prepare(umb_partial_lower(here.partial), &here.settings, &query, &here.error);
    if (status == UMB_OK) {
        status = umb_points_check(&points, &here.error);
    }
    if (status != UMB_OK) {
        return status;
    }
    umb_query_explain(&query, &points, 0, &e);
    const double numbers[] = {e.answer,
                              e.lit_taps,
                              e.taps,
                              e.level,
                              e.frustum,
                              e.nodes,
                              e.bricks,
                              e.transmittance,
                              e.bias_m,
                              e.cosine,
                              e.voxel_size_m,
                              e.footprint_m,
                              e.facing_away,
                              e.undefined,
                              e.outside,
                              e.before,
                              e.behind,
                              e.has_normal,
                              e.moved[0],
                              e.moved[1],
                              e.moved[2],
                              e.voxel[0],
                              e.voxel[1],
                              e.voxel[2],
                              (double)e.cell[0],
                              (double)e.cell[1],
                              (double)e.cell[2],
                              (double)e.window[0],
                              (double)e.window[1],
                              e.step_count};
    const size_t count = sizeof numbers / sizeof *numbers;
    memcpy(here.numbers, numbers, sizeof numbers);
    for (size_t i = 0; i < UMB_TAPS_MAX; i++) {
        here.numbers[count + i] = e.rows[i];
    }
    for (size_t i = 0; i < sizeof e.steps / sizeof *e.steps; i++) {
        double *step = here.numbers + count + UMB_TAPS_MAX + 3 * i;
        step[0] = e.steps[i].level;
        step[1] = e.steps[i].state;
        step[2] = (double)e.steps[i].index;
    }
    return UMB_OK;
}

/* --- for GPUs --------------------------------------------------------------------------------- */

/* Makes a layout for a GPU, unless the last layout still has room for the built nodes and bricks.
 * In: spare: entries of room to add, raised to half of the last array. Out: numbers: entries of the
 * array; 1 if the layout is new, so that the whole array must be copied. */
int umbx_gpu_layout(double spare)
{
    const struct umb_asset *asset = umb_partial_lower(here.partial);
    enum umb_status status = UMB_OK;
    here.numbers[1] = here.gpu.entries == 0 || !umb_gpu_layout_fits(asset, &here.gpu);
    if (here.numbers[1] > 0) {
        const uint32_t least = whole_of(spare), half = here.gpu.entries / 2;
        status = umb_gpu_layout_make(asset, half > least ? half : least, &here.gpu, &here.error);
        umb_gpu_forget_changes(here.partial);
    }
    here.numbers[0] = here.gpu.entries;
    return status;
}

/* Lists ranges of changed entries: pairs of first and count. Returns their number. */
uint32_t umbx_gpu_changes(uint32_t *ranges, uint32_t room)
{
    return (uint32_t)umb_gpu_changes(here.partial, &here.gpu,
                                     (struct umb_gpu_range *)(void *)ranges, room);
}

void umbx_gpu_write(uint32_t first, uint32_t count, uint32_t *entries)
{
    umb_gpu_write(umb_partial_lower(here.partial), here.partial, &here.gpu, first, count, entries);
}

/* Computes the placement of a shader's positions. In: numbers: light, 1 if there is a matrix,
 * origin, matrix, mode of the bias, bias, face. Out: numbers: range in metres, bounds across and in
 * depth in voxels. */
int umbx_gpu_place(void)
{
    const double *in = here.numbers;
    struct umb_gpu_precision precision = {0};
    struct umb_gpu_view view = {.light = whole_of(in[0]),
                                .has_to_world = in[1] > 0,
                                .face = whole_of(in[23]),
                                .bias_mode = (enum umb_bias_mode)whole_of(in[21]),
                                .bias = in[22]};
    memcpy(view.origin, in + 2, sizeof view.origin);
    memcpy(view.to_world, in + 5, sizeof view.to_world);
    const enum umb_status status = umb_gpu_place(umb_partial_lower(here.partial), &view,
                                                 &here.placement, &precision, &here.error);
    here.numbers[0] = precision.range_m;
    here.numbers[1] = precision.across;
    here.numbers[2] = precision.depth;
    return status;
}

/* Returns the placement that umbx_gpu_place made: struct umb_gpu_placement. */
const void *umbx_gpu_placement(void)
{
    return &here.placement;
}
