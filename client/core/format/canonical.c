/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Encodes and decodes the canonical block (canonical.h). One table describes the entries for both
 * directions: where their records lie in memory, and which fields these have. Layouts:
 * docs/reference/umb-format.md, section 3.
 */
#include "format/canonical.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/utf8.h"
#include "format/layout.h"
#include "format/occluder_depth.h"
#include "format/receiver_mask.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "fields are copied between records and structs, and the file is little-endian"
#endif

/* A field of a record. Its bytes are the same in the file and in memory. */
struct field {
    uint32_t at;     /* Offset in bytes in the record */
    uint32_t bytes;  /* Number of bytes; 0 ends a list */
    uint32_t member; /* Offset in bytes in the struct */
};

#define FIELD(at, type, member)                                                                    \
    {                                                                                              \
        (at), sizeof((struct type *)NULL)->member, offsetof(struct type, member)                   \
    }

static const struct field scene_fields[] = {
    FIELD(0, umb__canonical, content.origin),
    FIELD(24, umb__canonical, content.bounds),
    FIELD(72, umb__canonical, content.scene_hash),
    {0},
};
static const struct field light_fields[] = {
    FIELD(0, umb_light_info, kind),          FIELD(4, umb_light_info, first_frustum),
    FIELD(8, umb_light_info, frustum_count), FIELD(16, umb_light_info, direction),
    FIELD(40, umb_light_info, position),     FIELD(64, umb_light_info, extent),
    FIELD(72, umb_light_info, name),         {0},
};
static const struct field side_fields[] = {
    FIELD(0, umb_light_info, side),
    {0},
};
static const struct field frustum_fields[] = {
    FIELD(0, umb_frustum_info, log2_size),
    FIELD(4, umb_frustum_info, light),
    FIELD(8, umb_frustum_info, closed),
    FIELD(16, umb_frustum_info, world_to_voxel),
    {0},
};
static const struct field count_fields[] = {
    {0, UMB__COUNTS_SIZE - 8, offsetof(struct umb__canonical, counts[UMB_LEVEL_BRICK])},
    FIELD(UMB__COUNTS_SIZE - 8, umb__canonical, content.bytes_2014),
    {0},
};
static const struct field root_fields[] = {
    FIELD(0, umb__packed_root, state),
    FIELD(4, umb__packed_root, page),
    FIELD(8, umb__packed_root, position),
    {0},
};

/* Offset of the word that is zero in the records of lights, frusta and roots. */
#define RECORD_ZERO 12U

/* The entries, in their fixed order. */
enum entry {
    ENTRY_SCENE,
    ENTRY_LIGHTS,
    ENTRY_FRUSTA,
    ENTRY_COUNTS,
    ENTRY_PLAN,
    ENTRY_SETTINGS,
    ENTRY_ROOTS,
    ENTRY_CURVE,
    ENTRY_OCCLUDER_DEPTH,
    ENTRY_TRANSMITTANCE,
    ENTRY_RECEIVER_MASK,
    ENTRY_SIDES,
    ENTRY_COUNT,
};

/* Place of an array in struct umb__canonical, and the size of its items. */
#define ARRAY(member)                                                                              \
    offsetof(struct umb__canonical, member), sizeof *((struct umb__canonical *)NULL)->member

/*
 * Most entries are marked as ones that a reader must understand. A reader that ignores translucent
 * casters would call their shadows lit. A reader that ignores the static rule would answer in
 * undefined space. The curve and the occluder depth may be ignored: answers are then fewer, but not
 * wrong. The entry of sides holds the side vectors of area lights. In memory a side is a member of
 * its light's record.
 */
