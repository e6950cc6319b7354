/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_TRY_H
#define UMBRAGE_CORE_BASE_TRY_H

#include "umbrage/status.h"

/* Evaluates `call` once; if the status is not UMB_OK, returns it from the calling function. For
 * places where nothing has to be undone. */
#define UMB__TRY(call)                                                                             \
    do {                                                                                           \
        const enum umb_status try_status = (call);                                                 \
        if (try_status != UMB_OK) {                                                                \
            return try_status;                                                                     \
        }                                                                                          \
    } while (0)

#endif
