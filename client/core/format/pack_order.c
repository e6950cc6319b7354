/* SPDX-License-Identifier: Apache-2.0 */
/* The order of a packed file's nodes; see pack_order.h. */
#include "format/pack_order.h"

#include <string.h>

#include "base/memory.h"

bool umb__pack_grow_pages(struct umb__pack_order *order, size_t needed)
{
    size_t capacity = order->page_capacity;
    bool complete = true;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX && complete; level++) {
        capacity = order->page_capacity;
        complete = umb__grow(order->alloc, &order->begins[level], &capacity, needed,
                             sizeof *order->begins[level]);
    }
    order->page_capacity = complete ? capacity : order->page_capacity;
    return complete;
}

struct umb__node_place umb__pack_place(const struct umb__pack_order *order, uint32_t level,
                                       uint32_t ordinal)
{
    const uint32_t *hint = order->hints[level] + ordinal / UMB__PACK_HINT;
    uint32_t low = hint[0], high = hint[1];
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (order->begins[level][middle + 1] <= ordinal) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (struct umb__node_place){low, ordinal - order->begins[level][low]};
}

void umb__pack_order_finish(struct umb__pack_order *order)
{
    for (size_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umb__free(order->alloc, order->nodes[level]);
        umb__free(order->alloc, order->ordinals[level]);
        umb__free(order->alloc, order->begins[level]);
        umb__free(order->alloc, order->hints[level]);
    }
    memset(order, 0, sizeof *order);
}
