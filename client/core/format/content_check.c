/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What must hold for lights and frusta before anything is computed from them. Run by the writer on
 * what a program hands over, and by the reader on what a file says.
 */
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/utf8.h"
#include "format/canonical.h"

static bool all_finite(const double *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

/*
 * Inverts the linear part of world_to_voxel into world vectors of one voxel. The cofactor form
 * keeps about 15 digits for the well-conditioned (orthogonal rows) matrices of light frames.
 */
static bool derive_voxel_step(const struct umb_frustum_info *frustum, double step[3][3])
{
    const double(*m)[4] = frustum->world_to_voxel;
    double cofactor[3][3];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            cofactor[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
    }
    double determinant =
        m[0][0] * cofactor[0][0] + m[0][1] * cofactor[0][1] + m[0][2] * cofactor[0][2];
    if (!isfinite(determinant) || determinant == 0.0) {
        return false;
    }
    for (int axis = 0; axis < 3; axis++) {
        for (int k = 0; k < 3; k++) {
            step[axis][k] = cofactor[axis][k] / determinant;
        }
    }
    return all_finite(&step[0][0], 9);
}

static enum umb_status check_light(const struct umb_content *content, uint32_t i,
                                   struct umb_error *error)
{
    const struct umb_light_info *light = &content->lights[i];
    const char *name_end = memchr(light->name, '\0', UMB_NAME_SIZE);
    uint32_t max_frusta = light->kind == UMB_LIGHT_POINT ? 6 : 1;
    if (name_end == NULL ||
        !umb__utf8_valid((const uint8_t *)light->name, (size_t)(name_end - light->name))) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u].name: must be UTF-8 text of at most %d bytes", i,
                        UMB_NAME_SIZE - 1);
    }
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        return umb_fail(error, UMB_E_VERSION, "lights[%u].kind: %d, this reader knows directional",
                        i, (int)light->kind);
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
    double length = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (!(fabs(length - 1.0) < 1e-6)) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u].direction: (%g, %g, %g), must be a unit vector", i, d[0], d[1],
                        d[2]);
    }
    if (!all_finite(light->position, 3) || !isfinite(light->extent) || light->extent < 0) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "lights[%u]: position (%g, %g, %g) and extent %g must be finite, extent "
                        "not below 0",
                        i, light->position[0], light->position[1], light->position[2],
                        light->extent);
    }
    return UMB_OK;
}

static enum umb_status check_frustum(const struct umb_content *content, uint32_t i,
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
    if (!all_finite(&frustum->world_to_voxel[0][0], 16) || last[0] != 0 || last[1] != 0 ||
        last[2] != 0 || last[3] != 1) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta[%u].world_to_voxel: not finite and affine",
                        i);
    }
    if (!derive_voxel_step(frustum, step)) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta[%u].world_to_voxel: not invertible", i);
    }
    return UMB_OK;
}

enum umb_status umb__content_check(const struct umb_content *content, struct umb_error *error)
{
    if (content->light_count < 1 || content->light_count > UMB_LIGHTS_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "lights: %u, allowed 1 to %d", content->light_count,
                        UMB_LIGHTS_MAX);
    }
    if (content->frustum_count < 1 || content->frustum_count > UMB_FRUSTA_MAX) {
        return umb_fail(error, UMB_E_CORRUPT, "frusta: %u, allowed 1 to %d",
                        content->frustum_count, UMB_FRUSTA_MAX);
    }
    if (!all_finite(content->origin, 3) || !all_finite(content->bounds.min, 3) ||
        !all_finite(content->bounds.max, 3)) {
        return umb_fail(error, UMB_E_CORRUPT, "scene: origin or bounds not finite");
    }
    enum umb_status status = UMB_OK;
    for (uint32_t i = 0; i < content->light_count && status == UMB_OK; i++) {
        status = check_light(content, i, error);
    }
    for (uint32_t i = 0; i < content->frustum_count && status == UMB_OK; i++) {
        status = check_frustum(content, i, error);
    }
    return status;
}

void umb__content_derive(struct umb_content *content)
{
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        (void)derive_voxel_step(&content->frusta[i], content->frusta[i].voxel_step);
    }
}
