/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_SERVICE_MANAGER_H
#define UMBRAGE_SERVER_DAEMON_BASE_SERVICE_MANAGER_H
/*
 * Messages to a service manager (systemd): states, signs of life, and the sockets that the manager
 * passes. Without a manager every function does nothing.
 * Source: sd_notify(3), sd_watchdog_enabled(3), sd_listen_fds(3). Only the protocols are used, not
 * the library.
 */
#include <stdint.h>

/* Sends a state, such as "READY=1", to NOTIFY_SOCKET. It never blocks for long and reports no
 * failure. Threads: one at a time. */
void umbd_notify(const char *state);

/* Sends RELOADING=1 and the current time, as Type=notify-reload requires. READY=1 ends the
 * reload. */
void umbd_notify_reloading(void);

/* Half of the manager's watchdog interval in milliseconds; 0 = no watchdog. */
uint64_t umbd_watchdog_ms(void);

#define UMBD_HANDED_FIRST 3 /* number of the first descriptor */

/*
 * Returns the number of listening sockets that the manager passes. Their descriptors begin at
 * UMBD_HANDED_FIRST and get close-on-exec. A second call returns 0.
 */
unsigned umbd_handed_sockets(void);

/* Returns 1 if `name` is the name that the manager gave to passed socket number `index`
 * (FileDescriptorName=). Call it before umbd_handed_sockets. */
int umbd_handed_is_named(unsigned index, const char *name);

#endif
