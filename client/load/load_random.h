/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOAD_LOAD_RANDOM_H
#define UMBRAGE_LOAD_LOAD_RANDOM_H
/* Random numbers of load tests: the same from the same seed, everywhere. One owner a state. */
#include <stdint.h>

/* Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014. */
static inline uint64_t umbc_random(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
}

/* Uniform in [low, high). */
static inline double umbc_random_within(uint64_t *state, double low, double high)
{
    double share = (double)(umbc_random(state) >> 11) * 0x1p-53;
    return low * (1 - share) + high * share;
}

#endif
