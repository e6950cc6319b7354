/* SPDX-License-Identifier: Apache-2.0 */
/* Frames, blocks and sequences; see zstd_frame.h. Section numbers are those of RFC 8878. */
#include "web/module/zstd_frame.h"

#include <stdlib.h>
#include <xxhash.h>

#include "web/module/zstd_literals.h"

#define MAGIC       0xFD2FB528U
#define OFFSET_CODE 31U /* Highest code of an offset */
#define FAR_OFFSET  8U  /* Offset from which matches are copied in words */

/* Kinds of codes, in the order of their tables in a block. */
enum kind {
    LITERALS,
    OFFSETS,
    MATCHES,
    KINDS
};

struct umbx_zstd {
    struct umbx_literals literals;
    struct umbx_fse_table tables[KINDS];
    bool has_table[KINDS];
    size_t offsets[3]; /* Last three offsets, for repetition */
};

/* Content under way. */
struct output {
    uint8_t *start, *at, *end;
    size_t window; /* Longest offset */
};

struct code {
    uint32_t base;
    uint8_t bits;
};

/* Lengths of literals and matches: base, and number of bits that are added (3.1.1.3.2.1.1). */
static const struct code literal_codes[36] = {
    {0, 0},     {1, 0},      {2, 0},      {3, 0},     {4, 0},   {5, 0},     {6, 0},     {7, 0},
    {8, 0},     {9, 0},      {10, 0},     {11, 0},    {12, 0},  {13, 0},    {14, 0},    {15, 0},
    {16, 1},    {18, 1},     {20, 1},     {22, 1},    {24, 2},  {28, 2},    {32, 3},    {40, 3},
    {48, 4},    {64, 6},     {128, 7},    {256, 8},   {512, 9}, {1024, 10}, {2048, 11}, {4096, 12},
    {8192, 13}, {16384, 14}, {32768, 15}, {65536, 16}};
static const struct code match_codes[53] = {
    {3, 0},     {4, 0},     {5, 0},      {6, 0},      {7, 0},     {8, 0},   {9, 0},     {10, 0},
    {11, 0},    {12, 0},    {13, 0},     {14, 0},     {15, 0},    {16, 0},  {17, 0},    {18, 0},
    {19, 0},    {20, 0},    {21, 0},     {22, 0},     {23, 0},    {24, 0},  {25, 0},    {26, 0},
    {27, 0},    {28, 0},    {29, 0},     {30, 0},     {31, 0},    {32, 0},  {33, 0},    {34, 0},
    {35, 1},    {37, 1},    {39, 1},     {41, 1},     {43, 2},    {47, 2},  {51, 3},    {59, 3},
    {67, 4},    {83, 4},    {99, 5},     {131, 7},    {259, 8},   {515, 9}, {1027, 10}, {2051, 11},
    {4099, 12}, {8195, 13}, {16387, 14}, {32771, 15}, {65539, 16}};

/* Predefined tables of codes, which a block may use without describing them (3.1.1.3.2.2). */
static const int16_t usual_literals[36] = {4, 3, 2, 2, 2, 2, 2, 2, 2,  2,  2,  2,
                                           2, 1, 1, 1, 2, 2, 2, 2, 2,  2,  2,  2,
                                           2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1};
static const int16_t usual_offsets[29] = {1, 1, 1, 1, 1, 1, 2, 2, 2, 1,  1,  1,  1,  1, 1,
                                          1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1};
static const int16_t usual_matches[53] = {
    1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,  1,  1,  1,  1,  1,  1, 1,
    1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1};

static const struct {
    const int16_t *usual;
    unsigned usual_symbols, usual_log;
    unsigned symbols, log_max;
} kinds[KINDS] = {
    [LITERALS] = {usual_literals, 36, 6, 36, 9},
    [OFFSETS] = {usual_offsets, 29, 5, OFFSET_CODE + 1, 8},
    [MATCHES] = {usual_matches, 53, 6, 53, 9},
};

struct umbx_zstd *umbx_zstd_make(void)
{
    return malloc(sizeof(struct umbx_zstd));
}

void umbx_zstd_free(struct umbx_zstd *zstd)
{
    free(zstd);
}

/* Copies `count` bytes of literals. */
static void put_literals(struct output *out, const uint8_t *from, size_t count)
{
    memcpy(out->at, from, count);
    out->at += count;
}

/* Copies `count` bytes from `offset` bytes before; the two may overlap. */
static void put_match(struct output *out, size_t offset, size_t count)
{
    const uint8_t *from = out->at - offset;
    uint8_t *to = out->at, *const end = to + count;
    out->at = end;
    if (offset >= FAR_OFFSET) {
        while ((size_t)(end - to) >= 8) {
            memcpy(to, from, 8);
            to += 8;
            from += 8;
        }
    }
    while (to < end) {
        *to++ = *from++;
    }
}

/* Reads the table for one kind of codes: literal lengths, offsets or match lengths. Returns the
 * length of its description, or -1. */
