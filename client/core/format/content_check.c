/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Checks lights and frusta before anything is computed from them. The writer checks a program's
 * content, the reader a file's.
 */
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/try.h"
#include "base/utf8.h"
#include "base/vec.h"
#include "format/canonical.h"
#include "format/occluder_depth.h"
#include "format/layout.h"
#include "format/transmittance.h"
#include "umbrage/curve.h"

/*
 * Inverts a matrix of three rows: step[i] is the world vector that changes row i by one and the
 * other two rows not at all. Cofactors keep about 15 digits for the matrices of light frames, whose
 * rows are orthogonal. Returns false if the matrix is singular.
 */
static bool invert_rows(const double *const rows[3], double step[3][3])
{
    double cofactor[3][3];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            cofactor[i][j] = rows[a][c] * rows[b][d] - rows[a][d] * rows[b][c];
        }
    }
    const double determinant = umb__dot(rows[0], cofactor[0]);
    if (!isfinite(determinant) || determinant == 0.0) {
        return false;
    }
    for (int axis = 0; axis < 3; axis++) {
        for (int k = 0; k < 3; k++) {
            step[axis][k] = cofactor[axis][k] / determinant;
        }
    }
    return umb__all_finite(&step[0][0], 9);
}

int umb__perspective_derive(const struct umb_frustum_info *frustum,
                            struct umb__perspective *perspective)
{
    const double(*m)[4] = frustum->world_to_voxel;
    const double *w = m[3];
    const double *const rows[3] = {m[0], m[1], w};
    const double square = umb__dot(w, w);
    double(*step)[3] = perspective->step;
    if (!(square > 0) || !invert_rows(rows, step)) {
        return 0;
    }
    memcpy(perspective->axis, step[2], sizeof perspective->axis);
    const double rate = umb__dot(m[2], w) / square;
    if (!(rate > 0)) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        step[2][k] = w[k] / square / rate;
        /* Depth must depend on W alone, up to the rounding of doubles, which is about 1e-16. */
        if (!(fabs(m[2][k] - rate * w[k]) <= 1e-9 * fabs(rate) * sqrt(square))) {
            return 0;
        }
    }
    const double size = (double)((uint32_t)1 << frustum->log2_size);
    perspective->scale = 1 / rate;
    perspective->offset = w[3] - perspective->scale * m[2][3];
    const double far_w = perspective->offset + perspective->scale * size;
    return umb__all_finite(step[2], 3) && far_w > 0 && isfinite(far_w);
}

/* Computes voxel_step of struct umb_frustum_info. Returns false if the transform is unsound. */
static bool derive_voxel_step(const struct umb_frustum_info *frustum, double step[3][3])
{
    struct umb__perspective perspective;
    if (!umb__is_perspective(frustum)) {
        const double(*m)[4] = frustum->world_to_voxel;
        const double *const rows[3] = {m[0], m[1], m[2]};
        return invert_rows(rows, step);
    }
    const bool is_sound = umb__perspective_derive(frustum, &perspective);
    if (is_sound) {
        memcpy(step, perspective.step, sizeof perspective.step);
    }
    return is_sound;
}

/* Checks the side vector of a light. A rectangle's side is perpendicular to the light's direction,
 * up to the rounding of doubles; other lights have no side. */
static enum umb_status check_side(const struct umb_light_info *light, uint32_t i,
                                  struct umb_error *error)
{
    const double *s = light->side, length = umb__length(s);
    const bool is_across = fabs(umb__dot(s, light->direction)) <= 1e-9 * length;
    const bool is_allowed = length == 0 || light->kind == UMB_LIGHT_RECTANGLE;
    return umb__all_finite(s, 3) && isfinite(length) && is_across && is_allowed
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT,
                          "lights[%u].side: (%g, %g, %g), must be finite and across the direction "
                          "of a rectangle, and 0 for other lights",
                          i, s[0], s[1], s[2]);
}

