/* SPDX-License-Identifier: Apache-2.0 */
/* Answers several lights for each point: block by block of points, light by light. */
#include "umbrage/query.h"

/* Points a block: 12 KiB as doubles and 6 KiB of normals stay in half of an L1 cache. */
#define BLOCK 512

void umb_query_run_lights(const struct umb_query *queries, size_t query_count,
                          const struct umb_points *points, size_t first, size_t count,
                          struct umb_light_answers *answers)
{
    for (size_t done = 0; done < count; done += BLOCK) {
        size_t block = count - done < BLOCK ? count - done : BLOCK;
        for (size_t k = 0; k < query_count; k++) {
            struct umb_answers one = {.values = answers->values[k], .stats = answers->stats[k]};
            umb_query_run(&queries[k], points, first + done, block, &one);
            answers->stats[k] = one.stats;
        }
    }
}
