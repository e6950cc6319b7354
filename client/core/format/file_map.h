/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_FORMAT_FILE_MAP_H
#define UMBRAGE_CORE_FORMAT_FILE_MAP_H
/* Mapping a whole file read-only: the only I/O of the core. */
#include <stddef.h>
#include "umbrage/status.h"

/* Fails: E_NO_INPUT (missing, a folder), E_PERMISSION, E_LIMIT (descriptors), E_TRUNCATED (empty),
 * E_IO. */
UMB_CHECKED enum umb_status umb__file_map(const char *path, void **map, size_t *bytes,
                                          struct umb_error *error);

/* NULL is allowed. */
void umb__file_unmap(void *map, size_t bytes);

#endif
