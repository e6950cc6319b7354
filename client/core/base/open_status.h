/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_OPEN_STATUS_H
#define UMBRAGE_CORE_BASE_OPEN_STATUS_H
/*
 * Status codes for the errno of a failed open of an input. They let scripts tell a missing file, a
 * file without permission, and a machine without free descriptors apart.
 */
#include <errno.h>
#include "umbrage/status.h"

/* Returns the failure for an errno; E_IO for an errno without a status of its own. Pure. */
static inline enum umb_status umb__open_status(int system_error)
{
    switch (system_error) {
    case ENOENT:
    case ENOTDIR:
    case EISDIR:
    case ENXIO: /* A socket, or a pipe without a reader */
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
