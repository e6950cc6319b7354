/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_OPEN_STATUS_H
#define UMBRAGE_CORE_BASE_OPEN_STATUS_H
/*
 * What the errno of a failed open of an input means: a script does something else about a file that
 * is missing than about one it may not read or about a machine that is out of descriptors.
 */
#include <errno.h>
#include "umbrage/status.h"

/* Pure. Returns a failure for any errno; E_IO for those without a status of their own. */
static inline enum umb_status umb__open_status(int system_error)
{
    switch (system_error) {
    case ENOENT:
    case ENOTDIR:
    case EISDIR:
    case ENXIO: /* a socket, a pipe */
        return UMB_E_NO_INPUT;
    case EACCES:
    case EPERM:
        return UMB_E_PERMISSION;
    case ENOMEM:
        return UMB_E_NO_MEMORY;
    case EMFILE:
    case ENFILE:
        return UMB_E_LIMIT;
    default:
        return UMB_E_IO;
    }
}

#endif