static const struct row {
    uint32_t tag, flags;
    bool is_optional;           /* True if the entry is left out when it has no bytes */
    uint32_t record;            /* Bytes of a record in the file */
    const struct field *fields; /* NULL: records are the same in memory */
    size_t array;               /* Offset of the pointer to the records in memory */
    size_t item;                /* Bytes of a record in memory; 0: it is struct umb__canonical */
} rows[ENTRY_COUNT] = {
    {UMB__TAG_SCENE, UMB__MUST_UNDERSTAND, false, UMB__SCENE_SIZE, scene_fields, 0, 0},
    {UMB__TAG_LIGHTS, UMB__MUST_UNDERSTAND, false, UMB__LIGHT_SIZE, light_fields,
     ARRAY(content.lights)},
    {UMB__TAG_FRUSTA, UMB__MUST_UNDERSTAND, false, UMB__FRUSTUM_SIZE, frustum_fields,
     ARRAY(content.frusta)},
    {UMB__TAG_COUNTS, UMB__MUST_UNDERSTAND, false, UMB__COUNTS_SIZE, count_fields, 0, 0},
    {UMB__TAG_PLAN, UMB__MUST_UNDERSTAND, false, 1, NULL, ARRAY(content.plan)},
    {UMB__TAG_SETTINGS, UMB__MUST_UNDERSTAND, false, 1, NULL, ARRAY(content.settings)},
    {UMB__TAG_ROOTS, UMB__MUST_UNDERSTAND, false, UMB__ROOT_SIZE, root_fields, ARRAY(roots)},
    {UMB__TAG_CURVE, 0, true, UMB__CURVE_SIZE, NULL, ARRAY(content.curve)},
    {UMB__TAG_OCCLUDER_DEPTH, 0, true, 1, NULL, ARRAY(content.occluder_depth)},
    {UMB__TAG_TRANSMITTANCE, UMB__MUST_UNDERSTAND, true, 1, NULL, ARRAY(content.transmittance)},
    {UMB__TAG_RECEIVER_MASK, UMB__MUST_UNDERSTAND, true, 8, NULL,
     ARRAY(content.receiver_mask_cells)},
    {UMB__TAG_SIDES, UMB__MUST_UNDERSTAND, true, UMB__SIDE_SIZE, side_fields,
     ARRAY(content.lights)},
};

_Static_assert(sizeof(struct umb__curve_record) == UMB__CURVE_SIZE, "a row of the curve");
_Static_assert(sizeof(enum umb_light_kind) == 4 && sizeof(int) == 4, "fields of lights and frusta");

static enum umb_status no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "canonical block: no memory");
}

/* Returns the padded length of an entry: the next multiple of 8, where the next entry begins. */
static uint64_t padded(uint64_t length)
{
    return (length + 7) & ~(uint64_t)7;
}

/* --- decoding --------------------------------------------------------------------------------- */

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
        if (size > length || !umb__take(&at, end, 1, padded(size), &body)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "canonical block: entry %.4s of %llu bytes is cut", (const char *)head,
                            (unsigned long long)size);
        }
        if (!umb__all_zero(body + size, padded(size) - size)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "canonical block: entry %.4s: padding is not zero", (const char *)head);
        }
        size_t i = 0;
        while (i < ENTRY_COUNT && rows[i].tag != tag) {
            i++;
        }
        if (i == ENTRY_COUNT) {
            if (umb__load32(head + 4) & UMB__MUST_UNDERSTAND) {
                return umb_fail(error, UMB_E_VERSION,
                                "canonical block: entry 0x%08x needs a newer reader", tag);
            }
            continue;
        }
        if (umb__load32(head + 4) != rows[i].flags) {
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
        if (!entries->bytes[i] && !rows[i].is_optional) {
            return umb_fail(error, UMB_E_CORRUPT, "canonical block: an entry (0x%08x) is missing",
                            rows[i].tag);
        }
    }
    return UMB_OK;
}

static bool reserved_are_zero(const struct entries *entries)
{
    static const enum entry checked[] = {ENTRY_LIGHTS, ENTRY_FRUSTA, ENTRY_ROOTS};
    uint32_t rest = 0;
    for (size_t k = 0; k < sizeof checked / sizeof checked[0]; k++) {
        const uint8_t *bytes = entries->bytes[checked[k]];
        for (uint64_t i = 0; i < entries->lengths[checked[k]]; i += rows[checked[k]].record) {
            rest |= umb__load32(bytes + i + RECORD_ZERO);
            rest |= checked[k] == ENTRY_FRUSTA ? umb__load32(bytes + i + 8) & ~(uint32_t)1 : 0;
        }
    }
    return rest == 0;
}

