/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes transmittance maps (transmittance.h). One walk checks and counts the parts of an
 * entry, and stores those parts for which there are arrays. */
#include "format/transmittance.h"

#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/numbers.h"
#include "base/try.h"

struct walk {
    const uint8_t *at, *end;
    uint32_t size;            /* Voxels along the frustum */
    struct umb__trans *trans; /* Counts; arrays are filled if they are not NULL */
};

static bool take_mask(struct walk *w, uint64_t *mask)
{
    if (w->end - w->at < 8) {
        return false;
    }
    *mask = umb__load64(w->at);
    w->at += 8;
    return true;
}

/* Earlier steps of a square that a list may refer to. */
struct recent {
    int64_t first_z;                           /* First z of the list before */
    uint32_t drops[UMB__TRANSMITTANCE_RECENT]; /* Last drop by index modulo 8; 0: none yet */
};

/* Reads the drop of light at a step of a list. Returns 0 if the drop is cut off or longer than
 * necessary. */
static uint32_t take_drop(struct walk *w, bool same, uint32_t *recent)
{
    uint32_t less = 0;
    if (!same) {
        if (!umb__take_number(&w->at, w->end, &less) || less >= UMB__TRANSMITTANCE_ONE ||
            less + 1 == *recent) {
            return 0;
        }
        *recent = less + 1;
    }
    return *recent;
}

static bool take_list(struct walk *w, struct recent *recent)
{
    struct umb__trans *t = w->trans;
    int64_t z = 0;
    uint32_t lost = 0, step;
    if (t->starts) {
        t->starts[t->list_count] = (uint32_t)t->step_count;
    }
    t->list_count++;
    for (uint32_t number = 0;; number++) {
        if (!umb__take_number(&w->at, w->end, &step)) {
            return false;
        }
        const uint32_t drop =
            take_drop(w, (step & 2) != 0, &recent->drops[number % UMB__TRANSMITTANCE_RECENT]);
        z = number == 0 ? recent->first_z + umb__unfold(step >> 2) : z + (step >> 2) + 1;
        if (z < 0 || z >= w->size || drop == 0 || drop > UMB__TRANSMITTANCE_ONE - lost) {
            return false;
        }
        lost += drop;
        recent->first_z = number == 0 ? z : recent->first_z;
        if (t->steps) {
            t->steps[t->step_count] = (struct umb__transmittance_step){(uint32_t)z, lost};
        }
        t->step_count++;
        if ((step & 1) == 0) {
            return true;
        }
    }
}

static bool take_square(struct walk *w)
{
    struct umb__trans *t = w->trans;
    struct recent recent = {0};
    uint64_t blocks, texels;
    if (!take_mask(w, &blocks)) {
        return false;
    }
    if (t->squares) {
        t->squares[t->square_count] =
            (struct umb__transmittance_group){blocks, (uint32_t)t->block_count};
    }
    t->square_count++;
    for (; blocks; blocks &= blocks - 1) {
        if (!take_mask(w, &texels) || texels == 0) {
            return false;
        }
        if (t->blocks) {
            t->blocks[t->block_count] =
                (struct umb__transmittance_group){texels, (uint32_t)t->list_count};
        }
        t->block_count++;
        for (; texels; texels &= texels - 1) {
            if (!take_list(w, &recent)) {
                return false;
            }
        }
    }
    return true;
}

static enum umb_status take_map(struct walk *w, uint32_t frustum, uint32_t level,
                                struct umb_error *error)
{
    const uint64_t squares = (uint64_t)1 << (2 * (level - UMB__TRANSMITTANCE_LEVEL_MIN));
    for (uint64_t i = 0; i < squares; i++) {
        if (!take_square(w)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "transmittance: frustum %u, square %llu: cut, or a step that is out of "
                            "order, outside the frustum, or takes more light than there is",
                            frustum, (unsigned long long)i);
        }
    }
    return UMB_OK;
}

