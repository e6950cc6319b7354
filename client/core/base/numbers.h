/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_NUMBERS_H
#define UMBRAGE_CORE_BASE_NUMBERS_H
/*
 * Variable-length numbers.
 *
 * A single number is below 2^32. Each byte has seven bits of the number, the lowest first; bit 7 is
 * set in all bytes but the last. The encoding is as short as possible: the last byte is 0 only for
 * the number 0.
 *
 * All numbers of a list are below one limit. A list begins with one byte for each number: the
 * number's lowest eight bits. The higher bits follow, packed without gaps: from each number as many
 * as the limit needs, from the lowest bit of a byte up, with zeros up to a whole byte. So a list of
 * small numbers is a row of bytes, in which a compressor finds repetitions, and other lists take
 * hardly more than their bits.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define UMB__NUMBER_BYTES_MAX 5U

/* Reads the next number. Returns false if it is cut off, longer than needed, or beyond 32 bits. */
static inline bool umb__take_number(const uint8_t **at, const uint8_t *end, uint32_t *value)
{
    uint64_t sum = 0;
    for (unsigned shift = 0; shift < 35 && *at < end; shift += 7) {
        const uint8_t byte = *(*at)++;
        sum |= (uint64_t)(byte & 0x7f) << shift;
        if (byte < 0x80) {
            *value = (uint32_t)sum;
            return sum <= UINT32_MAX && (byte != 0 || shift == 0);
        }
    }
    return false;
}

/* Reads the next number. In: bytes that umb__take_number has accepted before. */
static inline uint32_t umb__next_number(const uint8_t **at)
{
    uint32_t value = 0;
    for (unsigned shift = 0;; shift += 7) {
        const uint8_t byte = *(*at)++;
        value |= (uint32_t)(byte & 0x7f) << shift;
        if (byte < 0x80) {
            return value;
        }
    }
}

/* Writes a number; returns where the next byte goes. */
static inline uint8_t *umb__put_number(uint8_t *at, uint32_t value)
{
    for (; value >= 0x80; value >>= 7) {
        *at++ = (uint8_t)(value | 0x80);
    }
    *at++ = (uint8_t)value;
    return at;
}

/* Turns a difference into a number: 0, -1, 1, -2, 2 ... become 0, 1, 2, 3, 4 ... In: a difference
 * whose absolute value is below 2^31. */
static inline uint32_t umb__fold(int64_t difference)
{
    return (uint32_t)(difference < 0 ? -2 * difference - 1 : 2 * difference);
}

/* Inverse of umb__fold. */
static inline int64_t umb__unfold(uint32_t number)
{
    return number & 1 ? -(int64_t)(number / 2) - 1 : (int64_t)(number / 2);
}

/* A list of numbers below a limit. */
struct umb__number_list {
    const uint8_t *bytes; /* [umb__list_bytes(count, high_bits)] */
    uint64_t count;
    unsigned high_bits; /* Bits of each number beyond eight */
};

/* Returns how many bits a number below the limit can have beyond its lowest eight: 0 to 25. */
static inline unsigned umb__list_high_bits(uint64_t limit)
{
    unsigned bits = 0;
    while ((uint64_t)0x100 << bits < limit) {
        bits++;
    }
    return bits;
}

/* Returns the bytes of a list. In: count: below 2^58. */
static inline uint64_t umb__list_bytes(uint64_t count, unsigned high_bits)
{
    return count + (count * high_bits + 7) / 8;
}

/* Writes a list; returns where the next byte goes. */
static inline uint8_t *umb__put_list(uint8_t *at, const uint32_t *numbers, size_t count,
                                     unsigned high_bits)
{
    for (size_t i = 0; i < count; i++) {
        at[i] = (uint8_t)numbers[i];
    }
    at += count;
    uint64_t pending = 0;
    unsigned pending_bits = 0;
    for (size_t i = 0; i < count && high_bits > 0; i++) {
        pending |= (uint64_t)(numbers[i] >> 8) << pending_bits;
        for (pending_bits += high_bits; pending_bits >= 8; pending_bits -= 8) {
            *at++ = (uint8_t)pending;
            pending >>= 8;
        }
    }
    if (pending_bits > 0) {
        *at++ = (uint8_t)pending;
    }
    return at;
}

/* Reader of a list from its first number on. */
struct umb__list_reader {
    const uint8_t *low, *high;
    unsigned high_bits, pending_bits;
    uint64_t pending; /* Bits loaded from high and not used yet; zero behind the last number */
};

static inline struct umb__list_reader umb__list_read(const struct umb__number_list *list)
{
    return (struct umb__list_reader){
        .low = list->bytes, .high = list->bytes + list->count, .high_bits = list->high_bits};
}

/* Returns the next number; call it at most once for each number of the list. */
static inline uint32_t umb__list_next(struct umb__list_reader *r)
{
    for (; r->pending_bits < r->high_bits; r->pending_bits += 8) {
        r->pending |= (uint64_t)*r->high++ << r->pending_bits;
    }
    const uint32_t high = (uint32_t)(r->pending & (((uint64_t)1 << r->high_bits) - 1));
    r->pending >>= r->high_bits;
    r->pending_bits -= r->high_bits;
    return *r->low++ | high << 8;
}

#endif
