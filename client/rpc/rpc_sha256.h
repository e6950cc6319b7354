/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_RPC_RPC_SHA256_H
#define UMBRAGE_RPC_RPC_SHA256_H
/* SHA-256 from OpenSSL in the shape the core asks for; for the client's side of a proof. */
#include "format/content.h"

/* A hasher without state; may be used from any thread. */
extern const struct umb_sha256 umb__client_sha256;

#endif
