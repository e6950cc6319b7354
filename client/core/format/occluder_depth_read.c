/* SPDX-License-Identifier: Apache-2.0 */
/* Checks occluder depth maps. A check reads the records in the order in which they were
 * written, and each reference must lead to the next one. So nothing is read twice, and the walk
 * ends. */
#include "format/occluder_depth_build.h"

struct checker {
    const uint32_t *words;
    uint64_t count, next; /* First word that is not read yet */
    uint32_t log2_size;
};

/* Returns the next `count` words; NULL if there are fewer. */
static const uint32_t *take(struct checker *c, uint64_t count)
{
    if (c->count - c->next < count) {
        return NULL;
    }
    c->next += count;
    return c->words + (c->next - count);
}

static bool in_range(const struct checker *c, int64_t value)
{
    return value >= 0 && value <= (int64_t)1 << c->log2_size;
}

/* Returns false for a plane whose constant term is so large that sums could overflow. */
static bool plane_is_sane(const uint32_t *plane)
{
    const int32_t high = (int32_t)plane[1];
    return high > -(1 << 24) && high < 1 << 24;
}

/* Checks a plane over a square by its corners, where its extremes lie. */
static bool plane_fits(const struct checker *c, const uint32_t *plane, uint32_t x, uint32_t y,
                       uint32_t side)
{
    return in_range(c, umb__occluder_depth_wide_plane(plane, x, y)) &&
           in_range(c, umb__occluder_depth_wide_plane(plane, x + side - 1, y)) &&
           in_range(c, umb__occluder_depth_wide_plane(plane, x, y + side - 1)) &&
           in_range(c, umb__occluder_depth_wide_plane(plane, x + side - 1, y + side - 1));
}

/* Returns the words of a block's record; 0 if there is no such kind. */
static uint32_t block_words(uint32_t kind, uint32_t planes)
{
    const uint32_t width = kind % UMB__OCCLUDER_DEPTH_MASKED;
    if (width <= UMB__OCCLUDER_DEPTH_WIDTH_MAX) {
        return (kind >= UMB__OCCLUDER_DEPTH_MASKED ? 5 : 3) + 2 * width;
    }
    /* Checks the record of a block that chooses a plane for each texel: the numbers of planes must
     * have enough bits for every plane. */
    return kind > UMB__OCCLUDER_DEPTH_CHOICE && kind <= UMB__OCCLUDER_DEPTH_CHOICE + 4 &&
                   planes >> (kind - UMB__OCCLUDER_DEPTH_CHOICE) == 0
               ? 2 * (kind - UMB__OCCLUDER_DEPTH_CHOICE)
               : 0;
}

static bool block_fits(struct checker *c, uint32_t reference, const uint32_t *square,
                       uint32_t block)
{
    const uint32_t kind = umb__occluder_depth_kind(reference), words = block_words(kind, square[0]);
    if (words == 0 || umb__occluder_depth_offset(reference) != c->next) {
        return false;
    }
    const uint32_t *record = take(c, words);
    if (!record) {
        return false;
    }
    for (uint32_t texel = 0; texel < 64; texel++) {
        if (kind > UMB__OCCLUDER_DEPTH_CHOICE && kind < UMB__OCCLUDER_DEPTH_MASKED &&
            umb__occluder_depth_residual(record, kind - UMB__OCCLUDER_DEPTH_CHOICE, texel) >
                square[0]) {
            return false;
        }
        int64_t value;
        if (umb__occluder_depth_value(record, kind, square + 1, block % 8 * 8 + texel % 8,
                                      block / 8 * 8 + texel / 8, &value) &&
            !in_range(c, value)) {
            return false;
        }
    }
    return true;
}

/* Checks a square of several planes. Each block may be answered at most once: by a plane, or by a
 * record of its own. */