static enum umb_status check_light(const struct umb__content *content, uint32_t i,
                                   struct umb_error *error)
{
    const struct umb_light_info *light = &content->lights[i];
    const char *name_end = memchr(light->name, '\0', UMB_NAME_SIZE);
    uint32_t max_frusta = light->kind == UMB_LIGHT_DIRECTIONAL ? 1 : 6;
    if (name_end == NULL ||
        !umb__utf8_valid((const uint8_t *)light->name, (size_t)(name_end - light->name))) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u].name: must be UTF-8 text of at most %d bytes", i,
                        UMB_NAME_SIZE - 1);
    }
    if ((unsigned)light->kind >= UMB_LIGHT_KINDS) {
        return umb_fail(error, UMB_E_VERSION, "lights[%u].kind: %d, this reader knows 0 to %d", i,
                        (int)light->kind, UMB_LIGHT_KINDS - 1);
    }
    if (light->frustum_count < 1 || light->frustum_count > max_frusta ||
        light->first_frustum > content->frustum_count ||
        light->frustum_count > content->frustum_count - light->first_frustum) {
        return umb_fail(error, UMB_E_CORRUPT, "lights[%u]: frusta %u + %u, the asset has %u", i,
                        light->first_frustum, light->frustum_count, content->frustum_count);
    }
    for (uint32_t f = 0; f < light->frustum_count; f++) {
        uint32_t owner = content->frusta[light->first_frustum + f].light;
        if (owner != i) {
            return umb_fail(error, UMB_E_CORRUPT, "lights[%u]: its frustum %u names light %u", i,
                            light->first_frustum + f, owner);
        }
    }
    const double *d = light->direction;
    const double wanted = light->kind == UMB_LIGHT_POINT ? 0.0 : 1.0;
    if (!(fabs(umb__dot(d, d) - wanted) < 1e-6)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u].direction: (%g, %g, %g), must have length %g", i, d[0], d[1],
                        d[2], wanted);
    }
    if (!umb__all_finite(light->position, 3) || !isfinite(light->extent) || light->extent < 0) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u]: position (%g, %g, %g) and extent %g must be finite, extent "
                        "not below 0",
                        i, light->position[0], light->position[1], light->position[2],
                        light->extent);
    }
    UMB__TRY(check_side(light, i, error));
    return content->receiver_mask_cells == NULL || light->kind == UMB_LIGHT_DIRECTIONAL
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT,
                          "lights[%u]: the static rule is for directional lights", i);
}

static enum umb_status check_frustum(const struct umb__content *content, uint32_t i,
                                     struct umb_error *error)
{
    const struct umb_frustum_info *frustum = &content->frusta[i];
    double step[3][3];
    if (frustum->log2_size < UMB_LEVEL_MIN || frustum->log2_size > UMB_LEVEL_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta[%u].log2_size: %u, allowed %d to %d", i,
                        frustum->log2_size, UMB_LEVEL_MIN, UMB_LEVEL_MAX);
    }
    if (frustum->light >= content->light_count) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta[%u].light: %u, the asset has %u", i,
                        frustum->light, content->light_count);
    }
    const struct umb_light_info *light = &content->lights[frustum->light];
    if (i < light->first_frustum || i - light->first_frustum >= light->frustum_count) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta[%u]: not among those of its light %u", i,
                        frustum->light);
    }
    const double *last = frustum->world_to_voxel[3];
    const bool affine = !umb__is_perspective(frustum) && last[3] == 1;
    if (!umb__all_finite(&frustum->world_to_voxel[0][0], 16) ||
        affine != (light->kind == UMB_LIGHT_DIRECTIONAL)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "frusta[%u].world_to_voxel: not finite, or its last row (%g, %g, %g, %g) "
                        "does not fit its light's kind",
                        i, last[0], last[1], last[2], last[3]);
    }
    if (!derive_voxel_step(frustum, step)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "frusta[%u].world_to_voxel: not invertible, depth does not follow the "
                        "axis, or its far side is not ahead of the light",
                        i);
    }
    return UMB_OK;
}

uint32_t umb_level_max(uint32_t log2_size)
{
    const uint32_t least = log2_size > UMB__GRID_LOG2_MAX + UMB_LEVEL_BRICK
                               ? log2_size - UMB__GRID_LOG2_MAX
                               : UMB_LEVEL_BRICK;
    return least | 1U;
}

/* Returns the highest level of coarse look-ups that all frusta of a light allow; 0: none. */
static uint32_t coarse_level_max(const struct umb__content *content, uint32_t light)
{
    const struct umb_light_info *info = &content->lights[light];
    return info->kind == UMB_LIGHT_DIRECTIONAL
               ? umb_level_max(content->frusta[info->first_frustum].log2_size)
               : 0;
}

