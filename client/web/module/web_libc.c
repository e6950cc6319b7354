/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The system calls that wasi-libc's formatted printing can reach: it names the standard streams,
 * and never writes to them here. With these the module imports nothing.
 */
#include <wasi/api.h>

__wasi_errno_t __wasi_fd_close(__wasi_fd_t file)
{
    (void)file;
    return __WASI_ERRNO_BADF;
}

__wasi_errno_t __wasi_fd_seek(__wasi_fd_t file, __wasi_filedelta_t offset, __wasi_whence_t whence,
                              __wasi_filesize_t *place)
{
    (void)file;
    (void)offset;
    (void)whence;
    (void)place;
    return __WASI_ERRNO_BADF;
}

__wasi_errno_t __wasi_fd_write(__wasi_fd_t file, const __wasi_ciovec_t *parts, size_t count,
                               __wasi_size_t *written)
{
    (void)file;
    (void)parts;
    (void)count;
    (void)written;
    return __WASI_ERRNO_BADF;
}
