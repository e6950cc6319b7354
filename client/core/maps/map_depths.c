/* SPDX-License-Identifier: Apache-2.0 */
/* Depths as a depth map stores them: struct umb__depths of map_parts.h. */
#include "maps/map_parts.h"

#include <string.h>
#include "base/bytes.h"
#include "base/memory.h"

static unsigned format_bytes(enum umb_map_format format)
{
    return format == UMB_MAP_U16 ? 2 : format == UMB_MAP_U24 ? 3 : 4;
}

/* Returns the greatest value of an integer format; 0 for floats. */
static uint32_t format_top(enum umb_map_format format)
{
    return format == UMB_MAP_U16 ? 0xffffU : format == UMB_MAP_U24 ? 0xffffffU : 0;
}

static void texel_store(uint8_t *at, enum umb_map_format format, float depth)
{
    const uint32_t top = format_top(format);
    if (top == 0) {
        uint32_t bits;
        memcpy(&bits, &depth, sizeof bits);
        umb__store32(at, bits);
        return;
    }
    uint32_t value = (uint32_t)((double)depth * (double)top + 0.5);
    value = depth < 1.0F && value == top ? top - 1 : value;
    umb__store_narrow(at, value, format_bytes(format));
}

enum umb_status umb__depths_init(struct umb__depths *depths, const struct umb_map *map,
                                 const float *layer, struct umb_error *error)
{
    const size_t count = (size_t)map->frustum.width * map->frustum.height;
    const unsigned width = format_bytes(map->settings.format);
    *depths = (struct umb__depths){.format = map->settings.format,
                                   .width = map->frustum.width,
                                   .height = map->frustum.height,
                                   .bytes = (uint64_t)count * width};
    depths->texels = umb__alloc(umb__map_alloc(map), count, width);
    if (depths->texels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a map of %zu texels does not fit in memory",
                        count);
    }
    for (size_t i = 0; i < count; i++) {
        texel_store((uint8_t *)depths->texels + width * i, depths->format, layer[i]);
    }
    return UMB_OK;
}

void umb__depths_finish(struct umb__depths *depths, const struct umb_map *map)
{
    umb__free(umb__map_alloc(map), depths->texels);
    depths->texels = NULL;
}

double umb__depth_at(const struct umb__depths *depths, int64_t x, int64_t y)
{
    if (x < 0 || y < 0 || x >= (int64_t)depths->width || y >= (int64_t)depths->height) {
        return INFINITY;
    }
    const size_t index = (size_t)y * depths->width + (size_t)x;
    const uint8_t *texels = depths->texels;
    const uint32_t top = format_top(depths->format);
    if (top == 0) {
        const double depth = (double)umb__load_f32(texels + 4 * index);
        return depth < 1.0 ? depth : INFINITY;
    }
    const unsigned width = format_bytes(depths->format);
    const uint32_t value = umb__load_narrow(texels + width * index, width);
    return value < top ? (double)value / (double)top : INFINITY;
}
