/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See byte_growth.h. The constants of nodes were fitted to 96 bakes of 50 scenes, those of pages to
 * 88 bakes of 44 scenes (docs/results/effects.md).
 */
#include "bake/byte_growth.h"

#include <math.h>
#include <string.h>

#include "format/content.h"
#include "format/layout.h"

/* Share of a level's last change of growth that goes on. */
#define GROWTH_TREND 0.3
/* Weight of a level's own growth beside that of the level below. */
#define GROWTH_OWN 0.3
#define GROWTH_MIN 1.0
#define GROWTH_MAX 4.0 /* areas */

/* The density is the number of bytes of the file for each estimated byte in pages. Share of its
 * last change that continues at each doubling. */
#define DENSITY_TREND 0.8

/* Small pages: growth of the logarithm of the copies with each doubling, as a share of the last
 * growth and of the last fall of the density. Nodes that compress better and better repeat
 * themselves, so pages share more of them. */
#define COPIES_TREND 0.75
#define COPIES_FALL  1.3
/* Logarithm of the factor around UMB__PAGE_COPIES_MAX within which either size of pages is likely.
 * The forecast is then between the two. */
#define COPIES_BAND 0.2

/* Factors between a forecast and the bytes, in tenths: at one doubling, and for each further one.
 * With two samples: a factor for each doubling. */
#define FACTOR_FIRST 14
#define FACTOR_NEXT  2
#define FACTOR_FEW   1.7

/* Limit of the growth of the ratio of bytes, closed rule to open rule, in a doubling. The closed
 * rule saves about the same share or more at each doubling. */
#define RATIO_RISE_MAX 1.05

/* Estimated bytes of each level at three resolutions, each twice the one before: a, b and c. Levels
 * that a resolution lacks have 0. */
struct levels {
    double a[UMB_LEVEL_MAX + 2], b[UMB_LEVEL_MAX + 2], c[UMB_LEVEL_MAX + 2];
};

static const struct umbb_costs *last_of(const struct umbb_growth_samples *samples)
{
    return &samples->costs[samples->count - 1];
}

static const struct umbb_costs *before_of(const struct umbb_growth_samples *samples)
{
    return &samples->costs[samples->count - 2];
}

/* Computes the factors by which a level grew: growth[1] over the last doubling, growth[0] over the
 * one before. If that is unknown, both are equal. */
static void growth_of(const struct levels *levels, uint32_t level, double growth[2])
{
    growth[1] = levels->c[level] / levels->b[level];
    growth[0] = levels->a[level] > 0.0 ? levels->b[level] / levels->a[level] : growth[1];
}

/* Bytes of a level after the next doubling. */
static double next_of(const struct levels *levels, uint32_t level)
{
    double own[2], below[2];
    if (!(levels->b[level] > 0.0) || !(levels->c[level] > 0.0)) {
        return levels->c[level - 1]; /* near the root, nodes of the level below move up */
    }
    growth_of(levels, level, own);
    double growth = own[1] + GROWTH_TREND * (own[1] - own[0]);
    if (level > UMB_LEVEL_BRICK) {
        growth_of(levels, level - 1, below);
        growth = GROWTH_OWN * growth + (1.0 - GROWTH_OWN) * (below[1] + own[1] - below[0]);
    }
    return levels->c[level] * fmin(fmax(growth, GROWTH_MIN), GROWTH_MAX);
}

/* Sum of the estimated bytes of all levels after some doublings. */
static double level_bytes(const struct umbb_growth_samples *samples, uint32_t doublings)
{
    struct levels levels = {.a = {0.0}};
    double sum = 0.0;
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        levels.a[level] = samples->count > 2 ? samples->costs[0].level_bytes[level] : 0.0;
        levels.b[level] = before_of(samples)->level_bytes[level];
        levels.c[level] = last_of(samples)->level_bytes[level];
    }
    for (uint32_t i = 0; i < doublings; i++) {
        struct levels next = {.a = {0.0}};
        memcpy(next.a, levels.b, sizeof next.a);
        memcpy(next.b, levels.c, sizeof next.b);
        for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
            next.c[level] = next_of(&levels, level);
        }
        levels = next;
    }
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        sum += levels.c[level];
    }
    return sum;
}

