/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_WEB_SHA256_H
#define UMBRAGE_WEB_WEB_SHA256_H
/*
 * SHA-256 (FIPS 180-4) for the WebAssembly module. The browser's own, crypto.subtle, answers later
 * and only on secure pages; a page is proven in one step with its use.
 */
#include "umbrage/file.h"

/* Returns the hash, which has no state. */
const struct umb_sha256 *umbx_sha256(void);

#endif
