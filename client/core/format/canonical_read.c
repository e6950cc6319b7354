/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes the canonical block (canonical.h). Layouts of entries: docs/reference/umb-format.md,
 * section 3. */
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/canonical_parts.h"
#include "format/occluder_depth.h"
#include "format/receiver_mask.h"

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "canonical block: no memory");
}

/* Bytes of each entry; NULL for an optional entry that is left out. */
struct entries {
    const uint8_t *bytes[ENTRY_COUNT];
    uint64_t lengths[ENTRY_COUNT];
};

/* Finds all entries. Fails: E_CORRUPT, E_VERSION (an entry that this version does not know). */
static enum umb_status find_entries(const uint8_t *bytes, uint64_t length, struct entries *entries,
                                    struct umb_error *error)
{
    const uint8_t *at = bytes, *end = bytes + length, *head, *body;
    memset(entries, 0, sizeof *entries);
    while (at < end) {
        if (!umb__take(&at, end, 1, UMB__ENTRY_HEAD, &head)) {
            return umb_fail(error, UMB_E_CORRUPT, "canonical block: cut inside an entry");
        }
        uint32_t tag = umb__load32(head);
        uint64_t size = umb__load64(head + 8);
        if (size > length || !umb__take(&at, end, 1, umb__entry_padded(size), &body)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "canonical block: entry %.4s of %llu bytes is cut", (const char *)head,
                            (unsigned long long)size);
        }
        if (!umb__all_zero(body + size, umb__entry_padded(size) - size)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "canonical block: entry %.4s: padding is not zero", (const char *)head);
        }
        size_t i = 0;
        while (i < ENTRY_COUNT && umb__entry_tags[i] != tag) {
            i++;
        }
        if (i == ENTRY_COUNT) {
            if (umb__load32(head + 4) & UMB__MUST_UNDERSTAND) {
                return umb_fail(error, UMB_E_VERSION,
                                "canonical block: entry 0x%08x needs a newer reader", tag);
            }
            continue;
        }
        if (umb__load32(head + 4) != umb__entry_flags(i)) {
            return umb_fail(error, UMB_E_VERSION,
                            "canonical block: entry %.4s has flags 0x%x of a newer writer",
                            (const char *)head, umb__load32(head + 4));
        }
        if (entries->bytes[i]) {
            return umb_fail(error, UMB_E_CORRUPT, "canonical block: entry %.4s stands twice",
                            (const char *)head);
        }
        entries->bytes[i] = body;
        entries->lengths[i] = size;
    }
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (!entries->bytes[i] && !umb__entry_is_optional(i)) {
            return umb_fail(error, UMB_E_CORRUPT, "canonical block: an entry (0x%08x) is missing",
                            umb__entry_tags[i]);
        }
    }
    return UMB_OK;
}

/* Returns true if the fields reserved for later versions are zero. */
static bool reserved_are_zero(const struct entries *entries)
{
    const uint8_t *light = entries->bytes[ENTRY_LIGHTS], *frustum = entries->bytes[ENTRY_FRUSTA];
    const uint8_t *root = entries->bytes[ENTRY_ROOTS];
    uint32_t rest = 0;
    for (uint64_t i = 0; i < entries->lengths[ENTRY_LIGHTS]; i += UMB__LIGHT_SIZE) {
        rest |= umb__load32(light + i + 12);
    }
    for (uint64_t i = 0; i < entries->lengths[ENTRY_FRUSTA]; i += UMB__FRUSTUM_SIZE) {
        rest |= (umb__load32(frustum + i + 8) & ~(uint32_t)1) | umb__load32(frustum + i + 12);
    }
    for (uint64_t i = 0; i < entries->lengths[ENTRY_ROOTS]; i += UMB__ROOT_SIZE) {
        rest |= umb__load32(root + i + 12);
    }
    return rest == 0;
}

static char *read_text(const uint8_t *bytes, uint64_t length, const struct umb_alloc *alloc)
{
    char *text = umb__alloc(alloc, (size_t)length + 1, 1);
    if (text) {
        memcpy(text, bytes, (size_t)length);
        text[length] = '\0';
    }
    return text;
}

