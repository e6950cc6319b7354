/* SPDX-License-Identifier: Apache-2.0 */
/* See grpc_status.h. Without a default, so that the compiler asks for every new status. */
#include "wire/grpc_status.h"

int umbw_grpc_code(enum umb_status status)
{
    switch (status) {
    case UMB_OK:
        return 0;
    case UMB_E_CANCELLED:
        return 1;
    case UMB_E_ARGUMENT:
    case UMB_E_BAD_SCENE:
        return 3;
    case UMB_E_DEADLINE:
        return 4;
    case UMB_E_NOT_FOUND:
    case UMB_E_NO_INPUT:
        return 5;
    case UMB_E_EXISTS:
        return 6;
    case UMB_E_PERMISSION:
        return 7;
    case UMB_E_TOO_LARGE:
    case UMB_E_NO_MEMORY:
    case UMB_E_BUSY:
    case UMB_E_LIMIT:
        return 8;
    case UMB_E_STATE:
        return 9;
    case UMB_E_UNSUPPORTED:
    case UMB_E_VERSION:
        return 12;
    case UMB_E_IO:
    case UMB_E_CANNOT_CREATE:
    case UMB_E_PROTOCOL:
    case UMB_E_INTERNAL:
        return 13;
    case UMB_E_UNAVAILABLE:
        return 14;
    case UMB_E_FORMAT:
    case UMB_E_TRUNCATED:
    case UMB_E_CORRUPT:
        return 15;
    case UMB_E_UNAUTHENTICATED:
        return 16;
    }
    return 2;
}

enum umb_status umbw_grpc_status(int code)
{
    switch (code) {
    case 0:
        return UMB_OK;
    case 1:
        return UMB_E_CANCELLED;
    case 3:
    case 11:
        return UMB_E_ARGUMENT;
    case 4:
        return UMB_E_DEADLINE;
    case 5:
        return UMB_E_NOT_FOUND;
    case 6:
        return UMB_E_EXISTS;
    case 7:
        return UMB_E_PERMISSION;
    case 8:
        return UMB_E_TOO_LARGE;
    case 9:
    case 10:
        return UMB_E_STATE;
    case 12:
        return UMB_E_UNSUPPORTED;
    case 13:
    case 2:
        return UMB_E_INTERNAL;
    case 14:
        return UMB_E_UNAVAILABLE;
    case 15:
        return UMB_E_CORRUPT;
    case 16:
        return UMB_E_UNAUTHENTICATED;
    default:
        return UMB_E_PROTOCOL;
    }
}
