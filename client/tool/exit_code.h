/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_EXIT_CODE_H
#define UMBRAGE_TOOL_EXIT_CODE_H
/* Process exit codes, the same in all programs (docs/reference/operations.md, "Exit codes"). */
#include "umbrage/status.h"

/* Returns the exit code of a program that ends with a status. Pure. The switch has no default, so
 * the compiler warns if a new status is missing. */
static inline int umbu_exit_code(enum umb_status status)
{
    switch (status) {
    case UMB_OK:
        return 0;
    case UMB_E_ARGUMENT:
    case UMB_E_TOO_LARGE:
        return 2;
    case UMB_E_FORMAT:
    case UMB_E_VERSION:
    case UMB_E_TRUNCATED:
    case UMB_E_CORRUPT:
    case UMB_E_BAD_SCENE:
        return 65;
    case UMB_E_NOT_FOUND:
    case UMB_E_NO_INPUT:
        return 66;
    case UMB_E_UNSUPPORTED:
    case UMB_E_UNAVAILABLE:
        return 69;
    case UMB_E_STATE:
    case UMB_E_PROTOCOL:
    case UMB_E_INTERNAL:
        return 70;
    case UMB_E_EXISTS:
    case UMB_E_CANNOT_CREATE:
        return 73;
    case UMB_E_IO:
        return 74;
    case UMB_E_NO_MEMORY:
    case UMB_E_BUSY:
    case UMB_E_LIMIT:
    case UMB_E_DEADLINE:
    case UMB_E_CANCELLED:
        return 75;
    case UMB_E_PERMISSION:
    case UMB_E_UNAUTHENTICATED:
        return 77;
    }
    return 70;
}

#endif
