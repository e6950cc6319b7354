/* SPDX-License-Identifier: Apache-2.0 */
/* Encodes the canonical block (canonical.h). Layouts of entries: docs/reference/umb-format.md,
 * section 3. */
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/canonical_parts.h"
#include "format/receiver_mask.h"

static void write_scene(uint8_t *at, const struct umb__content *content)
{
    for (size_t i = 0; i < 3; i++) {
        umb__store_f64(at + 8 * i, content->origin[i]);
        umb__store_f64(at + 24 + 8 * i, content->bounds.min[i]);
        umb__store_f64(at + 48 + 8 * i, content->bounds.max[i]);
    }
    memcpy(at + 72, content->scene_hash, UMB_ID_BYTES);
}

static void write_light(uint8_t *at, const struct umb_light_info *light)
{
    umb__store32(at, (uint32_t)light->kind);
    umb__store32(at + 4, light->first_frustum);
    umb__store32(at + 8, light->frustum_count);
    for (size_t i = 0; i < 3; i++) {
        umb__store_f64(at + 16 + 8 * i, light->direction[i]);
        umb__store_f64(at + 40 + 8 * i, light->position[i]);
    }
    umb__store_f64(at + 64, light->extent);
    size_t length = strlen(light->name);
    memcpy(at + 72, light->name, length);
}

static void write_frustum(uint8_t *at, const struct umb_frustum_info *frustum)
{
    umb__store32(at, frustum->log2_size);
    umb__store32(at + 4, frustum->light);
    umb__store32(at + 8, frustum->closed ? 1U : 0U);
    for (size_t i = 0; i < 16; i++) {
        umb__store_f64(at + 16 + 8 * i, frustum->world_to_voxel[i / 4][i % 4]);
    }
}

static void write_counts(uint8_t *at, const struct umb__canonical *canonical)
{
    for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        umb__store64(at + 8 * (level - UMB_LEVEL_BRICK), canonical->counts[level]);
    }
    umb__store64(at + UMB__COUNTS_SIZE - 8, canonical->content.bytes_2014);
}

static void write_curve(uint8_t *at, const struct umb__curve_record *record)
{
    umb__store32(at, record->light);
    umb__store32(at + 4, record->level);
    umb__store32(at + 8, record->taps);
    umb__store32(at + 12, record->points);
    umb__store64(at + 16, record->nodes);
    umb__store64(at + 24, record->lines);
    umb__store64(at + 32, record->squares);
}

static void write_entry(uint8_t *at, enum umb__entry entry, const struct umb__canonical *canonical)
{
    const struct umb__content *content = &canonical->content;
    switch (entry) {
    case ENTRY_SCENE:
        write_scene(at, content);
        break;
    case ENTRY_LIGHTS:
        for (uint32_t i = 0; i < content->light_count; i++) {
            write_light(at + (size_t)i * UMB__LIGHT_SIZE, &content->lights[i]);
        }
        break;
    case ENTRY_FRUSTA:
        for (uint32_t i = 0; i < content->frustum_count; i++) {
            write_frustum(at + (size_t)i * UMB__FRUSTUM_SIZE, &content->frusta[i]);
        }
        break;
    case ENTRY_COUNTS:
        write_counts(at, canonical);
        break;
    case ENTRY_PLAN:
        memcpy(at, content->plan, strlen(content->plan));
        break;
    case ENTRY_SETTINGS:
        memcpy(at, content->settings, strlen(content->settings));
        break;
    case ENTRY_ROOTS:
        for (uint32_t i = 0; i < content->frustum_count; i++) {
            const struct umb__packed_root *root = &canonical->roots[i];
            umb__store32(at + (size_t)i * UMB__ROOT_SIZE, root->state);
            umb__store32(at + (size_t)i * UMB__ROOT_SIZE + 4, root->page);
            umb__store32(at + (size_t)i * UMB__ROOT_SIZE + 8, root->position);
        }
        break;
    case ENTRY_CURVE:
        for (uint32_t i = 0; i < content->curve_count; i++) {
            write_curve(at + (size_t)i * UMB__CURVE_SIZE, &content->curve[i]);
        }
        break;
    case ENTRY_OCCLUDER_DEPTH:
        for (uint64_t i = 0; i < content->occluder_depth_words; i++) {
            umb__store32(at + 4 * i, content->occluder_depth[i]);
        }
        break;
    case ENTRY_TRANSMITTANCE:
        memcpy(at, content->transmittance, (size_t)content->transmittance_bytes);
        break;
    case ENTRY_RECEIVER_MASK:
        for (size_t i = 0; i < content->frustum_count * UMB__RECEIVER_MASK_WORDS; i++) {
            umb__store64(at + 8 * i, content->receiver_mask_cells[i]);
        }
        break;
    case ENTRY_COUNT:
        break;
    }
}

