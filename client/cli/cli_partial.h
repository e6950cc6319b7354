/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_PARTIAL_H
#define UMBRAGE_CLI_CLI_PARTIAL_H
/* Partial files, as `umbrage stream -o` writes them, and the pages of packed files. */
#include <stdbool.h>
#include "umbrage/partial.h"

/*
 * Opens a file as a partial asset: a partial file with its pages, or a packed file without any page
 * and with all entries of its directory.
 *
 * Out:   partial: NULL if it is neither of the two and `status` is UMB_OK: a mapped file.
 * Owns:  the caller closes it with umb_partial_close.
 * Fails: as umb_file_open, umb_partial_open and umb_partial_open_saved.
 */
UMB_CHECKED enum umb_status umbc_partial_open(const char *path, struct umb_partial **partial,
                                              struct umb_error *error);

/* Returns true if a file is a partial file, by its first bytes. */
bool umbc_is_partial(const char *path);

#endif
