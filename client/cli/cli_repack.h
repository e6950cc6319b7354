/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_REPACK_H
#define UMBRAGE_CLI_CLI_REPACK_H
/* Packing the content of an open asset again, which makes its identity from what queries read. */
#include "format/content.h"

/*
 * Packs an asset and proves that its content has the id it claims.
 *
 * In:    sink: gets the packed file; NULL if only the proof is wanted.
 * Fails: E_CORRUPT (another id: damaged, or of a version that packs otherwise), E_NO_MEMORY, or
 * what the sink returns.
 */
UMB_CHECKED enum umb_status umbc_repack(const struct umb_asset *asset, const struct umb_sink *sink,
                                        struct umb_error *error);

#endif
