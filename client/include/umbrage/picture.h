/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_PICTURE_H
#define UMBRAGE_PICTURE_H
/*
 * Frame loops: a point for each pixel of a depth picture, and answers packed so that a frame costs
 * only what changed since an earlier one.
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
 * Client and server run the same code. Nothing here keeps state.
 * Trust: unpacking is safe on hostile bytes.
 * Stability: stable; umbrage/version.h says what that means.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/query.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Depths beyond this, metres, are taken for pixels with nothing in them. */
#define UMB_DEPTH_MAX 1e9

/* What a camera sees: pixel x + y * width, from the upper left corner. */
struct umb_picture {
    struct umb_camera camera; /* aspect, near_m and far_m are not read */
    uint32_t width, height;   /* Numbers of pixels, at least 1; pixels are square */
    const void *depth; /* float[width * height], little-endian, any alignment: along `forward`, not
                          along the pixel's ray. Not positive, not finite or beyond UMB_DEPTH_MAX:
                          nothing is there */
    uint64_t reserved[4]; /* Zero: room for later versions (umbrage/version.h) */
};

/* Fails: E_ARGUMENT (what is wrong is named). */
UMB_API UMB_CHECKED enum umb_status umb_picture_check(const struct umb_picture *picture,
                                                      struct umb_error *error);

/*
 * Where the pixels first .. first + count - 1 are.
 *
 * In:  picture: one that umb_picture_check takes.
 * Out: points: float[3 * count], relative to picture->camera.eye; 0 where nothing is there. Through
 *      the pixel's centre, in double precision, rounded once; the tangent of fov_y is the C
 *      library's.
 */
UMB_API void umb_picture_points(const struct umb_picture *picture, size_t first, size_t count,
                                float *points);

/* Answers of those pixels that have nothing in them become 1. In: first: a multiple of 8; values:
 * of the whole picture, in `format`. */
UMB_API void umb_picture_fill(const struct umb_picture *picture, size_t first, size_t count,
                              enum umb_answer_format format, void *values);

/* Bytes that a packed frame of `size` bytes takes at most. */
UMB_API size_t umb_picture_room(size_t size);

/* A mark of a frame's answers, never 0: who has a frame says so by it. */
UMB_API uint64_t umb_picture_mark(const void *values, size_t size);

/*
 * Packs answers: one zstd frame of their bytes, each XORed with the base's if there is one.
 *
 * In:    values, base: uint8[size]; base NULL: none. scratch: uint8[size], needed with a base.
 * Out:   packed: uint8[umb_picture_room(size)]; packed_size.
 * Fails: E_NO_MEMORY.
 */
UMB_API UMB_CHECKED enum umb_status umb_picture_pack(const void *values, const void *base,
                                                     size_t size, void *scratch, void *packed,
                                                     size_t *packed_size, struct umb_error *error);

/*
 * The way back.
 *
 * In:    packed: uint8[packed_size]. base: uint8[size] that was packed against, or NULL.
 * Out:   values: uint8[size], not the base itself; without meaning on failure.
 * Fails: E_CORRUPT (not a frame of `size` bytes), E_NO_MEMORY.
 */
UMB_API UMB_CHECKED enum umb_status umb_picture_unpack(const void *packed, size_t packed_size,
                                                       const void *base, void *values, size_t size,
                                                       struct umb_error *error);

#ifdef __cplusplus
}
#endif
#endif
