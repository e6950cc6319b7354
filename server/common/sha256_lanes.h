/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_LANES_H
#define UMBRAGE_SERVER_COMMON_SHA256_LANES_H
/*
 * SHA-256 of many messages at once, one in each lane of the vector registers, by Intel's
 * Multi-Buffer Crypto library (libipsec-mb, BSD-3-Clause) where the build has it. One message is a
 * chain of dependent steps; sixteen side by side take little longer than one.
 *
 *     struct umbs_sha256_lanes *lanes = umbs_sha256_lanes_create(NULL);
 *     made = lanes != NULL && umbs_sha256_lanes_digest(lanes, messages, sizes, count, digests);
 *     umbs_sha256_lanes_destroy(lanes);
 *
 * The library reads what the processor can and calls no system. Threads: one at a time.
 */
#include <stdbool.h>
#include "format/content.h"

struct umbs_sha256_lanes; /* opaque, 200 KB */

/*
 * In:   alloc: NULL for malloc. Returns NULL if there is no memory, or no library in this build.
 * Cost: most of a millisecond: the library tests itself.
 */
struct umbs_sha256_lanes *umbs_sha256_lanes_create(const struct umb_alloc *alloc);

/* The library takes no longer messages: it counts a lane's bytes in 16 bits. */
#define UMBS_SHA256_LANES_LONGEST ((size_t)65534)

/*
 * In:  messages, sizes: [count] bytes and how many they are; best of like lengths.
 * Out: digests: [count]; those of messages that are too long are left alone.
 * Returns false if the library did not make all others; digests are then of no use.
 * Cost: allocates nothing.
 */
bool umbs_sha256_lanes_digest(struct umbs_sha256_lanes *lanes, const uint8_t *const *messages,
                              const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES]);

/* NULL is allowed. */
void umbs_sha256_lanes_destroy(struct umbs_sha256_lanes *lanes);

#endif
