/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_ZSTD_FSE_H
#define UMBRAGE_WEB_ZSTD_FSE_H
/* Tables of finite state entropy (RFC 8878, section 4.1). */
#include "web/module/zstd_bits.h"

#define UMBX_FSE_LOG_MAX     9U
#define UMBX_FSE_SYMBOLS_MAX 64U

/* A decoder's state: its symbol, and how the next bits lead to the next state. */
struct umbx_fse_state {
    uint16_t base;
    uint8_t symbol, bits;
};

struct umbx_fse_table {
    unsigned log; /* 1 << log states */
    struct umbx_fse_state state[1U << UMBX_FSE_LOG_MAX];
};

/*
 * Reads a table's description.
 *
 * In:  log_max: largest log allowed, up to UMBX_FSE_LOG_MAX. symbols: number of symbols allowed, up
 *      to UMBX_FSE_SYMBOLS_MAX.
 * Returns the length of the description in bytes; 0: it is damaged.
 */
size_t umbx_fse_read(struct umbx_fse_table *table, const uint8_t *from, size_t size,
                     unsigned log_max, unsigned symbols);

/* Makes a table from probabilities, -1 for "less than one", which add up to 1 << log. */
void umbx_fse_make(struct umbx_fse_table *table, const int16_t *probability, unsigned symbols,
                   unsigned log);

/* Makes the table of one state, which stands for `symbol` for ever. */
void umbx_fse_make_single(struct umbx_fse_table *table, uint8_t symbol);

/* Reads the number of the next state. */
static inline uint32_t umbx_fse_next(const struct umbx_fse_table *table, uint32_t state,
                                     struct umbx_bits *bits)
{
    const struct umbx_fse_state *at = &table->state[state];
    return at->base + (uint32_t)umbx_bits_take(bits, at->bits);
}

#endif
