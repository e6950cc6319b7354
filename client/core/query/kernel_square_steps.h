/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_H
#define UMBRAGE_CORE_QUERY_KERNEL_SQUARE_STEPS_H
/* Steps of kernel_squares_body.h, in C. Other files have them hand-written with vector
 * instructions. */
#include "query/kernel_parts.h"
#include "query/receivers.h"

#define UMB__SAMPLES 64U /* Samples of a point */

/* Voxels of the samples of a point. Samples outside the frustum have any voxel. */
struct umb__samples {
    _Alignas(64) int32_t x[UMB__SAMPLES];
    int32_t y[UMB__SAMPLES];
    int32_t z[UMB__SAMPLES];
    uint16_t low[3][UMB__SAMPLES]; /* Low 16 bits of x, y and z; only with AVX-512 */
};

/* Only with AVX-512: places of the samples in the slices of their bricks, as a word of 16 bits and
 * the bit in that word. */
struct umb__slice_places {
    _Alignas(64) uint16_t word[UMB__SAMPLES];
    uint16_t bit[UMB__SAMPLES];
};

/* Positions of the samples along the edges of their square, by axis: umb__square_place. */
#define UMB__PLACED(i) (((double)(i) + 0.5) / UMB__SQUARE_SAMPLES - 0.5)
#define UMB__EVERY(i)                                                                              \
    UMB__PLACED(i), UMB__PLACED((i) + 1), UMB__PLACED((i) + 2), UMB__PLACED((i) + 3)
#define UMB__ACROSS(i) UMB__PLACED((i)*UMB__SQUARE_STRIDE % UMB__SQUARE_SAMPLES)
#define UMB__EACH(i)                                                                               \
    UMB__ACROSS(i), UMB__ACROSS((i) + 1), UMB__ACROSS((i) + 2), UMB__ACROSS((i) + 3)
static const double umb__lattice[2][UMB__SQUARE_SAMPLES] __attribute__((aligned(64))) = {
    {UMB__EVERY(0), UMB__EVERY(4), UMB__EVERY(8), UMB__EVERY(12), UMB__EVERY(16), UMB__EVERY(20),
     UMB__EVERY(24), UMB__EVERY(28)},
    {UMB__EACH(0), UMB__EACH(4), UMB__EACH(8), UMB__EACH(12), UMB__EACH(16), UMB__EACH(20),
     UMB__EACH(24), UMB__EACH(28)},
};

/* For each sample, the index of the child that contains it, in a node of one level. */
struct umb__child_bytes {
    _Alignas(64) uint8_t of[UMB__SAMPLES];
};

/* Computes the voxels of the samples of receiver `lane`: half of them in its narrow square, half in
 * its wide one. Returns the samples inside the frustum. A sample behind the last voxel in z counts
 * as in it. */
static inline uint64_t umb__place_samples(const struct umb__receivers *r, uint32_t lane,
                                          uint32_t log2_size, struct umb__samples *samples)
{
    const double size = (double)((uint32_t)1 << log2_size);
    uint64_t inside = 0;
    for (uint32_t k = 0; k < UMB__SAMPLES; k++) {
        const uint32_t wide = k / UMB__SQUARE_SAMPLES, i = k % UMB__SQUARE_SAMPLES;
        const double scale = wide ? 1 : 0.5;
        double v[3];
        for (unsigned axis = 0; axis < 3; axis++) {
            const double from_centre = umb__lattice[0][i] * r->edge[0][axis][lane] +
                                       umb__lattice[1][i] * r->edge[1][axis][lane];
            v[axis] = r->centre[wide][axis][lane] + scale * from_centre;
        }
        const bool in = v[0] >= 0 && v[0] < size && v[1] >= 0 && v[1] < size && v[2] >= 0;
        samples->x[k] = in ? (int32_t)v[0] : 0;
        samples->y[k] = in ? (int32_t)v[1] : 0;
        samples->z[k] = in ? (int32_t)(v[2] < size - 1 ? v[2] : size - 1) : 0;
        inside |= (uint64_t)in << k;
    }
    return inside;
}

/* Finds the child of `level` that contains each sample. */
static inline void umb__child_bytes_make(const struct umb__samples *samples, uint32_t level,
                                         struct umb__child_bytes *bytes)
{
    for (uint32_t k = 0; k < UMB__SAMPLES; k++) {
        bytes->of[k] = (uint8_t)umb__child_bit(samples->x[k], samples->y[k], samples->z[k], level);
    }
}

/* Returns the samples among `these` whose children are set in a mask of a node. */
static inline uint64_t umb__children_in(const struct umb__child_bytes *bytes, uint64_t these,
                                        uint64_t mask)
{
    uint64_t in = 0;
    for (uint64_t rest = these; rest; rest &= rest - 1) {
        const uint32_t k = umb__first_bit(rest);
        in |= (mask >> bytes->of[k] & 1) << k;
    }
    return in;
}

/* Returns the samples among `these` that are in child `child`. */
static inline uint64_t umb__samples_in(const struct umb__child_bytes *bytes, uint64_t these,
                                       uint8_t child)
{
    uint64_t in = 0;
    for (uint64_t rest = these; rest; rest &= rest - 1) {
        const uint32_t k = umb__first_bit(rest);
        in |= (uint64_t)(bytes->of[k] == child) << k;
    }
    return in;
}

static inline void umb__slice_places_make(const struct umb__samples *samples,
                                          struct umb__slice_places *places)
{
    (void)samples;
    (void)places;
}

/* Returns the lit samples among `these`, which are all in one brick. */
static inline uint64_t umb__lit_in_brick(const struct umb__samples *samples,
                                         const struct umb__slice_places *places, uint64_t these,
                                         const uint64_t brick[8])
{
    uint64_t lit = 0;
    (void)places;
    for (uint64_t rest = these; rest; rest &= rest - 1) {
        const uint32_t k = umb__first_bit(rest);
        const uint32_t bit = ((uint32_t)samples->x[k] & 7) | ((uint32_t)samples->y[k] & 7) << 3;
        lit |= (brick[samples->z[k] & 7] >> bit & 1) << k;
    }
    return lit;
}

#endif