/* Reads a light. Returns false if a byte behind the name's NUL is not zero, because equal content
 * must have equal bytes. */
static bool read_light(const uint8_t *at, struct umb_light_info *light)
{
    light->kind = (enum umb_light_kind)umb__load32(at);
    light->first_frustum = umb__load32(at + 4);
    light->frustum_count = umb__load32(at + 8);
    for (size_t i = 0; i < 3; i++) {
        light->direction[i] = umb__load_f64(at + 16 + 8 * i);
        light->position[i] = umb__load_f64(at + 40 + 8 * i);
    }
    light->extent = umb__load_f64(at + 64);
    memcpy(light->name, at + 72, UMB_NAME_SIZE);
    size_t length = strnlen(light->name, UMB_NAME_SIZE);
    return umb__all_zero(at + 72 + length, UMB_NAME_SIZE - length);
}

static void read_frustum(const uint8_t *at, struct umb_frustum_info *frustum)
{
    frustum->log2_size = umb__load32(at);
    frustum->light = umb__load32(at + 4);
    frustum->closed = (int)(umb__load32(at + 8) & 1);
    for (size_t i = 0; i < 16; i++) {
        frustum->world_to_voxel[i / 4][i % 4] = umb__load_f64(at + 16 + 8 * i);
    }
}

static void read_root(const uint8_t *at, struct umb__packed_root *root)
{
    root->state = umb__load32(at);
    root->page = umb__load32(at + 4);
    root->position = umb__load32(at + 8);
}

static void read_curve(const uint8_t *at, struct umb__curve_record *record)
{
    record->light = umb__load32(at);
    record->level = umb__load32(at + 4);
    record->taps = umb__load32(at + 8);
    record->points = umb__load32(at + 12);
    record->nodes = umb__load64(at + 16);
    record->lines = umb__load64(at + 24);
    record->squares = umb__load64(at + 32);
}

static enum umb_status check_lengths(const struct entries *entries, struct umb_error *error)
{
    const uint64_t *lengths = entries->lengths;
    uint64_t frusta = lengths[ENTRY_FRUSTA] / UMB__FRUSTUM_SIZE;
    if (lengths[ENTRY_SCENE] != UMB__SCENE_SIZE || lengths[ENTRY_COUNTS] != UMB__COUNTS_SIZE ||
        lengths[ENTRY_LIGHTS] % UMB__LIGHT_SIZE != 0 ||
        lengths[ENTRY_FRUSTA] % UMB__FRUSTUM_SIZE != 0 ||
        lengths[ENTRY_ROOTS] != frusta * UMB__ROOT_SIZE ||
        lengths[ENTRY_CURVE] % UMB__CURVE_SIZE != 0 ||
        (entries->bytes[ENTRY_CURVE] && lengths[ENTRY_CURVE] == 0) ||
        (entries->bytes[ENTRY_RECEIVER_MASK] &&
         lengths[ENTRY_RECEIVER_MASK] != frusta * UMB__RECEIVER_MASK_WORDS * 8)) {
        return umb_fail(error, UMB_E_CORRUPT, "canonical block: entry lengths do not fit");
    }
    if (lengths[ENTRY_PLAN] > UMB__TEXT_MAX || lengths[ENTRY_SETTINGS] > UMB__TEXT_MAX ||
        !umb__utf8_valid(entries->bytes[ENTRY_PLAN], (size_t)lengths[ENTRY_PLAN]) ||
        !umb__utf8_valid(entries->bytes[ENTRY_SETTINGS], (size_t)lengths[ENTRY_SETTINGS])) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "canonical block: plan (%llu bytes) and settings (%llu bytes) must be "
                        "UTF-8 texts of at most %u bytes",
                        (unsigned long long)lengths[ENTRY_PLAN],
                        (unsigned long long)lengths[ENTRY_SETTINGS], UMB__TEXT_MAX);
    }
    if (!reserved_are_zero(entries)) {
        return umb_fail(error, UMB_E_VERSION,
                        "canonical block: reserved fields are used by a newer writer");
    }
    return UMB_OK;
}

