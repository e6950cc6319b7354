/* SPDX-License-Identifier: Apache-2.0 */
/* Deep shadow maps: makes transmittance lists from fragments, and answers from them; see
 * deep_parts.h. Source: Lokovic, Veach 2000. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#ifdef __SSE2__
#include <emmintrin.h>
#endif
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

enum umb_status umb__lists_write(const struct umb_map_fragments *in, size_t texels,
                                 const struct umb_alloc *alloc, umb__list_writer *write, void *user,
                                 uint64_t *first, struct umb_error *error)
{
    uint64_t longest = 0, used = 0;
    for (size_t i = 0; i < texels; i++) {
        const uint64_t count = in->first[i + 1] - in->first[i];
        longest = count > longest ? count : longest;
    }
    struct umb_map_fragment *sorted = umb__alloc(alloc, longest, sizeof *sorted);
    if (sorted == NULL) {
        return umb__fragments_no_memory(longest, error);
    }
    for (size_t i = 0; i < texels; i++) {
        const size_t count = (size_t)(in->first[i + 1] - in->first[i]);
        if (count > 0) {
            memcpy(sorted, &in->fragments[in->first[i]], count * sizeof *sorted);
        }
        qsort(sorted, count, sizeof *sorted, fragment_compare);
        first[i] = used;
        used += write(user, sorted, count, used);
    }
    first[texels] = used;
    umb__free(alloc, sorted);
    return UMB_OK;
}

/*
 * Writes the list of one texel of a deep map. The transmittance at a node is a product of n factors
 * in doubles, off by n 2^-53, and is rounded once, to 2^-30. Fragments that absorb nothing are left
 * out. The list ends at the first node that leaves no light, or less than epsilon.
 */
