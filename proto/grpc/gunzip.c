/* SPDX-License-Identifier: Apache-2.0 */
/* Decompression of single messages by zlib, within a limit. */
#include "grpc/grpc.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#define GZIP_ONLY  (15 + 16) /* windowBits of zlib: the largest window, gzip framing */
#define GZIP_LEAST 18        /* Bytes of head and end: no stream is shorter */

/* Returns the size before compression, which a gzip stream states in its last four bytes (RFC
 * 1952). zlib compares this size with that of its output. */
static size_t stated_size(const uint8_t *bytes, size_t size)
{
    const uint8_t *end = bytes + size - 4;
    return (size_t)end[0] | (size_t)end[1] << 8 | (size_t)end[2] << 16 | (size_t)end[3] << 24;
}

/* Inflates a whole stream into a block of the size that it states, and not one byte more. */
static enum umb_status inflate_whole(const uint8_t *bytes, size_t size, uint8_t *block,
                                     size_t stated, struct umb_error *error)
{
    z_stream stream;
    memset(&stream, 0, sizeof stream);
    int code = inflateInit2(&stream, GZIP_ONLY);
    if (code == Z_OK) {
        stream.next_in = (Bytef *)(uintptr_t)bytes; /* zlib only reads it */
        stream.avail_in = (uInt)size;
        stream.next_out = block;
        stream.avail_out = (uInt)stated;
        code = inflate(&stream, Z_FINISH);
        (void)inflateEnd(&stream);
    }
    if (code == Z_MEM_ERROR) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for inflating a message");
    }
    if (code != Z_STREAM_END || stream.avail_in > 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "message: is not one whole gzip stream");
    }
    return UMB_OK;
}

enum umb_status umbw_gunzip(const uint8_t *bytes, size_t size, size_t max, uint8_t **out,
                            size_t *out_size, struct umb_error *error)
{
    const size_t limit = max < UMBW_GUNZIP_MAX ? max : UMBW_GUNZIP_MAX;
    *out = NULL;
    *out_size = 0;
    if (size > UMBW_GUNZIP_MAX) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: %zu compressed bytes are over the limit of %zu; send it "
                        "uncompressed",
                        size, UMBW_GUNZIP_MAX);
    }
    if (size < GZIP_LEAST || bytes[0] != 0x1f || bytes[1] != 0x8b) {
        return umb_fail(error, UMB_E_ARGUMENT, "message: is not one whole gzip stream");
    }
    const size_t stated = stated_size(bytes, size);
    if (stated > limit) {
        return umb_fail(error, UMB_E_TOO_LARGE,
                        "message: says that it inflates to %zu bytes, over the limit of %zu; send "
                        "it uncompressed",
                        stated, limit);
    }
    uint8_t *block = malloc(stated + 1);
    if (block == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a message of %zu bytes", stated);
    }
    enum umb_status status = inflate_whole(bytes, size, block, stated, error);
    if (status != UMB_OK) {
        free(block);
        return status;
    }
    *out = block;
    *out_size = stated;
    return UMB_OK;
}
