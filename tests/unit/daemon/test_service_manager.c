/* SPDX-License-Identifier: Apache-2.0 */
/* What the daemon reads from the environment of a service manager, and what it sends to the
 * manager's socket. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/base/daemon_options.h"
#include "daemon/base/service_manager.h"

static void set_number(const char *name, unsigned long long value)
{
    char text[32];
    snprintf(text, sizeof text, "%llu", value);
    assert_int_equal(setenv(name, text, 1), 0);
}

/* A datagram socket under an abstract name of this process. */
static int listen_abstract(char name[64])
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    const int length = snprintf(name, 64, "@umbrage-notify-%ld", (long)getpid());
    assert_true(fd >= 0 && length > 0 && length < 64);
    memcpy(address.sun_path, name, (size_t)length);
    address.sun_path[0] = '\0';
    assert_int_equal(bind(fd, (struct sockaddr *)&address,
                          (socklen_t)(offsetof(struct sockaddr_un, sun_path) + (size_t)length)),
                     0);
    return fd;
}

static void states_go_to_an_abstract_name_and_to_no_odd_one(void **state)
{
    char name[64], longest[200], got[128];
    (void)state;
    const int fd = listen_abstract(name);
    memset(longest, 'x', sizeof longest - 1);
    longest[0] = '/';
    longest[sizeof longest - 1] = '\0';
    const char *const odd[] = {"", "@", "relative", longest};
    assert_int_equal(unsetenv("NOTIFY_SOCKET"), 0);
    umbd_notify("READY=1");
    for (size_t i = 0; i < sizeof odd / sizeof odd[0]; i++) {
        assert_int_equal(setenv("NOTIFY_SOCKET", odd[i], 1), 0);
        umbd_notify("READY=1");
    }
    assert_int_equal(recv(fd, got, sizeof got, 0), -1);
    assert_int_equal(setenv("NOTIFY_SOCKET", name, 1), 0);
    umbd_notify("READY=1");
    assert_int_equal(recv(fd, got, sizeof got, 0), 7);
    assert_memory_equal(got, "READY=1", 7);
    umbd_notify_reloading();
    const ssize_t size = recv(fd, got, sizeof got - 1, 0);
    assert_true(size > 0);
    got[size] = '\0';
    assert_non_null(strstr(got, "RELOADING=1\nMONOTONIC_USEC="));
    close(fd);
    assert_int_equal(unsetenv("NOTIFY_SOCKET"), 0);
}

static void watchdog_is_of_this_process_and_a_number(void **state)
{
    (void)state;
    assert_int_equal(unsetenv("WATCHDOG_PID"), 0);
    assert_int_equal(unsetenv("WATCHDOG_USEC"), 0);
    assert_int_equal(umbd_watchdog_ms(), 0);
    static const char *const none[] = {"", "soon", "5s", "-1", ":1"};
    for (size_t i = 0; i < sizeof none / sizeof none[0]; i++) {
        assert_int_equal(setenv("WATCHDOG_USEC", none[i], 1), 0);
        assert_int_equal(umbd_watchdog_ms(), 0);
    }
    set_number("WATCHDOG_USEC", 3000000);
    assert_int_equal(umbd_watchdog_ms(), 1500);
    set_number("WATCHDOG_PID", (unsigned long long)getpid());
    assert_int_equal(umbd_watchdog_ms(), 1500);
    set_number("WATCHDOG_PID", (unsigned long long)getpid() + 1);
    assert_int_equal(umbd_watchdog_ms(), 0);
    assert_int_equal(unsetenv("WATCHDOG_PID"), 0);
    assert_int_equal(unsetenv("WATCHDOG_USEC"), 0);
}

static void sockets_are_taken_once_and_only_by_their_process(void **state)
{
    (void)state;
    assert_int_equal(unsetenv("LISTEN_FDS"), 0);
    assert_int_equal(umbd_handed_sockets(), 0);
    set_number("LISTEN_FDS", 1);
    set_number("LISTEN_PID", (unsigned long long)getpid() + 1);
    assert_int_equal(umbd_handed_sockets(), 0);
    set_number("LISTEN_FDS", UMBD_LISTEN_MAX + 1);
    set_number("LISTEN_PID", (unsigned long long)getpid());
    assert_int_equal(umbd_handed_sockets(), 0);
    set_number("LISTEN_FDS", 1);
    set_number("LISTEN_PID", (unsigned long long)getpid());
    assert_int_equal(umbd_handed_sockets(), 1);
    assert_null(getenv("LISTEN_FDS"));
    assert_int_equal(umbd_handed_sockets(), 0);
}

static void names_of_sockets_are_whole_words_between_colons(void **state)
{
    (void)state;
    assert_int_equal(unsetenv("LISTEN_FDNAMES"), 0);
    assert_false(umbd_handed_is_named(0, "tls"));
    assert_int_equal(setenv("LISTEN_FDNAMES", "plain:tls:tls2:tlx", 1), 0);
    assert_false(umbd_handed_is_named(0, "tls"));
    assert_true(umbd_handed_is_named(1, "tls"));
    assert_false(umbd_handed_is_named(2, "tls"));
    assert_false(umbd_handed_is_named(3, "tls"));
    assert_false(umbd_handed_is_named(4, "tls"));
    assert_int_equal(unsetenv("LISTEN_FDNAMES"), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(states_go_to_an_abstract_name_and_to_no_odd_one),
        cmocka_unit_test(watchdog_is_of_this_process_and_a_number),
        cmocka_unit_test(sockets_are_taken_once_and_only_by_their_process),
        cmocka_unit_test(names_of_sockets_are_whole_words_between_colons),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