static size_t list_write(void *user, const struct umb_map_fragment *sorted, size_t count,
                         uint64_t used)
{
    const struct umb__deep *deep = user;
    const double epsilon = deep->settings.epsilon;
    uint8_t *nodes = deep->nodes + used * deep->stride;
    double left = 1.0;
    size_t length = 0;
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
    UMB__TRY(umb__lists_write(in, texels, alloc, list_write, deep, deep->first, error));
    const uint64_t used = deep->first[texels];
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

/* Links each node of list `from` to the node of list `to` that is nearest in depth. Both lists are
 * sorted. */
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

/* Mean length of non-empty lists up to which UMB_MAP_DEEP_AUTO streams. A stream is faster than
 * links up to 36 nodes of smooth sheets and beyond 40 of hair, at 7 x 7 (`make bench-deep-ways`,
 * docs/results/maps.md). */
#define STREAM_MEAN 32U

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

/* Replaces the transmittance of each node by the node's drop, from the end of each list to its
 * start. */
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

/* Returns the least float that is not below a depth: a node is nearer than the depth exactly if its
 * own depth is below the result. */
static float float_from(double depth)
{
    const float near = depth < 2.0 ? (float)depth : depth >= 2.0 ? 2.0F : 0.0F; /* Last: a NaN */
    return (double)near < depth && near < 2.0F ? nextafterf(near, INFINITY) : near;
}

static inline int is_nearer(const struct umb__deep_list *list, uint32_t i, float near)
{
    return umb__deep_at(list, i)->depth < near;
}

static inline uint32_t list_search(const struct umb__deep_list *list, float near)
{
    uint32_t low = 0, high = list->count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (is_nearer(list, middle, near)) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

static inline uint32_t list_walk(const struct umb__deep_list *list, uint32_t guess, float near)
{
    while (guess < list->count && is_nearer(list, guess, near)) {
        guess++;
    }
    while (guess > 0 && !is_nearer(list, guess - 1, near)) {
        guess--;
    }
    return guess;
}

uint32_t umb__deep_search(const struct umb__deep_list *list, double depth)
{
    return list_search(list, float_from(depth));
}

uint32_t umb__deep_walk(const struct umb__deep_list *list, uint32_t guess, double depth)
{
    return list_walk(list, guess, float_from(depth));
}

/* A filter's position in one row of its window: a texel's list, and the number of nodes in that
 * list nearer than the receiver. */
struct place {
    struct umb__deep_list list;
    uint32_t nearer;
};

/* In: stride: deep->stride, a constant where the function is inlined. */
static inline struct umb__deep_list list_at(const struct umb__deep *deep, size_t stride, int64_t x,
                                            int64_t y)
{
    const size_t i = (size_t)y * deep->width + (size_t)x;
    return (struct umb__deep_list){deep->nodes + deep->first[i] * stride, stride,
                                   (uint32_t)(deep->first[i + 1] - deep->first[i])};
}

/* Returns the transmittance at a position, in units of 2^-30: the light left behind the last node
 * nearer than the receiver, a whole number. */
static inline uint32_t place_left(const struct place *place)
{
    return place->nearer > 0 ? umb__deep_at(&place->list, place->nearer - 1)->left : UMB__DEEP_ONE;
}

/* Returns the transmittance at a position of a map with an exponent. Behind a node the light falls
 * exponentially with depth, from its value before the node to the node's own. */
static double place_faded(const struct umb__deep *deep, const struct place *place, double depth)
{
    const double left = (double)place_left(place);
    if (place->nearer == 0) {
        return left;
    }
    const struct umb__deep_node *node = umb__deep_at(&place->list, place->nearer - 1);
    const double before = place->nearer > 1
                              ? (double)umb__deep_at(&place->list, place->nearer - 2)->left
                              : (double)UMB__DEEP_ONE;
    return left + (before - left) * exp(-deep->settings.exponent * (depth - (double)node->depth));
}

/* Returns the link of a position's node: the number of a node in the list of the texel to the right
 * or, if `upper` is 1, of the texel above. 0: the position has no node. */
static inline uint32_t place_link(const struct place *place, int upper)
{
    if (place->nearer == 0) {
        return 0;
    }
    const struct umb__deep_linked *node =
        (const struct umb__deep_linked *)(const void *)umb__deep_at(&place->list,
                                                                    place->nearer - 1);
    return upper ? node->upper : node->right;
}

/* Moves a position to a neighbouring texel's list: by the link of the position's node, or by a
 * search. */
static inline void place_move(int links, const struct place *from, int upper,
                              struct umb__deep_list list, float near, struct place *to)
{
    to->nearer = links ? list_walk(&list, place_link(from, upper), near) : list_search(&list, near);
    to->list = list;
}

/* The part of a filter's window that lies on the map: texels [x0, x1) x [y0, y1). */
struct window {
    int64_t x0, y0, x1, y1;
};

/*
 * Sums the transmittance of a window's texels: up the left column, and from each of its texels to
 * the right. Rows do not wait for each other, so a processor has several in flight.
 *
 * In: links, stride, faded: constants, so that each caller has a loop of its own.
 */
static inline __attribute__((always_inline)) double rows_sum(const struct umb__deep *deep,
                                                             const struct window *w, double depth,
                                                             int links, size_t stride, int faded)
{
    const float near = float_from(depth);
    struct place row = {.list = list_at(deep, stride, w->x0, w->y0)};
    double sum = 0.0;
    uint64_t whole = 0;
    row.nearer = list_search(&row.list, near);
    for (int64_t y = w->y0;;) {
        struct place place = row;
        for (int64_t x = w->x0;;) {
            whole += faded ? 0 : place_left(&place);
            sum += faded ? place_faded(deep, &place, depth) : 0.0;
            if (++x >= w->x1) {
                break;
            }
            place_move(links, &place, 0, list_at(deep, stride, x, y), near, &place);
        }
        if (++y >= w->y1) {
            return faded ? sum : (double)whole;
        }
        place_move(links, &row, 1, list_at(deep, stride, w->x0, y), near, &row);
    }
}

static double window_sum(const struct umb__deep *deep, const struct window *w, double depth)
{
    const int links = deep->way == UMB_MAP_DEEP_LINKS;
    if (deep->settings.exponent > 0.0) {
        return rows_sum(deep, w, depth, links, deep->stride, 1);
    }
    return links ? rows_sum(deep, w, depth, 1, sizeof(struct umb__deep_linked), 0)
                 : rows_sum(deep, w, depth, 0, sizeof(struct umb__deep_node), 0);
}

/* Returns the bits of float_from(depth); 0 if depth is not above 0. Floats from 0 on have the order
 * of their bits. */
static uint32_t bits_from(double depth)
{
    uint32_t bits = 0;
    const float near = float_from(depth);
    if (depth > 0.0) {
        memcpy(&bits, &near, sizeof bits);
    }
    return bits;
}

/* Returns the drop of a node if its depth's bits are below the limit, else 0. It uses a mask
 * instead of a branch: about half of the nodes are nearer, in an order that no branch predictor
 * learns. */
static inline uint64_t drop_before(const struct umb__deep_node *node, uint32_t limit)
{
    uint32_t bits;
    memcpy(&bits, &node->depth, sizeof bits);
    return node->left & (0U - (uint32_t)(bits < limit));
}

/* Sums the drops of nodes [i, end) whose depth's bits are below the limit. */
static uint64_t drops_before(const struct umb__deep_node *nodes, uint64_t i, uint64_t end,
                             uint32_t limit)
{
    uint64_t lost = 0;
#ifdef __SSE2__
    /* Two nodes a register, four at once: d0 l0 d1 l1. Bits of depths are below 2^31, so that the
     * signed comparison is right; the result for a depth is copied to the lane of its drop. */
    const __m128i limits = _mm_set1_epi32((int)limit);
    __m128i sums[2] = {_mm_setzero_si128(), _mm_setzero_si128()};
    for (; i + 4 <= end; i += 4) {
        for (int k = 0; k < 2; k++) {
            const __m128i two = _mm_loadu_si128((const __m128i *)(const void *)&nodes[i] + k);
            const __m128i verdicts =
                _mm_shuffle_epi32(_mm_cmpgt_epi32(limits, two), _MM_SHUFFLE(2, 2, 0, 0));
            const __m128i drops = _mm_srli_epi64(_mm_and_si128(two, verdicts), 32);
            sums[k] = _mm_add_epi64(sums[k], drops);
        }
    }
    uint64_t halves[2];
    _mm_storeu_si128((__m128i *)(void *)halves, _mm_add_epi64(sums[0], sums[1]));
    lost = halves[0] + halves[1];
#endif
    for (; i < end; i++) {
        lost += drop_before(&nodes[i], limit);
    }
    return lost;
}

/* Sums the transmittance of a window from streams: 1 for each texel, minus the drops of all nodes
 * nearer than `depth`. */
static double stream_sum(const struct umb__deep *deep, const struct window *w, double depth)
{
    const struct umb__deep_node *nodes = (const struct umb__deep_node *)(const void *)deep->nodes;
    const uint32_t limit = bits_from(depth);
    uint64_t lost = 0;
    for (int64_t y = w->y0; y < w->y1; y++) {
        const uint64_t *row = deep->first + (size_t)y * deep->width;
        lost += drops_before(nodes, row[w->x0], row[w->x1], limit);
    }
    const uint64_t all = (uint64_t)((w->x1 - w->x0) * (w->y1 - w->y0)) * UMB__DEEP_ONE;
    return (double)(all - lost);
}

static double deep_answer(const struct umb__map_query *query, const struct umb__receiver *receiver,
                          const double *at)
{
    (void)at;
    const struct umb__deep *deep = query->map->deep;
    const int64_t taps = (int64_t)query->taps;
    const int64_t x0 = (int64_t)floor(receiver->x) - taps / 2;
    const int64_t y0 = (int64_t)floor(receiver->y) - taps / 2;
    struct window w = {x0, y0, x0 + taps, y0 + taps};
    w.x0 = w.x0 < 0 ? 0 : w.x0;
    w.y0 = w.y0 < 0 ? 0 : w.y0;
    w.x1 = w.x1 > (int64_t)deep->width ? (int64_t)deep->width : w.x1;
    w.y1 = w.y1 > (int64_t)deep->height ? (int64_t)deep->height : w.y1;
    const double depth = umb__biased_depth(query, receiver, (double)taps);
    if (w.x1 <= w.x0 || w.y1 <= w.y0) {
        return 1.0;
    }
    const int64_t inside = (w.x1 - w.x0) * (w.y1 - w.y0);
    const double lit = (double)(taps * taps - inside); /* No caster beyond the border */
    const double sum = deep->way == UMB_MAP_DEEP_STREAM ? stream_sum(deep, &w, depth)
                                                        : window_sum(deep, &w, depth);
    return (sum / (double)UMB__DEEP_ONE + lit) / (double)(taps * taps);
}

static enum umb_status deep_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    (void)settings;
    return umb_fail(error, UMB_E_UNSUPPORTED,
                    "settings.technique: deep maps are built by umb_map_build_deep");
}

static double deep_slack(const struct umb_map *map)
{
    return map->deep->settings.epsilon + 0x1p-24; /* The answer is a float */
}

const struct umb__technique umb__map_deep = {
    .name = "deep",
    .bound = UMB_MAP_EXACT,
    .check = deep_check,
    .answer = deep_answer,
    .slack = deep_slack,
};