static enum umb_status walk_entry(const uint8_t *bytes, uint64_t length,
                                  const struct umb_frustum_info *frusta, uint32_t frustum_count,
                                  struct umb__trans *trans, struct umb_error *error)
{
    struct walk w = {.end = bytes + length, .trans = trans};
    trans->square_count = trans->block_count = trans->list_count = trans->step_count = 0;
    if (length < frustum_count) {
        return umb_fail(error, UMB_E_CORRUPT, "transmittance: %llu bytes for %u frusta",
                        (unsigned long long)length, frustum_count);
    }
    w.at = bytes + frustum_count;
    for (uint32_t i = 0; i < frustum_count; i++) {
        const uint32_t level = bytes[i];
        if (level != 0 && (level < UMB__TRANSMITTANCE_LEVEL_MIN || level > frusta[i].log2_size)) {
            return umb_fail(error, UMB_E_CORRUPT,
                            "transmittance: frustum %u has a map of 2^%u texels a side, allowed %u "
                            "to %u, or 0",
                            i, level, UMB__TRANSMITTANCE_LEVEL_MIN, frusta[i].log2_size);
        }
        if (trans->maps) {
            trans->maps[i] = (struct umb__transmittance_map){level, (uint32_t)trans->square_count};
        }
        w.size = (uint32_t)1 << frusta[i].log2_size;
        UMB__TRY(level == 0 ? UMB_OK : take_map(&w, i, level, error));
    }
    return w.at == w.end ? UMB_OK
                         : umb_fail(error, UMB_E_CORRUPT, "transmittance: %llu bytes too many",
                                    (unsigned long long)(w.end - w.at));
}

enum umb_status umb__transmittance_check(const uint8_t *bytes, uint64_t length,
                                         const struct umb_frustum_info *frusta,
                                         uint32_t frustum_count, struct umb_error *error)
{
    struct umb__trans counts = {0};
    return walk_entry(bytes, length, frusta, frustum_count, &counts, error);
}

enum umb_status umb__transmittance_load(const uint8_t *bytes, uint64_t length,
                                        const struct umb_frustum_info *frusta,
                                        uint32_t frustum_count, const struct umb_alloc *alloc,
                                        struct umb__trans *trans, struct umb_error *error)
{
    struct umb__trans counts = {0};
    memset(trans, 0, sizeof *trans);
    UMB__TRY(walk_entry(bytes, length, frusta, frustum_count, &counts, error));
    /* Each array has one item more than needed, so that none has length 0 */
    trans->maps = umb__alloc(alloc, (size_t)frustum_count + 1, sizeof *trans->maps);
    trans->squares = umb__alloc(alloc, (size_t)counts.square_count + 1, sizeof *trans->squares);
    trans->blocks = umb__alloc(alloc, (size_t)counts.block_count + 1, sizeof *trans->blocks);
    trans->starts = umb__alloc(alloc, (size_t)counts.list_count + 1, sizeof *trans->starts);
    trans->steps = umb__alloc(alloc, (size_t)counts.step_count + 1, sizeof *trans->steps);
    enum umb_status status =
        trans->maps && trans->squares && trans->blocks && trans->starts && trans->steps
            ? walk_entry(bytes, length, frusta, frustum_count, trans, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "transmittance: no memory for %llu steps",
                       (unsigned long long)counts.step_count);
    if (status != UMB_OK) {
        umb__transmittance_finish(trans, alloc);
        return status;
    }
    trans->starts[trans->list_count] = (uint32_t)trans->step_count;
    return UMB_OK;
}

void umb__transmittance_finish(struct umb__trans *trans, const struct umb_alloc *alloc)
{
    umb__free(alloc, trans->maps);
    umb__free(alloc, trans->squares);
    umb__free(alloc, trans->blocks);
    umb__free(alloc, trans->starts);
    umb__free(alloc, trans->steps);
    memset(trans, 0, sizeof *trans);
}

/* Returns the light that a list takes up to and at depth z. */
static uint32_t list_lost(const struct umb__trans *trans, uint32_t list, uint32_t z)
{
    const uint32_t begin = trans->starts[list];
    uint32_t low = begin, high = trans->starts[list + 1];
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (trans->steps[middle].z <= z) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low > begin ? trans->steps[low - 1].lost : 0;
}

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static uint32_t most(uint32_t a, uint32_t b)
{
    return a > b ? a : b;
}

/* Returns how many of the voxels v0..v1 on an axis lie in a texel, which is 2^shift voxels wide. */
static uint32_t overlap(uint32_t v0, uint32_t v1, uint32_t texel, uint32_t shift)
{
    const uint32_t first = texel << shift, last = first + (((uint32_t)1 << shift) - 1);
    return least(v1, last) - most(v0, first) + 1;
}