double umbb_level_bytes_sum(const struct umbb_costs *costs)
{
    double sum = 0.0;
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        sum += costs->level_bytes[level];
    }
    return fmax(sum, 1.0);
}

/* Pages of one size at the last two samples. */
struct pages {
    struct umbb_page_costs before, now;
    double density, change; /* density of the last sample; its factor over the last doubling */
};

static struct pages pages_of(const struct umbb_growth_samples *samples, int large)
{
    const struct umbb_costs *now = last_of(samples), *before = before_of(samples);
    struct pages pages = {.before = large ? before->large_pages : before->small_pages,
                          .now = large ? now->large_pages : now->small_pages};
    if (pages.now.bytes > 0.0 && pages.before.bytes > 0.0) {
        const double old =
            pages.before.bytes / (pages.before.copies * umbb_level_bytes_sum(before));
        pages.density = pages.now.bytes / (pages.now.copies * umbb_level_bytes_sum(now));
        pages.change = pages.density / old;
    }
    return pages;
}

/* Bytes of a file in pages of one size, for its bytes of nodes. */
static double file_bytes(const struct pages *pages, double nodes, uint32_t doublings)
{
    double copies = pages->now.copies, density = pages->density, trend = 1.0;
    for (uint32_t i = 0; i < doublings; i++) {
        trend *= DENSITY_TREND;
        copies *= pages->now.copies / pages->before.copies;
        density *= pow(pages->change, trend);
    }
    return nodes * copies * density;
}

/* Share of large pages in the forecast: 0 or 1 where the size of the pages is certain. */
static double large_share(const struct pages *small, uint32_t doublings)
{
    if (!(small->density > 0.0)) {
        return 1.0;
    }
    const double growth = COPIES_TREND * log(small->now.copies / small->before.copies) -
                          COPIES_FALL * log(small->change);
    const double copies =
        log(small->now.copies / UMB__PAGE_COPIES_MAX) + fmax(0.0, growth * doublings);
    return fmin(fmax(0.5 + copies / (2.0 * COPIES_BAND), 0.0), 1.0);
}

/* Continues the ratio of closed to open bytes. */
static double ratio_after(double before, double now, uint32_t doublings)
{
    const double growth = now / before;
    for (uint32_t i = 0; i < doublings; i++) {
        now *= growth < RATIO_RISE_MAX ? growth : RATIO_RISE_MAX;
    }
    return now;
}

struct umbb_rule_bytes umbb_growth_nodes(const struct umbb_growth_samples *open,
                                         const struct umbb_growth_samples *closed,
                                         uint32_t doublings)
{
    const double now = umbb_level_bytes_sum(last_of(closed)) / umbb_level_bytes_sum(last_of(open));
    const double before =
        umbb_level_bytes_sum(before_of(closed)) / umbb_level_bytes_sum(before_of(open));
    const double bytes = level_bytes(open, doublings);
    return (struct umbb_rule_bytes){bytes, bytes * ratio_after(before, now, doublings)};
}

double umbb_growth_packed(const struct umbb_growth_samples *samples, uint32_t doublings)
{
    const double nodes = level_bytes(samples, doublings);
    const struct pages small = pages_of(samples, 0), large = pages_of(samples, 1);
    const double share = large_share(&small, doublings);
    const double in_large = file_bytes(&large, nodes, doublings);
    if (share >= 1.0) {
        return in_large;
    }
    const double in_small = fmax(file_bytes(&small, nodes, doublings), in_large);
    return in_small * pow(in_large / in_small, share);
}

double umbb_growth_packed_factor(uint32_t samples, uint32_t doublings)
{
    if (doublings == 0) {
        return 1.0;
    }
    return samples > 2 ? (FACTOR_FIRST + FACTOR_NEXT * (doublings - 1)) / 10.0
                       : pow(FACTOR_FEW, doublings);
}
