/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Derived maps as a KTX 2.0 file: header, index, data format descriptor, key/value data, then the
 * levels, the smallest first, each with all its layers. Source: KTX File Format Specification 2.0
 * and Khronos Data Format Specification 1.3 (basic descriptor block).
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include "base/bytes.h"
#include "base/memory.h"
#include "maps/derive_parts.h"

#define HEADER_BYTES 80
#define INDEX_BYTES  24 /* Bytes of the index for each level */
#define SAMPLE_BYTES 16
#define BLOCK_BYTES  24 /* Bytes of the descriptor before its samples */
#define JSON_MAX     16384
#define KEY_JSON     "umbrage.map"
#define WRITER       "KTXwriter\0umbrage"
#define LEVELS_MAX   16

enum sample_kind {
    SAMPLE_F32,
    SAMPLE_F16,
    SAMPLE_UNORM16,
    SAMPLE_SNORM16,
};

/* Numbers of enum VkFormat, by type of sample and number of channels (1, 2 or 4). */
static const uint32_t vk_formats[][5] = {
    [SAMPLE_F32] = {[1] = 100, [2] = 103, [4] = 109},
    [SAMPLE_F16] = {[1] = 76, [2] = 83, [4] = 97},
    [SAMPLE_UNORM16] = {[1] = 70, [2] = 77, [4] = 91},
    [SAMPLE_SNORM16] = {[1] = 71, [2] = 78, [4] = 92},
};

/* Offsets of the parts of the file. */
struct plan {
    enum sample_kind kind;
    uint32_t channels, width, height, layers, level_count;
    size_t texel_bytes;
    size_t descriptor, descriptor_bytes, keys, keys_bytes;
    size_t levels[LEVELS_MAX], level_bytes[LEVELS_MAX]; /* Offset and length of each level, all
                                                           layers together */
    size_t json_bytes, size;
    char json[JSON_MAX];
};

/* Appends to the JSON. The text cannot be cut: the buffer is twice as large as 8 maps of 16 numbers
 * of 25 characters. */
static void put(struct plan *plan, const char *format, ...) UMB_PRINTF(2, 3);
static void put(struct plan *plan, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const size_t room = JSON_MAX - plan->json_bytes;
    const int count = vsnprintf(plan->json + plan->json_bytes, room, format, arguments);
    va_end(arguments);
    if (count > 0) {
        plan->json_bytes += (size_t)count < room ? (size_t)count : room - 1;
    }
}

static void put_numbers(struct plan *plan, const char *name, const double *values, size_t count)
{
    put(plan, ",\"%s\":[", name);
    for (size_t i = 0; i < count; i++) {
        put(plan, "%s%.17g", i > 0 ? "," : "", values[i]);
    }
    put(plan, "]");
}

static void describe_map(struct plan *plan, const struct umb_derived *derived, uint32_t i)
{
    const struct umb_map_frustum *frustum = &derived->frusta[i];
    put(plan, "%s{\"projection\":\"%s\",\"depth_m\":%.17g", i > 0 ? "," : "",
        frustum->projection == UMB_MAP_AFFINE ? "affine" : "perspective", frustum->depth_m);
    put_numbers(plan, "origin", frustum->origin, 3);
    put_numbers(plan, "world_to_map", &frustum->world_to_map[0][0], 16);
    if (derived->splits[derived->count] > 0.0) {
        put_numbers(plan, "split", &derived->splits[i], 2);
    }
    if (derived->settings.contrast > 0.0 || derived->settings.match_contrast) {
        put(plan, ",\"contrast\":%.17g", derived->contrast[i]);
    }
    put(plan, "}");
}