/* Returns a mask of those texels among t0..t1 that lie in block `block` of eight texels. */
static uint32_t bits_in_block(uint32_t t0, uint32_t t1, uint32_t block)
{
    const uint32_t first = most(t0, 8 * block) & 7, last = least(t1, 8 * block + 7) & 7;
    return (2U << last) - (1U << first);
}

static uint64_t below(unsigned bit)
{
    return ((uint64_t)1 << bit) - 1;
}

/* Block (bx, by) of 8 x 8 texels, or NULL where no column of it loses light. */
static const struct umb__transmittance_group *block_at(const struct umb__trans *trans,
                                                       const struct umb__transmittance_map *map,
                                                       uint32_t bx, uint32_t by)
{
    const uint32_t across = map->level - UMB__TRANSMITTANCE_LEVEL_MIN;
    const struct umb__transmittance_group *square =
        &trans->squares[map->first_square + ((size_t)(by / 8) << across) + bx / 8];
    const unsigned bit = (bx & 7) + 8 * (by & 7);
    if (!(square->mask >> bit & 1)) {
        return NULL;
    }
    return &trans
                ->blocks[square->first + (uint32_t)__builtin_popcountll(square->mask & below(bit))];
}

uint64_t umb__transmittance_lost(const struct umb__trans *trans,
                                 const struct umb__transmittance_map *map, uint32_t n,
                                 const struct umb__transmittance_window *w)
{
    const uint32_t shift = n - map->level;
    const uint32_t x0 = w->x0 >> shift, x1 = w->x1 >> shift;
    const uint32_t y0 = w->y0 >> shift, y1 = w->y1 >> shift;
    uint64_t sum = 0;
    for (uint32_t by = y0 / 8; by <= y1 / 8; by++) {
        const uint32_t rows = bits_in_block(y0, y1, by);
        for (uint32_t bx = x0 / 8; bx <= x1 / 8; bx++) {
            const struct umb__transmittance_group *block = block_at(trans, map, bx, by);
            if (block == NULL) {
                continue;
            }
            const uint64_t columns = bits_in_block(x0, x1, bx) * UINT64_C(0x0101010101010101);
            for (uint64_t rest = block->mask & columns; rest; rest &= rest - 1) {
                const unsigned texel = (unsigned)__builtin_ctzll(rest);
                if (rows >> (texel >> 3) & 1) {
                    const uint32_t list =
                        block->first + (uint32_t)__builtin_popcountll(block->mask & below(texel));
                    sum += (uint64_t)list_lost(trans, list, w->z) *
                           overlap(w->x0, w->x1, 8 * bx + (texel & 7), shift) *
                           overlap(w->y0, w->y1, 8 * by + (texel >> 3), shift);
                }
            }
        }
    }
    return sum;
}

#define CLEAR_BLOCKS 64U /* Blocks of a window that umb__transmittance_is_clear looks at */

bool umb__transmittance_is_clear(const struct umb__trans *trans,
                                 const struct umb__transmittance_map *map, uint32_t n,
                                 const struct umb__transmittance_window *w)
{
    const uint32_t shift = n - map->level;
    const uint32_t x0 = w->x0 >> shift, x1 = w->x1 >> shift;
    const uint32_t y0 = w->y0 >> shift, y1 = w->y1 >> shift;
    if ((x1 / 8 - x0 / 8 + 1) * (y1 / 8 - y0 / 8 + 1) > CLEAR_BLOCKS) {
        return false;
    }
    for (uint32_t by = y0 / 8; by <= y1 / 8; by++) {
        const uint32_t rows = bits_in_block(y0, y1, by);
        uint64_t texels = 0;
        for (unsigned row = 0; row < 8; row++) {
            texels |= (rows >> row & 1 ? UINT64_C(0xff) : 0) << 8 * row;
        }
        for (uint32_t bx = x0 / 8; bx <= x1 / 8; bx++) {
            const struct umb__transmittance_group *block = block_at(trans, map, bx, by);
            if (block == NULL) {
                continue;
            }
            const uint64_t columns = bits_in_block(x0, x1, bx) * UINT64_C(0x0101010101010101);
            if (block->mask & columns & texels) {
                return false;
            }
        }
    }
    return true;
}

/* --- writing ---------------------------------------------------------------------------------- */

#define STEP_BYTES_MAX (2 * UMB__NUMBER_BYTES_MAX)

