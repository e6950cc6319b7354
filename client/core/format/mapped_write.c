/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the mapped form of an open asset: its head, then the arrays of its view, each at a
 * multiple of 4096 bytes. */
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "format/asset_parts.h"
#include "format/head.h"

enum {
    SECTION_COUNT = 7
};

struct section {
    uint32_t tag;
    const void *bytes;
    uint64_t length;
    uint64_t offset;
};

static uint64_t aligned(uint64_t offset)
{
    return (offset + UMB__SECTION_ALIGN - 1) / UMB__SECTION_ALIGN * UMB__SECTION_ALIGN;
}

static uint64_t place_sections(struct section *sections, uint64_t head_length)
{
    uint64_t offset = head_length;
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        sections[i].offset = aligned(offset);
        offset = sections[i].offset + sections[i].length;
    }
    return offset;
}

static enum umb_status write_sections(const struct section *sections, uint64_t written,
                                      const struct umb_sink *sink)
{
    static const uint8_t zeros[UMB__SECTION_ALIGN];
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < SECTION_COUNT && status == UMB_OK; i++) {
        if (sections[i].offset > written) {
            status = sink->write(sink->user, zeros, (size_t)(sections[i].offset - written));
        }
        if (status == UMB_OK && sections[i].length > 0) {
            status = sink->write(sink->user, sections[i].bytes, (size_t)sections[i].length);
        }
        written = sections[i].offset + sections[i].length;
    }
    return status;
}

enum umb_status umb__mapped_write(const struct umb_asset *asset, const struct umb_sink *sink,
                                  struct umb_error *error)
{
    const struct umb__view *view = &asset->view;
    struct section sections[SECTION_COUNT] = {
        {UMB__TAG_TOPS, view->tops,
         (uint64_t)asset->canonical.content.frustum_count * UMB__TOP_SIZE, 0},
        {UMB__TAG_LEVELS, view->level_begin, sizeof view->level_begin, 0},
        {UMB__TAG_GRID, view->grid, view->grid_count * 4, 0},
        {UMB__TAG_NODES, view->nodes, view->node_words * 8, 0},
        {UMB__TAG_BRICKS, view->bricks, view->brick_count * 64, 0},
        {UMB__TAG_COLUMNS, view->columns, view->column_count * sizeof *view->columns, 0},
        {UMB__TAG_PIECES, view->pieces, view->piece_count * 4, 0},
    };
    uint8_t directory[SECTION_COUNT * UMB__SECTION_ENTRY] = {0};
    struct umb__head head = {
        .encoding = UMB_ENCODING_MAPPED,
        .canonical = asset->canonical_bytes,
        .canonical_length = asset->canonical_length,
        .directory = directory,
        .directory_count = SECTION_COUNT,
        .info = (const uint8_t *)asset->notes,
        .info_length = (uint32_t)strlen(asset->notes),
    };
    memcpy(head.id, asset->id, UMB_ID_BYTES);
    head.head_length = umb__head_length(head.canonical_length, SECTION_COUNT, UMB__SECTION_ENTRY,
                                        head.info_length);
    head.file_length = place_sections(sections, head.head_length);
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        uint8_t *entry = directory + i * UMB__SECTION_ENTRY;
        umb__store32(entry + UMB__SECTION_TAG, sections[i].tag);
        umb__store64(entry + UMB__SECTION_OFFSET, sections[i].offset);
        umb__store64(entry + UMB__SECTION_LENGTH, sections[i].length);
        umb__store64(entry + UMB__SECTION_CHECK,
                     XXH3_64bits(sections[i].bytes, (size_t)sections[i].length));
    }
    uint8_t *bytes = umb__alloc(asset->alloc, (size_t)head.head_length, 1);
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "writing the mapped form: out of memory");
    }
    umb__head_write(&head, UMB__SECTION_ENTRY, bytes);
    enum umb_status status = sink->write(sink->user, bytes, (size_t)head.head_length);
    umb__free(asset->alloc, bytes);
    status = status == UMB_OK ? write_sections(sections, head.head_length, sink) : status;
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(error, status, "mapped form: %llu bytes of output: %s",
                          (unsigned long long)head.file_length, umb_status_text(status));
}