static void describe(struct plan *plan, const struct umb_derived *derived)
{
    const struct umb_map_settings *map = &derived->settings.map;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(derived->asset_id, id);
    put(plan, "{\"asset\":\"%s\",\"light\":%u,\"technique\":\"%s\"", id, derived->settings.light,
        map->technique == UMB_MAP_PCF ? "depth" : umb_map_technique_name(map->technique));
    put(plan, ",\"depth_error_m\":%.17g,\"blur\":%u", derived->texel_error_m,
        map->blur > 0 ? map->blur : 1);
    if (map->exponent > 0.0) {
        put(plan, ",\"exponent\":%.17g", map->exponent);
    }
    if (map->negative_exponent > 0.0) {
        put(plan, ",\"negative_exponent\":%.17g", map->negative_exponent);
    }
    if (derived->settings.cascades.count > 0 && derived->settings.cascades.blend > 0.0) {
        put(plan, ",\"blend\":%.17g", derived->settings.cascades.blend);
    }
    put_numbers(plan, "to_light", derived->frusta[0].light, 3);
    put(plan, ",\"maps\":[");
    for (uint32_t i = 0; i < derived->count; i++) {
        describe_map(plan, derived, i);
    }
    put(plan, "]}");
}

static size_t aligned(size_t at, size_t step)
{
    return (at + step - 1) / step * step;
}

static enum sample_kind kind_of(const struct umb_map_level *level, int is_depth)
{
    switch (level->format) {
    case UMB_MAP_F16:
        return SAMPLE_F16;
    case UMB_MAP_U16:
        return is_depth ? SAMPLE_UNORM16 : SAMPLE_SNORM16;
    default:
        return SAMPLE_F32;
    }
}

static void make_plan(struct plan *plan, const struct umb_derived *derived)
{
    struct umb_map_level level;
    memset(plan, 0, sizeof *plan);
    (void)umb_map_get_level(derived->maps[0], 0, &level);
    plan->kind = kind_of(&level, derived->settings.map.technique == UMB_MAP_PCF);
    plan->channels = level.channels;
    plan->width = level.width;
    plan->height = level.height;
    plan->layers = derived->count;
    plan->texel_bytes = level.channels * (plan->kind == SAMPLE_F32 ? 4U : 2U);
    while (plan->level_count < LEVELS_MAX &&
           umb_map_get_level(derived->maps[0], plan->level_count, &level) == UMB_OK) {
        plan->level_bytes[plan->level_count++] = level.bytes * plan->layers;
    }
    describe(plan, derived);
    plan->descriptor = HEADER_BYTES + (size_t)plan->level_count * INDEX_BYTES;
    plan->descriptor_bytes = 4 + BLOCK_BYTES + (size_t)plan->channels * SAMPLE_BYTES;
    plan->keys = plan->descriptor + plan->descriptor_bytes;
    plan->keys_bytes =
        aligned(4 + sizeof WRITER, 4) + aligned(4 + sizeof KEY_JSON + plan->json_bytes + 1, 4);
    plan->size = plan->keys + plan->keys_bytes;
    for (uint32_t i = plan->level_count; i-- > 0;) {
        plan->levels[i] = aligned(plan->size, plan->texel_bytes > 4 ? plan->texel_bytes : 4);
        plan->size = plan->levels[i] + plan->level_bytes[i];
    }
}

static void write_header(const struct plan *plan, uint8_t *to)
{
    static const uint8_t identifier[12] = {0xAB, 0x4B, 0x54, 0x58, 0x20, 0x32,
                                           0x30, 0xBB, 0x0D, 0x0A, 0x1A, 0x0A};
    const uint32_t fields[] = {vk_formats[plan->kind][plan->channels],
                               plan->kind == SAMPLE_F32 ? 4 : 2,
                               plan->width,
                               plan->height,
                               0, /* depth: two dimensions */
                               plan->layers > 1 ? plan->layers : 0,
                               1, /* faces */
                               plan->level_count,
                               0, /* not compressed */
                               (uint32_t)plan->descriptor,
                               (uint32_t)plan->descriptor_bytes,
                               (uint32_t)plan->keys,
                               (uint32_t)plan->keys_bytes};
    memcpy(to, identifier, sizeof identifier);
    for (size_t i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        umb__store32(to + 12 + 4 * i, fields[i]);
    }
    for (uint32_t i = 0; i < plan->level_count; i++) {
        uint8_t *index = to + HEADER_BYTES + (size_t)i * INDEX_BYTES;
        umb__store64(index, plan->levels[i]);
        umb__store64(index + 8, plan->level_bytes[i]);
        umb__store64(index + 16, plan->level_bytes[i]); /* uncompressed */
    }
}

