/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reads and writes mapped files: a head, then the arrays of a view, each at a multiple of 4096
 * bytes.
 *
 * The reader validates a file, so that queries need no checks. Every number that a query follows is
 * the start of a node of the right level, or an existing brick. A walk over each level finds the
 * node starts and marks them, one bit a word. Every byte of the file is checked: sections by their
 * checksums, the gaps between them as zero.
 */
#include <stdbool.h>
#include <string.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/try.h"
#include "format/asset_parts.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the mapped layout is little-endian and used in place"
#endif

enum section {
    SECTION_TOPS,
    SECTION_LEVELS,
    SECTION_GRID,
    SECTION_NODES,
    SECTION_BRICKS,
    SECTION_COLUMNS,
    SECTION_PIECES,
    SECTION_COUNT,
};

static const uint32_t section_tags[SECTION_COUNT] = {
    UMB__TAG_TOPS,   UMB__TAG_LEVELS,  UMB__TAG_GRID,   UMB__TAG_NODES,
    UMB__TAG_BRICKS, UMB__TAG_COLUMNS, UMB__TAG_PIECES,
};

/* The bytes of each section. */
struct sections {
    const void *bytes[SECTION_COUNT];
    uint64_t lengths[SECTION_COUNT];
};

static enum umb_status find_sections(const uint8_t *file, const struct umb__head *head, int full,
                                     struct sections *sections, struct umb_error *error)
{
    if (head->directory_count != SECTION_COUNT) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: %u sections, a mapped file has %d",
                        head->directory_count, SECTION_COUNT);
    }
    uint64_t end = head->head_length; /* End of the section before */
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        const uint8_t *entry = head->directory + i * UMB__SECTION_ENTRY;
        uint64_t offset = umb__load64(entry + UMB__SECTION_OFFSET);
        uint64_t length = umb__load64(entry + UMB__SECTION_LENGTH);
        if (umb__load32(entry + UMB__SECTION_ZERO) != 0) {
            return umb_fail(error, UMB_E_VERSION,
                            "directory: section %zu uses reserved fields of a newer writer", i);
        }
        if (umb__load32(entry + UMB__SECTION_TAG) != section_tags[i] ||
            offset % UMB__SECTION_ALIGN != 0 || offset < end ||
            offset - end >= UMB__SECTION_ALIGN || offset > head->file_length ||
            length > head->file_length - offset) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "directory: section %zu at %llu with %llu bytes does not follow %llu "
                            "in a file of %llu",
                            i, (unsigned long long)offset, (unsigned long long)length,
                            (unsigned long long)end, (unsigned long long)head->file_length);
        }
        if (full && !umb__all_zero(file + end, offset - end)) {
            return umb_fail(error, UMB_E_CORRUPT, "section %zu: bytes before it are not zero", i);
        }
        end = offset + length;
        sections->bytes[i] = file + offset;
        sections->lengths[i] = length;
        if (full &&
            XXH3_64bits(file + offset, (size_t)length) != umb__load64(entry + UMB__SECTION_CHECK)) {
            return umb_fail(error, UMB_E_CORRUPT, "section %.4s: checksum does not match",
                            (const char *)entry);
        }
    }
    if (end != head->file_length) {
        return umb_fail(error, UMB_E_CORRUPT, "directory: %llu bytes follow the last section",
                        (unsigned long long)(head->file_length - end));
    }
    return UMB_OK;
}

static uint64_t pieces_of(const struct umb__view *view, const struct umb__content *content,
                          uint32_t i)
{
    uint64_t end =
        i + 1 < content->frustum_count ? view->tops[i + 1].first_piece : view->piece_count;
    return end - view->tops[i].first_piece;
}

/* Checks that the grids and columns of all frusta are contiguous, and that each has the size that
 * its frustum requires. */
