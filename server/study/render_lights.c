/* SPDX-License-Identifier: Apache-2.0 */
/* The lights of a rendered picture; see render_lights.h. */
#include "study/render_lights.h"

#include <stdlib.h>
#include <string.h>
#include "base/try.h"

enum umb_status umbt_read_light(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error)
{
    struct umbt_light_list *list = field;
    const char *at = text;
    uint64_t number;
    int good = umbu_read_count(&at, &number) && *at == '\0' && number < UMB_LIGHTS_MAX &&
               list->count < UMBT_LIGHTS_MAX;
    for (uint32_t i = 0; good && i < list->count; i++) {
        good = list->numbers[i] != number;
    }
    if (!good) {
        return umbu_refuse(option, text, error);
    }
    list->numbers[list->count++] = (uint32_t)number;
    return UMB_OK;
}

/* Decides which lights are drawn, in the order of their numbers, once the first is open. */
static void lights_choose(struct umbt_render_lights *lights, const struct umbt_light_list *wanted,
                          int one)
{
    const uint32_t all = lights->sources[0].light_count;
    lights->count = wanted->count > 0 ? wanted->count : one || all > UMBT_LIGHTS_MAX ? 1 : all;
    lights->left_out = wanted->count == 0 ? all - lights->count : 0;
    for (uint32_t i = 0; i < lights->count; i++) {
        lights->numbers[i] = wanted->count > 0 ? wanted->numbers[i] : i;
    }
}

static int compare_numbers(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

enum umb_status umbt_render_lights_open(struct umbt_render_lights *lights,
                                        const struct umbt_light_list *wanted, int one,
                                        const char *asset, const struct umbu_session *daemon,
                                        const struct umb_query_settings *settings,
                                        struct umb_error *error)
{
    struct umb_query_settings first = *settings;
    struct umbt_light_list sorted = *wanted;
    struct umbt_shadow_source *sources = lights->sources;
    memset(lights, 0, sizeof *lights);
    qsort(sorted.numbers, sorted.count, sizeof sorted.numbers[0], compare_numbers);
    first.light = sorted.count > 0 ? sorted.numbers[0] : 0;
    enum umb_status status = umbt_shadow_source_open(&sources[0], asset, daemon, &first, error);
    if (status != UMB_OK) {
        return status;
    }
    lights_choose(lights, &sorted, one);
    for (uint32_t i = 1; i < lights->count && status == UMB_OK; i++) {
        status = umbt_shadow_source_of_light(&sources[i], &sources[0], lights->numbers[i], error);
    }
    if (status != UMB_OK) {
        umbt_render_lights_close(lights);
    }
    return status;
}

void umbt_render_lights_close(struct umbt_render_lights *lights)
{
    for (uint32_t i = UMBT_LIGHTS_MAX; i-- > 0;) { /* the first lends its asset to the others */
        umbt_shadow_source_close(&lights->sources[i]);
    }
    memset(lights, 0, sizeof *lights);
}

void umbt_direction_to(const struct umb_light_info *light, int z_up, double to_light[3])
{
    for (int k = 0; k < 3; k++) {
        to_light[k] = light->kind == UMB_LIGHT_POINT ? k == (z_up ? 2 : 1) : -light->direction[k];
    }
}

static void truth_set(struct umbt_render_lights *lights, uint32_t i, const struct umbt_scene *scene,
                      enum umbt_truth_kind kind, uint32_t samples)
{
    const struct umbt_shadow_source *source = &lights->sources[i];
    const struct umb_light_info *light = &source->light;
    struct umbt_truth *truth = &lights->truths[i];
    *truth =
        umbt_truth_of(scene, lights->lights[i].to_light, source->info.origin, &source->frustum);
    truth->kind = kind;
    truth->settings = source->settings;
    truth->samples = samples;
    truth->extent =
        source->settings.light_extent > 0 ? source->settings.light_extent : light->extent;
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        truth->lamp = light;
        truth->frusta = source->frusta;
        truth->frustum_count = light->frustum_count;
    }
}

void umbt_render_lights_set(struct umbt_render_lights *lights, const struct umbt_scene *scene,
                            int z_up, enum umbt_truth_kind kind, uint32_t samples)
{
    for (uint32_t i = 0; i < lights->count; i++) {
        const struct umb_light_info *light = &lights->sources[i].light;
        struct umbt_picture_light *part = &lights->lights[i];
        *part =
            (struct umbt_picture_light){.source = &lights->sources[i],
                                        .truth = &lights->truths[i],
                                        .lamp = light->kind != UMB_LIGHT_DIRECTIONAL ? light : NULL,
                                        .power = {1.0, 1.0, 1.0}};
        umbt_direction_to(light, z_up, part->to_light);
        truth_set(lights, i, scene, kind, samples);
    }
}
