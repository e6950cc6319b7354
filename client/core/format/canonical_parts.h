/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_CANONICAL_PARTS_H
#define UMBRAGE_CORE_FORMAT_CANONICAL_PARTS_H
/* Entries of the canonical block, their order and flags; shared by its writer and its reader. */
#include <stdbool.h>
#include "format/canonical.h"
#include "format/layout.h"

/* The entries, in their fixed order. */
enum umb__entry {
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
    ENTRY_COUNT,
};

static const uint32_t umb__entry_tags[ENTRY_COUNT] = {
    UMB__TAG_SCENE,          UMB__TAG_LIGHTS,        UMB__TAG_FRUSTA,        UMB__TAG_COUNTS,
    UMB__TAG_PLAN,           UMB__TAG_SETTINGS,      UMB__TAG_ROOTS,         UMB__TAG_CURVE,
    UMB__TAG_OCCLUDER_DEPTH, UMB__TAG_TRANSMITTANCE, UMB__TAG_RECEIVER_MASK,
};

/* Returns true for entries that are left out if they have no bytes. */
static inline bool umb__entry_is_optional(size_t entry)
{
    return entry == ENTRY_CURVE || entry == ENTRY_OCCLUDER_DEPTH || entry == ENTRY_TRANSMITTANCE ||
           entry == ENTRY_RECEIVER_MASK;
}

/* Returns an entry's flags, which say whether a reader must understand the entry. A reader that
 * ignores translucent casters would call their shadows lit. A reader that ignores the static rule
 * would answer in undefined space. The curve and the occluder depth may be ignored: answers are
 * then fewer, but not wrong. */
static inline uint32_t umb__entry_flags(size_t entry)
{
    return entry == ENTRY_CURVE || entry == ENTRY_OCCLUDER_DEPTH ? 0 : UMB__MUST_UNDERSTAND;
}

/* Returns the padded length of an entry: the next multiple of 8, where the next entry begins. */
static inline uint64_t umb__entry_padded(uint64_t length)
{
    return (length + 7) & ~(uint64_t)7;
}

#endif
