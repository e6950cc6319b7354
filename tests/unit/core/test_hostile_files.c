/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Files whose checksums are right and whose content is wrong: an attacker can make them, an
 * accident does not. The tests damage files and then make the head's checksum right again.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "format/asset_parts.h"
#include "format/layout.h"
#include "make_asset.h"
#include "seal_asset.h"
#include "umbrage/query.h"

static const double origin[3] = {10, 20, 30};

static int bumpy(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    uint32_t size = 1U << *(const uint32_t *)user;
    uint64_t coarse = (x / 16 * 73856093U) ^ (y / 16 * 19349663U) ^ (frustum * 83492791U);
    uint64_t fine = (x * 2654435761U) ^ (y * 40503U);
    return z < (uint32_t)(coarse % (size - 8)) + (uint32_t)(fine >> 7) % 5;
}

static struct bytes bumpy_file(uint32_t log2_size)
{
    struct voxels voxels = {bumpy, &log2_size, log2_size, 1};
    return make_packed(&voxels, 0.5, origin);
}

static enum umb_status open_status(const struct bytes *file, struct umb_error *error)
{
    struct umb_asset *asset;
    memset(error, 0, sizeof *error);
    enum umb_status status = umb_asset_open_bytes(file->data, file->size, NULL, &asset, error);
    umb_asset_close(asset);
    return status;
}

/* Offset of the body of a canonical entry. */
static size_t entry_at(const struct bytes *file, uint32_t tag)
{
    size_t at = UMB__HEAD_SIZE;
    while (umb__load32(file->data + at) != tag) {
        at += UMB__ENTRY_HEAD + (umb__load64(file->data + at + 8) + 7) / 8 * 8;
        assert_true(at < file->size);
    }
    return at + UMB__ENTRY_HEAD;
}

static size_t directory_at(const struct bytes *file)
{
    return UMB__HEAD_SIZE + umb__load64(file->data + UMB__HEAD_CANONICAL_LENGTH);
}

/* Offset of the entry of page 0, in the first block behind the head. */
static size_t first_entry_at(const struct bytes *file)
{
    return (size_t)umb__load64(file->data + UMB__HEAD_LENGTH);
}

/* Changes one byte of a sealed file, tries it and puts the byte back. */
static void expect_spoilt(struct bytes *file, size_t at, uint8_t value, enum umb_status wanted,
                          const char *words)
{
    struct umb_error error;
    uint8_t before = file->data[at];
    assert_int_not_equal(before, value);
    file->data[at] = value;
    seal_asset(file, false);
    assert_int_equal(open_status(file, &error), wanted);
    if (strstr(error.message, words) == NULL) {
        fail_msg("'%s' does not say '%s'", error.message, words);
    }
    file->data[at] = before;
    seal_asset(file, false);
}

