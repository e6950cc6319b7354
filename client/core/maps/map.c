/* SPDX-License-Identifier: Apache-2.0 */
/* Building, querying and freeing maps of any technique; see umbrage/maps.h. */
#include <string.h>
#include "base/memory.h"
#include "base/reserved.h"
#include "base/try.h"
#include "maps/deep_parts.h"
#include "maps/map_channels.h"

_Static_assert(sizeof(struct umb__map_query) <= sizeof(struct umb_map_query),
               "a prepared query fits its storage");

static const struct umb__technique *const techniques[UMB_MAP_TECHNIQUES] = {
    [UMB_MAP_PCF] = &umb__map_pcf,         [UMB_MAP_VSM] = &umb__map_vsm,
    [UMB_MAP_LVSM] = &umb__map_lvsm,       [UMB_MAP_CONVOLUTION] = &umb__map_convolution,
    [UMB_MAP_ESM] = &umb__map_esm,         [UMB_MAP_EVSM] = &umb__map_evsm,
    [UMB_MAP_MSM] = &umb__map_msm,         [UMB_MAP_DEEP] = &umb__map_deep,
    [UMB_MAP_MOMENTS] = &umb__map_moments, [UMB_MAP_ABSORBANCE] = &umb__map_absorbance,
};

const char *umb_map_technique_name(enum umb_map_technique technique)
{
    return (unsigned)technique < UMB_MAP_TECHNIQUES ? techniques[technique]->name : "unknown";
}

static enum umb_status layer_check(const struct umb_map_frustum *frustum,
                                   const struct umb_map_layer *layer, struct umb_error *error)
{
    if (UMB__UNKNOWN(layer, "layer", error)) {
        return UMB_E_ARGUMENT;
    }
    if (layer->samples > UMB__LAYER_SAMPLES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "layer.samples is %llu; it must be 1..%d",
                        (unsigned long long)layer->samples, UMB__LAYER_SAMPLES_MAX);
    }
    const size_t count = (size_t)frustum->width * frustum->height;
    for (size_t i = 0; i < count * umb__layer_samples(layer); i++) {
        if (!(layer->depth[i] >= 0.0F && layer->depth[i] <= 1.0F)) {
            return umb_fail(error, UMB_E_ARGUMENT, "layer.depth[%zu] is %g; it must be 0..1", i,
                            (double)layer->depth[i]);
        }
    }
    for (size_t i = 0; layer->slope != NULL && i < count; i++) {
        if (!(isfinite(layer->slope[2 * i]) && isfinite(layer->slope[2 * i + 1]))) {
            return umb_fail(error, UMB_E_ARGUMENT, "layer.slope[%zu] is not finite", i);
        }
    }
    return UMB_OK;
}

/* Checks that a technique can average the samples of a layer. */
static enum umb_status samples_check(const struct umb_map_layer *layer,
                                     const struct umb_map_settings *settings,
                                     struct umb_error *error)
{
    return umb__layer_samples(layer) == 1 ||
                   (techniques[settings->technique]->filterable && !settings->depth_plane)
               ? UMB_OK
               : umb_fail(error, UMB_E_UNSUPPORTED,
                          "layer.samples is %llu; '%s'%s takes one depth a texel",
                          (unsigned long long)layer->samples, techniques[settings->technique]->name,
                          settings->depth_plane ? " with depth_plane" : "");
}

static enum umb_status settings_check(const struct umb_map_settings *settings,
                                      struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    if ((unsigned)settings->technique >= UMB_MAP_TECHNIQUES) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.technique %d is unknown",
                        (int)settings->technique);
    }
    if ((unsigned)settings->format > UMB_MAP_U16 || (unsigned)settings->access > UMB_MAP_SAT) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings: format %d or access %d is unknown",
                        (int)settings->format, (int)settings->access);
    }
    if (settings->blur > 63 || (settings->blur > 0 && settings->blur % 2 == 0)) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.blur is %u; it must be odd, 1..63",
                        settings->blur);
    }
    UMB__TRY(umb__check_number("settings.min_variance", settings->min_variance, 0.0, 1.0, error));
    const struct umb__technique *technique = techniques[settings->technique];
    if (settings->keep_depth &&
        (!technique->filterable || technique->weigh != NULL || settings->access == UMB_MAP_BASE)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "settings.keep_depth: '%s' with access %d; it is for filterable maps of "
                        "opaque casters with access %d (MIPS) or %d (SAT)",
                        technique->name, (int)settings->access, UMB_MAP_MIPS, UMB_MAP_SAT);
    }
    if (technique->plain != NULL && settings->format != UMB_MAP_F32 &&
        settings->format != UMB_MAP_U16) {
        return umb_fail(error, UMB_E_UNSUPPORTED, "settings.format: %s are F32 or U16",
                        technique->plain);
    }
    return technique->check != NULL ? technique->check(settings, error) : UMB_OK;
}

