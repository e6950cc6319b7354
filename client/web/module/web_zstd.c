/* SPDX-License-Identifier: Apache-2.0 */
/* The functions of zstd.h that the core calls in a thin client, over the module's own decoder. */
#include <zstd.h>

#include "web/module/zstd_frame.h"

#define FAILED ((size_t)-1)

ZSTD_DCtx *ZSTD_createDCtx(void)
{
    return (ZSTD_DCtx *)(void *)umbx_zstd_make();
}

size_t ZSTD_freeDCtx(ZSTD_DCtx *zstd)
{
    umbx_zstd_free((struct umbx_zstd *)(void *)zstd);
    return 0;
}

size_t ZSTD_decompressDCtx(ZSTD_DCtx *zstd, void *to, size_t room, const void *from, size_t size)
{
    size_t got = 0;
    return umbx_zstd_decode((struct umbx_zstd *)(void *)zstd, to, room, from, size, &got) ? got
                                                                                          : FAILED;
}

size_t ZSTD_findFrameCompressedSize(const void *from, size_t size)
{
    const size_t bytes = umbx_zstd_frame_bytes(from, size);
    return bytes > 0 ? bytes : FAILED;
}

unsigned ZSTD_isError(size_t result)
{
    return result == FAILED;
}
