/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_SERVICE_MANAGER_H
#define UMBRAGE_SERVER_DAEMON_BASE_SERVICE_MANAGER_H
/*
 * Messages to a service manager (systemd), states and signs of life, and the sockets that it hands
 * over. Without a manager every function does nothing.
 * Source: sd_notify(3), sd_watchdog_enabled(3), sd_listen_fds(3): the protocols, not the library.
 */
#include <stdint.h>

/* Sends a state, such as "READY=1", to NOTIFY_SOCKET. Never blocks for long, never fails.
 * Threads: one at a time. */
void umbd_notify(const char *state);

/* Sends RELOADING=1 with the time that Type=notify-reload asks for. READY=1 ends it. */
void umbd_notify_reloading(void);

/* Half of the manager's watchdog interval in milliseconds; 0 = no watchdog. */
uint64_t umbd_watchdog_ms(void);

#define UMBD_HANDED_FIRST 3 /* number of the first descriptor */

/*
 * Number of listening sockets that the manager hands over, 0 without any: their descriptors begin
 * at UMBD_HANDED_FIRST. They get close-on-exec; a second call returns 0.
 */
unsigned umbd_handed_sockets(void);

/* 1 if the manager named that socket (FileDescriptorName=) `name`. Before umbd_handed_sockets. */
int umbd_handed_is_named(unsigned index, const char *name);

#endif
