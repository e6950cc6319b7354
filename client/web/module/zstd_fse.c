/* SPDX-License-Identifier: Apache-2.0 */
#include "web/module/zstd_fse.h"

/* Bits that are read from the first byte on; bits behind the end are 0. */
struct forward {
    const uint8_t *bytes;
    size_t size, at; /* at: in bits */
};

static uint32_t forward_peek(const struct forward *in, unsigned count)
{
    const size_t byte = in->at / 8;
    uint32_t word = 0;
    for (size_t i = 0; i < 4 && byte + i < in->size; i++) {
        word |= (uint32_t)in->bytes[byte + i] << 8 * i;
    }
    return word >> (in->at & 7) & ((1U << count) - 1);
}

static uint32_t forward_take(struct forward *in, unsigned count)
{
    const uint32_t value = forward_peek(in, count);
    in->at += count;
    return value;
}

/* Reads a number from 0 to most. Small numbers take a bit less than large ones. */
static uint32_t take_below(struct forward *in, uint32_t most)
{
    const unsigned bits = umbx_highest_bit(most) + 1;
    const uint32_t short_ones = (1U << bits) - (most + 1), value = forward_peek(in, bits);
    const uint32_t low = value & ((1U << (bits - 1)) - 1);
    if (low < short_ones) {
        in->at += bits - 1;
        return low;
    }
    in->at += bits;
    return value >= 1U << (bits - 1) ? value - short_ones : value;
}

size_t umbx_fse_read(struct umbx_fse_table *table, const uint8_t *from, size_t size,
                     unsigned log_max, unsigned symbols)
{
    struct forward in = {from, size, 0};
    int16_t probability[UMBX_FSE_SYMBOLS_MAX] = {0};
    const unsigned log = 5 + forward_take(&in, 4);
    unsigned symbol = 0;
    if (size == 0 || log > log_max) {
        return 0;
    }
    uint32_t left = 1U << log;
    while (left > 0 && symbol < symbols) {
        const uint32_t value = take_below(&in, left + 1);
        probability[symbol++] = (int16_t)((int32_t)value - 1);
        left -= value == 0 ? 1 : value - 1;
        for (uint32_t zeros = value == 1 ? 3 : 0; zeros == 3;) {
            zeros = forward_take(&in, 2);
            symbol += zeros;
            if (symbol > symbols || in.at > 8 * size) {
                return 0;
            }
        }
    }
    const size_t bytes = (in.at + 7) / 8;
    if (left > 0 || bytes > size) {
        return 0;
    }
    umbx_fse_make(table, probability, symbol, log);
    return bytes;
}

void umbx_fse_make(struct umbx_fse_table *table, const int16_t *probability, unsigned symbols,
                   unsigned log)
{
    const uint32_t size = 1U << log, step = (size >> 1) + (size >> 3) + 3;
    uint16_t next[UMBX_FSE_SYMBOLS_MAX];
    uint32_t end = size, at = 0;
    table->log = log;
    for (unsigned s = 0; s < symbols; s++) {
        next[s] = (uint16_t)(probability[s] < 0 ? 1 : probability[s]);
        if (probability[s] < 0) {
            table->state[--end].symbol = (uint8_t)s;
        }
    }
    for (unsigned s = 0; s < symbols; s++) {
        for (int i = 0; i < probability[s]; i++) {
            table->state[at].symbol = (uint8_t)s;
            do {
                at = (at + step) & (size - 1);
            } while (at >= end);
        }
    }
    for (uint32_t i = 0; i < size; i++) {
        struct umbx_fse_state *state = &table->state[i];
        const uint32_t number = next[state->symbol]++;
        state->bits = (uint8_t)(log - umbx_highest_bit(number));
        state->base = (uint16_t)((number << state->bits) - size);
    }
}

void umbx_fse_make_single(struct umbx_fse_table *table, uint8_t symbol)
{
    table->log = 0;
    table->state[0] = (struct umbx_fse_state){0, symbol, 0};
}