static enum umb_status check_tops(const struct umb__content *content, const struct umb__view *view,
                                  struct umb_error *error)
{
    uint64_t cells = 0, columns = 0, pieces = 0;
    for (uint32_t i = 0; i < content->frustum_count; i++) {
        const struct umb__top *top = &view->tops[i];
        uint32_t n = content->frusta[i].log2_size, g = top->grid_log2, c = top->column_level;
        if (g > UMB__GRID_LOG2_MAX || g + UMB_LEVEL_BRICK > n || (n - g) % 2 == 0 ||
            top->first_cell != cells) {
            return umb_fail(error, UMB_E_CORRUPT, "tops[%u]: grid of 2^%u cells does not fit", i,
                            g);
        }
        if (c % 2 == 0 || c > n - g || c < (n - g < UMB__WIDE_FIRST ? n - g : UMB__WIDE_FIRST) ||
            top->first_column != columns) {
            return umb_fail(error, UMB_E_CORRUPT, "tops[%u]: columns of level %u do not fit", i, c);
        }
        cells += (uint64_t)1 << (3 * g);
        columns += (uint64_t)1 << (2 * (n - c));
        if ((i == 0 && top->first_piece != 0) || top->first_piece < pieces ||
            view->piece_count < 2 || top->first_piece > view->piece_count - 2) {
            return umb_fail(error, UMB_E_CORRUPT, "tops[%u]: no pieces at %llu", i,
                            (unsigned long long)top->first_piece);
        }
        pieces = top->first_piece + 2; /* A frustum has at least the pieces 0 and 1 */
    }
    if (cells != view->grid_count || columns != view->column_count) {
        return umb_fail(error, UMB_E_CORRUPT,
                        "sections: %llu cells and %llu columns, the frusta need %llu and %llu",
                        (unsigned long long)view->grid_count,
                        (unsigned long long)view->column_count, (unsigned long long)cells,
                        (unsigned long long)columns);
    }
    return UMB_OK;
}

static enum umb_status check_shapes(const struct sections *s, const struct umb__content *content,
                                    struct umb__top *tops, struct umb__view *view,
                                    struct umb_error *error)
{
    if (s->lengths[SECTION_TOPS] != (uint64_t)content->frustum_count * UMB__TOP_SIZE ||
        s->lengths[SECTION_LEVELS] != sizeof view->level_begin ||
        s->lengths[SECTION_GRID] % 4 != 0 || s->lengths[SECTION_NODES] % 8 != 0 ||
        s->lengths[SECTION_BRICKS] % 64 != 0 ||
        s->lengths[SECTION_COLUMNS] % sizeof *view->columns != 0 ||
        s->lengths[SECTION_PIECES] % 4 != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "sections: a length does not fit its content");
    }
    memcpy(tops, s->bytes[SECTION_TOPS], (size_t)s->lengths[SECTION_TOPS]);
    view->tops = tops;
    view->grid = s->bytes[SECTION_GRID];
    view->nodes = s->bytes[SECTION_NODES];
    view->bricks = s->bytes[SECTION_BRICKS];
    view->columns = s->bytes[SECTION_COLUMNS];
    view->pieces = s->bytes[SECTION_PIECES];
    view->grid_count = s->lengths[SECTION_GRID] / 4;
    view->node_words = s->lengths[SECTION_NODES] / 8;
    view->brick_count = s->lengths[SECTION_BRICKS] / 64;
    view->column_count = s->lengths[SECTION_COLUMNS] / sizeof *view->columns;
    view->piece_count = s->lengths[SECTION_PIECES] / 4;
    memcpy(view->level_begin, s->bytes[SECTION_LEVELS], sizeof view->level_begin);
    if (view->level_begin[0] != 0 || view->level_begin[UMB__WIDE_COUNT] != view->node_words) {
        return umb_fail(error, UMB_E_CORRUPT, "levels: do not span the nodes");
    }
    for (size_t i = 0; i < UMB__WIDE_COUNT; i++) {
        if (view->level_begin[i] > view->level_begin[i + 1]) {
            return umb_fail(error, UMB_E_CORRUPT, "levels: not in order");
        }
    }
    return check_tops(content, view, error);
}

/* Returns true if `number` is a brick, or the start of a node of `level`. */
static bool number_is_valid(const struct umb__view *view, const uint64_t *starts, uint32_t level,
                            uint64_t number)
{
    if (level == UMB_LEVEL_BRICK) {
        return number < view->brick_count;
    }
    size_t wide = (level - UMB__WIDE_FIRST) / 2;
    return number >= view->level_begin[wide] && number < view->level_begin[wide + 1] &&
           (starts[number / 64] >> (number % 64) & 1) != 0;
}

