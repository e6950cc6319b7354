/* SPDX-License-Identifier: Apache-2.0 */
/* See square_content.h. The square is read in columns of cubes of 64 voxels a side, from the light
 * on. Uniform cubes that follow one another are one run; a mixed cube is written as a tree, which
 * its voxels alone determine. */
#include "bake/write/square_content.h"

#include <string.h>

#include "base/bytes.h"
#include "common/sha256.h"

#define CUBE_LOG2 6U

/* Words of the digest's input. */
enum word {
    WORD_SHADOWED = 0,
    WORD_LIT = 1,
    WORD_MIXED = 2,
    WORD_RUN = 3,
    WORD_CUBE = 4
};

struct reading {
    const struct umb__tree *tree;
    struct umbs_sha256_run run;
    uint8_t bytes[1024];
    size_t used;
    struct umb_volume_stats stats;
};

static void put(struct reading *reading, const void *bytes, size_t count)
{
    if (reading->used + count > sizeof reading->bytes) {
        umbs_sha256_add(&reading->run, reading->bytes, reading->used);
        reading->used = 0;
    }
    memcpy(reading->bytes + reading->used, bytes, count);
    reading->used += count;
}

static void put_word(struct reading *reading, enum word word)
{
    const uint8_t byte = (uint8_t)word;
    put(reading, &byte, 1);
}

/* Writes a cube of 1 << level voxels a side. */
static void put_cube(struct reading *reading, uint32_t level, uint32_t x, uint32_t y, uint32_t z)
{
    const struct umb__place place = umb__tree_locate(reading->tree, x, y, z, &reading->stats);
    if (place.brick == NULL && place.level >= level) {
        put_word(reading, place.lit ? WORD_LIT : WORD_SHADOWED);
        return;
    }
    put_word(reading, WORD_MIXED);
    if (level == UMB_LEVEL_BRICK) {
        put(reading, place.brick, 64);
        return;
    }
    const uint32_t half = 1U << (level - 1);
    for (uint32_t c = 0; c < 8; c++) {
        put_cube(reading, level - 1, x + (c & 1) * half, y + (c >> 1 & 1) * half,
                 z + (c >> 2) * half);
    }
}

/* Returns 1 if a cube of 64 voxels a side is uniform. Uniform cubes have odd levels in the mapped
 * layout, so it may stand there as eight. Out: end: depth behind what is known to be uniform. */
static int is_uniform(struct reading *reading, uint32_t x, uint32_t y, uint32_t z, int *lit,
                      uint32_t *end)
{
    const uint32_t half = 1U << (CUBE_LOG2 - 1);
    *end = z + 2 * half;
    for (uint32_t c = 0; c < 8; c++) {
        const struct umb__place place =
            umb__tree_locate(reading->tree, x + (c & 1) * half, y + (c >> 1 & 1) * half,
                             z + (c >> 2) * half, &reading->stats);
        if (place.brick != NULL || place.level < CUBE_LOG2 - 1 || (c > 0 && place.lit != *lit)) {
            return 0;
        }
        *lit = place.lit;
        if (place.level >= CUBE_LOG2) {
            *end = (z | ((1U << place.level) - 1U)) + 1U;
            return 1;
        }
    }
    return 1;
}

static void put_run(struct reading *reading, int lit, uint32_t cubes)
{
    uint8_t bytes[5];
    if (cubes > 0) {
        put_word(reading, WORD_RUN);
        bytes[0] = (uint8_t)lit;
        umb__store32(bytes + 1, cubes);
        put(reading, bytes, sizeof bytes);
    }
}

/* Writes the column of cubes above (x, y). */
static void put_column(struct reading *reading, uint32_t x, uint32_t y)
{
    const uint32_t size = 1U << reading->tree->log2_size;
    uint32_t cubes = 0; /* length of the run */
    int run_lit = 0;
    for (uint32_t z = 0, next; z < size; z = next) {
        int lit = 0;
        const int uniform = is_uniform(reading, x, y, z, &lit, &next);
        if (!uniform || lit != run_lit) {
            put_run(reading, run_lit, cubes);
            cubes = 0;
        }
        if (uniform) {
            run_lit = lit;
            cubes += (next - z) >> CUBE_LOG2;
        } else {
            put_word(reading, WORD_CUBE);
            put_cube(reading, CUBE_LOG2, x, y, z);
        }
    }
    put_run(reading, run_lit, cubes);
}

void umbb_square_digest(const struct umb__tree *tree, uint32_t x, uint32_t y, uint32_t log2,
                        const uint8_t casters[UMBB_SQUARE_DIGEST],
                        uint8_t digest[UMBB_SQUARE_DIGEST])
{
    struct reading reading = {.tree = tree};
    uint8_t whole[UMB_ID_BYTES];
    const uint32_t side = 1U << log2, cube = 1U << CUBE_LOG2;
    umbs_sha256_begin(&reading.run);
    put(&reading, casters, UMBB_SQUARE_DIGEST);
    for (uint32_t dy = 0; dy < side; dy += cube) {
        for (uint32_t dx = 0; dx < side; dx += cube) {
            put_column(&reading, x + dx, y + dy);
        }
    }
    umbs_sha256_add(&reading.run, reading.bytes, reading.used);
    umbs_sha256_end(&reading.run, whole);
    memcpy(digest, whole, UMBB_SQUARE_DIGEST);
}
