/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Maps from an asset's voxels; see umbrage/derive.h. A frustum gives the light ray of a texel, a
 * column query its first occluder, and umb_map_build the map.
 */
#include "umbrage/derive.h"

#include <math.h>
#include <string.h>
#include "base/reserved.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/vec.h"
#include "maps/derive_parts.h"
#include "maps/map_parts.h"
#include "umbrage/volume.h"

#define EXPONENT_ESM      80.0
#define EXPONENT_EVSM     40.0
#define EXPONENT_NEGATIVE 5.0

/* Bytes of memory for each texel: a float of the layer, and two planes of doubles while channels
 * are built. */
#define TEXEL_BYTES (sizeof(float) + 2 * sizeof(double))
/* Bytes a texel of a row: those of struct row. */
#define ROW_BYTES (4 * sizeof(double) + sizeof(struct umb_column_answer))
/* Bytes for handles, and for planning a KTX file. */
#define FIXED_BYTES 32768U

static uint32_t map_count(const struct umb_derive_settings *settings)
{
    return settings->cascades.count > 0 ? settings->cascades.count : 1;
}

uint64_t umb_derive_bytes(const struct umb_derive_settings *settings)
{
    const uint64_t texels = (uint64_t)settings->width * settings->height;
    const uint64_t channels = settings->map.technique == UMB_MAP_PCF ? 1 : 4;
    const uint64_t stored = texels * channels * sizeof(float) * 4 / 3 + 4096; /* Mips included */
    return FIXED_BYTES + settings->width * (uint64_t)ROW_BYTES + texels * TEXEL_BYTES +
           2 * stored * map_count(settings) + umb__derive_seam_bytes(settings);
}

static int is_whole_frustum(const double rect[4])
{
    return rect[0] == 0.0 && rect[1] == 0.0 && rect[2] == 0.0 && rect[3] == 0.0;
}

static enum umb_status rect_check(const double rect[4], double size, struct umb_error *error)
{
    for (int k = 0; k < 4; k++) {
        if (!(rect[k] >= -size && rect[k] <= 2.0 * size)) {
            return umb_fail(error, UMB_E_ARGUMENT, "rect[%d] is %g; it must be %g..%g voxels", k,
                            rect[k], -size, 2.0 * size);
        }
    }
    if (!(rect[2] - rect[0] >= 0.001 && rect[3] - rect[1] >= 0.001)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "rect: %g,%g to %g,%g; each side must be at least 0.001 voxels", rect[0],
                        rect[1], rect[2], rect[3]);
    }
    return UMB_OK;
}

static enum umb_status contrast_check(const struct umb_derive_settings *settings,
                                      struct umb_error *error)
{
    const enum umb_map_technique technique = settings->map.technique;
    if (settings->contrast == 0.0 && !settings->match_contrast) {
        return UMB_OK;
    }
    if (technique != UMB_MAP_VSM && technique != UMB_MAP_EVSM) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "contrast, match_contrast: '%s' has none; vsm and evsm have",
                        technique == UMB_MAP_PCF ? "depth" : umb_map_technique_name(technique));
    }
    if (settings->match_contrast && settings->cascades.count == 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "match_contrast: one map has no seam; cascades.count must be 1..%d",
                        UMB_CASCADES_MAX);
    }
    return settings->contrast == 0.0
               ? UMB_OK
               : umb__check_number("contrast", settings->contrast, 1e-6, 1e6, error);
}