/* Walks the nodes of one level, checks each node and marks its start. */
static bool check_level(const struct umb__view *view, uint64_t *starts, size_t wide)
{
    uint32_t child_level = (uint32_t)(UMB__WIDE_FIRST + 2 * wide - 2);
    uint64_t word = view->level_begin[wide], end = view->level_begin[wide + 1];
    while (word < end) {
        const uint64_t *node = view->nodes + word;
        if (end - word < 2) {
            return false;
        }
        if (node[0] == 0 &&
            node[1] == 0) { /* A gap between nodes, or a node that is all shadowed */
            starts[word / 64] |= (uint64_t)1 << (word % 64);
            word += 2;
            continue;
        }
        unsigned count = (unsigned)__builtin_popcountll(node[0]);
        if (end - word < umb__wide_words(count) || (node[0] & node[1]) != 0) {
            return false;
        }
        if (count % 2 == 1 && node[2 + count / 2] >> 32 != 0) {
            return false; /* The unused half of the last word is not zero */
        }
        if ((count + 1) / 2 % 2 == 1 && node[2 + count / 2 + count % 2] != 0) {
            return false; /* The unused word is not zero */
        }
        for (unsigned i = 0; i < count; i++) {
            uint64_t number = i % 2 ? node[2 + i / 2] >> 32 : node[2 + i / 2] & 0xffffffffU;
            if (!number_is_valid(view, starts, child_level, number)) {
                return false;
            }
        }
        starts[word / 64] |= (uint64_t)1 << (word % 64);
        word += umb__wide_words(count);
    }
    return true;
}

/* Checks that the lists of all columns lie within the frustum's pieces, and that every piece is
 * valid. */
static bool check_columns(const struct umb__view *view, const uint64_t *starts,
                          const struct umb__content *content, uint32_t frustum)
{
    const struct umb__top *top = &view->tops[frustum];
    const struct umb__column *columns = view->columns + top->first_column;
    const uint32_t *pieces = view->pieces + top->first_piece;
    /* Columns are 2^up pieces deep, and a frustum has 2^up by 2^up of them. */
    const uint32_t up = content->frusta[frustum].log2_size - top->column_level;
    uint64_t count = pieces_of(view, content, frustum);
    for (uint64_t i = 0; i < (uint64_t)1 << (2 * up); i++) {
        const struct umb__column *c = &columns[i];
        if (c->low > c->high || c->high >> up != 0 ||
            (uint64_t)c->first + c->high - c->low >= count) {
            return false;
        }
    }
    for (uint64_t i = 0; i < count; i++) {
        if (pieces[i] >= UMB__CELL_FIRST &&
            !number_is_valid(view, starts, top->column_level, pieces[i] - UMB__CELL_FIRST)) {
            return false;
        }
    }
    return pieces[0] == UMB__CELL_SHADOWED && pieces[1] == UMB__CELL_LIT;
}

/* Checks all cells of a frustum's grid, and its columns. */
static enum umb_status check_frustum(const struct umb__view *view, const uint64_t *starts,
                                     const struct umb__content *content, uint32_t frustum,
                                     struct umb_error *error)
{
    const struct umb__top *top = &view->tops[frustum];
    const uint32_t level = content->frusta[frustum].log2_size - top->grid_log2;
    const uint64_t cells = (uint64_t)1 << (3 * top->grid_log2);
    for (uint64_t c = 0; c < cells; c++) {
        uint32_t value = view->grid[top->first_cell + c];
        if (value >= UMB__CELL_FIRST &&
            !number_is_valid(view, starts, level, value - UMB__CELL_FIRST)) {
            return umb_fail(error, UMB_E_CORRUPT, "grid %u: cell %llu leads nowhere", frustum,
                            (unsigned long long)c);
        }
    }
    return check_columns(view, starts, content, frustum)
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "columns %u: malformed", frustum);
}

static enum umb_status check_structure(const struct umb__view *view,
                                       const struct umb__content *content,
                                       const struct umb_alloc *alloc, struct umb_error *error)
{
    uint64_t *starts = umb__alloc_zeroed(alloc, (size_t)(view->node_words / 64 + 1), 8);
    if (!starts) {
        return umb_fail(error, UMB_E_NO_MEMORY, "validating: out of memory");
    }
    enum umb_status status = UMB_OK;
    for (size_t wide = 0; wide < UMB__WIDE_COUNT && status == UMB_OK; wide++) {
        if (!check_level(view, starts, wide)) {
            status = umb_fail(error, UMB_E_CORRUPT, "nodes: level %zu is malformed",
                              UMB__WIDE_FIRST + 2 * wide);
        }
    }
    for (uint32_t i = 0; i < content->frustum_count && status == UMB_OK; i++) {
        status = check_frustum(view, starts, content, i, error);
    }
    umb__free(alloc, starts);
    return status;
}

