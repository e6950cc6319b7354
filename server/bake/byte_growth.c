/* SPDX-License-Identifier: Apache-2.0 */
/*
 * See byte_growth.h. The constants were fitted to 96 bakes of 50 scenes at 8192 and 16384 voxels
 * (docs/results/effects.md).
 */
#include "bake/byte_growth.h"

#include <math.h>
#include <string.h>

#include "format/content.h"

/* Share of a level's last change of growth that goes on. */
#define GROWTH_TREND 0.3
/* Weight of a level's own growth beside that of the level below. */
#define GROWTH_OWN 0.3
#define GROWTH_MIN 1.0
#define GROWTH_MAX 4.0 /* areas */

/* The density is the number of packed bytes for each estimated byte of nodes. DENSITY_TREND: share
 * of its last change that continues at each doubling. REFERENCES: growth of the density when the
 * bytes of copies grow by the factor e, because references to shared nodes take bytes. */
#define DENSITY_TREND 0.8
#define DENSITY_MIN   0.4
#define REFERENCES    0.06

/* Limit of the growth of the bytes that copies of nodes would add, and the share of that growth
 * that continues at each doubling. */
#define COPIES_GROWTH_MAX   3.0
#define COPIES_GROWTH_TREND 0.7
/* Factor by which the forecast of copies may be wrong, as a logarithm. */
#define COPIES_DOUBT 0.7

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

/* Returns the factor by which copies of shared nodes would enlarge the lowest levels' bytes after
 * some doublings. */
static double copies_after(const struct umbb_growth_samples *samples, uint32_t doublings)
{
    const double now = last_of(samples)->copies - 1.0, before = before_of(samples)->copies - 1.0;
    double growth = fmin(fmax(now / fmax(before, 0.03), 1.0), COPIES_GROWTH_MAX), copies = now;
    for (uint32_t i = 0; i < doublings; i++) {
        copies *= growth;
        growth = 1.0 + (growth - 1.0) * COPIES_GROWTH_TREND;
    }
    return 1.0 + copies;
}

/* Packed bytes without copies, of the open rule. */
static double bytes_without_copies(const struct umbb_growth_samples *samples, uint32_t doublings)
{
    const struct umbb_costs *now = last_of(samples), *before = before_of(samples);
    const double density = now->once_bytes / umbb_level_bytes_sum(now);
    double sum = density + REFERENCES * log(copies_after(samples, doublings) / now->copies);
    double trend = density - before->once_bytes / umbb_level_bytes_sum(before) -
                   REFERENCES * log(now->copies / before->copies);
    for (uint32_t i = 0; i < doublings; i++) {
        trend *= DENSITY_TREND;
        sum += trend;
    }
    return level_bytes(samples, doublings) * fmax(sum, DENSITY_MIN);
}

/* Returns the bytes of a file whose pages repeat nodes of other pages, from its bytes without such
 * copies. Copies do not count if the file surely has none, and count half if that is uncertain. */
static double with_copies(const struct umbb_growth_samples *samples, uint32_t doublings,
                          double bytes)
{
    const struct umbb_costs *now = last_of(samples);
    const double copies = copies_after(samples, doublings);
    if (now->copies > UMB__COPIES_MAX) {
        return bytes;
    }
    double slope = 0.2; /* share of the copies that compression leaves */
    if (now->copies > 1.05) {
        slope = (now->packed_bytes / now->once_bytes - 1.0) / (now->copies - 1.0);
        slope = fmin(fmax(slope, 0.0), 0.6);
    }
    const double doubt = log(fmax(copies - 1.0, 1e-3) / (UMB__COPIES_MAX - 1.0)) / COPIES_DOUBT;
    const double likely = fmin(fmax(0.5 * (1.0 - doubt), 0.0), 1.0);
    return bytes * (1.0 + likely * slope * (fmin(copies, UMB__COPIES_MAX) - 1.0));
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

double umbb_growth_packed_alone(const struct umbb_growth_samples *samples, uint32_t doublings)
{
    return with_copies(samples, doublings, bytes_without_copies(samples, doublings));
}

struct umbb_rule_bytes umbb_growth_packed(const struct umbb_growth_samples *open,
                                          const struct umbb_growth_samples *closed,
                                          uint32_t doublings)
{
    const double bytes = bytes_without_copies(open, doublings);
    const double ratio =
        ratio_after(before_of(closed)->once_bytes / before_of(open)->once_bytes,
                    last_of(closed)->once_bytes / last_of(open)->once_bytes, doublings);
    return (struct umbb_rule_bytes){with_copies(open, doublings, bytes),
                                    with_copies(closed, doublings, bytes * ratio)};
}