/* Checks sizes and GPU formats. The functions that use the other settings check them. */
static enum umb_status settings_check(const struct umb_derive_settings *settings,
                                      struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    const struct umb_map_settings *map = &settings->map;
    const uint32_t count = map_count(settings);
    if (settings->width < 1 || settings->height < 1 || settings->width > UMB_MAP_SIDE_MAX ||
        settings->height > UMB_MAP_SIDE_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "width, height: %u x %u texels; sides are 1..%d",
                        settings->width, settings->height, UMB_MAP_SIDE_MAX);
    }
    if (count < 1 || count > UMB_CASCADES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "cascades.count is %u; it must be 1..%d", count,
                        UMB_CASCADES_MAX);
    }
    if ((uint64_t)settings->width * settings->height * count > UMB_DERIVE_TEXELS_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE, "%u maps of %u x %u texels, at most %llu together",
                        count, settings->width, settings->height,
                        (unsigned long long)UMB_DERIVE_TEXELS_MAX);
    }
    if (settings->cascades.count > 0 && settings->width != settings->height) {
        return umb_fail(error, UMB_E_ARGUMENT, "width, height: %u x %u; a cascade is square",
                        settings->width, settings->height);
    }
    if (settings->cascades.count > 0 && !is_whole_frustum(settings->rect)) {
        return umb_fail(error, UMB_E_ARGUMENT, "rect: cascades have none");
    }
    if (map->technique != UMB_MAP_PCF && map->technique != UMB_MAP_VSM &&
        map->technique != UMB_MAP_ESM && map->technique != UMB_MAP_EVSM &&
        map->technique != UMB_MAP_MSM) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "technique: '%s' is not derived; depth, vsm, esm, evsm and msm are",
                        umb_map_technique_name(map->technique));
    }
    if (map->format == UMB_MAP_U24 || map->access == UMB_MAP_SAT) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "format, access: GPUs filter f32, f16 and u16, as they are or by mips");
    }
    if (map->keep_depth) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "keep_depth: a texture has no depths beside it");
    }
    return contrast_check(settings, error);
}

/* Fills in the defaults of exponents that are 0. */
static void fill_in(struct umb_map_settings *map)
{
    const int is_evsm = map->technique == UMB_MAP_EVSM;
    if (map->technique != UMB_MAP_ESM && !is_evsm) {
        return;
    }
    map->linear = 1;
    const double limit = umb_map_exponent_limit(map->format, is_evsm ? 2 : 1);
    if (map->exponent == 0.0) {
        map->exponent = fmin(limit, is_evsm ? EXPONENT_EVSM : EXPONENT_ESM);
    }
    if (is_evsm && map->negative_exponent == 0.0) {
        map->negative_exponent = fmin(limit, EXPONENT_NEGATIVE);
    }
}

/* Makes the frustum of a rectangle of the light's own frustum. */
static void rect_frustum(const struct umb_frustum_info *from, const double origin[3],
                         const struct umb_light_info *light, const struct umb_derived *derived,
                         struct umb_map_frustum *out)
{
    const double size = (double)((uint64_t)1 << from->log2_size);
    const double whole[4] = {0.0, 0.0, size, size};
    const struct umb_derive_settings *settings = &derived->settings;
    const double *rect = is_whole_frustum(settings->rect) ? whole : settings->rect;
    const double scale[3] = {(double)settings->width / (rect[2] - rect[0]),
                             (double)settings->height / (rect[3] - rect[1]), 1.0 / size};
    *out = (struct umb_map_frustum){.projection = UMB_MAP_AFFINE,
                                    .width = settings->width,
                                    .height = settings->height,
                                    .depth_m = 2.0 * size * derived->texel_error_m,
                                    .directional = 1};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 4; k++) {
            out->world_to_map[i][k] = from->world_to_voxel[i][k] * scale[i];
        }
        out->origin[i] = origin[i];
        out->light[i] = -light->direction[i];
    }
    out->world_to_map[0][3] -= rect[0] * scale[0];
    out->world_to_map[1][3] -= rect[1] * scale[1];
    out->world_to_map[3][3] = 1.0;
}

static enum umb_status plan_cascades(const struct umb_light_info *light, const struct umb_box *box,
                                     const struct umb__map_view *view, struct umb_derived *derived,
                                     struct umb_error *error)
{
    const double to_light[3] = {-light->direction[0], -light->direction[1], -light->direction[2]};
    struct umb_cascade_settings *cascades = &derived->settings.cascades;
    struct umb_cascade_plan plan;
    for (uint32_t i = 0; i < UMB_CASCADES_MAX; i++) {
        cascades->resolution[i] = derived->settings.width;
    }
    UMB__TRY(umb__cascades_plan(view, to_light, box, cascades, &plan, error));
    memcpy(derived->frusta, plan.frusta, sizeof derived->frusta);
    memcpy(derived->splits, plan.splits, sizeof derived->splits);
    return UMB_OK;
}