static void reserved_fields_are_a_newer_file(void **state)
{
    struct bytes packed = bumpy_file(6), mapped = make_mapped(&packed);
    struct umb_error error;
    (void)state;
    size_t light = entry_at(&packed, UMB__TAG_LIGHTS);
    size_t frustum = entry_at(&packed, UMB__TAG_FRUSTA);
    size_t root = entry_at(&packed, UMB__TAG_ROOTS);
    expect_spoilt(&packed, light + 13, 1, UMB_E_VERSION, "newer");
    expect_spoilt(&packed, light - 12, 0, UMB_E_VERSION, "newer"); /* the entry's flags */
    expect_spoilt(&packed, light - 11, 1, UMB_E_VERSION, "newer");
    expect_spoilt(&packed, frustum + 8, 2, UMB_E_VERSION, "newer");
    expect_spoilt(&packed, frustum + 15, 1, UMB_E_VERSION, "newer");
    expect_spoilt(&packed, root + 12, 1, UMB_E_VERSION, "newer");
    expect_spoilt(&mapped, directory_at(&mapped) + UMB__SECTION_ZERO, 1, UMB_E_VERSION, "newer");
    expect_spoilt(&packed, UMB__HEAD_ZERO + 7, 1, UMB_E_VERSION, "newer");
    assert_int_equal(open_status(&packed, &error), UMB_OK);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void a_directory_that_does_not_fit_its_file_is_refused(void **state)
{
    struct bytes packed = bumpy_file(6);
    (void)state;
    expect_spoilt(&packed, UMB__HEAD_PAGES + 1, 1, UMB_E_CORRUPT, "pages: 257");
    expect_spoilt(&packed, UMB__HEAD_BLOCKS, 1, UMB_E_CORRUPT, "do not fit the file");
    expect_spoilt(&packed, UMB__HEAD_BLOCKS + 7, 0xff, UMB_E_CORRUPT, "do not fit the file");
    expect_spoilt(&packed, UMB__HEAD_FIRST_BLOCK, 1, UMB_E_CORRUPT, "do not fit the file");
    expect_spoilt(&packed, directory_at(&packed) + UMB__BLOCK_END, 1, UMB_E_CORRUPT,
                  "do not fit the file");
    expect_spoilt(&packed, directory_at(&packed) + UMB__BLOCK_END + 7, 0xff, UMB_E_CORRUPT,
                  "do not fit the file");
    expect_spoilt(&packed, first_entry_at(&packed) + UMB__PAGE_LINKS, 1, UMB_E_CORRUPT,
                  "its entries and links");
    expect_spoilt(&packed, first_entry_at(&packed), 1, UMB_E_CORRUPT, "block 0");
    expect_spoilt(&packed, first_entry_at(&packed) + UMB__PAGE_STORED_LENGTH + 3, 1, UMB_E_CORRUPT,
                  "page 0");
    packed.data[first_entry_at(&packed) + UMB__PAGE_HASH] ^= 1; /* its check is not made again */
    struct umb_error error;
    assert_int_equal(open_status(&packed, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "checksum of block 0"));
    packed.data[UMB__HEAD_VERSION] = 1;
    assert_int_equal(open_status(&packed, &error), UMB_E_VERSION);
    assert_non_null(strstr(error.message, "version: 1.0, this reader knows version 3"));
    assert_non_null(strstr(error.message, "an earlier version: bake the scene again"));
    packed.data[UMB__HEAD_VERSION] = 4;
    assert_int_equal(open_status(&packed, &error), UMB_E_VERSION);
    assert_non_null(strstr(error.message, "a later version"));
    bytes_finish(&packed);
}

static void an_entry_that_must_be_understood_is_not_passed_over(void **state)
{
    struct bytes packed = bumpy_file(6);
    (void)state;
    /* An unknown tag whose flags say that a reader must understand the entry. */
    expect_spoilt(&packed, entry_at(&packed, UMB__TAG_LIGHTS) - UMB__ENTRY_HEAD, '?', UMB_E_VERSION,
                  "needs a newer reader");
    bytes_finish(&packed);
}

static void a_frustum_of_another_light_is_refused(void **state)
{
    struct bytes packed = bumpy_file(6);
    (void)state;
    expect_spoilt(&packed, entry_at(&packed, UMB__TAG_FRUSTA) + 4, 1, UMB_E_CORRUPT,
                  "names light 1");
    bytes_finish(&packed);
}

static void a_page_that_claims_too_much_is_refused(void **state)
{
    struct bytes packed = bumpy_file(6);
    (void)state;
    expect_spoilt(&packed, first_entry_at(&packed) + UMB__PAGE_RAW_LENGTH + 2, 0x11, UMB_E_CORRUPT,
                  "at most 1048576");
    bytes_finish(&packed);
}

static void bytes_behind_the_last_page_are_refused(void **state)
{
    struct bytes packed = bumpy_file(6);
    struct bytes longer = {malloc(packed.size + 1), packed.size + 1, packed.size + 1};
    struct umb_error error;
    (void)state;
    assert_non_null(longer.data);
    memcpy(longer.data, packed.data, packed.size);
    longer.data[packed.size] = 0;
    umb__store64(longer.data + UMB__HEAD_FILE_LENGTH, longer.size);
    seal_asset(&longer, false);
    assert_int_equal(open_status(&longer, &error), UMB_E_CORRUPT);
    if (strstr(error.message, "1 bytes follow the last page") == NULL) {
        fail_msg("'%s'", error.message);
    }
    free(longer.data);
    bytes_finish(&packed);
}

static void texts_that_are_not_utf8_are_refused(void **state)
{
    struct bytes packed = bumpy_file(6);
    (void)state;
    size_t info = directory_at(&packed) +
                  umb__load32(packed.data + UMB__HEAD_DIRECTORY_COUNT) * UMB__BLOCK_ENTRY;
    size_t name = entry_at(&packed, UMB__TAG_LIGHTS) + 72;
    expect_spoilt(&packed, name, 0xff, UMB_E_CORRUPT, "lights[0].name");
    expect_spoilt(&packed, name + 20, 'x', UMB_E_CORRUPT, "not padded");
    expect_spoilt(&packed, entry_at(&packed, UMB__TAG_PLAN) + 3, 0xc3, UMB_E_CORRUPT, "UTF-8");
    expect_spoilt(&packed, entry_at(&packed, UMB__TAG_SETTINGS) + 3, 0, UMB_E_CORRUPT, "UTF-8");
    expect_spoilt(&packed, info + 2, 0x80, UMB_E_CORRUPT, "info");
    expect_spoilt(&packed, info + 2, 0, UMB_E_CORRUPT, "info");
    bytes_finish(&packed);
}

static void messages_about_hostile_bytes_are_plain_text(void **state)
{
    struct bytes packed = bumpy_file(6);
    struct umb_error error;
    (void)state;
    /* An entry's tag that would clear the screen, with a length that does not fit. */
    size_t entry = entry_at(&packed, UMB__TAG_PLAN) - UMB__ENTRY_HEAD;
    memcpy(packed.data + entry, "\x1b[2J", 4);
    packed.data[entry + 12] = 1;
    seal_asset(&packed, false);
    assert_int_equal(open_status(&packed, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "[2J"));
    for (const char *p = error.message; *p != '\0'; p++) {
        assert_true(*p >= ' ' && *p <= '~');
    }
    bytes_finish(&packed);
}

static void every_bit_of_a_mapped_file_counts(void **state)
{
    struct bytes packed = bumpy_file(6), mapped = make_mapped(&packed);
    struct umb_error error;
    (void)state;
    /* Flips all bits of the head, then one bit of every other byte. */
    size_t head = (size_t)umb__load64(mapped.data + UMB__HEAD_LENGTH);
    size_t count = head * 8 + mapped.size - head;
    for (size_t k = 0; k < count; k++) {
        size_t at = k < head * 8 ? k / 8 : k - head * 7;
        uint8_t bit = (uint8_t)(1U << (k % 8));
        mapped.data[at] ^= bit;
        assert_int_not_equal(open_status(&mapped, &error), UMB_OK);
        mapped.data[at] ^= bit;
    }
    assert_int_equal(open_status(&mapped, &error), UMB_OK);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void a_second_frame_behind_a_page_is_refused(void **state)
{
    /* Adds a zstd skippable frame: decoders pass over it, so bytes could be hidden there. */
    static const uint8_t frame[12] = {0x50, 0x2a, 0x4d, 0x18, 4, 0, 0, 0, 'h', 'i', 'd', 'e'};
    struct bytes packed = bumpy_file(6), longer = {0};
    struct umb_sink sink = bytes_sink(&longer);
    struct umb_error error;
    (void)state;
    assert_int_equal(sink.write(&longer, packed.data, packed.size), UMB_OK);
    assert_int_equal(sink.write(&longer, frame, sizeof frame), UMB_OK);
    uint32_t last = umb__load32(packed.data + UMB__HEAD_PAGES) - 1;
    assert_true(last < UMB__BLOCK_PAGES);
    uint8_t *entry = longer.data + first_entry_at(&packed) + last * UMB__PAGE_ENTRY;
    uint32_t stored = umb__load32(entry + UMB__PAGE_STORED_LENGTH) + (uint32_t)sizeof frame;
    umb__store32(entry + UMB__PAGE_STORED_LENGTH, stored);
    umb__store64(entry + UMB__PAGE_CHECK,
                 XXH3_64bits(longer.data + umb__load64(entry + UMB__PAGE_OFFSET), stored));
    umb__store64(longer.data + UMB__HEAD_FILE_LENGTH, longer.size);
    seal_asset(&longer, false);
    assert_int_equal(open_status(&longer, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "one zstd frame"));
    assert_int_equal(umb_packed_prove(longer.data, longer.size, NULL, &test_digest, NULL),
                     UMB_E_CORRUPT);
    bytes_finish(&packed);
    bytes_finish(&longer);
}

/* Counts the bytes allocated and their peak; the size of each block is stored in front of it. */
struct meter {
    size_t live, peak;
    struct bytes *file; /* overwritten ... */
    size_t at;          /* ... at this offset, when an allocation of `trigger` bytes is requested */
    size_t trigger;
    int done;
};

enum {
    BLOCK_HEAD = 16
};

static void *metered_resize(void *user, void *block, size_t bytes)
{
    struct meter *m = user;
    uint8_t *old = block ? (uint8_t *)block - BLOCK_HEAD : NULL;
    size_t before = 0;
    if (old) {
        memcpy(&before, old, sizeof before);
    }
    if (m->file && bytes == m->trigger) {
        memset(m->file->data + m->at, 0xff, 2);
        m->done = 1;
    }
    m->live -= before;
    if (bytes == 0) {
        free(old);
        return NULL;
    }
    m->live += bytes;
    /* A growing block may exist twice for a moment. */
    m->peak = m->live + before > m->peak ? m->live + before : m->peak;
    uint8_t *fresh = realloc(old, bytes + BLOCK_HEAD);
    assert_non_null(fresh);
    memcpy(fresh, &bytes, sizeof bytes);
    return fresh + BLOCK_HEAD;
}

static void opening_never_takes_more_than_its_limit(void **state)
{
    /* The head, texts and lists of lights come on top of the limit; they are small here. */
    enum {
        ON_TOP = 8192
    };
    struct bytes packed = bumpy_file(9);
    struct meter meter = {0};
    struct umb_alloc alloc = {metered_resize, &meter};
    struct umb_asset *asset;
    int opened = 0, refused = 0;
    (void)state;
    for (uint64_t limit = 4096; limit < (uint64_t)1 << 26; limit += limit / 8) {
        struct umb_open_options options = {.max_memory_bytes = limit, .alloc = &alloc};
        struct umb_error error = {0};
        meter.peak = 0;
        enum umb_status status =
            umb_asset_open_bytes(packed.data, packed.size, &options, &asset, &error);
        assert_true(meter.peak <= limit + ON_TOP);
        umb_asset_close(asset);
        assert_int_equal(meter.live, 0);
        opened += status == UMB_OK;
        refused += status == UMB_E_TOO_LARGE;
        assert_true(status == UMB_OK || strstr(error.message, "the limit is") != NULL);
        assert_true(status == UMB_OK || opened == 0);
    }
    print_message("%d limits refused, %d enough\n", refused, opened);
    assert_true(opened > 3 && refused > 3);
    bytes_finish(&packed);
}

/* Many frusta with equal trees: each takes little besides its own records. */
static int one_step(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 20 + (x + y) / 32 * 9;
}

static void opening_many_frusta_takes_no_more_than_its_limit(void **state)
{
    struct voxels voxels = {one_step, NULL, 6, 16};
    struct bytes packed = make_packed(&voxels, 0.5, origin);
    struct meter meter = {0};
    struct umb_alloc alloc = {metered_resize, &meter};
    struct umb_asset *asset;
    size_t on_top = 0;
    int opened = 0;
    (void)state;
    for (uint64_t limit = 1024; limit < (uint64_t)1 << 22; limit += limit / 64 + 1) {
        struct umb_open_options options = {.max_memory_bytes = limit, .alloc = &alloc};
        struct umb_error error = {0};
        meter.peak = 0;
        enum umb_status status =
            umb_asset_open_bytes(packed.data, packed.size, &options, &asset, &error);
        on_top = on_top ? on_top : meter.peak; /* the head: refused before anything is read */
        if (meter.peak > limit + on_top) {
            fail_msg("%zu bytes with a limit of %llu", meter.peak - on_top,
                     (unsigned long long)limit);
        }
        umb_asset_close(asset);
        opened += status == UMB_OK;
        assert_true(status == UMB_OK || status == UMB_E_TOO_LARGE);
    }
    assert_true(opened > 3);
    bytes_finish(&packed);
}

static void a_directory_overwritten_while_it_is_read_does_no_harm(void **state)
{
    (void)state;
    /* Imitates another process that changes a mapped file: page 0 grows after its size was read, at
     * the moment when the memory for all pages is allocated. */
    struct bytes packed = bumpy_file(7);
    size_t directory = first_entry_at(&packed), raw_total = 0;
    uint32_t pages = umb__load32(packed.data + UMB__HEAD_PAGES);
    assert_true(pages <= UMB__BLOCK_PAGES);
    for (uint32_t i = 0; i < pages; i++) {
        const uint8_t *entry = packed.data + directory + i * UMB__PAGE_ENTRY;
        raw_total += umb__load32(entry + UMB__PAGE_RAW_LENGTH);
        raw_total += umb__load16(entry + UMB__PAGE_LINKS);
    }
    static const size_t fields[] = {UMB__PAGE_RAW_LENGTH, UMB__PAGE_STORED_LENGTH,
                                    UMB__PAGE_OFFSET};
    for (size_t i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        uint8_t *copy = malloc(packed.size); /* exact, so that a sanitizer sees reads beyond it */
        assert_non_null(copy);
        memcpy(copy, packed.data, packed.size);
        struct bytes file = {copy, packed.size, packed.size};
        struct meter meter = {.file = &file, .at = directory + fields[i], .trigger = raw_total};
        struct umb_alloc alloc = {metered_resize, &meter};
        struct umb_open_options options = {.alloc = &alloc, .trust = UMB_TRUST_VALIDATED};
        struct umb_error error = {0};
        struct umb_asset *asset;
        assert_int_equal(umb_asset_open_bytes(copy, packed.size, &options, &asset, &error),
                         UMB_E_CORRUPT);
        assert_int_equal(meter.done, 1);
        assert_int_equal(meter.live, 0);
        free(copy);
    }
    bytes_finish(&packed);
}

enum {
    TALL = 19
};

/* One node a level, whose eight children are all the node below, down to a brick that is wholly
 * lit. A canonical writer would store one uniform state for all of it. */
static struct bytes shared_uniform_file(void)
{
    static uint64_t bricks[1][8];
    static uint16_t masks[TALL + 1][1];
    static uint32_t first[TALL + 1][2], children[TALL + 1][8];
    struct umb__octree_root root = {UMB__NODE_MIXED, TALL, 0};
    struct voxels voxels = {bumpy, NULL, TALL, 1};
    struct umb__octree octree = {
        .brick_count = 1, .bricks = bricks, .root_count = 1, .roots = &root};
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    uint8_t id[UMB_ID_BYTES];
    memset(bricks, 0xff, sizeof bricks);
    for (uint32_t l = UMB_LEVEL_BRICK + 1; l <= TALL; l++) {
        masks[l][0] = 0xaaaa;
        first[l][1] = 8;
        octree.level[l] = (struct umb__octree_level){1, masks[l], first[l], children[l]};
    }
    make_content(&voxels, 0.5, origin, &content);
    assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
    return file;
}

static void shared_uniform_subtrees_cost_no_more_than_their_nodes(void **state)
{
    struct bytes file = shared_uniform_file();
    struct umb_asset *asset;
    struct umb__octree octree;
    struct umb__content content;
    (void)state;
    (void)alarm(60); /* 64^8 visits would take centuries */
    assert_int_equal(umb_asset_open_bytes(file.data, file.size, NULL, &asset, NULL), UMB_OK);
    assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
    assert_int_equal(octree.roots[0].state, UMB__NODE_LIT);
    assert_int_equal(octree.brick_count, 0);
    (void)alarm(0);
    umb__octree_finish(&octree);
    umb_asset_close(asset);
    bytes_finish(&file);
}

static void levels_above_every_grid_are_not_laid_out(void **state)
{
    struct bytes packed = bumpy_file(8);
    struct umb_asset *asset;
    (void)state;
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL), UMB_OK);
    uint32_t cell_level = 8 - asset->view.tops[0].grid_log2;
    assert_true(cell_level < 7); /* else there is nothing to leave out */
    assert_true(asset->canonical.counts[7] > 0);
    for (uint32_t i = 0; i < UMB__WIDE_COUNT; i++) {
        uint64_t words = asset->view.level_begin[i + 1] - asset->view.level_begin[i];
        assert_int_equal(words > 0, UMB__WIDE_FIRST + 2 * i <= cell_level);
    }
    umb_asset_close(asset);
    bytes_finish(&packed);
}