/* Checks the frustum and the settings. In: translucent: 1 for the techniques of
 * umb_map_build_translucent, 0 for those of umb_map_build. */
static enum umb_status filtered_check(const struct umb_map_frustum *frustum,
                                      const struct umb_map_settings *settings, int translucent,
                                      struct umb_error *error)
{
    UMB__TRY(umb__frustum_check(frustum, error));
    UMB__TRY(settings_check(settings, error));
    return translucent == (techniques[settings->technique]->weigh != NULL)
               ? UMB_OK
               : umb_fail(error, UMB_E_UNSUPPORTED, "settings.technique: '%s' is built by %s",
                          techniques[settings->technique]->name,
                          translucent ? "umb_map_build" : "umb_map_build_translucent");
}

static double nearest_depth(const struct umb_map_frustum *frustum,
                            const struct umb_map_layer *layer)
{
    float nearest = 1.0F;
    const size_t texels = (size_t)frustum->width * frustum->height;
    for (size_t i = 0; i < texels * umb__layer_samples(layer); i++) {
        nearest = layer->depth[i] < nearest ? layer->depth[i] : nearest;
    }
    return (double)nearest;
}

/* Makes a map without texels. Fails: E_NO_MEMORY. */
static enum umb_status map_create(const struct umb_map_frustum *frustum,
                                  const struct umb_map_settings *settings,
                                  const struct umb_alloc *alloc, struct umb_map **out,
                                  struct umb_error *error)
{
    struct umb_map *map = umb__alloc_zeroed(alloc, 1, sizeof *map);
    if (map == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a map does not fit in memory");
    }
    map->frustum = *frustum;
    map->technique = techniques[settings->technique];
    map->settings = *settings;
    if (alloc != NULL) {
        map->own_alloc = *alloc;
        map->alloc = &map->own_alloc;
    }
    *out = map;
    return UMB_OK;
}

/* Gives a built map to the caller, or destroys the map if the build failed. Returns status. */
static enum umb_status map_give(struct umb_map *map, enum umb_status status, struct umb_map **out)
{
    if (status == UMB_OK) {
        *out = map;
    } else {
        umb_map_destroy(map);
    }
    return status;
}

enum umb_status umb_map_build(const struct umb_map_frustum *frustum,
                              const struct umb_map_layer *layer,
                              const struct umb_map_settings *settings,
                              const struct umb_alloc *alloc, struct umb_map **out,
                              struct umb_error *error)
{
    struct umb_map *map;
    *out = NULL;
    UMB__TRY(filtered_check(frustum, settings, 0, error));
    UMB__TRY(layer_check(frustum, layer, error));
    UMB__TRY(samples_check(layer, settings, error));
    UMB__TRY(map_create(frustum, settings, alloc, &map, error));
    map->nearest = nearest_depth(frustum, layer);
    const struct umb__texels texels = {.layer = layer};
    if (!map->technique->filterable) {
        return map_give(map, umb__depths_init(&map->depths, map, settings->format, layer, error),
                        out);
    }
    enum umb_status status = umb__channels_init(&map->channels, map, &texels, error);
    if (status == UMB_OK && settings->keep_depth) {
        status = umb__depths_init(&map->depths, map, UMB_MAP_F32, layer, error);
    }
    return map_give(map, status, out);
}

static enum umb_status deep_settings_check(const struct umb_map_deep_settings *settings,
                                           struct umb_error *error)
{
    if (UMB__UNKNOWN(settings, "settings", error)) {
        return UMB_E_ARGUMENT;
    }
    UMB__TRY(umb__check_number("settings.epsilon", settings->epsilon, 0.0, 1.0, error));
    if (!(settings->exponent >= 0.0 && settings->exponent <= 1e6)) {
        return umb_fail(error, UMB_E_ARGUMENT, "settings.exponent is %g; it must be 0..1e6",
                        settings->exponent);
    }
    if ((unsigned)settings->way > UMB_MAP_DEEP_STREAM ||
        (settings->way == UMB_MAP_DEEP_STREAM && settings->exponent > 0.0)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "settings.way is %d; it must be 0..3, and not 3 (STREAM) with an exponent",
                        (int)settings->way);
    }
    return UMB_OK;
}

