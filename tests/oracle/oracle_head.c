/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The oracle's reader: head, info and canonical block. Source: docs/reference/umb-format.md,
 * sections 2 and 3.
 */
#include "oracle_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

enum {
    HEAD_FIXED = 128,
    CHECK_AT = 120,
    BLOCK_LIMIT = 64 << 20,
    INFO_LIMIT = 1 << 20,
    PACKED_ENTRY = 48,
    PAGE_ENTRY = 64,
    BLOCK_PAGES = 32,
    MAPPED_ENTRY = 32,
    MAPPED_SECTIONS = 7,
    LIGHT_SIZE = 136,
    FRUSTUM_SIZE = 144,
    ROOT_SIZE = 16,
    LIGHTS_LIMIT = 4096,
    FRUSTA_LIMIT = 24576,
};

static int check_magic(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    static const uint8_t packed[8] = {0x89, 0x55, 0x4d, 0x42, 0x0d, 0x0a, 0x1a, 0x0a};
    static const uint8_t mapped[8] = {0x89, 0x55, 0x4d, 0x4d, 0x0d, 0x0a, 0x1a, 0x0a};
    if (oracle->size < HEAD_FIXED) {
        return oracle_refuse(error, "file: %zu bytes, a head has 128", oracle->size);
    }
    if (memcmp(oracle->bytes, packed, 8) == 0) {
        oracle->form = ORACLE_PACKED;
    } else if (memcmp(oracle->bytes, mapped, 8) == 0) {
        oracle->form = ORACLE_MAPPED;
    } else {
        return oracle_refuse(error, "magic: neither packed nor mapped");
    }
    uint64_t major = oracle_number(oracle->bytes + 8, 2),
             known = oracle->form == ORACLE_PACKED ? 3 : 3;
    if (major != known) {
        return oracle_refuse(error, "major version: %" PRIu64 ", not %" PRIu64, major, known);
    }
    return 1;
}

static int check_head_hash(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    const uint64_t parts[2] = {
        XXH3_64bits(oracle->bytes, CHECK_AT),
        XXH3_64bits(oracle->bytes + HEAD_FIXED, (size_t)(oracle->head_size - HEAD_FIXED))};
    uint8_t both[16];
    for (int i = 0; i < 16; i++) {
        both[i] = (uint8_t)(parts[i / 8] >> (8 * (i % 8)));
    }
    if (XXH3_64bits(both, sizeof both) != oracle_number(oracle->bytes + CHECK_AT, 8)) {
        return oracle_refuse(error, "check: does not match the head");
    }
    return 1;
}

/* `key=value` lines of UTF-8. */
static int is_key_value_text(const uint8_t *bytes, uint64_t size)
{
    if (!oracle_is_utf8(bytes, size)) {
        return 0;
    }
    for (uint64_t start = 0; start < size;) {
        const uint8_t *line = bytes + start;
        const uint8_t *end = memchr(line, '\n', (size_t)(size - start));
        uint64_t length = end != NULL ? (uint64_t)(end - line) : size - start;
        if (length > 0 && memchr(line + 1, '=', (size_t)(length - 1)) == NULL) {
            return 0;
        }
        start += length + 1;
    }
    return 1;
}

/* How many pages there are, and where the blocks of their entries stand: inside the file. */
static int read_pages_field(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    uint64_t pages = oracle_number(oracle->bytes + 80, 4);
    oracle->page_count = (uint32_t)pages;
    oracle->first_block = oracle_number(oracle->bytes + 84, 4);
    oracle->blocks_at = oracle_number(oracle->bytes + 88, 8);
    if (oracle->form == ORACLE_MAPPED) {
        return (pages == 0 && oracle->blocks_at == 0 && oracle->first_block == 0) ||
               oracle_refuse(error, "head: a mapped file has no pages");
    }
    if (oracle->directory_count != (pages + BLOCK_PAGES - 1) / BLOCK_PAGES) {
        return oracle_refuse(error, "directory: %" PRIu32 " blocks for %" PRIu64 " pages",
                             oracle->directory_count, pages);
    }
    uint64_t end = 0, first = 0;
    for (uint32_t i = 0; i < oracle->directory_count; i++) {
        const uint64_t rest = pages - (uint64_t)i * BLOCK_PAGES, before = end;
        const uint64_t entries = PAGE_ENTRY * (rest < BLOCK_PAGES ? rest : BLOCK_PAGES);
        end = oracle_number(
            oracle->bytes + HEAD_FIXED + oracle->block_size + (uint64_t)i * PACKED_ENTRY + 8, 8);
        first = i == 0 ? end : first;
        if (end < before || end - before < entries || end > oracle->size) {
            return oracle_refuse(error, "directory: block %" PRIu32 " ends at %" PRIu64, i, end);
        }
    }
    if (first != oracle->first_block || first > oracle->size - oracle->head_size ||
        (end == first ? oracle->blocks_at != 0
                      : oracle->blocks_at > oracle->size ||
                            end - first > oracle->size - oracle->blocks_at)) {
        return oracle_refuse(error, "directory: %" PRIu64 " pages' blocks are not in the file",
                             pages);
    }
    return 1;
}