static enum umb_status place_maps(const struct umb_asset *asset,
                                  const struct umb_derive_settings *asked,
                                  const struct umb__map_view *view, struct umb_derived *derived,
                                  struct umb_error *error)
{
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    umb_asset_get_info(asset, &info);
    if (umb_asset_get_light(asset, asked->light, &light) != UMB_OK ||
        umb_asset_get_frustum(asset, light.first_frustum, &frustum) != UMB_OK) {
        return umb_fail(error, UMB_E_NOT_FOUND, "light: %u, the asset's lights are 0 to %u",
                        asked->light, info.light_count - 1);
    }
    if (light.kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "light: %u is not directional", asked->light);
    }
    memcpy(derived->asset_id, info.id, UMB_ID_BYTES);
    derived->texel_error_m = 0.5 * umb__length(frustum.voxel_step[2]);
    if (view != NULL) {
        return plan_cascades(&light, &info.bounds, view, derived, error);
    }
    const double size = (double)((uint64_t)1 << frustum.log2_size);
    if (!is_whole_frustum(asked->rect)) {
        UMB__TRY(rect_check(asked->rect, size, error));
    }
    rect_frustum(&frustum, info.origin, &light, derived, &derived->frusta[0]);
    return UMB_OK;
}

/* Working memory for one row of texels. */
struct row {
    double (*begin)[3]; /* [width] Point of each texel's light ray at depth 0 */
    double *length_m;   /* [width] Length in metres of the ray from depth 0 to depth 1 */
    struct umb_column_answer *columns; /* [width] */
};

static void derive_row(const struct umb_volume *volume, const struct umb_map_frustum *frustum,
                       uint32_t y, const struct row *row, float *depth)
{
    for (uint32_t x = 0; x < frustum->width; x++) {
        double ray[3];
        if (umb_map_frustum_point(frustum, x + 0.5, y + 0.5, 0.0, row->begin[x]) != UMB_OK ||
            umb_map_frustum_point(frustum, x + 0.5, y + 0.5, 1.0, ray) != UMB_OK) {
            memset(row->begin[x], 0, sizeof row->begin[x]);
            row->length_m[x] = 0.0;
            continue;
        }
        umb__subtract(ray, row->begin[x], ray);
        row->length_m[x] = umb__length(ray);
    }
    const struct umb_points points = {
        .positions = row->begin, .format = UMB_POINT_F64, .count = frustum->width};
    struct umb_column_answers answers = {.columns = row->columns};
    umb_volume_columns(volume, &points, 0, points.count, &answers);
    for (uint32_t x = 0; x < frustum->width; x++) {
        const double length_m = row->length_m[x], distance_m = row->columns[x].distance_m;
        depth[x] = 1.0F; /* Without an occluder, or without a ray */
        if (length_m > 0.0 && distance_m < length_m) {
            depth[x] = distance_m > 0.0 ? (float)(distance_m / length_m) : 0.0F;
        }
    }
}

static enum umb_status derive_layer(const struct umb_volume *volume,
                                    const struct umb_derive_settings *asked,
                                    const struct umb_map_frustum *frustum, const struct row *row,
                                    float *depth, struct umb_error *error)
{
    for (uint32_t y = 0; y < frustum->height; y++) {
        if (asked->cancelled != NULL && asked->cancelled(asked->cancel_user)) {
            return umb_fail(error, UMB_E_CANCELLED, "derive: given up at row %u", y);
        }
        derive_row(volume, frustum, y, row, depth + (size_t)y * frustum->width);
    }
    return UMB_OK;
}

