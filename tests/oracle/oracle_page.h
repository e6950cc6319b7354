/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_ORACLE_PAGE_H
#define UMBRAGE_TESTS_ORACLE_PAGE_H
/* A page of a packed file, between the oracle's reader of the file and of a page. */
#include "oracle_parts.h"

struct oracle_page {
    uint64_t stored_at;
    uint32_t stored_size, size, nodes;
    uint64_t stored_hash;
    uint32_t high, low;
    const uint8_t *hash;           /* SHA-256 stated by the directory */
    uint8_t *bytes;                /* expanded */
    uint32_t count[ORACLE_LEVELS]; /* N[l] */
    uint64_t base[ORACLE_LEVELS];  /* number of its first node among all of level l */
    struct oracle_cursor cursor;   /* what stands after the counts */
    struct oracle_cursor links;    /* the page's links in the directory */
};

/* The counts of an expanded page, and where its nodes get their numbers. */
int oracle_read_counts(struct oracle *oracle, uint32_t number, struct oracle_page *page,
                       char error[ORACLE_ERROR_SIZE]);

/* Nodes and bricks of a page; the counts of all pages are read. */
int oracle_decode_page(struct oracle *oracle, struct oracle_page *pages, uint32_t number,
                       char error[ORACLE_ERROR_SIZE]);

#endif