int oracle_read_head(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    const uint8_t *head = oracle->bytes;
    if (!check_magic(oracle, error)) {
        return 0;
    }
    if (!oracle_all_zero(head + 12, 4) || !oracle_all_zero(head + 96, 24)) {
        return oracle_refuse(error, "head: flags or zero fields are not zero");
    }
    if (oracle_number(head + 16, 8) != oracle->size) {
        return oracle_refuse(error, "file length: %" PRIu64 ", the file has %zu bytes",
                             oracle_number(head + 16, 8), oracle->size);
    }
    oracle->head_size = oracle_number(head + 24, 8);
    oracle->block_size = oracle_number(head + 32, 8);
    oracle->directory_count = (uint32_t)oracle_number(head + 40, 4);
    oracle->info_size = (uint32_t)oracle_number(head + 44, 4);
    memcpy(oracle->id, head + 48, 32);
    if (oracle->block_size > BLOCK_LIMIT || oracle->block_size % 8 != 0) {
        return oracle_refuse(error, "canonical block: %" PRIu64 " bytes, limit 64 MiB by eights",
                             oracle->block_size);
    }
    if (oracle->info_size > INFO_LIMIT) {
        return oracle_refuse(error, "info: %" PRIu32 " bytes, limit 1 MiB", oracle->info_size);
    }
    uint64_t entry = oracle->form == ORACLE_PACKED ? PACKED_ENTRY : MAPPED_ENTRY;
    uint64_t before_info = HEAD_FIXED + oracle->block_size + oracle->directory_count * entry;
    if (oracle->head_size != before_info + oracle->info_size || oracle->head_size > oracle->size) {
        return oracle_refuse(error, "head length: %" PRIu64 ", its parts have %" PRIu64,
                             oracle->head_size, before_info + oracle->info_size);
    }
    if (oracle->form == ORACLE_MAPPED && oracle->directory_count != MAPPED_SECTIONS) {
        return oracle_refuse(error, "directory: %" PRIu32 " sections, not 7",
                             oracle->directory_count);
    }
    if (!check_head_hash(oracle, error) || !read_pages_field(oracle, error)) {
        return 0;
    }
    if (!is_key_value_text(head + before_info, oracle->info_size)) {
        return oracle_refuse(error, "info: not key=value lines of UTF-8");
    }
    return 1;
}

static int read_scene(struct oracle *oracle, const uint8_t *data, char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t k = 0; k < 3; k++) {
        oracle->origin[k] = oracle_double(data + 8 * k);
        oracle->box_min[k] = oracle_double(data + 24 + 8 * k);
        oracle->box_max[k] = oracle_double(data + 48 + 8 * k);
        if (!isfinite(oracle->origin[k]) || !isfinite(oracle->box_min[k]) ||
            !isfinite(oracle->box_max[k]) || oracle->box_min[k] > oracle->box_max[k]) {
            return oracle_refuse(error, "SCEN: axis %" PRIu32 " has no origin and box", k);
        }
    }
    return 1;
}

