/* SPDX-License-Identifier: Apache-2.0 */
/* Deep shadow maps asked; see deep_parts.h. */
#include <math.h>
#include "deep/deep_parts.h"

uint32_t umb__deep_search(const struct umb__deep_node *nodes, uint32_t count, double depth)
{
    uint32_t low = 0, high = count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if ((double)nodes[middle].depth < depth) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

uint32_t umb__deep_walk(const struct umb__deep_node *nodes, uint32_t count, uint32_t guess,
                        double depth)
{
    while (guess < count && (double)nodes[guess].depth < depth) {
        guess++;
    }
    while (guess > 0 && !((double)nodes[guess - 1].depth < depth)) {
        guess--;
    }
    return guess;
}

/* A texel's list. */
struct list {
    const struct umb__deep_node *nodes;
    uint64_t first;
    uint32_t count;
};

static struct list list_at(const struct umb__deep *deep, int64_t x, int64_t y)
{
    const size_t i = (size_t)y * deep->width + (size_t)x;
    return (struct list){deep->nodes + deep->first[i], deep->first[i],
                         (uint32_t)(deep->first[i + 1] - deep->first[i])};
}

/* Light left behind `nearer` nodes, at a depth. With an exponent the last step fades in. */
static double list_value(const struct umb__deep *deep, const struct list *list, uint32_t nearer,
                         double depth)
{
    if (nearer == 0) {
        return 1.0;
    }
    const double left = (double)list->nodes[nearer - 1].left;
    if (deep->settings.exponent == 0.0) {
        return left;
    }
    const double before = nearer > 1 ? (double)list->nodes[nearer - 2].left : 1.0;
    const double behind = depth - (double)list->nodes[nearer - 1].depth;
    return left + (before - left) * exp(-deep->settings.exponent * behind);
}

/* Place of a depth in the list next to one where it is known: by the link of the node there. */
static uint32_t neighbour_place(const struct umb__deep *deep, const struct list *from,
                                uint32_t nearer, int upper, const struct list *to, double depth)
{
    if (deep->links == NULL) {
        return umb__deep_search(to->nodes, to->count, depth);
    }
    uint32_t guess = 0;
    if (nearer > 0) {
        const struct umb__deep_link *link = &deep->links[from->first + nearer - 1];
        guess = upper ? link->upper : link->right;
    }
    return umb__deep_walk(to->nodes, to->count, guess, depth);
}

/* The part of a window that lies on the map. */
struct window {
    int64_t x0, y0, x1, y1;
};

static double window_sum(const struct umb__deep *deep, const struct window *w, double depth)
{
    double sum = 0.0;
    struct list row = list_at(deep, w->x0, w->y0);
    uint32_t row_place = umb__deep_search(row.nodes, row.count, depth);
    for (int64_t y = w->y0;; y++) {
        struct list here = row;
        uint32_t place = row_place;
        sum += list_value(deep, &here, place, depth);
        for (int64_t x = w->x0 + 1; x < w->x1; x++) {
            const struct list next = list_at(deep, x, y);
            place = neighbour_place(deep, &here, place, 0, &next, depth);
            here = next;
            sum += list_value(deep, &here, place, depth);
        }
        if (y + 1 >= w->y1) {
            return sum;
        }
        const struct list above = list_at(deep, w->x0, y + 1);
        row_place = neighbour_place(deep, &row, row_place, 1, &above, depth);
        row = above;
    }
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
    const int64_t inside = (w.x1 - w.x0) * (w.y1 - w.y0);
    const double lit = (double)(taps * taps - inside); /* beyond the border nothing casts */
    return (window_sum(deep, &w, depth) + lit) / (double)(taps * taps);
}

static enum umb_status deep_check(const struct umb_map_settings *settings, struct umb_error *error)
{
    (void)settings;
    return umb_fail(error, UMB_E_UNSUPPORTED,
                    "settings.technique: deep maps are built by umb_map_build_deep");
}

static double deep_slack(const struct umb_map *map)
{
    return map->deep->settings.epsilon + 0x1p-24;
}

const struct umb__technique umb__map_deep = {
    .name = "deep",
    .bound = UMB_MAP_EXACT,
    .check = deep_check,
    .answer = deep_answer,
    .slack = deep_slack,
};
