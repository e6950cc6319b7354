/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
/*
 * All loops of a server. The first runs on the main thread: only it listens, takes signals and
 * serves the admin port. The others run on threads of their own. The first loop passes new
 * connections to them, so that each loop owns equally many.
 */
#include "daemon/transport/loop.h"

/* Creates as many loops as --loops says; the first is server->loops. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_loops_init(struct umbd_server *server, struct umb_error *error);

/*
 * Starts the threads, calls `ready`, and runs until all loops are drained. If ready fails, the
 * threads end and nothing runs. Fails: E_LIMIT (no thread), or the status of ready.
 */
UMB_CHECKED enum umb_status umbd_loops_run(struct umbd_server *server,
                                           enum umb_status (*ready)(struct umbd_server *server,
                                                                    struct umb_error *error),
                                           struct umb_error *error);

/* Closes all connections and listeners. _finish frees the loops; call it when no task runs any
 * more. */
void umbd_loops_stop(struct umbd_server *server);
void umbd_loops_finish(struct umbd_server *server);

/*
 * Blocks the signals that the loop handles, in this thread and all threads that it starts later.
 * The loop's thread accepts them only inside umbd_loops_run. When libuv closes a signal handle it
 * restores the default action, so an unblocked signal could kill a daemon that is just ending.
 */
void umbd_signals_block(void);

#endif
