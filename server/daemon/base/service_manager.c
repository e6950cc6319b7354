/* SPDX-License-Identifier: Apache-2.0 */
/* Service managers, see service_manager.h. A name of the notify socket that begins with '@' is in
 * Linux's abstract namespace. */
#include "daemon/base/service_manager.h"

#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/base/daemon_options.h"
#include "tool/clock.h"

/* Notify socket of the process, kept open. A sign of life then works even when no descriptor is
 * left; without it the manager would end a healthy daemon. */
static int notify_socket = -1;

void umbd_notify(const char *state)
{
    const char *path = getenv("NOTIFY_SOCKET");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    size_t length = path != NULL ? strlen(path) : 0;
    if (length < 2 || length >= sizeof address.sun_path || (path[0] != '/' && path[0] != '@')) {
        return;
    }
    memcpy(address.sun_path, path, length);
    if (path[0] == '@') {
        address.sun_path[0] = '\0';
    }
    if (notify_socket < 0) {
        notify_socket = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    }
    if (notify_socket >= 0) {
        (void)sendto(notify_socket, state, strlen(state), MSG_NOSIGNAL | MSG_DONTWAIT,
                     (struct sockaddr *)&address,
                     (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length));
    }
}

void umbd_notify_reloading(void)
{
    char state[80];
    (void)snprintf(state, sizeof state, "RELOADING=1\nMONOTONIC_USEC=%llu",
                   (unsigned long long)(umbu_clock_ns() / 1000));
    umbd_notify(state);
}

/* A decimal number of the environment, or 0. */
static unsigned long long number_of(const char *name)
{
    const char *text = getenv(name);
    char *end;
    if (text == NULL || text[0] < '0' || text[0] > '9') {
        return 0;
    }
    unsigned long long value = strtoull(text, &end, 10);
    return *end == '\0' ? value : 0;
}

unsigned umbd_handed_sockets(void)
{
    unsigned long long count = number_of("LISTEN_FDS");
    if (number_of("LISTEN_PID") != (unsigned long long)getpid() || count > UMBD_LISTEN_MAX) {
        count = 0;
    }
    for (unsigned i = 0; i < count; i++) {
        (void)fcntl(UMBD_HANDED_FIRST + (int)i, F_SETFD, FD_CLOEXEC);
    }
    (void)unsetenv("LISTEN_PID");
    (void)unsetenv("LISTEN_FDS");
    (void)unsetenv("LISTEN_FDNAMES");
    return (unsigned)count;
}

int umbd_handed_is_named(unsigned index, const char *name)
{
    const char *at = getenv("LISTEN_FDNAMES");
    while (at != NULL && index > 0) {
        at = strchr(at, ':');
        at = at != NULL ? at + 1 : NULL;
        index--;
    }
    size_t length = at != NULL ? strcspn(at, ":") : 0;
    return at != NULL && length == strlen(name) && memcmp(at, name, length) == 0;
}

uint64_t umbd_watchdog_ms(void)
{
    unsigned long long pid = number_of("WATCHDOG_PID");
    if (pid != 0 && pid != (unsigned long long)getpid()) {
        return 0;
    }
    uint64_t half_ms = number_of("WATCHDOG_USEC") / 2000;
    return half_ms;
}
