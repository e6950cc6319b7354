/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_TRANSMITTANCE_WRITE_H
#define UMBRAGE_CORE_FORMAT_TRANSMITTANCE_WRITE_H
/*
 * Writing transmittance maps (format/transmittance.h): squares of 64x64 texels, in the order of the
 * entry.
 *
 *     umb__transmittance_square(&bytes, lists, max_bytes, &error);   each square, row by row
 *
 * Several threads may write squares, each to an array of its own; then umb__transmittance_append
 * puts the arrays one behind the other. No square depends on another.
 */
#include "format/transmittance.h"

#define UMB__TRANSMITTANCE_SIDE 64U /* Texels a side of a square */

/* A step as it is written. */
struct umb__transmittance_drop {
    uint32_t z;
    uint32_t drop; /* Light taken, in units of 2^-21, 1 and up */
};

/* The list of one texel, z ascending; none if count is 0. */
struct umb__transmittance_list {
    const struct umb__transmittance_drop *steps;
    uint32_t count;
};

/* A growing array of bytes. Start zeroed. */
struct umb__transmittance_bytes {
    const struct umb_alloc *alloc;
    uint8_t *data; /* Bytes; free them with umb__transmittance_bytes_finish */
    size_t count, capacity;
};
void umb__transmittance_bytes_finish(struct umb__transmittance_bytes *bytes);

/*
 * Appends a square.
 *
 * In:    lists: [64 * 64], row by row.
 * Fails: E_NO_MEMORY, E_LIMIT (more than max_bytes then). After a failure only finish `bytes`.
 */
UMB_CHECKED enum umb_status umb__transmittance_square(struct umb__transmittance_bytes *bytes,
                                                      const struct umb__transmittance_list *lists,
                                                      size_t max_bytes, struct umb_error *error);

/*
 * Appends bytes unchanged: the levels of all frusta, or squares written elsewhere.
 *
 * Fails: as umb__transmittance_square.
 */
UMB_CHECKED enum umb_status umb__transmittance_append(struct umb__transmittance_bytes *bytes,
                                                      const void *data, size_t count,
                                                      size_t max_bytes, struct umb_error *error);

#endif
