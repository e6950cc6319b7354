/* SPDX-License-Identifier: Apache-2.0 */
/* See page_compress.h. */
#include "format/page_compress.h"

#include <zstd.h>
#include <zstd_errors.h>

/*
 * Pages are short, so tables that fit the L1 cache find as many matches as large ones. zstd's level
 * 6 would save 5 % and take three times as long (docs/results/bakes.md).
 */
#define TABLE_LOG2     12
#define SHORTEST_MATCH 4

/* Least bytes of a block: a shorter part shares the block of the part before, since a table of its
 * own would take more than it saves. */
#define BLOCK_LEAST 1024U

/* Bytes that one more block adds to zstd's bound of a frame: its head, and rounding. */
#define BLOCK_COST 16U

ZSTD_CCtx *umb__page_compressor(void)
{
    const struct {
        ZSTD_cParameter name;
        int value;
    } settings[] = {
        {ZSTD_c_compressionLevel, 1},
        {ZSTD_c_strategy, ZSTD_fast},
        {ZSTD_c_hashLog, TABLE_LOG2},
        {ZSTD_c_minMatch, SHORTEST_MATCH},
    };
    ZSTD_CCtx *zstd = ZSTD_createCCtx();
    for (size_t i = 0; zstd && i < sizeof settings / sizeof settings[0]; i++) {
        if (ZSTD_isError(ZSTD_CCtx_setParameter(zstd, settings[i].name, settings[i].value))) {
            ZSTD_freeCCtx(zstd);
            zstd = NULL;
        }
    }
    return zstd;
}

size_t umb__page_compress_bound(const struct umb__page_encoder *encoder)
{
    return ZSTD_compressBound(encoder->raw_size) + BLOCK_COST * (encoder->part_count + 1);
}

/* Returns the end of the block that begins at `begin`. */
static size_t block_end(const struct umb__page_encoder *encoder, size_t begin)
{
    for (size_t i = 0; i < encoder->part_count; i++) {
        const size_t end = encoder->parts[i];
        if (end >= begin + BLOCK_LEAST && encoder->raw_size - end >= BLOCK_LEAST) {
            return end;
        }
    }
    return encoder->raw_size;
}

/* Compresses all blocks of a frame. Returns zstd's code: an error or 0, or what it could not
 * write. */
static size_t compress_blocks(ZSTD_CCtx *zstd, const struct umb__page_encoder *encoder,
                              ZSTD_outBuffer *out)
{
    size_t code = ZSTD_CCtx_reset(zstd, ZSTD_reset_session_only);
    if (!ZSTD_isError(code)) {
        code = ZSTD_CCtx_setPledgedSrcSize(zstd, encoder->raw_size);
    }
    for (size_t begin = 0; begin < encoder->raw_size && code == 0;) {
        const size_t end = block_end(encoder, begin);
        ZSTD_inBuffer in = {.src = encoder->raw + begin, .size = end - begin};
        code = ZSTD_compressStream2(zstd, out, &in,
                                    end == encoder->raw_size ? ZSTD_e_end : ZSTD_e_flush);
        begin = end;
    }
    return code;
}

enum umb_status umb__page_compress(ZSTD_CCtx *zstd, const struct umb__page_encoder *encoder,
                                   uint8_t *stored, size_t *length, struct umb_error *error)
{
    ZSTD_outBuffer out = {.dst = stored, .size = umb__page_compress_bound(encoder)};
    const size_t code = compress_blocks(zstd, encoder, &out);
    *length = out.pos;
    if (code == 0) {
        return UMB_OK;
    }
    const bool memory =
        ZSTD_isError(code) && ZSTD_getErrorCode(code) == ZSTD_error_memory_allocation;
    return umb_fail(error, memory ? UMB_E_NO_MEMORY : UMB_E_INTERNAL, "packing: zstd: %s",
                    ZSTD_isError(code) ? ZSTD_getErrorName(code) : "the page exceeds its bound");
}
