/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_H
#define UMBRAGE_SERVER_COMMON_SHA256_H
/* SHA-256 in the shape the core asks for: OpenSSL's; many messages at once in lanes. */
#include "format/content.h"

/* May be used from any thread. Digests cannot fail. */
extern const struct umb_sha256 umbs_sha256;

/* Digest of one buffer. */
void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES]);

#endif