static void what_a_validated_mapped_file_is_still_checked_for(void **state)
{
    const struct umb_open_options options = {.trust = UMB_TRUST_VALIDATED};
    struct bytes packed = bumpy_file(6), mapped = make_mapped(&packed);
    struct umb_asset *asset;
    struct umb_error error;
    (void)state;
    size_t head = (size_t)umb__load64(mapped.data + UMB__HEAD_LENGTH);
    for (size_t bit = 0; bit < head * 8; bit += 3) {
        mapped.data[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        assert_int_not_equal(
            umb_asset_open_bytes(mapped.data, mapped.size, &options, &asset, &error), UMB_OK);
        mapped.data[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    }
    for (size_t size = 0; size < mapped.size; size += 257) {
        assert_int_not_equal(umb_asset_open_bytes(mapped.data, size, &options, &asset, &error),
                             UMB_OK);
    }
    /* Opening without the full check looks at sections, grids and levels, but not at the numbers in
     * them. */
    const uint8_t *entry = mapped.data + directory_at(&mapped);
    size_t tops = (size_t)umb__load64(entry + UMB__SECTION_OFFSET);
    size_t levels = (size_t)umb__load64(entry + UMB__SECTION_ENTRY + UMB__SECTION_OFFSET);
    size_t grid = (size_t)umb__load64(entry + 2 * (size_t)UMB__SECTION_ENTRY + UMB__SECTION_OFFSET);
    const size_t shapes[] = {tops, tops + 4, tops + 8, tops + 16, tops + 24, levels, levels + 64};
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        mapped.data[shapes[i]] ^= 2;
        assert_int_not_equal(
            umb_asset_open_bytes(mapped.data, mapped.size, &options, &asset, &error), UMB_OK);
        mapped.data[shapes[i]] ^= 2;
    }
    mapped.data[grid + 3] ^= 0x40; /* Leads far outside: never to be queried */
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, &error),
                     UMB_E_CORRUPT);
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, &options, &asset, &error),
                     UMB_OK);
    umb_asset_close(asset);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

