/* SPDX-License-Identifier: Apache-2.0 */
/* Queries of deep shadow maps; see deep_parts.h. */
#include <math.h>
#include <string.h>
#include "maps/deep_parts.h"

static int is_nearer(const struct umb__deep_list *list, uint32_t i, double depth)
{
    return (double)umb__deep_at(list, i)->depth < depth;
}

uint32_t umb__deep_search(const struct umb__deep_list *list, double depth)
{
    uint32_t low = 0, high = list->count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (is_nearer(list, middle, depth)) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

uint32_t umb__deep_walk(const struct umb__deep_list *list, uint32_t guess, double depth)
{
    while (guess < list->count && is_nearer(list, guess, depth)) {
        guess++;
    }
    while (guess > 0 && !is_nearer(list, guess - 1, depth)) {
        guess--;
    }
    return guess;
}

/* A filter's position in one row of its window: a texel's list, and the number of nodes in that
 * list nearer than the receiver. */
struct place {
    struct umb__deep_list list;
    uint32_t nearer;
};

static struct umb__deep_list list_at(const struct umb__deep *deep, int64_t x, int64_t y)
{
    const size_t i = (size_t)y * deep->width + (size_t)x;
    return (struct umb__deep_list){deep->nodes + deep->first[i] * deep->stride, deep->stride,
                                   (uint32_t)(deep->first[i + 1] - deep->first[i])};
}

/* Returns the transmittance at a position, in units of 2^-30. An exponent fades the last step in;
 * without one the result is a whole number. */
static double place_value(const struct umb__deep *deep, const struct place *place, double depth)
{
    const double one = (double)UMB__DEEP_ONE;
    if (place->nearer == 0) {
        return one;
    }
    const struct umb__deep_node *node = umb__deep_at(&place->list, place->nearer - 1);
    const double left = (double)node->left;
    if (deep->settings.exponent == 0.0) {
        return left;
    }
    const double before =
        place->nearer > 1 ? (double)umb__deep_at(&place->list, place->nearer - 2)->left : one;
    return left + (before - left) * exp(-deep->settings.exponent * (depth - (double)node->depth));
}

/* Returns the number of the node in the next list to which a position's node is linked. */
static uint32_t place_link(const struct place *place, int upper)
{
    if (place->nearer == 0) {
        return 0;
    }
    const struct umb__deep_linked *node =
        (const struct umb__deep_linked *)(const void *)umb__deep_at(&place->list,
                                                                    place->nearer - 1);
    return upper ? node->upper : node->right;
}

/* Moves a position to a neighbouring texel's list, by the link of its node or by a search. */
static void place_move(const struct umb__deep *deep, const struct place *from, int upper,
                       struct umb__deep_list list, double depth, struct place *to)
{
    to->nearer = deep->way == UMB_MAP_DEEP_LINKS
                     ? umb__deep_walk(&list, place_link(from, upper), depth)
                     : umb__deep_search(&list, depth);
    to->list = list;
}

/* The part of a filter's window that lies on the map: texels [x0, x1) x [y0, y1). */
struct window {
    int64_t x0, y0, x1, y1;
};

/* Prefetches the first reads of the next step to the right. */
static void place_prefetch(const struct umb__deep *deep, const struct place *place, int64_t x,
                           int64_t y)
{
    if (deep->way == UMB_MAP_DEEP_LINKS) {
        const struct umb__deep_list next = list_at(deep, x, y);
        __builtin_prefetch(umb__deep_at(&next, place_link(place, 0)));
    }
}

/*
 * Sums the transmittance of a window's texels. It starts with the left column and then steps all
 * rows to the right together, so that while one row waits for memory, the others go on.
 */
static double window_sum(const struct umb__deep *deep, const struct window *w, double depth)
{
    struct place rows[UMB_MAP_WIDTH_MAX];
    const int64_t count = w->y1 - w->y0;
    double sum = 0.0;
    rows[0].list = list_at(deep, w->x0, w->y0);
    rows[0].nearer = umb__deep_search(&rows[0].list, depth);
    for (int64_t i = 1; i < count; i++) {
        place_move(deep, &rows[i - 1], 1, list_at(deep, w->x0, w->y0 + i), depth, &rows[i]);
    }
    for (int64_t x = w->x0;; x++) {
        for (int64_t i = 0; i < count; i++) {
            if (x > w->x0) {
                place_move(deep, &rows[i], 0, list_at(deep, x, w->y0 + i), depth, &rows[i]);
            }
            if (x + 1 < w->x1) {
                place_prefetch(deep, &rows[i], x + 1, w->y0 + i);
            }
            sum += place_value(deep, &rows[i], depth);
        }
        if (x + 1 >= w->x1) {
            return sum;
        }
    }
}

/* Returns the bits of the least float that is not below a depth. Floats from 0 on are ordered as
 * their bits are, so a float is nearer than the depth exactly if its bits are below the result. */
static uint32_t bits_from(double depth)
{
    uint32_t bits;
    if (!(depth > 0.0)) {
        return 0;
    }
    float near = depth < 2.0 ? (float)depth : 2.0F; /* Behind all nodes */
    near = (double)near < depth ? nextafterf(near, INFINITY) : near;
    memcpy(&bits, &near, sizeof bits);
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

/* Sums the transmittance of a window from streams: 1 for each texel, minus the drops of all nodes
 * nearer than `depth`. */
static double stream_sum(const struct umb__deep *deep, const struct window *w, double depth)
{
    const struct umb__deep_node *nodes = (const struct umb__deep_node *)(const void *)deep->nodes;
    const uint32_t limit = bits_from(depth);
    uint64_t lost[2] = {0, 0}; /* Two sums, so that a node need not wait for the one before */
    for (int64_t y = w->y0; y < w->y1; y++) {
        const uint64_t *row = deep->first + (size_t)y * deep->width;
        const uint64_t end = row[w->x1];
        uint64_t i = row[w->x0];
        for (; i + 1 < end; i += 2) {
            lost[0] += drop_before(&nodes[i], limit);
            lost[1] += drop_before(&nodes[i + 1], limit);
        }
        if (i < end) {
            lost[0] += drop_before(&nodes[i], limit);
        }
    }
    const uint64_t all = (uint64_t)((w->x1 - w->x0) * (w->y1 - w->y0)) * UMB__DEEP_ONE;
    return (double)(all - lost[0] - lost[1]);
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