/* Writes the basic descriptor block: model RGBSDA, primaries BT.709, linear; one sample a
 * channel. */
static void write_descriptor(const struct plan *plan, uint8_t *to)
{
    static const uint32_t lower[] = {0xBF800000U, 0xBF800000U, 0, 0xFFFF8001U};
    static const uint32_t upper[] = {0x3F800000U, 0x3F800000U, 0xFFFFU, 0x7FFFU};
    static const uint32_t qualifiers[] = {0xC0, 0xC0, 0, 0x40}; /* float 0x80, signed 0x40 */
    static const uint32_t ids[] = {0, 1, 2, 15};                /* red, green, blue, alpha */
    const uint32_t bits = plan->kind == SAMPLE_F32 ? 32 : 16;
    umb__store32(to, (uint32_t)plan->descriptor_bytes);
    umb__store32(to + 8, 2 | (uint32_t)(plan->descriptor_bytes - 4) << 16);
    umb__store32(to + 12, 1 | 1 << 8 | 1 << 16);
    umb__store32(to + 20, (uint32_t)plan->texel_bytes);
    for (uint32_t i = 0; i < plan->channels; i++) {
        uint8_t *sample = to + 4 + BLOCK_BYTES + (size_t)i * SAMPLE_BYTES;
        umb__store32(sample, i * bits | (bits - 1) << 16 | (ids[i] | qualifiers[plan->kind]) << 24);
        umb__store32(sample + 8, lower[plan->kind]);
        umb__store32(sample + 12, upper[plan->kind]);
    }
}

static void write_keys(const struct plan *plan, uint8_t *to)
{
    umb__store32(to, sizeof WRITER);
    memcpy(to + 4, WRITER, sizeof WRITER);
    to += aligned(4 + sizeof WRITER, 4);
    umb__store32(to, (uint32_t)(sizeof KEY_JSON + plan->json_bytes + 1));
    memcpy(to + 4, KEY_JSON, sizeof KEY_JSON);
    memcpy(to + 4 + sizeof KEY_JSON, plan->json, plan->json_bytes + 1);
}

static enum umb_status make_file(struct umb__derived *whole, struct umb_error *error)
{
    const struct umb_alloc *alloc = whole->alloc;
    const struct umb_derived *derived = &whole->shown;
    struct plan *plan = umb__alloc(alloc, 1, sizeof *plan);
    if (plan == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "a KTX file does not fit in memory");
    }
    make_plan(plan, derived);
    uint8_t *file = umb__alloc_zeroed(alloc, plan->size, 1);
    if (file == NULL) {
        enum umb_status status =
            umb_fail(error, UMB_E_NO_MEMORY, "a KTX file of %zu bytes does not fit", plan->size);
        umb__free(alloc, plan);
        return status;
    }
    write_header(plan, file);
    write_descriptor(plan, file + plan->descriptor);
    write_keys(plan, file + plan->keys);
    for (uint32_t i = 0; i < plan->level_count; i++) {
        for (uint32_t layer = 0; layer < plan->layers; layer++) {
            struct umb_map_level level;
            (void)umb_map_get_level(derived->maps[layer], i, &level);
            memcpy(file + plan->levels[i] + layer * level.bytes, level.texels, level.bytes);
        }
    }
    whole->file = file;
    whole->file_size = plan->size;
    umb__free(alloc, plan);
    return UMB_OK;
}

enum umb_status umb_derived_ktx2(struct umb_derived *derived, const uint8_t **bytes, size_t *size,
                                 struct umb_error *error)
{
    struct umb__derived *whole = (struct umb__derived *)(void *)derived;
    const enum umb_status status = whole->file == NULL ? make_file(whole, error) : UMB_OK;
    *bytes = whole->file;
    *size = whole->file_size;
    return status;
}