static int read_light(struct oracle_light *light, const uint8_t *data,
                      char error[ORACLE_ERROR_SIZE])
{
    light->kind = (uint32_t)oracle_number(data, 4);
    if (light->kind > 4 || oracle_number(data + 12, 4) != 0) {
        return oracle_refuse(error, "LGHT: kind %" PRIu32 " is not 0 to 4, or a zero field is set",
                             light->kind);
    }
    light->first_frustum = (uint32_t)oracle_number(data + 4, 4);
    light->frustum_count = (uint32_t)oracle_number(data + 8, 4);
    double square = 0.0;
    for (uint32_t k = 0; k < 3; k++) {
        light->direction[k] = oracle_double(data + 16 + 8 * k);
        square += light->direction[k] * light->direction[k];
        light->position[k] = oracle_double(data + 40 + 8 * k);
        if (!isfinite(light->position[k])) {
            return oracle_refuse(error, "LGHT: position %g", light->position[k]);
        }
    }
    /* A unit vector of rounded doubles is off by a few units of 2^-53; 1e-9 is far beyond that. */
    if (!(fabs(square - (light->kind == 2 ? 0.0 : 1.0)) < 1e-9)) {
        return oracle_refuse(error, "LGHT: the direction's square is %.17g", square);
    }
    double extent = oracle_double(data + 64);
    if (!(extent >= 0.0) || !isfinite(extent)) {
        return oracle_refuse(error, "LGHT: extent %g is not a size", extent);
    }
    const uint8_t *name = data + 72;
    const uint8_t *end = memchr(name, 0, 64);
    if (end == NULL || !oracle_all_zero(end, 64 - (uint64_t)(end - name)) ||
        !oracle_is_utf8(name, (uint64_t)(end - name))) {
        return oracle_refuse(error, "LGHT: the name is not NUL-padded UTF-8");
    }
    memcpy(light->name, name, 64);
    return 1;
}

static int read_lights(struct oracle *oracle, const uint8_t *data, uint64_t size,
                       char error[ORACLE_ERROR_SIZE])
{
    uint64_t count = size / LIGHT_SIZE;
    if (size % LIGHT_SIZE != 0 || count < 1 || count > LIGHTS_LIMIT) {
        return oracle_refuse(error, "LGHT: %" PRIu64 " bytes are not 1 to 4096 lights", size);
    }
    oracle->lights = calloc((size_t)count, sizeof *oracle->lights);
    if (oracle->lights == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    oracle->light_count = (uint32_t)count;
    for (uint32_t i = 0; i < oracle->light_count; i++) {
        if (!read_light(&oracle->lights[i], data + (size_t)i * LIGHT_SIZE, error)) {
            return 0;
        }
    }
    return 1;
}

/* Vectors of the sides of rectangles, one a light; at least one is not 0. */
static int check_sides(const struct oracle *oracle, struct oracle_section sides,
                       char error[ORACLE_ERROR_SIZE])
{
    double longest = 0.0;
    if (sides.data == NULL) {
        return 1;
    }
    if (sides.size != (uint64_t)oracle->light_count * 24) {
        return oracle_refuse(error, "SIDE: %" PRIu64 " bytes for %" PRIu32 " lights", sides.size,
                             oracle->light_count);
    }
    for (uint32_t i = 0; i < oracle->light_count; i++) {
        double square = 0.0, along = 0.0;
        for (uint32_t k = 0; k < 3; k++) {
            const double side = oracle_double(sides.data + 24 * (size_t)i + 8 * k);
            square += side * side;
            along += side * oracle->lights[i].direction[k];
        }
        if (!isfinite(square) || (square > 0.0 && oracle->lights[i].kind != 3) ||
            !(fabs(along) <= 1e-9 * sqrt(square))) {
            return oracle_refuse(error, "SIDE: that of light %" PRIu32 " is none", i);
        }
        longest = fmax(longest, square);
    }
    return longest > 0.0 ? 1 : oracle_refuse(error, "SIDE: no light has one");
}

static int read_frustum(struct oracle_frustum *frustum, const uint8_t *data,
                        char error[ORACLE_ERROR_SIZE])
{
    frustum->n = (uint32_t)oracle_number(data, 4);
    frustum->light = (uint32_t)oracle_number(data + 4, 4);
    frustum->flags = (uint32_t)oracle_number(data + 8, 4);
    if (frustum->n < 6 || frustum->n > 20) {
        return oracle_refuse(error, "FRUS: n is %" PRIu32 ", not 6 to 20", frustum->n);
    }
    if (frustum->flags > 1 || oracle_number(data + 12, 4) != 0) {
        return oracle_refuse(error, "FRUS: unknown flags or a zero field is set");
    }
    for (uint32_t k = 0; k < 16; k++) {
        double value = oracle_double(data + 16 + 8 * k);
        if (!isfinite(value)) {
            return oracle_refuse(error, "FRUS: M[%" PRIu32 "] is %g", k, value);
        }
        frustum->m[k] = value;
    }
    return 1;
}

static int read_frusta(struct oracle *oracle, const uint8_t *data, uint64_t size,
                       char error[ORACLE_ERROR_SIZE])
{
    uint64_t count = size / FRUSTUM_SIZE;
    if (size % FRUSTUM_SIZE != 0 || count < 1 || count > FRUSTA_LIMIT) {
        return oracle_refuse(error, "FRUS: %" PRIu64 " bytes are not 1 to 24576 frusta", size);
    }
    oracle->frusta = calloc((size_t)count, sizeof *oracle->frusta);
    if (oracle->frusta == NULL) {
        return oracle_refuse(error, "out of memory");
    }
    oracle->frustum_count = (uint32_t)count;
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        if (!read_frustum(&oracle->frusta[i], data + (size_t)i * FRUSTUM_SIZE, error)) {
            return 0;
        }
    }
    return 1;
}

