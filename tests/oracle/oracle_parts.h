/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_ORACLE_PARTS_H
#define UMBRAGE_TESTS_ORACLE_PARTS_H
/*
 * What the files of the oracle's reader share: a cursor over untrusted bytes, and the steps of
 * oracle_open. Every step returns 1, or 0 after oracle_refuse has written the reason.
 */
#include "oracle_reader.h"

struct oracle_cursor {
    const uint8_t *data;
    uint64_t size, at;
    int overrun; /* something was taken beyond the end; it read as zero */
};

uint64_t oracle_number(const uint8_t *bytes, uint32_t width); /* little-endian, width 1..8 */
double oracle_double(const uint8_t *bytes);
int oracle_all_zero(const uint8_t *bytes, uint64_t size);
int oracle_is_utf8(const uint8_t *bytes, uint64_t size);

uint64_t oracle_take(struct oracle_cursor *cursor, uint32_t width);
/* Reads a number of seven bits a byte; a malformed number counts as an overrun. */
uint64_t oracle_take_number(struct oracle_cursor *cursor);
/* The next `size` bytes, or NULL beyond the end. */
const uint8_t *oracle_take_bytes(struct oracle_cursor *cursor, uint64_t size);

/* Writes the reason; always 0. */
int oracle_refuse(char error[ORACLE_ERROR_SIZE], const char *format, ...)
    __attribute__((format(printf, 2, 3)));

int oracle_read_head(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]);  /* section 2 */
int oracle_read_block(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]); /* section 3 */
/* Checks the length of the entry NEAR, if there is one. */
int oracle_check_receiver_mask(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE]);
int oracle_read_transmittance(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]);
int oracle_read_pages(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]);  /* sections 4, 5 */
int oracle_check_tree(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]);  /* canonical: 1 */
int oracle_read_mapped(struct oracle *oracle, char error[ORACLE_ERROR_SIZE]); /* section 6 */

int oracle_packed_voxel(const struct oracle *oracle, uint32_t frustum, const uint32_t at[3]);
int oracle_mapped_voxel(const struct oracle *oracle, uint32_t frustum, const uint32_t at[3]);

#endif
