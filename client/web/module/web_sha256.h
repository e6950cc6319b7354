/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_WEB_SHA256_H
#define UMBRAGE_WEB_WEB_SHA256_H
/*
 * SHA-256 (FIPS 180-4) for the WebAssembly module. The browser's crypto.subtle is asynchronous and
 * exists only on secure pages; the module verifies a page in the same call that adds the page.
 */
#include "umbrage/file.h"

/* Returns the hash, which has no state. */
const struct umb_sha256 *umbx_sha256(void);

#endif
