/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_RESERVE_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_RESERVE_H
/*
 * Reserving libuv's table of descriptors. libuv indexes this table by descriptor and ends the
 * process if it cannot grow. A connection that comes when memory is short must not cause that. So
 * the table is grown at boot for all descriptors that the process may have.
 */
#include <uv.h>
#include "umbrage/status.h"

/*
 * Grows the loop's table for descriptors up to the process's limit (RLIMIT_NOFILE), which must not
 * be raised afterwards. Fails: E_LIMIT. Cost: 8 bytes a descriptor; if memory is short the process
 * ends here, at boot. Source: libuv 1.44, src/unix/core.c, maybe_resize.
 */
UMB_CHECKED enum umb_status umbd_loop_reserve(uv_loop_t *loop, struct umb_error *error);

#endif