static enum umb_status check_lengths(const struct entries *entries, struct umb_error *error)
{
    const uint64_t *lengths = entries->lengths;
    const uint64_t frusta = lengths[ENTRY_FRUSTA] / UMB__FRUSTUM_SIZE;
    bool fit = lengths[ENTRY_SCENE] == UMB__SCENE_SIZE &&
               lengths[ENTRY_COUNTS] == UMB__COUNTS_SIZE &&
               lengths[ENTRY_ROOTS] == frusta * UMB__ROOT_SIZE &&
               (!entries->bytes[ENTRY_CURVE] || lengths[ENTRY_CURVE] > 0) &&
               (!entries->bytes[ENTRY_SIDES] ||
                lengths[ENTRY_SIDES] == lengths[ENTRY_LIGHTS] / UMB__LIGHT_SIZE * UMB__SIDE_SIZE) &&
               (!entries->bytes[ENTRY_RECEIVER_MASK] ||
                lengths[ENTRY_RECEIVER_MASK] == frusta * UMB__RECEIVER_MASK_WORDS * 8);
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        fit = fit && lengths[i] % rows[i].record == 0;
    }
    if (!fit) {
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

/* Returns an entry's records in memory. */
static uint8_t *items_of(const struct umb__canonical *canonical, const struct row *row)
{
    uint8_t *items = (uint8_t *)(uintptr_t)canonical;
    if (row->item > 0) {
        memcpy(&items, items + row->array, sizeof items);
    }
    return items;
}

/* Copies an entry into memory: into a new array, or into `canonical` itself if it has one record.
 * The entry of sides goes into the lights that are already there. An entry without a list of fields
 * may be a text, so a NUL is added behind its bytes. Returns false if out of memory. */
static bool load(const struct entries *entries, enum entry entry, const struct umb_alloc *alloc,
                 struct umb__canonical *canonical)
{
    const struct row *row = &rows[entry];
    const uint8_t *bytes = entries->bytes[entry];
    const size_t length = (size_t)entries->lengths[entry], count = length / row->record;
    uint8_t *items = (uint8_t *)canonical;
    if (!bytes) {
        return true;
    }
    if (entry == ENTRY_SIDES) {
        items = items_of(canonical, row);
    } else if (row->item > 0) {
        items = umb__alloc_zeroed(alloc, row->fields ? count * row->item : length + 1, 1);
        memcpy((uint8_t *)canonical + row->array, &items, sizeof items);
    }
    if (items && !row->fields) {
        memcpy(items, bytes, length);
    }
    for (size_t i = 0; items && row->fields && i < count; i++) {
        for (const struct field *f = row->fields; f->bytes > 0; f++) {
            memcpy(items + i * row->item + f->member, bytes + i * row->record + f->at, f->bytes);
        }
    }
    return items != NULL;
}

/* Checks names and roots. A byte behind a name's NUL must be zero, because equal content must have
 * equal bytes. */
static enum umb_status check_records(const struct umb__canonical *canonical,
                                     struct umb_error *error)
{
    const struct umb__content *content = &canonical->content;
    for (uint32_t i = 0; i < content->light_count; i++) {
        const char *name = content->lights[i].name;
        const size_t length = strnlen(name, UMB_NAME_SIZE);
        if (!umb__all_zero((const uint8_t *)name + length, UMB_NAME_SIZE - length)) {
            return umb_fail(error, UMB_E_CORRUPT, "lights[%u].name: not padded with zeros", i);
        }
    }
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__packed_root *root = &canonical->roots[i];
        if (root->state > UMB__NODE_MIXED ||
            (root->state != UMB__NODE_MIXED && (root->page != 0 || root->position != 0))) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "roots[%u]: state %u, allowed 0 to 2, a place (page %u, position %u) "
                            "only with 2",
                            i, root->state, root->page, root->position);
        }
    }
    return UMB_OK;
}

/* Returns whether a light has a side vector other than zero, which makes it a rectangle. */
static bool has_side(const struct umb_light_info *light)
{
    return light->side[0] != 0 || light->side[1] != 0 || light->side[2] != 0;
}

static bool has_sides(const struct umb__content *content)
{
    bool any = false;
    for (uint32_t i = 0; i < content->light_count; i++) {
        any = any || has_side(&content->lights[i]);
    }
    return any;
}

/* Checks that the entry of side vectors is present only if some light has a side: equal content
 * must have equal bytes. */
static enum umb_status check_sides(const struct entries *entries,
                                   const struct umb__content *content, struct umb_error *error)
{
    return entries->bytes[ENTRY_SIDES] == NULL || has_sides(content)
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "canonical block: entry SIDE without a side");
}

/* Checks the number of nodes of each level. It must be below 2^32 - 1: node numbers have 32 bits,
 * and one of them means "none". */
static enum umb_status check_counts(const struct umb__canonical *canonical, struct umb_error *error)
{
    for (size_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        if (canonical->counts[level] >= UINT32_MAX) {
            return umb_fail(error, UMB_E_CORRUPT, "counts: level %zu claims %llu nodes", level,
                            (unsigned long long)canonical->counts[level]);
        }
    }
    return UMB_OK;
}

static enum umb_status load_occluder_depth(const struct entries *entries,
                                           const struct umb_alloc *alloc,
                                           struct umb__canonical *canonical,
                                           struct umb_error *error)
{
    const uint64_t length = entries->lengths[ENTRY_OCCLUDER_DEPTH];
    if (entries->bytes[ENTRY_OCCLUDER_DEPTH] && (length % 4 != 0 || length == 0)) {
        return umb_fail(error, UMB_E_CORRUPT, "front: %llu bytes are not whole words",
                        (unsigned long long)length);
    }
    canonical->content.occluder_depth_words = length / 4;
    return load(entries, ENTRY_OCCLUDER_DEPTH, alloc, canonical)
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "front: no memory for %llu bytes",
                          (unsigned long long)length);
}

