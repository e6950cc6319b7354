/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_SERVICE_MANAGER_H
#define UMBRAGE_SERVER_DAEMON_SERVICE_MANAGER_H
/*
 * What the daemon tells a service manager (systemd): states and signs of life. Without a manager
 * every function does nothing.
 * Source: sd_notify(3), sd_watchdog_enabled(3): the protocols, not the library.
 */
#include <stdint.h>

/* Sends a state, such as "READY=1", to NOTIFY_SOCKET. Never blocks for long, never fails. */
void umbd_notify(const char *state);

/* Milliseconds between two signs of life that the manager wants, halved; 0 = none wanted. */
uint64_t umbd_watchdog_ms(void);

#endif