void umb__transmittance_bytes_finish(struct umb__transmittance_bytes *bytes)
{
    umb__free(bytes->alloc, bytes->data);
    memset(bytes, 0, sizeof *bytes);
}

static enum umb_status reserve(struct umb__transmittance_bytes *bytes, size_t more,
                               struct umb_error *error)
{
    return umb__grow(bytes->alloc, &bytes->data, &bytes->capacity, bytes->count + more, 1)
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "transmittance: no memory for %zu bytes",
                          bytes->count + more);
}

static enum umb_status check_limit(const struct umb__transmittance_bytes *bytes, size_t max_bytes,
                                   struct umb_error *error)
{
    return bytes->count <= max_bytes
               ? UMB_OK
               : umb_fail(error, UMB_E_LIMIT, "transmittance: more than %zu bytes", max_bytes);
}

static void put_varint(struct umb__transmittance_bytes *bytes, uint32_t value)
{
    bytes->count = (size_t)(umb__put_number(bytes->data + bytes->count, value) - bytes->data);
}

/* Makes room for a mask; returns its place. */
static size_t put_mask(struct umb__transmittance_bytes *bytes, uint64_t mask)
{
    const size_t at = bytes->count;
    umb__store64(bytes->data + at, mask);
    bytes->count += 8;
    return at;
}

/* Writes a list, for which there is room. */
static void put_list(struct umb__transmittance_bytes *bytes,
                     const struct umb__transmittance_list *list, struct recent *recent)
{
    for (uint32_t i = 0; i < list->count; i++) {
        const uint32_t z = list->steps[i].z, drop = list->steps[i].drop;
        const uint32_t step =
            i == 0 ? umb__fold((int64_t)z - recent->first_z) : z - list->steps[i - 1].z - 1;
        uint32_t *last = &recent->drops[i % UMB__TRANSMITTANCE_RECENT];
        const uint32_t same = drop == *last, more = i + 1 < list->count;
        put_varint(bytes, 4 * step + 2 * same + more);
        if (drop != *last) {
            put_varint(bytes, drop - 1);
        }
        *last = drop;
    }
    recent->first_z = list->steps[0].z;
}

static const struct umb__transmittance_list *list_of(const struct umb__transmittance_list *lists,
                                                     uint32_t block, uint32_t texel)
{
    const size_t x = 8 * (block % 8) + texel % 8, y = 8 * (block / 8) + texel / 8;
    return &lists[y * UMB__TRANSMITTANCE_SIDE + x];
}

static enum umb_status put_block(struct umb__transmittance_bytes *bytes,
                                 const struct umb__transmittance_list *lists, uint32_t block,
                                 uint64_t texels, struct recent *recent, struct umb_error *error)
{
    UMB__TRY(reserve(bytes, 8, error));
    (void)put_mask(bytes, texels);
    for (; texels; texels &= texels - 1) {
        const struct umb__transmittance_list *list =
            list_of(lists, block, (uint32_t)__builtin_ctzll(texels));
        UMB__TRY(reserve(bytes, (size_t)list->count * STEP_BYTES_MAX, error));
        put_list(bytes, list, recent);
    }
    return UMB_OK;
}

enum umb_status umb__transmittance_square(struct umb__transmittance_bytes *bytes,
                                          const struct umb__transmittance_list *lists,
                                          size_t max_bytes, struct umb_error *error)
{
    uint64_t blocks = 0;
    struct recent recent = {0};
    UMB__TRY(reserve(bytes, 8, error));
    const size_t mask_at = put_mask(bytes, 0);
    for (uint32_t block = 0; block < 64; block++) {
        uint64_t texels = 0;
        for (uint32_t texel = 0; texel < 64; texel++) {
            texels |= (uint64_t)(list_of(lists, block, texel)->count > 0) << texel;
        }
        if (texels != 0) {
            blocks |= (uint64_t)1 << block;
            UMB__TRY(put_block(bytes, lists, block, texels, &recent, error));
        }
    }
    umb__store64(bytes->data + mask_at, blocks);
    return check_limit(bytes, max_bytes, error);
}

enum umb_status umb__transmittance_append(struct umb__transmittance_bytes *bytes, const void *data,
                                          size_t count, size_t max_bytes, struct umb_error *error)
{
    UMB__TRY(reserve(bytes, count, error));
    if (count > 0) {
        memcpy(bytes->data + bytes->count, data, count);
        bytes->count += count;
    }
    return check_limit(bytes, max_bytes, error);
}
