/* SPDX-License-Identifier: Apache-2.0 */
/* Powers of the lights of a picture; see picture_light.h. */
#include "study/picture_light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

#define COARSE_WIDTH  96 /* pixels of the view by which powers are scaled */
#define COARSE_HEIGHT 54
#define BRIGHT_SHARE  0.15 /* share of the points that may get more than 1 */
#define SAME_LIGHT    1e-4 /* greatest difference of a light in file and asset, as a share */

struct umbt_picture_light umbt_picture_sun(const struct umbt_setup *setup)
{
    struct umbt_picture_light light = {.power = {1.0, 1.0, 1.0}};
    memcpy(light.to_light, setup->to_light, sizeof light.to_light);
    return light;
}

/* Returns the share of a spot's light in a direction (KHR_lights_punctual: the square of a share
 * that is linear between both cosines). */
static double cone_share(const struct umbt_picture_light *light, const double towards[3])
{
    if (!(light->cone[0] > light->cone[1])) {
        return 1.0;
    }
    const double cosine = -umb__dot(towards, light->lamp->direction);
    const double line = (cosine - light->cone[1]) / (light->cone[0] - light->cone[1]);
    return line <= 0.0 ? 0.0 : line >= 1.0 ? 1.0 : line * line;
}

double umbt_picture_light_at(const struct umbt_picture_light *light, const double position[3],
                             const double normal[3], double *share)
{
    double towards[3], way[3];
    (void)umbt_towards_light(light->lamp, light->to_light, position, towards);
    *share = 1.0;
    if (light->lamp != NULL && light->reference_m > 0.0) {
        umb__subtract(light->lamp->position, position, way);
        const double near = 1e-3 * light->reference_m;
        *share = light->reference_m * light->reference_m / (umb__dot(way, way) + near * near);
        *share *= cone_share(light, towards);
    }
    return umb__dot(normal, towards);
}

/* 1 if an asset's light is a light of the scene file. */
static int is_same(const struct umbt_picture_light *light, const struct umbs_light *file,
                   double diagonal_m)
{
    const int is_lamp = light->lamp != NULL;
    double off = 0.0;
    if (is_lamp ? file->kind != (uint32_t)light->lamp->kind : file->kind != UMB_LIGHT_DIRECTIONAL) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        off = fmax(off, is_lamp ? fabs(light->lamp->position[k] - file->position[k]) / diagonal_m
                                : fabs(light->to_light[k] + file->direction[k]));
    }
    return off <= SAME_LIGHT;
}

/* Takes intensities and colours from the scene file. Returns 0 if its lights are not the asset's;
 * the powers are 1 then. */
static int powers_take(const struct umbs_scene_view *file, double diagonal_m,
                       const uint32_t *numbers, uint32_t total, struct umbt_picture_light *lights,
                       uint32_t count)
{
    int known = file->light_count == total;
    for (uint32_t i = 0; i < count; i++) {
        known = known && is_same(&lights[i], &file->lights[numbers[i]], diagonal_m) &&
                file->lights[numbers[i]].intensity > 0.0;
    }
    for (uint32_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            lights[i].power[k] =
                known ? file->lights[numbers[i]].intensity * file->lights[numbers[i]].color[k]
                      : 1.0;
        }
        lights[i].reference_m = lights[i].lamp != NULL ? 1.0 : 0.0;
        if (known && file->lights[numbers[i]].kind == UMB_LIGHT_SPOT) {
            lights[i].cone[0] = cos(file->lights[numbers[i]].inner_cone);
            lights[i].cone[1] = cos(file->lights[numbers[i]].outer_cone);
        }
    }
    return known;
}

/* Returns the light that a share BRIGHT_SHARE of the points exceeds, from lights `first` to `last`
 * - 1 without shadows. The brightest channel counts. The result is 0 if hardly a point faces the
 * lights. values: float[receivers].
 */
static double bright_value(const struct umbt_gbuffer *view, const struct umbt_picture_light *lights,
                           uint32_t first, uint32_t last, double *values)
{
    size_t count = 0;
    for (size_t p = 0; p < view->receiver_count; p++) {
        double normal[3], sum = 0.0, share;
        umbt_widen(view->normals[p], normal);
        for (uint32_t i = first; i < last; i++) {
            const double *power = lights[i].power;
            const double most = fmax(fmax(power[0], power[1]), power[2]);
            const double facing =
                umbt_picture_light_at(&lights[i], view->positions[p], normal, &share);
            sum += most * share * fmax(facing, 0.0);
        }
        if (sum > 0.0) {
            values[count++] = sum;
        }
    }
    qsort(values, count, sizeof *values, umbt_compare_doubles);
    return count > 0 ? values[(size_t)((1.0 - BRIGHT_SHARE) * (double)(count - 1))] : 0.0;
}

static void powers_scale(struct umbt_picture_light *lights, uint32_t first, uint32_t last,
                         double bright)
{
    for (uint32_t i = first; i < last && bright > 0.0; i++) {
        for (int k = 0; k < 3; k++) {
            lights[i].power[k] /= bright;
        }
    }
}

static enum umb_status powers_fit(const struct umbt_gbuffer *view, int known,
                                  struct umbt_picture_light *lights, uint32_t count,
                                  struct umb_error *error)
{
    double *values = calloc(view->receiver_count + 1, sizeof *values);
    if (values == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %u lights", count);
    }
    for (uint32_t i = 0; i < count && !known; i++) {
        powers_scale(lights, i, i + 1, bright_value(view, lights, i, i + 1, values));
    }
    powers_scale(lights, 0, count, bright_value(view, lights, 0, count, values));
    free(values);
    return UMB_OK;
}

enum umb_status umbt_picture_lights_weigh(const struct umbt_setup *setup,
                                          const struct umbt_ground *ground, const uint32_t *numbers,
                                          uint32_t total, struct umbt_picture_light *lights,
                                          uint32_t count, struct umb_error *error)
{
    const struct umbt_scene *scene = setup->scene;
    const int known =
        powers_take(&scene->scene->view, scene->diagonal_m, numbers, total, lights, count);
    if (count == 1 && lights[0].lamp == NULL) {
        const double *power = lights[0].power;
        powers_scale(lights, 0, 1, fmax(fmax(power[0], power[1]), power[2]));
        return UMB_OK;
    }
    struct umbt_gbuffer view = {0};
    enum umb_status status = umbt_gbuffer_init(&view, COARSE_WIDTH, 1, COARSE_HEIGHT, error);
    view.ground = *ground;
    if (status == UMB_OK) {
        status = umbt_gbuffer_fill(&view, scene, &setup->camera, COARSE_HEIGHT, 0, COARSE_HEIGHT, 1,
                                   error);
    }
    if (status == UMB_OK) {
        status = powers_fit(&view, known, lights, count, error);
    }
    umbt_gbuffer_finish(&view);
    return status;
}
