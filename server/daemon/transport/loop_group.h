/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
#define UMBRAGE_SERVER_DAEMON_TRANSPORT_LOOP_GROUP_H
/*
 * All loops of a daemon. The first runs on the main thread: it alone listens, takes signals and
 * serves the admin port. The others, on threads of their own, get connections from it and own them
 * from then on; each loop gets equally many. A call's path shares only the pool, the store's
 * look-up and counters.
 */
#include "daemon/transport/loop.h"
#include "daemon/base/net_address.h"

#define UMBD_LOOPS_MAX 64

/* Makes the loops of the options (--loops); the first is daemon->loops. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbd_loops_init(struct umbd_daemon *daemon, struct umb_error *error);

/*
 * Starts the threads and calls `ready`, whose failure ends them; then runs until all loops are
 * drained. Fails: E_LIMIT (thread), what ready fails with; nothing runs then.
 */
UMB_CHECKED enum umb_status umbd_loops_run(struct umbd_daemon *daemon,
                                           enum umb_status (*ready)(struct umbd_daemon *daemon,
                                                                    struct umb_error *error),
                                           struct umb_error *error);

/* Closes everything, ends the pool, frees the loops. */
void umbd_loops_finish(struct umbd_daemon *daemon);

/* The loop with the fewest connections. */
struct umbd_loop *umbd_loops_idlest(struct umbd_daemon *daemon);

/* The loop after this one, in a ring. */
struct umbd_loop *umbd_loop_after(struct umbd_loop *loop);

/* Hands an accepted socket to another loop; closes it if memory is short. refusals: number of
 * loops that had no room for it. */
void umbd_loop_hand(struct umbd_loop *to, int socket, enum umbn_transport transport,
                    uint32_t refusals);

/* Makes every other loop begin its drain; the second call ends them at once. */
void umbd_loops_drain(struct umbd_loop *from);

/* Milliseconds since the last tick of the loop that ticked least recently. Any thread. */
uint64_t umbd_loops_tick_age_ms(struct umbd_daemon *daemon);

/* Number of running loops, the first included. */
unsigned umbd_loops_running(struct umbd_daemon *daemon);

/* Takes the sockets and orders that other loops left. On the loop's own thread. */
void umbd_loop_take_orders(struct umbd_loop *loop);

#endif
