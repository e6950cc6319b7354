/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Translucent surfaces before the opaque ones, as receivers of a G-buffer (gbuffer.h).
 *
 * Threads collect the surfaces of blocks of sub-samples in lists of their own. The lists are joined
 * in the order of the blocks, so the result is the same for every number of threads.
 */
#include "study/gbuffer.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/try.h"
#include "tool/threads.h"
#include "study/study_math.h"

enum {
    BLOCK = 1024,     /* sub-samples */
    LAYERS_MAX = 256, /* surfaces of a ray; what lies behind is left out */
};

/* Share of light at which a ray ends: less than half a step of an 8-bit picture. */
#define LEAST_LIGHT 0.002

/* A translucent surface at a place. */
struct layer {
    double position[3];
    float normal[3];
    float opacity;
    uint32_t sample, triangle;
};

/* Surfaces of a block, sub-sample by sub-sample, the nearest first. */
struct layer_list {
    struct layer *layers; /* [count] */
    size_t count, capacity;
};

struct search {
    const struct umbt_gbuffer *buffer;
    const struct umbt_scene *scene;
    const struct umbt_camera *camera;
    uint32_t height;
    double far_m;
    struct layer_list *lists; /* one a block */
};

/* Returns the distance of the opaque surface that a sub-sample sees. A translucent surface that
 * lies on it counts as before it. */
static double opaque_distance(const struct search *search, size_t sample)
{
    const uint32_t slot = search->buffer->slots[sample];
    double way[3];
    if (slot == UMBT_SKY) {
        return search->far_m;
    }
    umb__subtract(search->buffer->positions[slot], search->camera->eye, way);
    return (1.0 + 1e-6) * umb__length(way);
}

static enum umb_status sample_search(const struct search *search, size_t sample,
                                     struct layer_list *list, struct umb_error *error)
{
    struct umbr_layer found[LAYERS_MAX];
    const double *eye = search->camera->eye;
    double direction[3];
    umbt_gbuffer_direction(search->buffer, search->camera, search->height, sample, direction);
    const size_t count =
        umbr_layers_find(umbt_seen_layers(search->scene), eye, direction,
                         opaque_distance(search, sample), LEAST_LIGHT, found, LAYERS_MAX);
    if (!umb__grow(NULL, &list->layers, &list->capacity, list->count + count,
                   sizeof *list->layers)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu translucent surfaces do not fit in memory",
                        list->count + count);
    }
    for (size_t i = 0; i < count; i++) {
        double normal[3];
        umb__triangle_cross((const double(*)[3])search->scene->corners[found[i].triangle], normal);
        if (!(umbt_normalize(normal) > 0.0)) {
            continue;
        }
        struct layer *layer = &list->layers[list->count++];
        const double side = umb__dot(normal, direction) > 0.0 ? -1.0 : 1.0;
        umbt_along(eye, found[i].distance, direction, layer->position);
        for (int k = 0; k < 3; k++) {
            layer->normal[k] = (float)(side * normal[k]);
        }
        layer->opacity = (float)found[i].opacity;
        layer->sample = (uint32_t)sample;
        layer->triangle = found[i].triangle;
    }
    return UMB_OK;
}

static enum umb_status block_search(void *user, size_t first, size_t count, struct umb_error *error)
{
    const struct search *search = user;
    for (size_t i = first; i < first + count; i++) {
        UMB__TRY(sample_search(search, i, &search->lists[first / BLOCK], error));
    }
    return UMB_OK;
}

/* Makes *array `count` items long. Returns 0 without memory; the array then is as it was. */
static int resize(void *array, size_t count, size_t item_bytes)
{
    void *old;
    memcpy(&old, array, sizeof old);
    void *grown = realloc(old, count * item_bytes);
    if (grown != NULL) {
        memcpy(array, &grown, sizeof grown);
    }
    return grown != NULL;
}

/* Makes room for that many translucent receivers behind the opaque ones. */
static enum umb_status room_make(struct umbt_gbuffer *buffer, size_t layers,
                                 struct umb_error *error)
{
    const size_t receivers = buffer->receiver_count + layers;
    int good = 1;
    if (receivers >= UMBT_GROUND) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu translucent surfaces in a band of a picture",
                        layers);
    }
    if (receivers > buffer->capacity) {
        good = resize(&buffer->positions, receivers, sizeof *buffer->positions) &&
               resize(&buffer->normals, receivers, sizeof *buffer->normals) &&
               resize(&buffer->triangles, receivers, sizeof *buffer->triangles);
        buffer->capacity = good ? receivers : buffer->capacity;
    }
    if (good && layers > buffer->layer_capacity) {
        good = resize(&buffer->opacities, layers, sizeof *buffer->opacities) &&
               resize(&buffer->behind, layers, sizeof *buffer->behind);
        buffer->layer_capacity = good ? layers : buffer->layer_capacity;
    }
    return good ? UMB_OK
                : umb_fail(error, UMB_E_NO_MEMORY, "%zu receivers do not fit in memory", receivers);
}

/* Appends the receivers of a list. The slots of their sub-samples get the nearest one, and the
 * farthest leads to what the slot had. */
static void list_append(struct umbt_gbuffer *buffer, const struct layer_list *list)
{
    for (size_t i = 0; i < list->count; i++) {
        const struct layer *layer = &list->layers[i];
        const size_t at = buffer->receiver_count++, number = at - buffer->first_layer;
        const int is_first = i == 0 || list->layers[i - 1].sample != layer->sample;
        uint32_t *slot = &buffer->slots[layer->sample];
        memcpy(buffer->positions[at], layer->position, sizeof layer->position);
        memcpy(buffer->normals[at], layer->normal, sizeof layer->normal);
        buffer->triangles[at] = layer->triangle;
        buffer->opacities[number] = layer->opacity;
        /* Each one leads to the opaque receiver until another comes between. */
        const uint32_t opaque = is_first ? *slot : buffer->behind[number - 1];
        buffer->seen_count += is_first && opaque == UMBT_SKY;
        if (is_first) {
            *slot = (uint32_t)at;
        } else {
            buffer->behind[number - 1] = (uint32_t)at;
        }
        buffer->behind[number] = opaque;
    }
}

enum umb_status umbt_gbuffer_add_layers(struct umbt_gbuffer *buffer, const struct umbt_scene *scene,
                                        const struct umbt_camera *camera, uint32_t height,
                                        double far_m, unsigned threads, struct umb_error *error)
{
    const size_t samples = (size_t)buffer->width * buffer->row_count * buffer->aa * buffer->aa;
    const size_t blocks = (samples + BLOCK - 1) / BLOCK;
    struct search search = {buffer, scene, camera, height, far_m, NULL};
    size_t total = 0;
    if (umbt_seen_layers(scene) == NULL) {
        return UMB_OK;
    }
    search.lists = calloc(blocks + 1, sizeof *search.lists);
    if (search.lists == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu lists do not fit in memory", blocks);
    }
    enum umb_status status = umbu_range_run(threads, samples, BLOCK, block_search, &search, error);
    for (size_t i = 0; i < blocks; i++) {
        total += search.lists[i].count;
    }
    if (status == UMB_OK) {
        status = room_make(buffer, total, error);
    }
    for (size_t i = 0; i < blocks; i++) {
        if (status == UMB_OK) {
            list_append(buffer, &search.lists[i]);
        }
        free(search.lists[i].layers);
    }
    free(search.lists);
    return status;
}
