/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_BASE_H
#define UMBRAGE_TOOL_BASE_H
/*
 * The parts of the core's base that programs use too: numbers in files, text for display, growing
 * arrays, and the status of a failed open. For assets, programs use the headers in umbrage/.
 */
#include "base/bytes.h"
#include "base/memory.h"
#include "base/open_status.h"
#include "base/utf8.h"

#endif
