/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_TRY_H
#define UMBRAGE_CORE_BASE_TRY_H

#include "umbrage/status.h"

/* Evaluates call once and returns its status from the calling function unless it is UMB_OK. For
 * functions that have nothing to undo at that place. */
#define UMB__TRY(call)                                                                             \
    do {                                                                                           \
        const enum umb_status try_status = (call);                                                 \
        if (try_status != UMB_OK) {                                                                \
            return try_status;                                                                     \
        }                                                                                          \
    } while (0)

#endif