static enum umb_status decode(const uint8_t *bytes, uint64_t length, const struct umb_alloc *alloc,
                              struct umb__canonical *canonical, struct umb_error *error)
{
    struct entries entries;
    struct umb__content *content = &canonical->content;
    UMB__TRY(find_entries(bytes, length, &entries, error));
    UMB__TRY(check_lengths(&entries, error));
    content->light_count = (uint32_t)(entries.lengths[ENTRY_LIGHTS] / UMB__LIGHT_SIZE);
    content->frustum_count = (uint32_t)(entries.lengths[ENTRY_FRUSTA] / UMB__FRUSTUM_SIZE);
    content->curve_count = (uint32_t)(entries.lengths[ENTRY_CURVE] / UMB__CURVE_SIZE);
    content->transmittance_bytes = entries.lengths[ENTRY_TRANSMITTANCE];
    for (enum entry i = ENTRY_SCENE; i <= ENTRY_CURVE; i++) {
        if (!load(&entries, i, alloc, canonical)) {
            return no_memory(error);
        }
    }
    if (!load(&entries, ENTRY_SIDES, alloc, canonical)) {
        return no_memory(error);
    }
    UMB__TRY(check_records(canonical, error));
    UMB__TRY(check_sides(&entries, content, error));
    UMB__TRY(check_counts(canonical, error));
    UMB__TRY(load_occluder_depth(&entries, alloc, canonical, error));
    if (!load(&entries, ENTRY_RECEIVER_MASK, alloc, canonical)) {
        return no_memory(error);
    }
    UMB__TRY(umb__content_check(content, error));
    if (entries.bytes[ENTRY_TRANSMITTANCE]) {
        UMB__TRY(umb__transmittance_load(entries.bytes[ENTRY_TRANSMITTANCE],
                                         content->transmittance_bytes, content->frusta,
                                         content->frustum_count, alloc, &canonical->trans, error));
    }
    if (!load(&entries, ENTRY_TRANSMITTANCE, alloc, canonical)) {
        return no_memory(error);
    }
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
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (rows[i].item > 0 && i != ENTRY_SIDES) {
            umb__free(alloc, items_of(canonical, &rows[i]));
        }
    }
    umb__transmittance_finish(&canonical->trans, alloc);
    memset(canonical, 0, sizeof *canonical);
}

/* --- encoding --------------------------------------------------------------------------------- */

/* Writes an entry of `length` bytes. In: at: zeroed. */
static void write_entry(uint8_t *at, enum entry entry, size_t length,
                        const struct umb__canonical *canonical)
{
    const struct row *row = &rows[entry];
    const uint8_t *items = items_of(canonical, row);
    if (!row->fields && length > 0) {
        memcpy(at, items, length);
    }
    for (size_t i = 0; row->fields && i < length / row->record; i++) {
        uint8_t *record = at + i * row->record;
        for (const struct field *f = row->fields; f->bytes > 0; f++) {
            memcpy(record + f->at, items + i * row->item + f->member, f->bytes);
        }
        if (entry == ENTRY_LIGHTS) { /* Bytes behind a name's NUL have no meaning in memory */
            const size_t name = strnlen((const char *)record + 72, UMB_NAME_SIZE);
            memset(record + 72 + name, 0, UMB_NAME_SIZE - name);
        } else if (entry == ENTRY_FRUSTA) { /* Any nonzero `closed` means 1 */
            umb__store32(record + 8, umb__load32(record + 8) != 0);
        }
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

/* Returns the number of bytes that an entry with `length` bytes of content takes in the block, its
 * head included; 0 if the entry is left out. */
static uint64_t entry_length(size_t entry, uint64_t length)
{
    return length == 0 && rows[entry].is_optional ? 0 : UMB__ENTRY_HEAD + padded(length);
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
    lengths[ENTRY_SIDES] = has_sides(content) ? (uint64_t)content->light_count * UMB__SIDE_SIZE : 0;
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
        umb__store32(at, rows[i].tag);
        umb__store32(at + 4, rows[i].flags);
        umb__store64(at + 8, lengths[i]);
        write_entry(at + UMB__ENTRY_HEAD, (enum entry)i, (size_t)lengths[i], canonical);
        at += entry_length(i, lengths[i]);
    }
    return UMB_OK;
}
