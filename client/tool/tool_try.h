/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_TOOL_TRY_H
#define UMBRAGE_TOOL_TOOL_TRY_H

/* UMB__TRY for programs, which include no header of the core. */
#include "base/try.h"

#endif
