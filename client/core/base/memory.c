/* SPDX-License-Identifier: Apache-2.0 */
/* Allocation; see memory.h. */
#define _GNU_SOURCE /* For madvise and MADV_HUGEPAGE, which POSIX does not have */
#include "base/memory.h"

#include <stdlib.h>
#include <string.h>
#ifndef __wasi__ /* WebAssembly has no pages to advise */
#include <sys/mman.h>
#endif

#define CACHE_LINE 64U
/* Bytes of a large page on x86-64; other systems round the size or refuse */
#define LARGE_PAGE ((uintptr_t)2 << 20)

void umb_free(void *block)
{
    free(block);
}

void *umb__resize(const struct umb_alloc *alloc, void *block, size_t bytes)
{
    if (alloc) {
        return alloc->resize(alloc->user, block, bytes);
    }
    if (bytes == 0) {
        free(block);
        return NULL;
    }
    return realloc(block, bytes);
}

void *umb__alloc(const struct umb_alloc *alloc, size_t count, size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes)) {
        return NULL;
    }
    return umb__resize(alloc, NULL, bytes ? bytes : 1);
}

/* Advises the system to use large pages for a block. madvise is called only for large pages that
 * lie wholly inside the block, so it never changes another block's memory. */
static void advise_large(void *block, size_t bytes)
{
#ifndef __wasi__
    const uintptr_t first = ((uintptr_t)block + LARGE_PAGE - 1) & ~(LARGE_PAGE - 1);
    const uintptr_t end = ((uintptr_t)block + bytes) & ~(LARGE_PAGE - 1);
    if (first < end) {
        (void)madvise((void *)first, end - first, MADV_HUGEPAGE);
    }
#else
    (void)block;
    (void)bytes;
#endif
}

void *umb__alloc_large(const struct umb_alloc *alloc, size_t count, size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX - LARGE_PAGE) {
        return NULL;
    }
    size_t align = bytes < LARGE_PAGE ? CACHE_LINE : LARGE_PAGE;
    void *block =
        alloc ? umb__alloc(alloc, count, size) : aligned_alloc(align, (bytes / align + 1) * align);
    if (block) {
        advise_large(block, bytes);
    }
    return block;
}

void *umb__alloc_zeroed(const struct umb_alloc *alloc, size_t count, size_t size)
{
    void *block = umb__alloc(alloc, count, size);
    if (block) {
        memset(block, 0, count * size);
    }
    return block;
}

void umb__free(const struct umb_alloc *alloc, void *block)
{
    if (block) {
        (void)umb__resize(alloc, block, 0);
    }
}

bool umb__grow(const struct umb_alloc *alloc, void *array, size_t *capacity, size_t needed,
               size_t size)
{
    if (needed <= *capacity) {
        return true;
    }
    size_t wanted = *capacity < 16 ? 16 : *capacity;
    while (wanted < needed) {
        if (__builtin_mul_overflow(wanted, (size_t)2, &wanted)) {
            return false;
        }
    }
    size_t bytes;
    if (__builtin_mul_overflow(wanted, size, &bytes)) {
        return false;
    }
    void *old;
    memcpy(&old, array, sizeof old);
    void *block = umb__resize(alloc, old, bytes);
    if (!block) {
        return false;
    }
    memcpy(array, &block, sizeof block);
    *capacity = wanted;
    return true;
}
