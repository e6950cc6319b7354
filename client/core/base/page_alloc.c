/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An allocator for arrays that grow to gigabytes; see page_alloc.h. The cache line before every
 * block records how the block was allocated.
 *
 * The kernel moves a whole large page at once if old and new address are both multiples of its
 * size. So the new address space is reserved with a surplus of one large page, and the surplus on
 * both sides is then returned.
 */
#define _GNU_SOURCE /* For mremap and madvise, which POSIX does not have */
#include "base/page_alloc.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define LARGE_PAGE ((size_t)2 << 20)

/* The cache line before a block. */
struct header {
    size_t mapped; /* Length of the mapping, from the header on; 0: malloc */
    size_t asked;  /* Bytes of the block */
    unsigned char rest[64 - 2 * sizeof(size_t)];
};

static struct header *header_of(void *block)
{
    return (struct header *)block - 1;
}

/* Resizes a block of malloc. In: header: of the block, or NULL. */
static void *small_resize(struct header *header, size_t bytes)
{
    header = bytes > SIZE_MAX - sizeof *header ? NULL : realloc(header, sizeof *header + bytes);
    if (header == NULL) {
        return NULL;
    }
    *header = (struct header){.asked = bytes};
    return header + 1;
}

/* Returns the bytes of the whole large pages that a block takes; 0 if the sum overflows. */
static size_t mapping_bytes(size_t bytes)
{
    return bytes > SIZE_MAX / 2
               ? 0
               : (bytes + sizeof(struct header) + LARGE_PAGE - 1) & ~(LARGE_PAGE - 1);
}

/* Reserves `bytes` of address space that begin at a large page; NULL if there is none. */
static void *space_take(size_t bytes, int protection)
{
    const int flags = MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE;
    unsigned char *space = mmap(NULL, bytes + LARGE_PAGE, protection, flags, -1, 0);
    if (space == MAP_FAILED) {
        return NULL;
    }
    const size_t before = (size_t)(-(uintptr_t)space & (LARGE_PAGE - 1));
    if (before > 0) {
        (void)munmap(space, before);
    }
    (void)munmap(space + before + bytes, LARGE_PAGE - before);
    return space + before;
}

static void *map_new(size_t bytes)
{
    const size_t mapped = mapping_bytes(bytes);
    struct header *header = mapped == 0 ? NULL : space_take(mapped, PROT_READ | PROT_WRITE);
    if (header == NULL) {
        return NULL;
    }
    (void)madvise(header, mapped, MADV_HUGEPAGE);
    *header = (struct header){.mapped = mapped, .asked = bytes};
    return header + 1;
}

/* Resizes a mapping to more or fewer pages. */
static void *map_resize(struct header *header, size_t bytes)
{
    const size_t old = header->mapped, mapped = mapping_bytes(bytes);
    if (mapped == 0) {
        return NULL;
    }
    void *moved = mapped == old ? header : mremap(header, old, mapped, 0);
    if (moved == MAP_FAILED) {
        void *space = space_take(mapped, PROT_NONE);
        if (space == NULL) {
            return NULL;
        }
        moved = mremap(header, old, mapped, MREMAP_MAYMOVE | MREMAP_FIXED, space);
        if (moved == MAP_FAILED) {
            /* The new address space is not unmapped: kernels mostly unmap it themselves before they
             * find out that memory is short, and another thread may use these addresses by now. If
             * the kernel refused because a process has too many mappings, the addresses stay
             * reserved, without memory. */
            return NULL;
        }
    }
    header = moved;
    *header = (struct header){.mapped = mapped, .asked = bytes};
    return header + 1;
}

static void *resize(void *user, void *block, size_t bytes)
{
    (void)user;
    struct header *header = block == NULL ? NULL : header_of(block);
    const size_t mapped = header == NULL ? 0 : header->mapped;
    if (bytes == 0) {
        if (mapped > 0) {
            (void)munmap(header, mapped);
        } else {
            free(header);
        }
        return NULL;
    }
    if (mapped > 0) {
        return map_resize(header, bytes);
    }
    if (bytes < UMB__PAGE_ALLOC_LARGE) {
        return small_resize(header, bytes);
    }
    void *larger = map_new(bytes);
    if (larger != NULL && header != NULL) {
        memcpy(larger, block, header->asked); /* The old block is smaller */
        free(header);
    }
    return larger;
}

const struct umb_alloc umb__page_alloc = {resize, NULL};
