/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
/*
 * All loops of a server. The first runs on the main thread: it alone listens, takes signals and
 * serves the admin port. The others, on threads of their own, get connections from it and own them
 * from then on; each loop gets equally many.
 */
#include "daemon/transport/loop.h"

/* Makes the loops of the options (--loops); the first is server->loops. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_loops_init(struct umbd_server *server, struct umb_error *error);

/*
 * Starts the threads and calls `ready`, whose failure ends them; then runs until all loops are
 * drained. Fails: E_LIMIT (thread), what ready fails with; nothing runs then.
 */
UMB_CHECKED enum umb_status umbd_loops_run(struct umbd_server *server,
                                           enum umb_status (*ready)(struct umbd_server *server,
                                                                    struct umb_error *error),
                                           struct umb_error *error);

/* Closes all connections and listeners. _finish: frees the loops, when no task is under way any
 * more. */
void umbd_loops_stop(struct umbd_server *server);
void umbd_loops_finish(struct umbd_server *server);

/*
 * Blocks the signals that the loop handles, in this thread and those it starts afterwards. The
 * loop's thread takes them only while it is in umbd_loops_run. Otherwise libuv's closing of a
 * handle, which restores the default action, would let a signal kill a daemon that is just ending.
 */
void umbd_signals_block(void);

#endif
