/* SPDX-License-Identifier: Apache-2.0 */
/* Best-candidate points; see map_poisson.h. */
#include "maps/map_poisson.h"

/* SplitMix64 (Steele, Lea, Flood 2014). */
static uint64_t next(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

/* Uniform in [-1, 1). */
static double signed_unit(uint64_t *state)
{
    return (double)(next(state) >> 11) * 0x1p-52 - 1.0;
}

/* Returns the squared distance to the nearest of the points so far. */
static double nearest(double (*points)[2], uint32_t count, const double at[2])
{
    double least = 8.0;
    for (uint32_t i = 0; i < count; i++) {
        const double dx = points[i][0] - at[0], dy = points[i][1] - at[1];
        const double square = dx * dx + dy * dy;
        least = square < least ? square : least;
    }
    return least;
}

void umb__poisson_disc(double (*points)[2], uint32_t count)
{
    uint64_t state = 20140704;
    for (uint32_t i = 0; i < count; i++) {
        double best = -1.0;
        for (uint32_t candidates = 0; candidates < 8 * i + 8;) {
            double at[2];
            at[0] = signed_unit(&state);
            at[1] = signed_unit(&state);
            if (at[0] * at[0] + at[1] * at[1] > 1.0) {
                continue; /* Ends: pi/4 of all candidates lie inside */
            }
            const double distance = nearest(points, i, at);
            if (distance > best) {
                best = distance;
                points[i][0] = at[0];
                points[i][1] = at[1];
            }
            candidates++;
        }
    }
}
