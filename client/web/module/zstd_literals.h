/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_ZSTD_LITERALS_H
#define UMBRAGE_WEB_ZSTD_LITERALS_H
/* The literals of a block, and their Huffman code (RFC 8878, sections 3.1.1.3.1 and 4.2). */
#include "web/module/zstd_fse.h"

#define UMBX_BLOCK_MAX   ((size_t)128 << 10) /* Most bytes of a block's content */
#define UMBX_HUFFMAN_LOG 11U                 /* Longest code, bits */

struct umbx_huffman {
    unsigned log; /* Longest code; 0: there is no code yet */
    struct {
        uint8_t byte, bits;
    } at[1U << UMBX_HUFFMAN_LOG]; /* By the next `log` bits */
};

struct umbx_literals {
    const uint8_t *bytes; /* In the block, or in `own` */
    size_t count;
    struct umbx_huffman huffman; /* Stays for the next block */
    struct umbx_fse_table weights;
    uint8_t own[UMBX_BLOCK_MAX];
};

/* Reads the literals section. Returns its length in bytes; 0: it is damaged. */
size_t umbx_literals_read(struct umbx_literals *literals, const uint8_t *from, size_t size);

#endif
