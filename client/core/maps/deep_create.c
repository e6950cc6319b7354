/* SPDX-License-Identifier: Apache-2.0 */
/* Transmittance lists from fragments; see deep_parts.h. Source: Lokovic, Veach 2000. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/try.h"
#include "maps/deep_parts.h"

enum umb_status umb__fragments_no_memory(uint64_t count, struct umb_error *error)
{
    return umb_fail(error, UMB_E_NO_MEMORY, "%llu fragments do not fit in memory",
                    (unsigned long long)count);
}

enum umb_status umb__fragments_check(const struct umb_map_fragments *in, size_t texels,
                                     struct umb_error *error)
{
    for (size_t i = 0; i < texels; i++) {
        if (in->first[i] > in->first[i + 1] || in->first[i + 1] - in->first[i] >= UINT32_MAX) {
            return umb_fail(error, UMB_E_ARGUMENT, "fragments.first[%zu]: %llu, then %llu", i,
                            (unsigned long long)in->first[i], (unsigned long long)in->first[i + 1]);
        }
    }
    for (uint64_t i = in->first[0]; i < in->first[texels]; i++) {
        const struct umb_map_fragment *f = &in->fragments[i];
        if (!(f->depth >= 0.0F && f->depth <= 1.0F && f->alpha >= 0.0F && f->alpha <= 1.0F)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "fragments[%llu]: depth %g, alpha %g; both must be 0..1",
                            (unsigned long long)i, (double)f->depth, (double)f->alpha);
        }
    }
    return UMB_OK;
}

static int fragment_compare(const void *a, const void *b)
{
    const struct umb_map_fragment *x = a, *y = b;
    if (x->depth != y->depth) {
        return x->depth < y->depth ? -1 : 1;
    }
    return (x->alpha > y->alpha) - (x->alpha < y->alpha);
}

uint64_t umb__fragments_longest(const struct umb_map_fragments *in, size_t texels)
{
    uint64_t longest = 0;
    for (size_t i = 0; i < texels; i++) {
        const uint64_t count = in->first[i + 1] - in->first[i];
        longest = count > longest ? count : longest;
    }
    return longest;
}

size_t umb__fragments_sort(const struct umb_map_fragments *in, size_t texel,
                           struct umb_map_fragment *sorted)
{
    const size_t count = (size_t)(in->first[texel + 1] - in->first[texel]);
    if (count > 0) {
        memcpy(sorted, &in->fragments[in->first[texel]], count * sizeof *sorted);
    }
    qsort(sorted, count, sizeof *sorted, fragment_compare);
    return count;
}

/*
 * Writes the list of one texel and returns its length. Transmittance is a product of n factors in
 * doubles, off by n 2^-53, which is rounded to 2^-30 once a node. Fragments that absorb nothing are
 * left out. The list ends at the first node that leaves no light, or less than epsilon.
 */
static uint32_t list_write(const struct umb_map_fragment *sorted, size_t count,
                           const struct umb__deep *deep, uint8_t *nodes)
{
    const double epsilon = deep->settings.epsilon;
    double left = 1.0;
    uint32_t length = 0;
    struct umb__deep_node *last = NULL;
    for (size_t i = 0; i < count; i++) {
        if (sorted[i].alpha == 0.0F) {
            continue;
        }
        left *= 1.0 - (double)sorted[i].alpha;
        if (last == NULL || last->depth != sorted[i].depth) {
            last = (struct umb__deep_node *)(void *)(nodes + length++ * deep->stride);
            last->depth = sorted[i].depth + 0.0F; /* -0 becomes 0, since streams compare bits */
        }
        last->left = (uint32_t)(left * (double)UMB__DEEP_ONE + 0.5);
        const int more_here = i + 1 < count && sorted[i + 1].depth == sorted[i].depth;
        if (!more_here && (left < epsilon || last->left == 0)) {
            break;
        }
    }
    return length;
}

static enum umb_status lists_make(struct umb__deep *deep, const struct umb_map_fragments *in,
                                  const struct umb_alloc *alloc, struct umb_error *error)
{
    const size_t texels = (size_t)deep->width * deep->height;
    const uint64_t longest = umb__fragments_longest(in, texels);
    uint64_t used = 0;
    struct umb_map_fragment *sorted = umb__alloc(alloc, longest, sizeof *sorted);
    if (sorted == NULL) {
        return umb__fragments_no_memory(longest, error);
    }
    for (size_t i = 0; i < texels; i++) {
        const size_t count = umb__fragments_sort(in, i, sorted);
        deep->first[i] = used;
        used += list_write(sorted, count, deep, deep->nodes + used * deep->stride);
    }
    deep->first[texels] = used;
    umb__free(alloc, sorted);
    /* Frees the memory behind the lists. If the allocator refuses, the block stays as it is. */
    uint8_t *less = umb__resize(alloc, deep->nodes, (used > 0 ? used : 1) * deep->stride);
    deep->nodes = less != NULL ? less : deep->nodes;
    deep->bytes = (texels + 1) * sizeof *deep->first + used * deep->stride;
    return UMB_OK;
}

static struct umb__deep_linked *linked_at(const struct umb__deep *deep, uint64_t i)
{
    return (struct umb__deep_linked *)(void *)(deep->nodes + i * deep->stride);
}