static enum umb_status text_length(const char *text, const char *field, uint64_t *length,
                                   struct umb_error *error)
{
    if (!text) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: missing", field);
    }
    *length = strlen(text);
    if (*length > UMB__TEXT_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: %llu bytes, at most %u", field,
                        (unsigned long long)*length, UMB__TEXT_MAX);
    }
    if (!umb__utf8_valid((const uint8_t *)text, (size_t)*length)) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: must be UTF-8 text", field);
    }
    return UMB_OK;
}

/* Returns the bytes of an entry of `length` bytes and its head; 0 if the entry is left out. */
static uint64_t entry_length(size_t entry, uint64_t length)
{
    return length == 0 && umb__entry_is_optional(entry)
               ? 0
               : UMB__ENTRY_HEAD + umb__entry_padded(length);
}

/* Computes the length of each entry without its head, and the length of the whole block. */
static enum umb_status measure(const struct umb__content *content, uint64_t lengths[ENTRY_COUNT],
                               uint64_t *length, struct umb_error *error)
{
    const uint64_t frusta = content->frustum_count;
    memset(lengths, 0, ENTRY_COUNT * sizeof *lengths);
    lengths[ENTRY_SCENE] = UMB__SCENE_SIZE;
    lengths[ENTRY_LIGHTS] = (uint64_t)content->light_count * UMB__LIGHT_SIZE;
    lengths[ENTRY_FRUSTA] = frusta * UMB__FRUSTUM_SIZE;
    lengths[ENTRY_COUNTS] = UMB__COUNTS_SIZE;
    lengths[ENTRY_ROOTS] = frusta * UMB__ROOT_SIZE;
    lengths[ENTRY_CURVE] = (uint64_t)content->curve_count * UMB__CURVE_SIZE;
    lengths[ENTRY_OCCLUDER_DEPTH] = content->occluder_depth_words * 4;
    lengths[ENTRY_TRANSMITTANCE] = content->transmittance_bytes;
    lengths[ENTRY_RECEIVER_MASK] =
        content->receiver_mask_cells ? frusta * UMB__RECEIVER_MASK_WORDS * 8 : 0;
    UMB__TRY(text_length(content->plan, "plan", &lengths[ENTRY_PLAN], error));
    UMB__TRY(text_length(content->settings, "settings", &lengths[ENTRY_SETTINGS], error));
    *length = 0;
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        *length += entry_length(i, lengths[i]);
    }
    return *length <= UMB__CANONICAL_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "canonical block: %llu bytes, at most %u",
                          (unsigned long long)*length, UMB__CANONICAL_MAX);
}

enum umb_status umb__content_head_bytes(const struct umb__content *content, uint64_t *bytes,
                                        struct umb_error *error)
{
    uint64_t lengths[ENTRY_COUNT];
    return measure(content, lengths, bytes, error);
}

enum umb_status umb__canonical_encode(const struct umb__canonical *canonical,
                                      const struct umb_alloc *alloc, uint8_t **bytes,
                                      uint64_t *length, struct umb_error *error)
{
    uint64_t lengths[ENTRY_COUNT];
    UMB__TRY(measure(&canonical->content, lengths, length, error));
    *bytes = umb__alloc_zeroed(alloc, (size_t)*length, 1);
    if (!*bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "canonical block: no memory for %llu bytes",
                        (unsigned long long)*length);
    }
    uint8_t *at = *bytes;
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (entry_length(i, lengths[i]) == 0) {
            continue;
        }
        umb__store32(at, umb__entry_tags[i]);
        umb__store32(at + 4, umb__entry_flags(i));
        umb__store64(at + 8, lengths[i]);
        write_entry(at + UMB__ENTRY_HEAD, (enum umb__entry)i, canonical);
        at += entry_length(i, lengths[i]);
    }
    return UMB_OK;
}
