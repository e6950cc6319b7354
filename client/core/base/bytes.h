/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_BYTES_H
#define UMBRAGE_CORE_BASE_BYTES_H
/*
 * Little-endian loads and stores at any alignment, and a bounded reader over untrusted bytes. Loads
 * and stores are written with shifts, which work alike on any host; compilers turn each into one
 * move. The file also converts hexadecimal digits.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint16_t umb__load16(const uint8_t *p)
{
    return (uint16_t)(p[0] | (p[1] << 8));
}

static inline uint32_t umb__load32(const uint8_t *p)
{
    return (uint32_t)p[0] | ((uint32_t)p[1] << 8) | ((uint32_t)p[2] << 16) | ((uint32_t)p[3] << 24);
}

static inline uint64_t umb__load64(const uint8_t *p)
{
    return (uint64_t)umb__load32(p) | ((uint64_t)umb__load32(p + 4) << 32);
}

static inline float umb__load_f32(const uint8_t *p)
{
    uint32_t bits = umb__load32(p);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline double umb__load_f64(const uint8_t *p)
{
    uint64_t bits = umb__load64(p);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Loads an unsigned number of `width` bytes, 1 to 4. */
static inline uint32_t umb__load_narrow(const uint8_t *p, unsigned width)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < width; i++) {
        value |= (uint32_t)p[i] << (8 * i);
    }
    return value;
}

static inline void umb__store16(uint8_t *p, uint16_t v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
}

static inline void umb__store32(uint8_t *p, uint32_t v)
{
    umb__store16(p, (uint16_t)v);
    umb__store16(p + 2, (uint16_t)(v >> 16));
}

static inline void umb__store64(uint8_t *p, uint64_t v)
{
    umb__store32(p, (uint32_t)v);
    umb__store32(p + 4, (uint32_t)(v >> 32));
}

static inline void umb__store_f64(uint8_t *p, double v)
{
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    umb__store64(p, bits);
}

static inline void umb__store_narrow(uint8_t *p, uint32_t v, unsigned width)
{
    for (unsigned i = 0; i < width; i++) {
        p[i] = (uint8_t)(v >> (8 * i));
    }
}

/* Returns the value of a hexadecimal digit of either case, or -1. */
static inline int umb__hex_value(char c)
{
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    if (c >= 'a' && c <= 'f') {
        return c - 'a' + 10;
    }
    if (c >= 'A' && c <= 'F') {
        return c - 'A' + 10;
    }
    return -1;
}

/* Returns true if `count` bytes are all zero. */
static inline bool umb__all_zero(const uint8_t *bytes, uint64_t count)
{
    uint8_t any = 0;
    for (uint64_t i = 0; i < count; i++) {
        any |= bytes[i];
    }
    return any == 0;
}

/* Takes `count * size` bytes from the front of the range [*at, end). Returns false if the range has
 * fewer. */
static inline bool umb__take(const uint8_t **at, const uint8_t *end, uint64_t count, uint64_t size,
                             const uint8_t **out)
{
    uint64_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > (uint64_t)(end - *at)) {
        return false;
    }
    *out = *at;
    *at += bytes;
    return true;
}

#endif
