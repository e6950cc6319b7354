/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_ALLOC_H
#define UMBRAGE_ALLOC_H
/*
 * The allocator for opening and building. Queries allocate nothing.
 *
 * A NULL allocator means malloc, realloc and free. A program passes an allocator of its own to
 * bound memory, or to test what happens when an allocation fails. zstd's working memory, a few MiB
 * while a packed file is opened or written, always comes from malloc.
 * Threads: an asset uses its allocator only while it is opened, exported, calibrated
 * (umbrage/curve.h) and closed. If you calibrate from several threads at once, the allocator must
 * be thread-safe.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct umb_alloc {
    /* Works as realloc: (NULL, n) allocates; (p, 0) frees and returns NULL; NULL means failure,
     * with the old block unchanged. Blocks are aligned as by malloc. Runs on the thread that calls
     * the library. */
    void *(*resize)(void *user, void *block, size_t bytes);
    void *user; /* First argument of `resize` */
};

/* Frees a list, a description or a file in memory that a function returned; the function's
 * description names umb_free. NULL is allowed. */
UMB_API void umb_free(void *block);

#ifdef __cplusplus
}
#endif
#endif
