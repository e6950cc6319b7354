/* SPDX-License-Identifier: Apache-2.0 */
/* See grpc_status.h. */
#include "wire/grpc_status.h"

#include <stddef.h>

#define UNKNOWN 2

static const struct {
    enum umb_status status;
    int code;
} codes[] = {{UMB_OK, 0},
             {UMB_E_CANCELLED, 1},
             {UMB_E_ARGUMENT, 3},
             {UMB_E_BAD_SCENE, 3},
             {UMB_E_DEADLINE, 4},
             {UMB_E_NOT_FOUND, 5},
             {UMB_E_NO_INPUT, 5},
             {UMB_E_EXISTS, 6},
             {UMB_E_PERMISSION, 7},
             {UMB_E_TOO_LARGE, 8},
             {UMB_E_NO_MEMORY, 8},
             {UMB_E_BUSY, 8},
             {UMB_E_LIMIT, 8},
             {UMB_E_STATE, 9},
             {UMB_E_UNSUPPORTED, 12},
             {UMB_E_VERSION, 12},
             {UMB_E_IO, 13},
             {UMB_E_CANNOT_CREATE, 13},
             {UMB_E_PROTOCOL, 13},
             {UMB_E_INTERNAL, 13},
             {UMB_E_UNAVAILABLE, 14},
             {UMB_E_FORMAT, 15},
             {UMB_E_TRUNCATED, 15},
             {UMB_E_CORRUPT, 15},
             {UMB_E_UNAUTHENTICATED, 16}};

/* By code. */
static const enum umb_status statuses[] = {
    UMB_OK,          UMB_E_CANCELLED,      UMB_E_INTERNAL,    UMB_E_ARGUMENT,  UMB_E_DEADLINE,
    UMB_E_NOT_FOUND, UMB_E_EXISTS,         UMB_E_PERMISSION,  UMB_E_TOO_LARGE, UMB_E_STATE,
    UMB_E_STATE,     UMB_E_ARGUMENT,       UMB_E_UNSUPPORTED, UMB_E_INTERNAL,  UMB_E_UNAVAILABLE,
    UMB_E_CORRUPT,   UMB_E_UNAUTHENTICATED};

int umbw_grpc_code(enum umb_status status)
{
    for (size_t i = 0; i < sizeof codes / sizeof codes[0]; i++) {
        if (codes[i].status == status) {
            return codes[i].code;
        }
    }
    return UNKNOWN;
}

enum umb_status umbw_grpc_status(int code)
{
    const int count = (int)(sizeof statuses / sizeof statuses[0]);
    return code >= 0 && code < count ? statuses[code] : UMB_E_PROTOCOL;
}
