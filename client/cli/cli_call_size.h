/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_CALL_SIZE_H
#define UMBRAGE_CLI_CLI_CALL_SIZE_H
/*
 * How many points, segments, columns or boxes `umbrage query` sends in one call: --batch, or less
 * where the server takes less.
 *
 *     umb_client_get_limits(client, &limits, &error), then umbc_call_size.
 */
#include "cli_query_options.h"
#include "umbrage/client.h"

/*
 * Chooses the size of a call.
 *
 * In:    limits: of the server. 0 in max_points and max_message_bytes means that it tells none; in
 *        max_segments, max_columns and max_boxes, that it takes none.
 * Out:   count: records, at least 1.
 * Fails: E_UNSUPPORTED (the server takes none of what is asked).
 */
UMB_CHECKED enum umb_status umbc_call_size(const struct umbc_query_options *options,
                                           const struct umb_client_limits *limits, size_t *count,
                                           struct umb_error *error);

#endif