static int64_t read_table(struct umbx_zstd *zstd, enum kind kind, unsigned mode,
                          const uint8_t *from, size_t size)
{
    struct umbx_fse_table *table = &zstd->tables[kind];
    size_t used = 0;
    if (mode == 3) {
        return zstd->has_table[kind] ? 0 : -1;
    }
    zstd->has_table[kind] = false;
    if (mode == 0) {
        umbx_fse_make(table, kinds[kind].usual, kinds[kind].usual_symbols, kinds[kind].usual_log);
    } else if (mode == 1) {
        if (size == 0 || from[0] >= kinds[kind].symbols) {
            return -1;
        }
        umbx_fse_make_single(table, from[0]);
        used = 1;
    } else {
        used = umbx_fse_read(table, from, size, kinds[kind].log_max, kinds[kind].symbols);
        if (used == 0) {
            return -1;
        }
    }
    zstd->has_table[kind] = true;
    return (int64_t)used;
}

/* Decodes an offset, and records it among the last three (3.1.1.5). Returns 0 if it is invalid. */
static size_t find_offset(size_t last[3], uint64_t value, bool no_literals)
{
    size_t offset;
    unsigned which = 3;
    if (value > 3) {
        offset = (size_t)(value - 3);
    } else {
        which = (unsigned)value - 1 + (no_literals ? 1 : 0);
        offset = which < 3 ? last[which] : last[0] - 1;
    }
    if (which > 1) {
        last[2] = last[1];
    }
    if (which > 0) {
        last[1] = last[0];
    }
    last[0] = offset;
    return offset;
}

/* States of the three tables. */
struct states {
    uint32_t of[KINDS];
};

/* Decodes and carries out `count` sequences. */
static bool run_sequences(struct umbx_zstd *zstd, struct umbx_bits *bits, uint32_t count,
                          struct output *out)
{
    const struct umbx_fse_table *const tables = zstd->tables;
    const uint8_t *literal = zstd->literals.bytes, *const end = literal + zstd->literals.count;
    struct states state;
    for (unsigned kind = 0; kind < KINDS; kind++) {
        state.of[kind] = (uint32_t)umbx_bits_take(bits, tables[kind].log);
    }
    for (uint32_t i = 0; i < count; i++) {
        const unsigned offset_code = tables[OFFSETS].state[state.of[OFFSETS]].symbol;
        const struct code match = match_codes[tables[MATCHES].state[state.of[MATCHES]].symbol];
        const struct code run = literal_codes[tables[LITERALS].state[state.of[LITERALS]].symbol];
        const uint64_t value = ((uint64_t)1 << offset_code) + umbx_bits_take(bits, offset_code);
        const size_t match_length = match.base + (size_t)umbx_bits_take(bits, match.bits);
        const size_t run_length = run.base + (size_t)umbx_bits_take(bits, run.bits);
        if (i + 1 < count) {
            state.of[LITERALS] = umbx_fse_next(&tables[LITERALS], state.of[LITERALS], bits);
            state.of[MATCHES] = umbx_fse_next(&tables[MATCHES], state.of[MATCHES], bits);
            state.of[OFFSETS] = umbx_fse_next(&tables[OFFSETS], state.of[OFFSETS], bits);
        }
        const size_t offset = find_offset(zstd->offsets, value, run_length == 0);
        if (bits->left < 0 || run_length > (size_t)(end - literal) ||
            run_length + match_length > (size_t)(out->end - out->at)) {
            return false;
        }
        put_literals(out, literal, run_length);
        literal += run_length;
        if (offset == 0 || offset > out->window || offset > (size_t)(out->at - out->start)) {
            return false;
        }
        put_match(out, offset, match_length);
    }
    const size_t rest = (size_t)(end - literal);
    if (bits->left != 0 || rest > (size_t)(out->end - out->at)) {
        return false;
    }
    put_literals(out, literal, rest);
    return true;
}

/* Reads the number of sequences. Returns the length of the number in bytes; 0: it is cut off. */
static size_t read_count(const uint8_t *from, size_t size, uint32_t *count)
{
    const size_t bytes = size == 0 ? 1 : from[0] < 128 ? 1 : from[0] < 255 ? 2 : 3;
    if (size < bytes) {
        return 0;
    }
    *count = bytes == 1   ? from[0]
             : bytes == 2 ? (from[0] - 128U) * 256 + from[1]
                          : from[1] + 256U * from[2] + 0x7f00U;
    return bytes;
}

/* Decodes a compressed block. */
static bool decode_block(struct umbx_zstd *zstd, const uint8_t *from, size_t size,
                         struct output *out)
{
    struct umbx_bits bits;
    uint32_t count = 0;
    size_t at = umbx_literals_read(&zstd->literals, from, size);
    const size_t counted = at == 0 ? 0 : read_count(from + at, size - at, &count);
    if (counted == 0) {
        return false;
    }
    at += counted;
    if (count == 0) {
        const bool fits = zstd->literals.count <= (size_t)(out->end - out->at) && at == size;
        put_literals(out, zstd->literals.bytes, fits ? zstd->literals.count : 0);
        return fits;
    }
    if (at == size || (from[at] & 3) != 0) {
        return false;
    }
    const uint8_t modes = from[at++];
    for (unsigned kind = 0; kind < KINDS; kind++) {
        const int64_t used =
            read_table(zstd, (enum kind)kind, modes >> (6 - 2 * kind) & 3, from + at, size - at);
        if (used < 0) {
            return false;
        }
        at += (size_t)used;
    }
    return umbx_bits_open(&bits, from + at, size - at) && run_sequences(zstd, &bits, count, out);
}