/* Links each node of list `from` to the nearest node of list `to`. Both lists are sorted. */
static void list_link(const struct umb__deep *deep, size_t from, size_t to, int upper)
{
    const uint32_t count = (uint32_t)(deep->first[to + 1] - deep->first[to]);
    uint32_t near = 0;
    for (uint64_t i = deep->first[from]; i < deep->first[from + 1]; i++) {
        struct umb__deep_linked *node = linked_at(deep, i);
        const float depth = node->node.depth;
        while (near + 1 < count) {
            const float here = linked_at(deep, deep->first[to] + near)->node.depth;
            const float next = linked_at(deep, deep->first[to] + near + 1)->node.depth;
            if (!(fabsf(next - depth) < fabsf(here - depth))) {
                break;
            }
            near++;
        }
        if (upper) {
            node->upper = near;
        } else {
            node->right = near;
        }
    }
}

/* Makes all links. Links to a side without a neighbour are 0 and are never followed. */
static void links_make(struct umb__deep *deep)
{
    const uint64_t used = deep->first[(size_t)deep->width * deep->height];
    for (uint64_t i = 0; i < used; i++) {
        linked_at(deep, i)->right = 0;
        linked_at(deep, i)->upper = 0;
    }
    for (uint32_t y = 0; y < deep->height; y++) {
        for (uint32_t x = 0; x < deep->width; x++) {
            const size_t i = (size_t)y * deep->width + x;
            if (x + 1 < deep->width) {
                list_link(deep, i, i + 1, 0);
            }
            if (y + 1 < deep->height) {
                list_link(deep, i, i + deep->width, 1);
            }
        }
    }
}

/* Mean length of non-empty lists up to which a stream is faster than links (measured at 7 x 7,
 * docs/results/techniques.md). */
#define STREAM_MEAN 16U

static enum umb_map_deep_way choose_way(const struct umb__deep *deep)
{
    const size_t texels = (size_t)deep->width * deep->height;
    uint64_t lists = 0;
    if (deep->settings.way != UMB_MAP_DEEP_AUTO) {
        return deep->settings.way;
    }
    for (size_t i = 0; i < texels; i++) {
        lists += deep->first[i + 1] > deep->first[i];
    }
    return deep->settings.exponent == 0.0 && deep->first[texels] <= STREAM_MEAN * lists
               ? UMB_MAP_DEEP_STREAM
               : UMB_MAP_DEEP_LINKS;
}

/* Replaces each node's transmittance by its drop, from the end of each list to the start. */
static void stream_make(struct umb__deep *deep)
{
    struct umb__deep_node *nodes = (struct umb__deep_node *)(void *)deep->nodes;
    const size_t texels = (size_t)deep->width * deep->height;
    for (size_t i = 0; i < texels; i++) {
        for (uint64_t k = deep->first[i + 1]; k > deep->first[i]; k--) {
            const uint32_t before = k - 1 > deep->first[i] ? nodes[k - 2].left : UMB__DEEP_ONE;
            nodes[k - 1].left = before - nodes[k - 1].left;
        }
    }
}

/* Makes room for links behind each node: moves the nodes apart in place, the last node first. */
static enum umb_status links_open(struct umb__deep *deep, const struct umb_alloc *alloc,
                                  struct umb_error *error)
{
    const uint64_t used = deep->first[(size_t)deep->width * deep->height];
    const size_t stride = sizeof(struct umb__deep_linked);
    uint8_t *more = umb__resize(alloc, deep->nodes, (size_t)(used > 0 ? used : 1) * stride);
    if (more == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "links of %llu fragments do not fit in memory",
                        (unsigned long long)used);
    }
    for (uint64_t i = used; i > 0; i--) {
        struct umb__deep_node node;
        memcpy(&node, more + (i - 1) * sizeof node, sizeof node);
        memcpy(more + (i - 1) * stride, &node, sizeof node);
    }
    deep->nodes = more;
    deep->stride = stride;
    deep->bytes += used * (stride - sizeof(struct umb__deep_node));
    return UMB_OK;
}

enum umb_status umb__deep_create(const struct umb_map_frustum *frustum,
                                 const struct umb_map_fragments *fragments,
                                 const struct umb_map_deep_settings *settings,
                                 const struct umb_alloc *alloc, struct umb__deep **out,
                                 struct umb_error *error)
{
    *out = NULL;
    const size_t texels = (size_t)frustum->width * frustum->height;
    UMB__TRY(umb__fragments_check(fragments, texels, error));
    const uint64_t total = fragments->first[texels] - fragments->first[0];
    struct umb__deep *deep = umb__alloc_zeroed(alloc, 1, sizeof *deep);
    if (deep != NULL) {
        deep->settings = *settings;
        deep->width = frustum->width;
        deep->height = frustum->height;
        deep->first = umb__alloc_zeroed(alloc, texels + 1, sizeof *deep->first);
        deep->stride = sizeof(struct umb__deep_node);
        deep->nodes = umb__alloc(alloc, total, deep->stride);
    }
    if (deep == NULL || deep->first == NULL || deep->nodes == NULL) {
        umb__deep_destroy(deep, alloc);
        return umb__fragments_no_memory(total, error);
    }
    enum umb_status status = lists_make(deep, fragments, alloc, error);
    deep->way = status == UMB_OK ? choose_way(deep) : settings->way;
    if (status == UMB_OK && deep->way == UMB_MAP_DEEP_LINKS) {
        status = links_open(deep, alloc, error);
    }
    if (status != UMB_OK) {
        umb__deep_destroy(deep, alloc);
        return status;
    }
    if (deep->way == UMB_MAP_DEEP_LINKS) {
        links_make(deep);
    } else if (deep->way == UMB_MAP_DEEP_STREAM) {
        stream_make(deep);
    }
    *out = deep;
    return UMB_OK;
}

void umb__deep_destroy(struct umb__deep *deep, const struct umb_alloc *alloc)
{
    if (deep == NULL) {
        return;
    }
    umb__free(alloc, deep->first);
    umb__free(alloc, deep->nodes);
    umb__free(alloc, deep);
}
