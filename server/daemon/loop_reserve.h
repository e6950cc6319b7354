/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_LOOP_RESERVE_H
#define UMBRAGE_SERVER_DAEMON_LOOP_RESERVE_H
/*
 * libuv keeps a table of its loop's descriptors, indexed by number, and ends the process if the
 * table cannot grow. A connection that comes when memory is short must not do that: the table is
 * grown at boot to all descriptors that the process may have.
 */
#include <uv.h>
#include "umbrage/status.h"

/*
 * Grows the loop's table for descriptors up to the process's limit (RLIMIT_NOFILE), which must not
 * be raised afterwards. Fails: E_LIMIT. Cost: 8 bytes a descriptor; memory that is short then ends
 * the process, at boot. Source: libuv 1.44, src/unix/core.c, maybe_resize.
 */
UMB_CHECKED enum umb_status umbd_loop_reserve(uv_loop_t *loop, struct umb_error *error);

#endif