static int read_roots(struct oracle *oracle, const uint8_t *data, uint64_t size,
                      char error[ORACLE_ERROR_SIZE])
{
    if (size != (uint64_t)oracle->frustum_count * ROOT_SIZE) {
        return oracle_refuse(error, "ROOT: %" PRIu64 " bytes for %" PRIu32 " frusta", size,
                             oracle->frustum_count);
    }
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const uint8_t *entry = data + (size_t)i * ROOT_SIZE;
        struct oracle_frustum *frustum = &oracle->frusta[i];
        frustum->root_state = (uint32_t)oracle_number(entry, 4);
        frustum->root_page = (uint32_t)oracle_number(entry + 4, 4);
        frustum->root_position = (uint32_t)oracle_number(entry + 8, 4);
        if (frustum->root_state > 2 || oracle_number(entry + 12, 4) != 0) {
            return oracle_refuse(error, "ROOT: frustum %" PRIu32 " has state %" PRIu32, i,
                                 frustum->root_state);
        }
    }
    return 1;
}

/* Each frustum lies in the range of exactly one light, and names it. */
static int check_ranges(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        uint32_t holders = 0;
        for (uint32_t k = 0; k < oracle->light_count; k++) {
            const struct oracle_light *light = &oracle->lights[k];
            if (i >= light->first_frustum && i - light->first_frustum < light->frustum_count) {
                holders += oracle->frusta[i].light == k ? 1 : 2;
            }
        }
        if (holders != 1) {
            return oracle_refuse(error, "frustum %" PRIu32 ": not in the one light it names", i);
        }
    }
    for (uint32_t k = 0; k < oracle->light_count; k++) {
        const struct oracle_light *light = &oracle->lights[k];
        uint32_t most = light->kind == 0 ? 1 : 6;
        if (light->frustum_count < 1 || light->frustum_count > most ||
            light->first_frustum >= oracle->frustum_count) {
            return oracle_refuse(error,
                                 "light %" PRIu32 ": of kind %" PRIu32 " with %" PRIu32
                                 " frusta from %" PRIu32,
                                 k, light->kind, light->frustum_count, light->first_frustum);
        }
    }
    for (uint32_t i = 0; i < oracle->frustum_count; i++) {
        const double *w = oracle->frusta[i].m + 12;
        int affine = w[0] == 0.0 && w[1] == 0.0 && w[2] == 0.0;
        if (affine != (oracle->lights[oracle->frusta[i].light].kind == 0) ||
            (affine && w[3] != 1.0)) {
            return oracle_refuse(error, "frustum %" PRIu32 ": M's last row does not fit its light",
                                 i);
        }
    }
    return 1;
}

