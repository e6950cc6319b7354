/* SPDX-License-Identifier: Apache-2.0 */
/* Which lines of the layout builds have written since a program copied them to its GPU. */
#include "base/memory.h"
#include "format/node_places.h"
#include "partial/partial_parts.h"
#include "umbrage/gpu.h"

#define LINE_ENTRIES 4U  /* A line of nodes, or a brick, is 64 bytes */
#define GAP_MOST     16U /* Ranges with so few unchanged lines between them are one */

/* Makes room for the bits of so many lines. */
static bool fit_bits(struct umb_partial *p, struct umb__line_bits *lines, uint64_t count)
{
    const size_t words = (size_t)((count + 63) / 64);
    const size_t before = lines->capacity;
    if (words > before &&
        !umb__grow(&p->alloc, &lines->bits, &lines->capacity, words, sizeof *lines->bits)) {
        return false;
    }
    for (size_t i = before; i < lines->capacity; i++) {
        lines->bits[i] = 0;
    }
    return true;
}

static void note(struct umb_partial *p, struct umb__line_bits *lines, uint32_t first,
                 uint32_t count)
{
    struct umb__changes *changes = &p->changes;
    if (!changes->wanted || changes->all || count == 0) {
        return;
    }
    if (!fit_bits(p, lines, (uint64_t)first + count)) {
        umb__changes_note_all(p);
        return;
    }
    for (uint64_t line = first; line < (uint64_t)first + count; line++) {
        lines->bits[line / 64] |= (uint64_t)1 << line % 64;
    }
}

void umb__changes_note_nodes(struct umb_partial *p, uint32_t word, uint64_t words)
{
    const uint32_t first = word / UMB__LINE_WORDS;
    const uint64_t last = (word + words - 1) / UMB__LINE_WORDS;
    note(p, &p->changes.nodes, first, (uint32_t)(last - first + 1));
}

void umb__changes_note_bricks(struct umb_partial *p, uint32_t first, uint32_t count)
{
    note(p, &p->changes.bricks, first, count);
}

void umb__changes_note_tops(struct umb_partial *p)
{
    p->changes.tops = true;
}

void umb__changes_note_all(struct umb_partial *p)
{
    p->changes.all = true;
    umb__free(&p->alloc, p->changes.nodes.bits);
    umb__free(&p->alloc, p->changes.bricks.bits);
    p->changes.nodes = p->changes.bricks = (struct umb__line_bits){0};
}

void umb_gpu_forget_changes(struct umb_partial *p)
{
    umb__changes_note_all(p);
    p->changes.all = p->changes.tops = false;
    p->changes.wanted = true;
}

/* Returns the next changed line from `from` on, or `end`. */
static uint64_t next_line(const struct umb__line_bits *lines, uint64_t from, uint64_t end)
{
    while (from < end) {
        const uint64_t rest = lines->bits[from / 64] >> from % 64;
        if (rest != 0) {
            from += (uint64_t)__builtin_ctzll(rest);
            return from < end ? from : end;
        }
        from = (from / 64 + 1) * 64;
    }
    return end;
}

/* Takes the changed lines of an array into ranges, and forgets them. Lines behind the array's end
 * are forgotten, too. In: first: entry of line 0; room: entries of the array. */
static size_t take(struct umb__line_bits *lines, uint32_t first, uint32_t room,
                   struct umb_gpu_range *ranges, size_t most)
{
    const uint64_t bits = (uint64_t)lines->capacity * 64;
    const uint64_t end = bits < room / LINE_ENTRIES ? bits : room / LINE_ENTRIES;
    size_t count = 0;
    for (uint64_t at = next_line(lines, 0, end); at < end && count < most; count++) {
        const uint64_t begin = at;
        uint64_t last = at, next = at;
        while (next < end && next - last <= GAP_MOST) {
            last = next;
            lines->bits[last / 64] &= ~((uint64_t)1 << last % 64);
            next = next_line(lines, last + 1, end);
        }
        ranges[count] = (struct umb_gpu_range){first + (uint32_t)begin * LINE_ENTRIES,
                                               (uint32_t)(last - begin + 1) * LINE_ENTRIES};
        at = next;
    }
    return count;
}

size_t umb_gpu_changes(struct umb_partial *p, const struct umb_gpu_layout *layout,
                       struct umb_gpu_range *ranges, size_t room)
{
    struct umb__changes *changes = &p->changes;
    size_t count = 0;
    if (!p->built || room == 0) {
        return 0;
    }
    if (!changes->wanted || changes->all) {
        umb_gpu_forget_changes(p);
        ranges[0] = (struct umb_gpu_range){0, layout->entries};
        return 1;
    }
    if (changes->tops) {
        changes->tops = false;
        ranges[count++] = (struct umb_gpu_range){0, layout->node_first};
    }
    count +=
        take(&changes->nodes, layout->node_first, layout->node_room, ranges + count, room - count);
    count += take(&changes->bricks, layout->brick_first, layout->brick_room, ranges + count,
                  room - count);
    return count;
}
