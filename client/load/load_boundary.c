/* SPDX-License-Identifier: Apache-2.0 */
/* Shadow boundaries by halving segments, see load_boundary.h. */
#include "load/load_boundary.h"

#include <stdlib.h>
#include <string.h>
#include "load/load_random.h"
#include "tool/tool_try.h"

#define HALVINGS 14
#define BLOCK    16384U /* segments at a time, and points in a call */
#define BLOCKS   8      /* most blocks of segments */

/* Segments whose first end is lit and whose second is not. */
struct hunt {
    struct umb_client *client;
    const struct umbc_load_source *source;
    const struct umbc_load_pool *pool;
    float *lit, *dark, *middle; /* [3 * BLOCK], relative to the pool's origin */
    uint8_t *of_lit, *of_dark;  /* [BLOCK] answers */
};

static enum umb_status ask(const struct hunt *hunt, const float *positions, uint8_t *answers,
                           struct umb_error *error)
{
    struct umb_client_query_request request = {
        .asset = hunt->source->asset,
        .settings = {.light = hunt->source->light,
                     .taps = 1,
                     .bias_mode = UMB_BIAS_NONE,
                     .format = UMB_ANSWER_U8},
        .points = {.positions = positions, .format = UMB_POINT_F32, .count = BLOCK},
    };
    memcpy(request.points.origin, hunt->pool->origin, sizeof request.points.origin);
    return umb_client_query(hunt->client, &request, answers, NULL, error);
}

static void draw(const struct hunt *hunt, const struct umb_box *bounds, uint64_t *seed, float *to)
{
    for (size_t i = 0; i < 3 * (size_t)BLOCK; i++) {
        size_t axis = i % 3;
        double at = umbc_random_within(seed, bounds->min[axis], bounds->max[axis]);
        to[i] = (float)(at - hunt->pool->origin[axis]);
    }
}

static void swap_point(float *a, float *b)
{
    float kept[3];
    memcpy(kept, a, sizeof kept);
    memcpy(a, b, sizeof kept);
    memcpy(b, kept, sizeof kept);
}

/* Keeps the segments that cross a boundary, lit end first. Returns their number. */
static size_t keep_crossing(const struct hunt *hunt)
{
    size_t kept = 0;
    for (size_t i = 0; i < BLOCK; i++) {
        bool first = hunt->of_lit[i] > 127;
        bool second = hunt->of_dark[i] > 127;
        if (first == second) {
            continue;
        }
        if (second) {
            swap_point(hunt->lit + 3 * i, hunt->dark + 3 * i);
        }
        memmove(hunt->lit + 3 * kept, hunt->lit + 3 * i, 3 * sizeof(float));
        memmove(hunt->dark + 3 * kept, hunt->dark + 3 * i, 3 * sizeof(float));
        kept++;
    }
    return kept;
}

static enum umb_status halve(const struct hunt *hunt, size_t count, struct umb_error *error)
{
    for (int round = 0; round < HALVINGS; round++) {
        for (size_t i = 0; i < 3 * count; i++) {
            hunt->middle[i] = 0.5F * hunt->lit[i] + 0.5F * hunt->dark[i];
        }
        UMB__TRY(ask(hunt, hunt->middle, hunt->of_lit, error));
        for (size_t i = 0; i < count; i++) {
            float *end = hunt->of_lit[i] > 127 ? hunt->lit : hunt->dark;
            memcpy(end + 3 * i, hunt->middle + 3 * i, 3 * sizeof(float));
        }
    }
    return UMB_OK;
}

/* Fills the pool. Out: found: number of different points. */
static enum umb_status fill(const struct hunt *hunt, const struct umb_box *bounds, float *positions,
                            size_t *found, struct umb_error *error)
{
    size_t wanted = hunt->pool->batch * hunt->pool->batch_count;
    uint64_t seed = hunt->source->seed;
    *found = 0;
    for (int block = 0; block < BLOCKS && *found < wanted; block++) {
        draw(hunt, bounds, &seed, hunt->lit);
        draw(hunt, bounds, &seed, hunt->dark);
        UMB__TRY(ask(hunt, hunt->lit, hunt->of_lit, error));
        UMB__TRY(ask(hunt, hunt->dark, hunt->of_dark, error));
        const size_t count = keep_crossing(hunt);
        UMB__TRY(halve(hunt, count, error));
        size_t taken = count < wanted - *found ? count : wanted - *found;
        memcpy(positions + 3 * *found, hunt->lit, 3 * taken * sizeof(float));
        *found += taken;
    }
    return *found * 1000 < (size_t)BLOCK * BLOCKS && *found < wanted
               ? umb_fail(error, UMB_E_NOT_FOUND,
                          "boundary: only %zu of %u random segments cross a shadow boundary; use "
                          "--points random",
                          *found, BLOCK * BLOCKS)
               : UMB_OK;
}

enum umb_status umbc_load_find_boundaries(struct umb_client *client,
                                          const struct umbc_load_source *source,
                                          const struct umb_box *bounds, struct umbc_load_pool *pool,
                                          struct umb_error *error)
{
    size_t found = 0;
    struct hunt hunt = {.client = client, .source = source, .pool = pool};
    hunt.lit = calloc(9 * (size_t)BLOCK, sizeof *hunt.lit);
    hunt.of_lit = calloc(2 * (size_t)BLOCK, 1);
    enum umb_status status = UMB_E_NO_MEMORY;
    if (hunt.lit != NULL && hunt.of_lit != NULL) {
        hunt.dark = hunt.lit + 3 * (size_t)BLOCK;
        hunt.middle = hunt.dark + 3 * (size_t)BLOCK;
        hunt.of_dark = hunt.of_lit + BLOCK;
        status = fill(&hunt, bounds, pool->positions, &found, error);
    } else {
        (void)umb_fail(error, status, "out of memory for the borders of shadows");
    }
    /* Repeats the points if there are fewer than wanted. */
    for (size_t i = found; status == UMB_OK && i < pool->batch * pool->batch_count; i++) {
        memcpy(pool->positions + 3 * i, pool->positions + 3 * (i - found), 3 * sizeof(float));
    }
    free(hunt.lit);
    free(hunt.of_lit);
    return status;
}