enum umb_status umb_map_build_deep(const struct umb_map_frustum *frustum,
                                   const struct umb_map_fragments *fragments,
                                   const struct umb_map_deep_settings *settings,
                                   const struct umb_alloc *alloc, struct umb_map **out,
                                   struct umb_error *error)
{
    const struct umb_map_settings deep = {.technique = UMB_MAP_DEEP};
    struct umb_map *map;
    *out = NULL;
    UMB__TRY(umb__frustum_check(frustum, error));
    UMB__TRY(deep_settings_check(settings, error));
    UMB__TRY(map_create(frustum, &deep, alloc, &map, error));
    return map_give(map, umb__deep_create(frustum, fragments, settings, alloc, &map->deep, error),
                    out);
}

enum umb_status umb_map_build_translucent(const struct umb_map_frustum *frustum,
                                          const struct umb_map_fragments *fragments,
                                          const struct umb_map_settings *settings,
                                          const struct umb_alloc *alloc, struct umb_map **out,
                                          struct umb_error *error)
{
    struct umb_map *map;
    *out = NULL;
    UMB__TRY(filtered_check(frustum, settings, 1, error));
    UMB__TRY(map_create(frustum, settings, alloc, &map, error));
    return map_give(map, umb__translucent_init(&map->channels, map, fragments, error), out);
}

void umb_map_destroy(struct umb_map *map)
{
    if (map == NULL) {
        return;
    }
    umb__channels_finish(&map->channels, map);
    umb__depths_finish(&map->depths, map);
    umb__deep_destroy(map->deep, map->alloc);
    const struct umb_alloc own_alloc = map->own_alloc;
    umb__free(map->alloc != NULL ? &own_alloc : NULL, map);
}

void umb_map_get_info(const struct umb_map *map, struct umb_map_info *info)
{
    *info = (struct umb_map_info){
        .technique = map->settings.technique,
        .name = map->technique->name,
        .width = map->frustum.width,
        .height = map->frustum.height,
        .channels = map->technique->filterable ? map->channels.count : map->deep == NULL,
        .bytes = map->depths.bytes + map->channels.bytes + (map->deep ? map->deep->bytes : 0),
        .fragments = map->deep != NULL
                         ? map->deep->first[(size_t)map->frustum.width * map->frustum.height]
                         : 0,
        .bound = map->technique->weigh != NULL && map->settings.overestimate > 0.0
                     ? UMB_MAP_ESTIMATE
                     : map->technique->bound,
        .slack = map->technique->slack != NULL ? map->technique->slack(map) : 0.0,
    };
}

enum umb_status umb_map_get_level(const struct umb_map *map, uint32_t level,
                                  struct umb_map_level *out)
{
    const struct umb__channels *channels = &map->channels;
    memset(out, 0, sizeof *out);
    if (!map->technique->filterable) {
        if (level > 0 || map->depths.texels == NULL) {
            return UMB_E_NOT_FOUND;
        }
        *out = (struct umb_map_level){.texels = map->depths.texels,
                                      .width = map->depths.width,
                                      .height = map->depths.height,
                                      .channels = 1,
                                      .format = map->depths.format,
                                      .bytes = map->depths.bytes};
        return UMB_OK;
    }
    if (level >= channels->level_count) {
        return UMB_E_NOT_FOUND;
    }
    *out = (struct umb_map_level){.texels = channels->levels[level],
                                  .width = umb__level_side(channels->width, level),
                                  .height = umb__level_side(channels->height, level),
                                  .channels = channels->count,
                                  .format = channels->format};
    out->bytes = (size_t)out->width * out->height * channels->count *
                 (channels->format == UMB_MAP_F32 ? 4 : 2);
    return UMB_OK;
}

static enum umb_status filter_numbers_check(const struct umb_map *map,
                                            const struct umb_map_filter *filter,
                                            struct umb_error *error)
{
    if (UMB__UNKNOWN(filter, "filter", error)) {
        return UMB_E_ARGUMENT;
    }
    const double largest = map->frustum.directional ? 1.0 : 1e6;
    UMB__TRY(umb__check_number("filter.width", filter->width, 1.0, UMB_MAP_WIDTH_MAX, error));
    UMB__TRY(umb__check_number("filter.bias_m", filter->bias_m, 0.0, 1e6, error));
    UMB__TRY(umb__check_number("filter.bias_slope", filter->bias_slope, 0.0, 100.0, error));
    UMB__TRY(umb__check_number("filter.bias_normal", filter->bias_normal, 0.0, 100.0, error));
    UMB__TRY(umb__check_number("filter.light_size", filter->light_size, 0.0, largest, error));
    UMB__TRY(umb__check_number("filter.reduction", filter->reduction, 0.0, 0.99, error));
    return umb__check_number("filter.contrast", filter->contrast, 1e-6, 1e6, error);
}

