/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_LANES_H
#define UMBRAGE_SERVER_COMMON_SHA256_LANES_H
/*
 * SHA-256 of many messages at once, one in each lane of a vector register. One message is a chain
 * of dependent steps, so that a processor without instructions for SHA takes some 6 cycles a byte;
 * sixteen side by side take about one.
 *
 *     umbs_sha256_lanes_fn lanes = umbs_sha256_lanes_avx512();     NULL: not on this machine
 *     lanes(messages, sizes, count, digests);
 *
 * Source: FIPS 180-4, section 6.2.
 */
#include <stddef.h>
#include <stdint.h>

/*
 * In:  messages, sizes: [count] bytes and how many they are; of any lengths, best of like ones.
 * Out: digests: [count][32].
 * Threads: any number. Cost: allocates nothing, cannot fail.
 */
typedef void (*umbs_sha256_lanes_fn)(const uint8_t *const *messages, const size_t *sizes,
                                     size_t count, uint8_t (*digests)[32]);

umbs_sha256_lanes_fn umbs_sha256_lanes_avx512(void);

#endif
