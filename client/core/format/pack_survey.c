/* SPDX-License-Identifier: Apache-2.0 */
/* The survey; see pack_survey.h. Children of surveyed nodes are reached, so one pass a level is
 * enough. */
#include "format/pack_survey.h"

#include <string.h>

#include "base/memory.h"
#include "base/try.h"
#include "format/layout.h"

enum umb_status umb__pack_no_memory(struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "packing: no memory for the cuts of the tree");
}

/* Returns the words of a set of `count` nodes, a bit each. */
static size_t bits_words(size_t count)
{
    return count / 64 + 1;
}

static void bits_add(uint64_t *bits, uint32_t number)
{
    bits[number / 64] |= (uint64_t)1 << (number % 64);
}

struct surveyor {
    const struct umb__octree *octree;
    struct umb__pack_survey *survey;
    struct umb_error *error;
    uint64_t *const *reached; /* Those of the survey */
};

/* Marks the roots, and checks that they exist. */
static enum umb_status mark_roots(struct surveyor *s)
{
    for (uint32_t i = 0; i < s->octree->root_count; i++) {
        const struct umb__octree_root *root = &s->octree->roots[i];
        if (root->state != UMB__NODE_MIXED) {
            continue;
        }
        const uint32_t count = umb__octree_level_count(s->octree, root->level);
        if (root->index >= count) {
            return umb_fail(s->error, UMB_E_ARGUMENT,
                            "octree: node %u of level %u, the level has %u", root->index,
                            root->level, count);
        }
        bits_add(s->reached[root->level], root->index);
    }
    return UMB_OK;
}

/* Checks that a node has a possible mask and leads to existing nodes, and marks its children. */
static enum umb_status survey_node(struct surveyor *s, uint32_t number, uint32_t node)
{
    const struct umb__octree_level *level = &s->octree->level[number];
    const uint16_t mask = level->masks[node];
    const uint32_t first = level->first[node], end = level->first[node + 1];
    if ((mask & (mask >> 1) & 0x5555U) != 0 || end < first ||
        end - first != umb__mask_mixed_count(mask)) {
        return umb_fail(s->error, UMB_E_ARGUMENT,
                        "octree: node %u of level %u: mask 0x%04x does not fit its children %u to "
                        "%u",
                        node, number, mask, first, end);
    }
    const uint32_t below = umb__octree_level_count(s->octree, number - 1);
    for (uint32_t i = first; i < end; i++) {
        if (level->children[i] >= below) {
            return umb_fail(s->error, UMB_E_ARGUMENT,
                            "octree: node %u of level %u leads to %u, the level below has %u", node,
                            number, level->children[i], below);
        }
        bits_add(s->reached[number - 1], level->children[i]);
    }
    s->survey->counts[number]++;
    s->survey->bytes[number] += umb__pack_node_estimate(end - first);
    return UMB_OK;
}

static enum umb_status survey_level(struct surveyor *s, uint32_t number)
{
    const uint64_t *reached = s->reached[number];
    const size_t words = bits_words(s->octree->level[number].count);
    for (size_t i = 0; i < words; i++) {
        for (uint64_t bits = reached[i]; bits != 0; bits &= bits - 1) {
            const uint32_t node = (uint32_t)(64 * i) + (uint32_t)__builtin_ctzll(bits);
            UMB__TRY(survey_node(s, number, node));
        }
    }
    return UMB_OK;
}

static void survey_bricks(struct surveyor *s)
{
    for (uint32_t i = 0; i < s->octree->brick_count; i++) {
        const unsigned runs = umb__brick_runs(s->octree->bricks[i]);
        s->survey->brick_bytes[i] = (uint8_t)(1 + 3 * __builtin_popcount(runs));
        if (umb__pack_reached(s->survey, UMB_LEVEL_BRICK, i)) {
            s->survey->counts[UMB_LEVEL_BRICK]++;
            s->survey->bytes[UMB_LEVEL_BRICK] += s->survey->brick_bytes[i];
        }
    }
}

enum umb_status umb__pack_survey(const struct umb__octree *octree, struct umb__pack_survey *survey,
                                 struct umb_error *error)
{
    struct surveyor s = {
        .octree = octree, .survey = survey, .error = error, .reached = survey->reached};
    memset(survey, 0, sizeof *survey);
    survey->alloc = octree->alloc;
    survey->brick_bytes = umb__alloc(octree->alloc, octree->brick_count + 1, 1);
    enum umb_status status = survey->brick_bytes != NULL ? UMB_OK : umb__pack_no_memory(error);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && status == UMB_OK; level++) {
        const size_t words = bits_words(umb__octree_level_count(octree, level));
        uint64_t *bits = umb__alloc_zeroed(octree->alloc, words, sizeof *bits);
        survey->reached[level] = bits;
        status = bits != NULL ? UMB_OK : umb__pack_no_memory(error);
    }
    status = status == UMB_OK ? mark_roots(&s) : status;
    for (uint32_t level = UMB_LEVEL_MAX; level > UMB_LEVEL_BRICK && status == UMB_OK; level--) {
        status = survey_level(&s, level);
    }
    if (status == UMB_OK) {
        survey_bricks(&s);
    } else {
        umb__pack_survey_finish(survey);
    }
    return status;
}

void umb__pack_survey_finish(struct umb__pack_survey *survey)
{
    umb__free(survey->alloc, survey->brick_bytes);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        umb__free(survey->alloc, survey->reached[level]);
    }
    memset(survey, 0, sizeof *survey);
}
