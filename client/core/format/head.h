/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_HEAD_H
#define UMBRAGE_CORE_FORMAT_HEAD_H
/* The head of a packed or mapped file, its parser and its writer. */
#include "format/content.h"

/* A parsed head; the pointers lead into the file's bytes. */
struct umb__head {
    enum umb_encoding encoding;
    uint64_t file_length;
    uint64_t head_length;
    const uint8_t *canonical;
    uint64_t canonical_length;
    const uint8_t *directory; /* Table of blocks (packed) or sections (mapped) */
    uint32_t directory_count;
    uint32_t page_count;    /* Number of pages of a packed file, else 0 */
    uint32_t first_block;   /* Length in bytes of the first block; 0: no pages */
    uint64_t blocks_offset; /* Offset of the second block of page entries; 0: one block or
                                  none */
    /* The blocks: bytes of the whole file, or the address of each block. Both are NULL from
     * umb__head_parse_front. */
    const uint8_t *file;
    const uint8_t *const *blocks; /* [directory_count] */
    const uint8_t *info;
    uint32_t info_length;
    uint8_t id[UMB_ID_BYTES];
};

/*
 * Parses the head of a whole file. Checks magic, version, lengths against the file's size, reserved
 * fields and the head's checksum.
 * Trust: safe on hostile bytes.
 */
UMB_CHECKED enum umb_status umb__head_parse(const uint8_t *bytes, size_t size,
                                            struct umb__head *head, struct umb_error *error);

/* Parses the front of a file, which holds at least the head. Page entries are not located. */
UMB_CHECKED enum umb_status umb__head_parse_front(const uint8_t *bytes, size_t size,
                                                  struct umb__head *head, struct umb_error *error);

/* Returns the length in bytes of a head, from the lengths of its parts. */
uint64_t umb__head_length(const struct umb__head *head);

/* Makes the bytes of a head, with its checksum. In: head: complete; parts of length 0 may be NULL.
 * Returns uint8[head->head_length], which the caller frees with umb__free; NULL: out of memory. */
uint8_t *umb__head_make(const struct umb__head *head, const struct umb_alloc *alloc);

#endif
