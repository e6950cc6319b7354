/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_LANES_H
#define UMBRAGE_SERVER_COMMON_SHA256_LANES_H
/*
 * SHA-256 of many messages at once, one in each lane of the vector registers. Intel's Multi-Buffer
 * Crypto library (libipsec-mb, BSD-3-Clause) does the work, if the build has it. The steps of one
 * message depend on one another, so sixteen messages side by side take little longer than one.
 *
 *     struct umbs_sha256_lanes *lanes = umbs_sha256_lanes_create(NULL);
 *     made = lanes != NULL && umbs_sha256_lanes_digest(lanes, messages, sizes, count, digests);
 *     umbs_sha256_lanes_destroy(lanes);
 *
 * The library detects the processor's features itself and makes no system calls. Threads: one at a
 * time.
 */
#include <stdbool.h>
#include "format/content.h"

struct umbs_sha256_lanes; /* opaque, 200 KB */

/*
 * Makes lanes. In: alloc: allocator; NULL for malloc. Returns NULL if memory is short, or if the
 * build has no such library.
 * Cost:  most of a millisecond, because the library tests itself.
 */
struct umbs_sha256_lanes *umbs_sha256_lanes_create(const struct umb_alloc *alloc);

/* Most bytes of a message: the library counts a lane's bytes in 16 bits. */
#define UMBS_SHA256_LANES_LONGEST ((size_t)65534)

/*
 * Hashes `count` messages.
 *
 * In:    messages: [count]. sizes: [count] bytes of each; similar sizes are fastest.
 * Out:   digests: [count]; those of messages that are too long are left unchanged. Returns false if
 *        the library failed on any other message; then discard all digests.
 * Cost:  allocates nothing.
 */
bool umbs_sha256_lanes_digest(struct umbs_sha256_lanes *lanes, const uint8_t *const *messages,
                              const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES]);

/* Frees the lanes. NULL is allowed. */
void umbs_sha256_lanes_destroy(struct umbs_sha256_lanes *lanes);

#endif