static enum umb_status kernel_check(const struct umb_map *map, const struct umb_map_filter *filter,
                                    struct umb_error *error)
{
    const int on_reals = filter->kernel != UMB_MAP_BOX;
    const enum umb_map_technique technique = map->settings.technique;
    if ((unsigned)filter->kernel > UMB_MAP_BILINEAR) {
        return umb_fail(error, UMB_E_ARGUMENT, "filter.kernel %d is unknown", (int)filter->kernel);
    }
    if (on_reals && (technique != UMB_MAP_PCF || filter->light_size > 0.0)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter.kernel: POISSON and BILINEAR are for PCF maps, without light_size");
    }
    if (filter->kernel == UMB_MAP_POISSON &&
        (filter->samples < 1 || filter->samples > UMB_MAP_SAMPLES_MAX)) {
        return umb_fail(error, UMB_E_ARGUMENT, "filter.samples is %u; it must be 1..%d",
                        filter->samples, UMB_MAP_SAMPLES_MAX);
    }
    if (filter->light_size > 0.0 && technique != UMB_MAP_PCF && !map->settings.keep_depth &&
        !(technique == UMB_MAP_VSM && map->settings.access == UMB_MAP_SAT)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "filter.light_size is for PCF maps, VSM with summed-area tables and maps "
                        "built with keep_depth");
    }
    const int on_texels = !map->technique->filterable && !on_reals && filter->light_size == 0.0;
    if (on_texels && (filter->width != floor(filter->width) || fmod(filter->width, 2.0) != 1.0)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "filter.width is %g; a box over texels is odd and whole", filter->width);
    }
    return UMB_OK;
}

enum umb_status umb_map_prepare(const struct umb_map *map, const struct umb_map_filter *filter,
                                struct umb_map_query *query, struct umb_error *error)
{
    struct umb__map_query *q = (struct umb__map_query *)(void *)query;
    memset(query, 0, sizeof *query);
    struct umb_map_filter f = *filter;
    f.width = f.width == 0.0 ? 1.0 : f.width;
    f.contrast = f.contrast == 0.0 ? 1.0 : f.contrast;
    UMB__TRY(filter_numbers_check(map, &f, error));
    UMB__TRY(kernel_check(map, &f, error));
    q->map = map;
    q->filter = f;
    q->taps = (uint32_t)f.width;
    const double base = map->settings.blur > 1 ? (double)map->settings.blur : 1.0;
    q->level = log2(f.width / base);
    if (f.kernel == UMB_MAP_POISSON) {
        umb__poisson_disc(q->kernel, f.samples);
        for (uint32_t i = 0; i < f.samples; i++) {
            q->kernel[i][0] *= 0.5 * f.width;
            q->kernel[i][1] *= 0.5 * f.width;
        }
    }
    return UMB_OK;
}

static double filterable_answer(const struct umb__map_query *q, struct umb__receiver *receiver)
{
    double at[UMB__MAP_CHANNELS_MAX], box = q->filter.width, level = q->level;
    if (q->filter.light_size > 0.0 && q->map->settings.keep_depth) {
        box = umb__penumbra_search(q, receiver);
        if (box == 0.0) {
            return 1.0;
        }
        level += log2(box / q->filter.width);
    }
    /* A filterable technique compares with a single depth of the receiver, so all biases are
     * applied to that depth. */
    const double width = q->filter.light_size > 0.0 ? 1.0 : q->filter.width;
    receiver->depth = fmin(umb__biased_depth(q, receiver, width), 1.0);
    if (!(receiver->depth > 0.0)) {
        return 1.0;
    }
    umb__channels_fetch(&q->map->channels, receiver->x, receiver->y, level, box, at);
    return q->map->technique->answer(q, receiver, at);
}

static double point_answer(const struct umb__map_query *q, const struct umb_points *points,
                           size_t index)
{
    struct umb__receiver receiver;
    umb__receiver_make(&q->map->frustum, &q->filter, points, index, &receiver);
    if (receiver.place != UMB__RECEIVER_INSIDE) {
        return receiver.place == UMB__RECEIVER_OUTSIDE ? 1.0 : 0.0;
    }
    const double visibility = q->map->technique->filterable
                                  ? filterable_answer(q, &receiver)
                                  : q->map->technique->answer(q, &receiver, NULL);
    const double rest = visibility - q->filter.reduction;
    return rest > 0.0 ? rest / (1.0 - q->filter.reduction) : 0.0;
}

void umb_map_run(const struct umb_map_query *query, const struct umb_points *points, size_t first,
                 size_t count, float *values)
{
    const struct umb__map_query *q = (const struct umb__map_query *)(const void *)query;
    for (size_t i = first; i < first + count; i++) {
        values[i] = (float)point_answer(q, points, i);
    }
}