static enum umb_status derive_maps(const struct umb_asset *asset,
                                   const struct umb_derive_settings *asked,
                                   const struct umb_alloc *alloc, struct umb_derived *derived,
                                   struct umb_error *error)
{
    const size_t width = asked->width, texels = width * asked->height;
    struct umb_volume volume;
    UMB__TRY(umb_volume_prepare(asset, asked->light, &volume, error));
    UMB__TRY(umb_volume_check_columns(&volume, error));
    enum umb_status status = UMB_OK;
    struct row row = {umb__alloc(alloc, width, sizeof *row.begin),
                      umb__alloc(alloc, width, sizeof *row.length_m),
                      umb__alloc(alloc, width, sizeof *row.columns)};
    float *depth = umb__alloc(alloc, texels, sizeof *depth);
    if (row.begin == NULL || row.length_m == NULL || row.columns == NULL || depth == NULL) {
        status =
            umb_fail(error, UMB_E_NO_MEMORY, "a map of %zu texels does not fit in memory", texels);
    }
    for (uint32_t i = 0; status == UMB_OK && i < derived->count; i++) {
        const struct umb_map_layer layer = {.depth = depth};
        status = derive_layer(&volume, asked, &derived->frusta[i], &row, depth, error);
        if (status == UMB_OK) {
            status = umb_map_build(&derived->frusta[i], &layer, &derived->settings.map, alloc,
                                   &derived->maps[i], error);
        }
    }
    umb__free(alloc, depth);
    umb__free(alloc, row.columns);
    umb__free(alloc, row.length_m);
    umb__free(alloc, row.begin);
    return status;
}

enum umb_status umb__derive(const struct umb_asset *asset,
                            const struct umb_derive_settings *settings,
                            const struct umb__map_view *view, const struct umb_alloc *alloc,
                            struct umb_derived **out, struct umb_error *error)
{
    *out = NULL;
    UMB__TRY(settings_check(settings, error));
    struct umb__derived *whole = umb__alloc_zeroed(alloc, 1, sizeof *whole);
    if (whole == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a derived map does not fit in memory");
    }
    struct umb_derived *derived = &whole->shown;
    if (alloc != NULL) {
        whole->own_alloc = *alloc;
        whole->alloc = &whole->own_alloc;
    }
    derived->count = map_count(settings);
    derived->contrast = whole->contrast;
    derived->settings = *settings;
    derived->settings.camera = NULL;
    derived->settings.cancelled = NULL;
    derived->settings.cancel_user = NULL;
    fill_in(&derived->settings.map);
    enum umb_status status = place_maps(asset, settings, view, derived, error);
    if (status == UMB_OK) {
        status = derive_maps(asset, settings, alloc, derived, error);
    }
    if (status == UMB_OK) {
        struct umb_asset_info info;
        umb_asset_get_info(asset, &info);
        status = umb__derive_contrasts(whole, view, &info.bounds, error);
    }
    if (status != UMB_OK) {
        umb_derived_destroy(derived);
        return status;
    }
    *out = derived;
    return UMB_OK;
}

enum umb_status umb_derive(const struct umb_asset *asset,
                           const struct umb_derive_settings *settings,
                           const struct umb_alloc *alloc, struct umb_derived **out,
                           struct umb_error *error)
{
    struct umb__map_view view;
    *out = NULL;
    if (settings->cascades.count == 0) {
        return umb__derive(asset, settings, NULL, alloc, out, error);
    }
    if (settings->camera == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "camera: NULL, %u cascades need one",
                        settings->cascades.count);
    }
    UMB__TRY(umb__map_view_make(settings->camera, &view, error));
    return umb__derive(asset, settings, &view, alloc, out, error);
}

void umb_derived_destroy(struct umb_derived *derived)
{
    if (derived == NULL) {
        return;
    }
    for (uint32_t i = 0; i < derived->count; i++) {
        umb_map_destroy(derived->maps[i]);
    }
    struct umb__derived *whole = (struct umb__derived *)(void *)derived;
    const struct umb_alloc own_alloc = whole->own_alloc;
    umb__free(whole->alloc, whole->file);
    umb__free(whole->alloc != NULL ? &own_alloc : NULL, whole);
}
