/* SPDX-License-Identifier: Apache-2.0 */
/* Decompression of single messages by zlib, within a limit. */
#include "wire/grpc.h"

#include "base/try.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#define GZIP_ONLY      (15 + 16) /* windowBits of zlib: the largest window, gzip framing */
#define FIRST_CAPACITY 4096

/* Grows the output block to at most the limit and one byte. That extra byte shows that the result
 * is too large. */
static enum umb_status grow(uint8_t **block, size_t *capacity, size_t limit,
                            struct umb_error *error)
{
    if (*capacity > limit) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: inflates to more than %zu bytes; send it uncompressed", limit);
    }
    size_t wanted = *capacity == 0 ? FIRST_CAPACITY : *capacity * 2;
    wanted = wanted <= limit ? wanted : limit + 1;
    uint8_t *bytes = realloc(*block, wanted);
    if (bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", wanted);
    }
    *block = bytes;
    *capacity = wanted;
    return UMB_OK;
}

/* Inflates the stream to its end. The loop ends, because each turn fills the block or ends the
 * stream. */
static enum umb_status inflate_all(z_stream *stream, uint8_t **block, size_t *used, size_t limit,
                                   struct umb_error *error)
{
    size_t capacity = 0;
    int code = Z_OK;
    while (code == Z_OK) {
        UMB__TRY(grow(block, &capacity, limit, error));
        stream->next_out = *block + *used;
        stream->avail_out = (uInt)(capacity - *used);
        code = inflate(stream, Z_NO_FLUSH);
        *used = capacity - stream->avail_out;
        if (code == Z_OK && stream->avail_out > 0) {
            code = Z_BUF_ERROR; /* The input ended before the stream */
        }
    }
    if (code == Z_MEM_ERROR) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for inflating a message");
    }
    if (code != Z_STREAM_END || stream->avail_in > 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "message: is not one whole gzip stream");
    }
    if (*used > limit) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: inflates to more than %zu bytes; send it uncompressed", limit);
    }
    return UMB_OK;
}

enum umb_status umbw_gunzip(const uint8_t *bytes, size_t size, size_t max, uint8_t **out,
                            size_t *out_size, struct umb_error *error)
{
    z_stream stream;
    uint8_t *block = NULL;
    size_t limit = max < UMBW_GUNZIP_MAX ? max : UMBW_GUNZIP_MAX;
    *out = NULL;
    *out_size = 0;
    if (size > UMBW_GUNZIP_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %zu compressed bytes are over the limit of %zu; send it "
                        "uncompressed",
                        size, UMBW_GUNZIP_MAX);
    }
    memset(&stream, 0, sizeof stream);
    if (inflateInit2(&stream, GZIP_ONLY) != Z_OK) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for inflating a message");
    }
    stream.next_in = (Bytef *)(uintptr_t)bytes; /* zlib only reads it */
    stream.avail_in = (uInt)size;
    size_t used = 0;
    enum umb_status status = inflate_all(&stream, &block, &used, limit, error);
    (void)inflateEnd(&stream);
    if (status != UMB_OK) {
        free(block);
        return status;
    }
    *out = block;
    *out_size = used;
    return UMB_OK;
}
