/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ALLOC_H
#define UMBRAGE_ALLOC_H
/*
 * The allocator that opening and building take; queries allocate nothing.
 *
 * A NULL allocator means malloc, realloc and free. Passing one's own is how a host bounds memory,
 * and how the tests make the n-th allocation fail. zstd's working memory, a few MiB while a packed
 * file is opened or written, comes from malloc all the same.
 * Threads: an asset uses its allocator while it is opened, exported, calibrated (umbrage/curve.h)
 * and closed only. Who calibrates on several threads at once passes one that takes that.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_alloc {
    /* realloc semantics: (NULL, n) allocates, (p, 0) frees and returns NULL, NULL on failure with
     * the old block left alone. Alignment as malloc's. Called from the thread that called us. */
    void *(*resize)(void *user, void *block, size_t bytes);
    void *user; /* handed back unchanged */
};

/* Frees a block that an umbrage function handed over and says to free so: lists, descriptions,
 * files in memory. NULL is allowed. */
UMB_API void umb_free(void *block);

#ifdef __cplusplus
}
#endif
#endif
