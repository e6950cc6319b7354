/* SPDX-License-Identifier: Apache-2.0 */
/*
 * System calls to which wasi-libc's formatted printing refers. Its code for the standard streams
 * needs them, but the module never writes to a stream. With these definitions the module imports
 * nothing.
 */
#include <wasi/api.h>

__wasi_errno_t __wasi_fd_close(__wasi_fd_t fd)
{
    (void)fd;
    return __WASI_ERRNO_BADF;
}

__wasi_errno_t __wasi_fd_seek(__wasi_fd_t fd, __wasi_filedelta_t offset, __wasi_whence_t whence,
                              __wasi_filesize_t *retptr0)
{
    (void)fd;
    (void)offset;
    (void)whence;
    (void)retptr0;
    return __WASI_ERRNO_BADF;
}

__wasi_errno_t __wasi_fd_write(__wasi_fd_t fd, const __wasi_ciovec_t *iovs, size_t iovs_len,
                               __wasi_size_t *retptr0)
{
    (void)fd;
    (void)iovs;
    (void)iovs_len;
    (void)retptr0;
    return __WASI_ERRNO_BADF;
}
