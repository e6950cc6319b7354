/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_PAGE_COMPRESS_H
#define UMBRAGE_CORE_FORMAT_PAGE_COMPRESS_H
/*
 * Compresses pages. A page is one zstd frame, and each part of the page begins a block of this
 * frame: masks, references, leaves and leaf numbers have different bytes, so each is coded by a
 * table of its own. Any zstd decoder reads such a frame. Compression is outside the identity of an
 * asset, so the settings may change.
 */
#include "format/page.h"

struct ZSTD_CCtx_s;

/* Makes a compressor for umb__page_compress; free it by ZSTD_freeCCtx. Returns NULL if out of
 * memory. */
struct ZSTD_CCtx_s *umb__page_compressor(void);

/* Returns the most bytes that the page encoded last can take when compressed. */
size_t umb__page_compress_bound(const struct umb__page_encoder *encoder);

/*
 * Compresses the page encoded last.
 *
 * Out:   stored: uint8[umb__page_compress_bound(encoder)]. length: bytes written.
 * Fails: E_NO_MEMORY, E_INTERNAL (zstd's message).
 */
UMB_CHECKED enum umb_status umb__page_compress(struct ZSTD_CCtx_s *zstd,
                                               const struct umb__page_encoder *encoder,
                                               uint8_t *stored, size_t *length,
                                               struct umb_error *error);

#endif