enum umb_status umb__mapped_view(const uint8_t *file, const struct umb__head *head,
                                 const struct umb__content *content, int full,
                                 struct umb__mapped *mapped, struct umb_error *error)
{
    struct sections sections;
    struct umb__view *view = &mapped->view;
    memset(view, 0, sizeof *view);
    mapped->tops = umb__alloc(mapped->alloc, (size_t)content->frustum_count + 1, UMB__TOP_SIZE);
    if (!mapped->tops) {
        return umb_fail(error, UMB_E_NO_MEMORY, "opening: out of memory");
    }
    UMB__TRY(find_sections(file, head, full, &sections, error));
    UMB__TRY(check_shapes(&sections, content, mapped->tops, view, error));
    return full ? check_structure(view, content, mapped->alloc, error) : UMB_OK;
}

/* --- writing ---------------------------------------------------------------------------------- */

static uint64_t aligned(uint64_t offset)
{
    return (offset + UMB__SECTION_ALIGN - 1) / UMB__SECTION_ALIGN * UMB__SECTION_ALIGN;
}

/* Fills the directory. Returns the length of the file. */
static uint64_t place_sections(const struct sections *sections, uint64_t head_length,
                               uint8_t *directory)
{
    uint64_t end = head_length;
    for (size_t i = 0; i < SECTION_COUNT; i++) {
        uint8_t *entry = directory + i * UMB__SECTION_ENTRY;
        umb__store32(entry + UMB__SECTION_TAG, section_tags[i]);
        umb__store64(entry + UMB__SECTION_OFFSET, aligned(end));
        umb__store64(entry + UMB__SECTION_LENGTH, sections->lengths[i]);
        umb__store64(entry + UMB__SECTION_CHECK,
                     XXH3_64bits(sections->bytes[i], (size_t)sections->lengths[i]));
        end = aligned(end) + sections->lengths[i];
    }
    return end;
}

static enum umb_status write_sections(const struct sections *sections, uint64_t written,
                                      const struct umb_sink *sink)
{
    static const uint8_t zeros[UMB__SECTION_ALIGN];
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < SECTION_COUNT && status == UMB_OK; i++) {
        const size_t gap = (size_t)(aligned(written) - written);
        if (gap > 0) {
            status = sink->write(sink->user, zeros, gap);
        }
        if (status == UMB_OK && sections->lengths[i] > 0) {
            status = sink->write(sink->user, sections->bytes[i], (size_t)sections->lengths[i]);
        }
        written += gap + sections->lengths[i];
    }
    return status;
}

enum umb_status umb__mapped_write(const struct umb_asset *asset, const struct umb_sink *sink,
                                  struct umb_error *error)
{
    const struct umb__view *view = &asset->view;
    const struct sections sections = {
        .bytes = {view->tops, view->level_begin, view->grid, view->nodes, view->bricks,
                  view->columns, view->pieces},
        .lengths = {asset->canonical.content.frustum_count * (uint64_t)UMB__TOP_SIZE,
                    sizeof view->level_begin, view->grid_count * 4, view->node_words * 8,
                    view->brick_count * 64, view->column_count * sizeof *view->columns,
                    view->piece_count * 4},
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
    head.head_length = umb__head_length(&head);
    head.file_length = place_sections(&sections, head.head_length, directory);
    uint8_t *bytes = umb__head_make(&head, asset->alloc);
    if (!bytes) {
        return umb_fail(error, UMB_E_NO_MEMORY, "writing the mapped form: out of memory");
    }
    enum umb_status status = sink->write(sink->user, bytes, (size_t)head.head_length);
    umb__free(asset->alloc, bytes);
    status = status == UMB_OK ? write_sections(&sections, head.head_length, sink) : status;
    return status == UMB_OK
               ? UMB_OK
               : umb_fail(error, status, "mapped form: %llu bytes of output: %s",
                          (unsigned long long)head.file_length, umb_status_text(status));
}