/* Reads the number of nodes of each level. It must be below 2^32 - 1: node numbers have 32 bits,
 * and one of them means "none". */
static enum umb_status read_counts(const uint8_t *at, struct umb__canonical *canonical,
                                   struct umb_error *error)
{
    for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        canonical->counts[level] = umb__load64(at + 8 * (level - UMB_LEVEL_BRICK));
        if (canonical->counts[level] >= UINT32_MAX) {
            return umb_fail(error, UMB_E_CORRUPT, "counts: level %zu claims %llu nodes", level,
                            (unsigned long long)canonical->counts[level]);
        }
    }
    canonical->content.bytes_2014 = umb__load64(at + UMB__COUNTS_SIZE - 8);
    return UMB_OK;
}

/* Checks and expands the transmittance. In: canonical: frusta checked. */
static enum umb_status read_transmittance(const struct entries *entries,
                                          const struct umb_alloc *alloc,
                                          struct umb__canonical *canonical, struct umb_error *error)
{
    struct umb__content *content = &canonical->content;
    const uint8_t *bytes = entries->bytes[ENTRY_TRANSMITTANCE];
    const uint64_t length = entries->lengths[ENTRY_TRANSMITTANCE];
    if (!bytes) {
        return UMB_OK;
    }
    UMB__TRY(umb__transmittance_load(bytes, length, content->frusta, content->frustum_count, alloc,
                                     &canonical->trans, error));
    content->transmittance = umb__alloc(alloc, (size_t)length, 1);
    if (!content->transmittance) {
        return no_memory(error);
    }
    memcpy(content->transmittance, bytes, (size_t)length);
    content->transmittance_bytes = length;
    return UMB_OK;
}

static enum umb_status read_receiver_mask(const struct entries *entries,
                                          const struct umb_alloc *alloc,
                                          struct umb__content *content, struct umb_error *error)
{
    const uint8_t *bytes = entries->bytes[ENTRY_RECEIVER_MASK];
    const size_t words = content->frustum_count * UMB__RECEIVER_MASK_WORDS;
    if (!bytes) {
        return UMB_OK;
    }
    content->receiver_mask_cells = umb__alloc(alloc, words, sizeof *content->receiver_mask_cells);
    if (!content->receiver_mask_cells) {
        return no_memory(error);
    }
    for (size_t i = 0; i < words; i++) {
        content->receiver_mask_cells[i] = umb__load64(bytes + 8 * i);
    }
    return UMB_OK;
}

/* Counts the records of all entries and allocates arrays and texts; false: out of memory. */
static bool allocate(const struct entries *entries, const struct umb_alloc *alloc,
                     struct umb__canonical *canonical)
{
    struct umb__content *content = &canonical->content;
    content->light_count = (uint32_t)(entries->lengths[ENTRY_LIGHTS] / UMB__LIGHT_SIZE);
    content->frustum_count = (uint32_t)(entries->lengths[ENTRY_FRUSTA] / UMB__FRUSTUM_SIZE);
    content->curve_count = (uint32_t)(entries->lengths[ENTRY_CURVE] / UMB__CURVE_SIZE);
    content->lights = umb__alloc_zeroed(alloc, content->light_count, sizeof *content->lights);
    content->frusta = umb__alloc_zeroed(alloc, content->frustum_count, sizeof *content->frusta);
    canonical->roots = umb__alloc_zeroed(alloc, content->frustum_count, sizeof *canonical->roots);
    if (content->curve_count > 0) {
        content->curve = umb__alloc_zeroed(alloc, content->curve_count, sizeof *content->curve);
    }
    content->plan = read_text(entries->bytes[ENTRY_PLAN], entries->lengths[ENTRY_PLAN], alloc);
    content->settings =
        read_text(entries->bytes[ENTRY_SETTINGS], entries->lengths[ENTRY_SETTINGS], alloc);
    return content->lights && content->frusta && canonical->roots && content->plan &&
           content->settings && (content->curve_count == 0 || content->curve);
}

