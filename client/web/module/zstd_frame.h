/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WEB_ZSTD_FRAME_H
#define UMBRAGE_WEB_ZSTD_FRAME_H
/*
 * A decoder of zstd frames (RFC 8878) for the WebAssembly module: Debian has no zstd library for
 * wasm32 (docs/decisions/0012-zstd-in-the-web-package.md). It decodes one frame into memory that
 * holds the whole content. Dictionaries and skippable frames are refused.
 *
 * Trust: safe on hostile bytes. Work is linear in the bytes read and written.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct umbx_zstd; /* Tables and literals of a frame under way */

/* Returns the working memory of a decoder, about 140 KiB, or NULL. */
struct umbx_zstd *umbx_zstd_make(void);
void umbx_zstd_free(struct umbx_zstd *zstd);

/*
 * Decodes one frame.
 *
 * In:  from: uint8[size], a frame and nothing behind it.
 * Out: to: uint8[room]; got: number of bytes written.
 * Returns false if the bytes are not one frame, or if its content is longer than room.
 */
bool umbx_zstd_decode(struct umbx_zstd *zstd, uint8_t *to, size_t room, const uint8_t *from,
                      size_t size, size_t *got);

/* Returns the length in bytes of the frame at the start of `from`; 0 if there is none. */
size_t umbx_zstd_frame_bytes(const uint8_t *from, size_t size);

#endif