/* Offset of a section of a mapped file; its length. */
static size_t section_at(const struct bytes *file, uint32_t tag, size_t *length)
{
    const uint8_t *entry = file->data + directory_at(file);
    while (umb__load32(entry) != tag) {
        entry += UMB__SECTION_ENTRY;
    }
    *length = (size_t)umb__load64(entry + UMB__SECTION_LENGTH);
    return (size_t)umb__load64(entry + UMB__SECTION_OFFSET);
}

/* Puts a number into a section, makes all checksums right, opens the file and puts the old number
 * back. */
static void expect_section_spoilt(struct bytes *file, size_t at, uint32_t value, const char *words)
{
    const uint32_t before = umb__load32(file->data + at);
    struct umb_error error;
    assert_int_not_equal(before, value);
    umb__store32(file->data + at, value);
    seal_sections(file);
    assert_int_equal(open_status(file, &error), UMB_E_CORRUPT);
    if (strstr(error.message, words) == NULL) {
        fail_msg("'%s' does not say '%s'", error.message, words);
    }
    umb__store32(file->data + at, before);
    seal_sections(file);
    assert_int_equal(open_status(file, &error), UMB_OK);
}

static void columns_that_lead_out_of_their_pieces_are_refused(void **state)
{
    struct bytes packed = bumpy_file(9), mapped = make_mapped(&packed);
    size_t length;
    (void)state;
    const size_t tops = section_at(&mapped, UMB__TAG_TOPS, &length);
    const uint32_t side = 1U << (9 - umb__load32(mapped.data + tops + 4));
    const size_t pieces = section_at(&mapped, UMB__TAG_PIECES, &length);
    const uint32_t count = (uint32_t)(length / 4);
    const size_t columns = section_at(&mapped, UMB__TAG_COLUMNS, &length);
    assert_int_equal(length, (size_t)side * side * 8);
    const uint32_t low_high = umb__load32(mapped.data + columns + 4);
    assert_true(low_high >> 16 > 0); /* a list of its own */
    const uint32_t low = low_high & 0xffff, high = low_high >> 16;
    const uint32_t spoilt_places[] = {
        low | side << 16, /* one behind the frustum's last piece */
        (high + 1) | high << 16,
        0xffffffff,
    };
    for (size_t i = 0; i < sizeof spoilt_places / sizeof spoilt_places[0]; i++) {
        expect_section_spoilt(&mapped, columns + 4, spoilt_places[i], "columns 0: malformed");
    }
    expect_section_spoilt(&mapped, columns + length - 8, count, "columns 0: malformed");
    expect_section_spoilt(&mapped, columns + length - 8, UINT32_MAX, "columns 0: malformed");
    expect_section_spoilt(&mapped, pieces, 1, "columns 0: malformed");
    expect_section_spoilt(&mapped, pieces + 4, 0, "columns 0: malformed");
    expect_section_spoilt(&mapped, pieces + 8, 0x40000000, "columns 0: malformed");
    expect_section_spoilt(&mapped, pieces + 4 * ((size_t)count - 1), UINT32_MAX,
                          "columns 0: malformed");
    expect_section_spoilt(&mapped, tops + 16, 1, "columns of level");
    expect_section_spoilt(&mapped, tops + 24, 1, "no pieces at 1");
    expect_section_spoilt(&mapped, tops + 4, 3, "columns of level 3");
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void a_pipe_is_refused_and_not_waited_for(void **state)
{
    char folder[] = "umbrage-test-XXXXXX", path[64];
    struct umb_asset *asset;
    struct umb_error error;
    (void)state;
    assert_non_null(mkdtemp(folder));
    (void)snprintf(path, sizeof path, "%s/pipe.umb", folder);
    assert_int_equal(mkfifo(path, 0600), 0);
    (void)alarm(20); /* a reader that waits for a writer ends here */
    assert_int_equal(umb_asset_open_file(path, NULL, &asset, &error), UMB_E_NO_INPUT);
    (void)alarm(0);
    assert_non_null(strstr(error.message, "not a regular file"));
    assert_int_equal(umb_asset_open_file(folder, NULL, &asset, &error), UMB_E_NO_INPUT);
    (void)unlink(path);
    (void)rmdir(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reserved_fields_are_a_newer_file),
        cmocka_unit_test(a_directory_that_does_not_fit_its_file_is_refused),
        cmocka_unit_test(an_entry_that_must_be_understood_is_not_passed_over),
        cmocka_unit_test(a_frustum_of_another_light_is_refused),
        cmocka_unit_test(a_page_that_claims_too_much_is_refused),
        cmocka_unit_test(bytes_behind_the_last_page_are_refused),
        cmocka_unit_test(texts_that_are_not_utf8_are_refused),
        cmocka_unit_test(messages_about_hostile_bytes_are_plain_text),
        cmocka_unit_test(every_bit_of_a_mapped_file_counts),
        cmocka_unit_test(a_second_frame_behind_a_page_is_refused),
        cmocka_unit_test(opening_never_takes_more_than_its_limit),
        cmocka_unit_test(opening_many_frusta_takes_no_more_than_its_limit),
        cmocka_unit_test(a_directory_overwritten_while_it_is_read_does_no_harm),
        cmocka_unit_test(shared_uniform_subtrees_cost_no_more_than_their_nodes),
        cmocka_unit_test(levels_above_every_grid_are_not_laid_out),
        cmocka_unit_test(what_a_validated_mapped_file_is_still_checked_for),
        cmocka_unit_test(columns_that_lead_out_of_their_pieces_are_refused),
        cmocka_unit_test(a_pipe_is_refused_and_not_waited_for),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