/* A frame's header (3.1.1.1). */
struct header {
    size_t bytes;
    uint64_t window, content;
    bool has_content, has_checksum;
};

static bool read_header(const uint8_t *from, size_t size, struct header *header)
{
    static const uint8_t content_bytes[4] = {0, 2, 4, 8};
    if (size < 5 || ((uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 |
                     (uint32_t)from[3] << 24) != MAGIC) {
        return false;
    }
    const uint8_t flags = from[4];
    const bool single = (flags >> 5 & 1) != 0;
    const size_t width = flags >> 6 == 0 && single ? 1 : content_bytes[flags >> 6];
    *header = (struct header){.bytes = 5 + (single ? 0U : 1U) + width,
                              .has_content = width > 0,
                              .has_checksum = (flags >> 2 & 1) != 0};
    if ((flags & 11) != 0 || size < header->bytes) { /* A reserved bit, or a dictionary */
        return false;
    }
    for (size_t i = 0; i < width; i++) {
        header->content |= (uint64_t)from[header->bytes - width + i] << 8 * i;
    }
    header->content += width == 2 ? 256 : 0;
    const uint64_t base = single ? 0 : (uint64_t)1 << (10 + (from[5] >> 3));
    header->window = single ? header->content : base + base / 8 * (from[5] & 7);
    return true;
}

/* A block's header (3.1.1.2). */
struct block {
    bool last;
    unsigned type; /* 0 raw, 1 one byte that repeats, 2 compressed */
    size_t count;  /* Bytes of the content, or of a compressed block */
    size_t stored; /* Bytes behind the header */
};

static bool read_block(const uint8_t *from, size_t size, struct block *block)
{
    if (size < 3) {
        return false;
    }
    const uint32_t word = (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16;
    *block = (struct block){.last = word & 1, .type = word >> 1 & 3, .count = word >> 3};
    block->stored = block->type == 1 ? 1 : block->count;
    return block->type < 3 && block->count <= UMBX_BLOCK_MAX && block->stored <= size - 3;
}

size_t umbx_zstd_frame_bytes(const uint8_t *from, size_t size)
{
    struct header header;
    struct block block = {.last = false};
    if (!read_header(from, size, &header)) {
        return 0;
    }
    size_t at = header.bytes;
    while (!block.last) {
        if (!read_block(from + at, size - at, &block)) {
            return 0;
        }
        at += 3 + block.stored;
    }
    at += header.has_checksum ? 4 : 0;
    return at <= size ? at : 0;
}

/* Decodes the content of one block, whose lengths are checked. */
static bool run_block(struct umbx_zstd *zstd, const struct block *block, const uint8_t *from,
                      struct output *out)
{
    const size_t most = out->window < UMBX_BLOCK_MAX ? out->window : UMBX_BLOCK_MAX;
    struct output part = *out;
    if (block->count > most) {
        return false;
    }
    if ((size_t)(out->end - out->at) > most) {
        part.end = out->at + most;
    }
    bool done = true;
    if (block->type == 2) {
        done = decode_block(zstd, from, block->count, &part);
    } else if (block->count > (size_t)(part.end - part.at)) {
        done = false;
    } else if (block->type == 1) {
        memset(part.at, from[0], block->count);
        part.at += block->count;
    } else {
        put_literals(&part, from, block->count);
    }
    out->at = part.at;
    return done;
}

bool umbx_zstd_decode(struct umbx_zstd *zstd, uint8_t *to, size_t room, const uint8_t *from,
                      size_t size, size_t *got)
{
    struct output out = {to, to, to + room, 0};
    struct header header;
    struct block block = {.last = false};
    if (!read_header(from, size, &header) || umbx_zstd_frame_bytes(from, size) != size) {
        return false;
    }
    out.window = header.window < room ? (size_t)header.window : room;
    zstd->literals.huffman.log = 0;
    memset(zstd->has_table, 0, sizeof zstd->has_table);
    memcpy(zstd->offsets, (const size_t[3]){1, 4, 8}, sizeof zstd->offsets);
    for (size_t at = header.bytes; !block.last; at += 3 + block.stored) {
        if (!read_block(from + at, size - at, &block) ||
            !run_block(zstd, &block, from + at + 3, &out)) {
            return false;
        }
    }
    *got = (size_t)(out.at - to);
    if (header.has_content && header.content != *got) {
        return false;
    }
    if (header.has_checksum) {
        const uint32_t check = (uint32_t)XXH64(to, *got, 0);
        const uint8_t *stored = from + size - 4;
        return check == ((uint32_t)stored[0] | (uint32_t)stored[1] << 8 |
                         (uint32_t)stored[2] << 16 | (uint32_t)stored[3] << 24);
    }
    return true;
}