static bool record_in_range(const struct umb__content *content,
                            const struct umb__curve_record *record)
{
    const uint64_t points = record->points;
    return record->light < content->light_count && points >= 1 && points <= UMB__CURVE_POINTS_MAX &&
           (record->level == 0 ||
            (record->level % 2 == 1 && record->level >= UMB_LEVEL_BRICK && record->taps == 1 &&
             record->level <= coarse_level_max(content, record->light))) &&
           record->taps % 2 == 1 && record->taps <= UMB_TAPS_MAX &&
           record->nodes <= points * UMB__CURVE_READS_MAX && record->lines >= points &&
           record->lines <= points * UMB__CURVE_READS_MAX &&
           record->squares <= points * UMB__CURVE_SQUARE;
}

/* Returns true if record a comes before record b in the order by light, then level, then taps. */
static bool record_before(const struct umb__curve_record *a, const struct umb__curve_record *b)
{
    const uint32_t x[3] = {a->light, a->level, a->taps}, y[3] = {b->light, b->level, b->taps};
    for (int i = 0; i < 3; i++) {
        if (x[i] != y[i]) {
            return x[i] < y[i];
        }
    }
    return false;
}

static enum umb_status check_curve(const struct umb__content *content, struct umb_error *error)
{
    for (uint32_t i = 0; i < content->curve_count; i++) {
        const struct umb__curve_record *record = &content->curve[i];
        if (!record_in_range(content, record) ||
            (i > 0 && !record_before(&content->curve[i - 1], record))) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "curve[%u]: light %u, level %u, %u taps: out of order, or %u points "
                            "with sums out of range",
                            i, record->light, record->level, record->taps, record->points);
        }
    }
    return UMB_OK;
}

enum umb_status umb__content_check(const struct umb__content *content, struct umb_error *error)
{
    if (content->light_count < 1 || content->light_count > UMB_LIGHTS_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "lights: %u, allowed 1 to %d", content->light_count,
                        UMB_LIGHTS_MAX);
    }
    if (content->frustum_count < 1 || content->frustum_count > UMB_FRUSTA_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta: %u, allowed 1 to %d", content->frustum_count,
                        UMB_FRUSTA_MAX);
    }
    if (!umb__all_finite(content->origin, 3) || !umb__all_finite(content->bounds.min, 3) ||
        !umb__all_finite(content->bounds.max, 3)) {
        return umb_fail(error, UMB_E_CORRUPT, "scene: origin or bounds not finite");
    }
    for (uint32_t i = 0; i < content->light_count; i++) {
        UMB__TRY(check_light(content, i, error));
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        UMB__TRY(check_frustum(content, i, error));
    }
    UMB__TRY(check_curve(content, error));
    if (content->transmittance != NULL) {
        UMB__TRY(umb__transmittance_check(content->transmittance, content->transmittance_bytes,
                                          content->frusta, content->frustum_count, error));
    }
    return content->occluder_depth != NULL
               ? umb__occluder_depth_check(content->occluder_depth, content->occluder_depth_words,
                                           content->frusta, content->frustum_count, error)
               : UMB_OK;
}

void umb__content_derive(struct umb__content *content)
{
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        (void)derive_voxel_step(&content->frusta[i], content->frusta[i].voxel_step);
    }
}

void umb_frustum_voxel_edges(const struct umb_frustum_info *frustum, double edges[3])
{
    const double(*m)[4] = frustum->world_to_voxel;
    double reach = 1.0; /* W at the depth of the last voxel; 1 for a directional light */
    for (int axis = 2; axis >= 0; axis--) {
        const double *step = frustum->voxel_step[axis];
        const double length = umb__length(step);
        if (axis == 2 && umb__is_perspective(frustum)) {
            /* A step along the axis changes Z by `rate` and W by `turn`. At the far end Z is
             * `size`. */
            const double *w = m[3];
            const double rate = umb__dot(m[2], step), turn = umb__dot(w, step);
            const double size = (double)((uint32_t)1 << frustum->log2_size);
            reach = w[3] + (size - m[2][3]) * turn / rate;
        }
        edges[axis] = axis == 2 ? length : length * reach;
    }
}
