/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_SHA256_H
#define UMBRAGE_SERVER_COMMON_SHA256_H
/* SHA-256 from OpenSSL in the shape the core asks for. */
#include "format/content.h"

/* A hasher without state; may be used from any thread. */
extern const struct umb_sha256 umbs_sha256;

/* Digest of one buffer. */
void umbs_sha256_bytes(const void *bytes, size_t size, uint8_t out[UMB_ID_BYTES]);

#endif