static void read_scene(const uint8_t *at, struct umb__content *content)
{
    for (size_t i = 0; i < 3; i++) {
        content->origin[i] = umb__load_f64(at + 8 * i);
        content->bounds.min[i] = umb__load_f64(at + 24 + 8 * i);
        content->bounds.max[i] = umb__load_f64(at + 48 + 8 * i);
    }
    memcpy(content->scene_hash, at + 72, UMB_ID_BYTES);
}

/* Reads lights, frusta, roots and the curve into their arrays. */
static enum umb_status read_records(const struct entries *entries, struct umb__canonical *canonical,
                                    struct umb_error *error)
{
    struct umb__content *content = &canonical->content;
    for (uint32_t i = 0; i < content->light_count; i++) {
        if (!read_light(entries->bytes[ENTRY_LIGHTS] + (size_t)i * UMB__LIGHT_SIZE,
                        &content->lights[i])) {
            return umb_fail(error, UMB_E_CORRUPT, "lights[%u].name: not padded with zeros", i);
        }
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        struct umb__packed_root *root = &canonical->roots[i];
        read_frustum(entries->bytes[ENTRY_FRUSTA] + (size_t)i * UMB__FRUSTUM_SIZE,
                     &content->frusta[i]);
        read_root(entries->bytes[ENTRY_ROOTS] + (size_t)i * UMB__ROOT_SIZE, root);
        if (root->state > UMB__NODE_MIXED ||
            (root->state != UMB__NODE_MIXED && (root->page != 0 || root->position != 0))) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "roots[%u]: state %u, allowed 0 to 2, a place (page %u, position %u) "
                            "only with 2",
                            i, root->state, root->page, root->position);
        }
    }
    for (uint32_t i = 0; i < content->curve_count; i++) {
        read_curve(entries->bytes[ENTRY_CURVE] + (size_t)i * UMB__CURVE_SIZE, &content->curve[i]);
    }
    return UMB_OK;
}

static enum umb_status decode(const uint8_t *bytes, uint64_t length, const struct umb_alloc *alloc,
                              struct umb__canonical *canonical, struct umb_error *error)
{
    struct entries entries;
    struct umb__content *content = &canonical->content;
    UMB__TRY(find_entries(bytes, length, &entries, error));
    UMB__TRY(check_lengths(&entries, error));
    if (!allocate(&entries, alloc, canonical)) {
        return no_memory(error);
    }
    read_scene(entries.bytes[ENTRY_SCENE], content);
    UMB__TRY(read_records(&entries, canonical, error));
    UMB__TRY(read_counts(entries.bytes[ENTRY_COUNTS], canonical, error));
    UMB__TRY(umb__occluder_depth_load(
        entries.bytes[ENTRY_OCCLUDER_DEPTH], entries.lengths[ENTRY_OCCLUDER_DEPTH], alloc,
        &content->occluder_depth, &content->occluder_depth_words, error));
    UMB__TRY(read_receiver_mask(&entries, alloc, content, error));
    UMB__TRY(umb__content_check(content, error));
    UMB__TRY(read_transmittance(&entries, alloc, canonical, error));
    umb__content_derive(content);
    return UMB_OK;
}

enum umb_status umb__canonical_decode(const uint8_t *bytes, uint64_t length,
                                      const struct umb_alloc *alloc,
                                      struct umb__canonical *canonical, struct umb_error *error)
{
    memset(canonical, 0, sizeof *canonical);
    const enum umb_status status = decode(bytes, length, alloc, canonical, error);
    if (status != UMB_OK) {
        umb__canonical_finish(canonical, alloc);
    }
    return status;
}

void umb__canonical_finish(struct umb__canonical *canonical, const struct umb_alloc *alloc)
{
    umb__free(alloc, canonical->content.lights);
    umb__free(alloc, canonical->content.frusta);
    umb__free(alloc, canonical->content.plan);
    umb__free(alloc, canonical->content.settings);
    umb__free(alloc, canonical->content.occluder_depth);
    umb__free(alloc, canonical->content.transmittance);
    umb__free(alloc, canonical->content.receiver_mask_cells);
    umb__transmittance_finish(&canonical->trans, alloc);
    umb__free(alloc, canonical->content.curve);
    umb__free(alloc, canonical->roots);
    memset(canonical, 0, sizeof *canonical);
}