static bool planes_fit(struct checker *c)
{
    const uint32_t *square = take(c, 1);
    if (!square || square[0] > UMB__OCCLUDER_DEPTH_PLANES_MAX ||
        !take(c, square[0] * UMB__OCCLUDER_DEPTH_PLANE_WORDS)) {
        return false;
    }
    uint64_t seen = 0;
    for (uint32_t i = 0; i < square[0]; i++) {
        const uint32_t *plane = square + 1 + i * UMB__OCCLUDER_DEPTH_PLANE_WORDS;
        const uint64_t mask = umb__occluder_depth_mask(plane + 4);
        if (!plane_is_sane(plane) || (mask & seen) != 0) {
            return false;
        }
        seen |= mask;
        for (uint64_t left = mask; left; left &= left - 1) {
            const uint32_t block = (uint32_t)__builtin_ctzll(left);
            if (!plane_fits(c, plane, block % 8 * 8, block / 8 * 8, 8)) {
                return false;
            }
        }
    }
    const uint32_t *rest = take(c, 2);
    const uint64_t mask = rest ? umb__occluder_depth_mask(rest) : 0;
    if (!rest || (mask & seen) != 0 || (mask | seen) == 0 ||
        !take(c, (uint64_t)__builtin_popcountll(mask))) {
        return false;
    }
    for (uint64_t left = mask, i = 2; left; left &= left - 1, i++) {
        if (!block_fits(c, rest[i], square, (uint32_t)__builtin_ctzll(left))) {
            return false;
        }
    }
    return true;
}

/* Checks a square at (x, y) of its level, counted in squares. Recursion ends at level 6. */
static bool square_fits(struct checker *c, uint32_t reference, uint32_t level, uint32_t x,
                        uint32_t y)
{
    const uint32_t kind = umb__occluder_depth_kind(reference);
    if (umb__occluder_depth_offset(reference) != c->next) {
        return false;
    }
    if (level == 6 && kind == 0) {
        const uint32_t *plane = take(c, 4);
        return plane && plane_is_sane(plane) && plane_fits(c, plane, 0, 0, 64);
    }
    if (level == 6) {
        return kind == UMB__OCCLUDER_DEPTH_PLANES && planes_fit(c);
    }
    const uint32_t *mask_words = kind == UMB__OCCLUDER_DEPTH_DIVIDED ? take(c, 2) : NULL;
    const uint64_t mask = mask_words ? umb__occluder_depth_mask(mask_words) : 0;
    const uint32_t *children = take(c, (uint64_t)__builtin_popcountll(mask));
    if (mask == 0 || !children) {
        return false;
    }
    const uint32_t side = (uint32_t)1 << c->log2_size >> (level - 3); /* Squares a side */
    for (uint64_t left = mask; left; left &= left - 1) {
        const uint32_t child = (uint32_t)__builtin_ctzll(left);
        const uint32_t cx = x * 8 + child % 8, cy = y * 8 + child / 8;
        if (cx >= side || cy >= side || !square_fits(c, *children++, level - 3, cx, cy)) {
            return false;
        }
    }
    return true;
}

int umb__occluder_depth_square_fits(uint32_t log2_size, const uint32_t *words, size_t count)
{
    struct checker c = {.words = words + 2, .log2_size = log2_size};
    if (count < 2 || words[0] != count || log2_size > UMB__OCCLUDER_DEPTH_LEVEL_MAX) {
        return 0;
    }
    c.count = count - 2;
    return square_fits(&c, words[1], 6, 0, 0) && c.next == c.count;
}

enum umb_status umb__occluder_depth_check(const uint32_t *words, uint64_t count,
                                          const struct umb_frustum_info *frusta,
                                          uint32_t frustum_count, struct umb_error *error)
{
    struct checker c = {.words = words, .count = count};
    bool fits = take(&c, frustum_count) != NULL;
    for (uint32_t i = 0; i < frustum_count && fits; i++) {
        c.log2_size = frusta[i].log2_size;
        if (words[i] == 0) {
            continue;
        }
        fits = frusta[i].closed && c.log2_size <= UMB__OCCLUDER_DEPTH_LEVEL_MAX &&
               square_fits(&c, words[i], umb__occluder_depth_top(c.log2_size), 0, 0);
        if (!fits) {
            return umb_fail(error, UMB_E_CORRUPT, "front: malformed in frustum %u at word %llu", i,
                            (unsigned long long)c.next);
        }
    }
    return fits && c.next == count
               ? UMB_OK
               : umb_fail(error, UMB_E_CORRUPT, "front: %llu words, its frusta use %llu",
                          (unsigned long long)count, (unsigned long long)c.next);
}
