/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Stand-ins for the allocator's functions (inject.c says when they fail). The work is glibc's,
 * under the second names that it keeps for this, so free and malloc_usable_size need no stand-in.
 */
#define _GNU_SOURCE
#include "inject.h"

#include <errno.h>
#include <stdlib.h>

/* glibc's own names of the allocator. */
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *block, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

EXPORT void *malloc(size_t size)
{
    return fault_memory(MALLOC) ? NULL : __libc_malloc(size);
}

EXPORT void *calloc(size_t count, size_t size)
{
    return fault_memory(CALLOC) ? NULL : __libc_calloc(count, size);
}

/* A realloc to nothing frees: that never fails. */
EXPORT void *realloc(void *block, size_t size)
{
    if ((block == NULL || size > 0) && fault_memory(REALLOC)) {
        return NULL;
    }
    return __libc_realloc(block, size);
}

EXPORT void *aligned_alloc(size_t alignment, size_t size)
{
    return fault_memory(ALIGNED_ALLOC) ? NULL : __libc_memalign(alignment, size);
}

EXPORT int posix_memalign(void **block, size_t alignment, size_t size)
{
    if (alignment < sizeof(void *) || (alignment & (alignment - 1)) != 0) {
        return EINVAL;
    }
    void *made = fault_memory(POSIX_MEMALIGN) ? NULL : __libc_memalign(alignment, size);
    if (made == NULL) {
        return ENOMEM;
    }
    *block = made;
    return 0;
}