/* The entries of the canonical block, found by tag. */
enum entry_tag {
    ENTRY_SCEN,
    ENTRY_LGHT,
    ENTRY_FRUS,
    ENTRY_CNTS,
    ENTRY_PLAN,
    ENTRY_BAKE,
    ENTRY_ROOT,
    ENTRY_FRNT, /* these four may lack */
    ENTRY_TRNS,
    ENTRY_RECEIVER_MASK,
    ENTRY_SIDE,
    ENTRY_COUNT,
};

static const char entry_names[ENTRY_COUNT][5] = {"SCEN", "LGHT", "FRUS", "CNTS", "PLAN", "BAKE",
                                                 "ROOT", "FRNT", "TRNS", "NEAR", "SIDE"};

static int find_entries(const struct oracle *oracle, struct oracle_section found[ENTRY_COUNT],
                        char error[ORACLE_ERROR_SIZE])
{
    struct oracle_cursor cursor = {.data = oracle->bytes + HEAD_FIXED, .size = oracle->block_size};
    while (cursor.at < cursor.size) {
        const uint8_t *tag = oracle_take_bytes(&cursor, 4);
        uint64_t flags = oracle_take(&cursor, 4);
        uint64_t length = oracle_take(&cursor, 8);
        const uint8_t *data = oracle_take_bytes(&cursor, length);
        const uint8_t *padding = oracle_take_bytes(&cursor, (8 - length % 8) % 8);
        if (cursor.overrun || !oracle_all_zero(padding, (8 - length % 8) % 8)) {
            return oracle_refuse(error, "canonical block: an entry runs over its end or its "
                                        "padding is not zero");
        }
        uint32_t kind = 0;
        while (kind < ENTRY_COUNT && memcmp(tag, entry_names[kind], 4) != 0) {
            kind++;
        }
        if (kind == ENTRY_COUNT) {
            if ((flags & 1) != 0) {
                return oracle_refuse(error, "canonical block: unknown entry that must be known");
            }
            continue;
        }
        if (found[kind].data != NULL) {
            return oracle_refuse(error, "%s: stands twice", entry_names[kind]);
        }
        found[kind] = (struct oracle_section){data, length};
    }
    for (uint32_t kind = 0; kind < ENTRY_COUNT; kind++) {
        if (found[kind].data == NULL && kind < ENTRY_FRNT) {
            return oracle_refuse(error, "%s: missing", entry_names[kind]);
        }
    }
    return 1;
}

int oracle_read_block(struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    struct oracle_section found[ENTRY_COUNT] = {{NULL, 0}};
    if (!find_entries(oracle, found, error)) {
        return 0;
    }
    if (found[ENTRY_SCEN].size != 104 || found[ENTRY_CNTS].size != 152) {
        return oracle_refuse(error, "SCEN, CNTS: %" PRIu64 ", %" PRIu64 " bytes, not 104, 152",
                             found[ENTRY_SCEN].size, found[ENTRY_CNTS].size);
    }
    for (uint32_t l = 3; l < ORACLE_LEVELS; l++) {
        oracle->unique[l] = oracle_number(found[ENTRY_CNTS].data + 8 * (l - 3), 8);
    }
    if (!oracle_is_utf8(found[ENTRY_PLAN].data, found[ENTRY_PLAN].size)) {
        return oracle_refuse(error, "PLAN: not UTF-8");
    }
    if (!is_key_value_text(found[ENTRY_BAKE].data, found[ENTRY_BAKE].size)) {
        return oracle_refuse(error, "BAKE: not key=value lines of UTF-8");
    }
    oracle->frnt = found[ENTRY_FRNT];
    oracle->trns = found[ENTRY_TRNS];
    oracle->receiver_mask = found[ENTRY_RECEIVER_MASK];
    return read_scene(oracle, found[ENTRY_SCEN].data, error) &&
           read_lights(oracle, found[ENTRY_LGHT].data, found[ENTRY_LGHT].size, error) &&
           check_sides(oracle, found[ENTRY_SIDE], error) &&
           read_frusta(oracle, found[ENTRY_FRUS].data, found[ENTRY_FRUS].size, error) &&
           read_roots(oracle, found[ENTRY_ROOT].data, found[ENTRY_ROOT].size, error) &&
           check_ranges(oracle, error) && oracle_check_receiver_mask(oracle, error) &&
           oracle_read_transmittance(oracle, error);
}
