/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_PICTURE_H
#define UMBRAGE_PICTURE_H
/*
 * Frame loops: a point for each pixel of a depth picture, and packed answers of which only the
 * changes since an earlier picture are sent.
 *
 *     if (umb_picture_check(&picture, &error)) {
 *         return error.status;
 *     }
 *     umb_picture_points(&picture, 0, count, points);  // floats relative to the eye
 *     // ... umb_query_run on them ...
 *     umb_picture_fill(&picture, 0, count, UMB_ANSWER_U8, values);  // empty pixels are lit
 *     if (umb_picture_pack(values, base, count, scratch, packed, &packed_size, &error) ||
 *         umb_picture_unpack(packed, packed_size, base, unpacked, count, &error)) {
 *         return error.status;
 *     }
 *
 * Client and server run the same code.
 * Threads: the functions have no state; any number of threads may call them.
 * Trust: unpacking is safe on hostile bytes.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Largest depth in metres; beyond it a pixel counts as empty. */
#define UMB_DEPTH_MAX 1e9

/* A depth picture of a camera: pixel x + y * width, from the upper left corner. */
struct umb_picture {
    struct umb_camera camera; /* aspect, near_m and far_m are not read */
    uint32_t width, height;   /* Numbers of pixels, at least 1; pixels are square */
    const void *depth; /* Depths in metres along `forward` (not along the pixel's ray), float[width
                          * height], little-endian, any alignment. A pixel whose depth is not
                          positive, not finite or beyond UMB_DEPTH_MAX is empty */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Checks a picture. Fails: E_ARGUMENT (the field is named). */
UMB_API UMB_CHECKED enum umb_status umb_picture_check(const struct umb_picture *picture,
                                                      struct umb_error *error);

/*
 * Computes the points that the pixels first .. first + count - 1 show.
 *
 * In:  picture: one that umb_picture_check accepts.
 * Out: points: float[3 * count], metres, relative to picture->camera.eye, through the pixels'
 *      centres; 0 for empty pixels. Computed in double precision and rounded once; tan(fov_y / 2)
 *      is the C library's.
 */
UMB_API void umb_picture_points(const struct umb_picture *picture, size_t first, size_t count,
                                float *points);

/* Sets the answers of the empty pixels among first .. first + count - 1 to 1, which is lit. In:
 * first: a multiple of 8. values: answers of the whole picture, in `format`. */
UMB_API void umb_picture_fill(const struct umb_picture *picture, size_t first, size_t count,
                              enum umb_answer_format format, void *values);

/* Returns the largest packed size of `size` bytes of answers. */
UMB_API size_t umb_picture_room(size_t size);

/* Returns the mark of a picture's answers: a hash, never 0. Client and server compare marks to be
 * sure that they pack later answers against the same base. */
UMB_API uint64_t umb_picture_mark(const void *values, size_t size);

/*
 * Packs answers into one zstd frame. With a base, each byte is first XORed with the same byte of
 * the base.
 *
 * In:    values, base: uint8[size]; base NULL: none. scratch: uint8[size], needed with a base.
 * Out:   packed: uint8[umb_picture_room(size)]. packed_size: length in bytes.
 * Fails: E_NO_MEMORY.
 */
UMB_API UMB_CHECKED enum umb_status umb_picture_pack(const void *values, const void *base,
                                                     size_t size, void *scratch, void *packed,
                                                     size_t *packed_size, struct umb_error *error);

/*
 * Unpacks answers.
 *
 * In:    packed: uint8[packed_size]. base: uint8[size], the base that they were packed with, or
 *        NULL.
 * Out:   values: uint8[size], not the base itself; unspecified on failure.
 * Fails: E_CORRUPT (not a frame of `size` bytes), E_NO_MEMORY.
 */
UMB_API UMB_CHECKED enum umb_status umb_picture_unpack(const void *packed, size_t packed_size,
                                                       const void *base, void *values, size_t size,
                                                       struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
