/* SPDX-License-Identifier: Apache-2.0 */
/* Opening listeners: what stands at a Unix path, permissions, addresses that are refused, and
 * sockets that a service manager hands over. A loop without connections: nothing is served. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/daemon.h"
#include "daemon/transport/listener.h"
#include "daemon/base/service_manager.h"

struct fixture {
    char folder[64], path[128], address[160];
    struct umbd_daemon daemon;
    struct umbd_loop loop;
    struct umb_error error;
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-listen-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->path, sizeof f->path, "%s/s", f->folder);
    snprintf(f->address, sizeof f->address, "unix:%s", f->path);
    umbs_log_init(&f->daemon.server.log, open("/dev/null", O_WRONLY | O_CLOEXEC), UMB_LOG_INFO);
    f->daemon.server.options.socket_mode = 0600;
    f->loop.server = &f->daemon.server;
    assert_int_equal(uv_loop_init(&f->loop.uv), 0);
    *state = f;
    return 0;
}

static void close_all(struct fixture *f)
{
    umbd_listeners_close(&f->loop);
    (void)uv_run(&f->loop.uv, UV_RUN_DEFAULT);
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    close_all(f);
    assert_int_equal(uv_loop_close(&f->loop.uv), 0);
    unlink(f->path);
    rmdir(f->folder);
    free(f);
    return 0;
}

static enum umb_status open_at(struct fixture *f, const char *address)
{
    f->daemon.server.options.listen[0] = address;
    f->daemon.server.options.listen_count = 1;
    return umbd_listeners_open(&f->loop, &f->error);
}

/* A socket of the test's own, bound, and listening if asked. */
static int make_socket(int type, const char *path, int listens)
{
    const int fd = socket(path != NULL ? AF_UNIX : AF_INET, type, 0);
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    struct sockaddr_in loopback = {.sin_family = AF_INET,
                                   .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    assert_true(fd >= 0);
    if (path != NULL) {
        snprintf(name.sun_path, sizeof name.sun_path, "%s", path);
        assert_int_equal(bind(fd, (struct sockaddr *)&name, sizeof name), 0);
    } else {
        assert_int_equal(bind(fd, (struct sockaddr *)&loopback, sizeof loopback), 0);
    }
    assert_true(!listens || listen(fd, 1) == 0);
    return fd;
}

static void unix_sockets_have_their_mode_whatever_the_umask(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    static const mode_t modes[] = {0600, 0660, 0777};
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        const mode_t before = umask(0077);
        f->daemon.server.options.socket_mode = modes[i];
        assert_int_equal(open_at(f, f->address), UMB_OK);
        umask(before);
        assert_int_equal(stat(f->path, &facts), 0);
        assert_int_equal(facts.st_mode & 07777, modes[i]);
        assert_string_equal(f->loop.listeners->text, f->address);
        close_all(f);
        assert_int_equal(stat(f->path, &facts), -1); /* it takes its name along */
    }
}

static void a_stale_socket_is_replaced(void **state)
{
    struct fixture *f = *state;
    close(make_socket(SOCK_STREAM, f->path, 1));
    assert_int_equal(open_at(f, f->address), UMB_OK);
}

static void a_socket_that_answers_is_left_alone(void **state)
{
    struct fixture *f = *state;
    struct stat before, after;
    const int other = make_socket(SOCK_STREAM, f->path, 1);
    assert_int_equal(stat(f->path, &before), 0);
    assert_int_equal(open_at(f, f->address), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, f->path));
    close_all(f);
    assert_int_equal(stat(f->path, &after), 0);
    assert_int_equal(before.st_ino, after.st_ino);
    close(other);
}

static void a_file_or_a_link_at_the_path_is_left_alone(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    const int file = open(f->path, O_CREAT | O_WRONLY | O_EXCL, 0644);
    assert_true(file >= 0);
    assert_int_equal(write(file, "mine", 4), 4);
    close(file);
    assert_int_equal(open_at(f, f->address), UMB_E_UNAVAILABLE);
    close_all(f);
    assert_int_equal(stat(f->path, &facts), 0);
    assert_int_equal(facts.st_size, 4);
    assert_int_equal(unlink(f->path), 0);
    assert_int_equal(symlink("nowhere", f->path), 0);
    assert_int_equal(open_at(f, f->address), UMB_E_UNAVAILABLE);
    close_all(f);
    assert_int_equal(lstat(f->path, &facts), 0);
    assert_true(S_ISLNK(facts.st_mode));
}

static void tcp_addresses_in_use_unknown_or_open_to_all_are_refused(void **state)
{
    struct fixture *f = *state;
    assert_int_equal(open_at(f, "tcp:127.0.0.1:0"), UMB_OK);
    char same[UMBD_ADDRESS_TEXT_SIZE];
    memcpy(same, f->loop.listeners->text, sizeof same);
    assert_null(strstr(same, ":0"));
    assert_int_equal(open_at(f, same), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(f->error.message, same));
    assert_int_equal(open_at(f, "tcp:no-such-host.invalid:0"), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "no-such-host.invalid"));
    assert_int_equal(open_at(f, "tcp:0.0.0.0:0"), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "--without-tokens"));
    assert_int_equal(open_at(f, "tcp:[::]:0"), UMB_E_ARGUMENT);
    assert_int_equal(open_at(f, "nothing:1"), UMB_E_ARGUMENT);
    f->daemon.server.options.without_tokens = 1;
    assert_int_equal(open_at(f, "tcp:0.0.0.0:0"), UMB_OK);
}

static void the_loopback_of_ipv6_is_this_machine(void **state)
{
    struct fixture *f = *state;
    const int fd = socket(AF_INET6, SOCK_STREAM, 0);
    const struct sockaddr_in6 here = {.sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT};
    const int is_there = fd >= 0 && bind(fd, (const struct sockaddr *)&here, sizeof here) == 0;
    close(fd);
    if (!is_there) {
        skip();
    }
    assert_int_equal(open_at(f, "tcp:[::1]:0"), UMB_OK);
    assert_non_null(strstr(f->loop.listeners->text, "tcp:[::1]:"));
}

/* Puts a socket at the first descriptor of a service manager, and opens listeners; the former
 * descriptor is put back. */
static enum umb_status open_handed(struct fixture *f, int fd, const char *names)
{
    char pid[32];
    const int kept = fcntl(UMBD_HANDED_FIRST, F_DUPFD_CLOEXEC, 100);
    snprintf(pid, sizeof pid, "%ld", (long)getpid());
    if (fd != UMBD_HANDED_FIRST) {
        assert_int_equal(dup2(fd, UMBD_HANDED_FIRST), UMBD_HANDED_FIRST);
        close(fd);
    }
    assert_int_equal(setenv("LISTEN_PID", pid, 1) | setenv("LISTEN_FDS", "1", 1) |
                         setenv("LISTEN_FDNAMES", names, 1),
                     0);
    enum umb_status status = umbd_listeners_open(&f->loop, &f->error);
    if (status == UMB_OK) {
        assert_int_equal(f->loop.listeners->acceptor.fd, UMBD_HANDED_FIRST);
    }
    close_all(f);
    if (kept >= 0) {
        assert_int_equal(dup2(kept, UMBD_HANDED_FIRST), UMBD_HANDED_FIRST);
        close(kept);
    } else {
        close(UMBD_HANDED_FIRST);
    }
    return status;
}

static void handed_sockets_must_listen_and_be_what_their_names_say(void **state)
{
    struct fixture *f = *state;
    f->daemon.server.options.listen_count = 0;
    assert_int_equal(open_handed(f, make_socket(SOCK_STREAM, NULL, 1), "plain"), UMB_OK);
    assert_int_equal(open_handed(f, make_socket(SOCK_STREAM, NULL, 0), ""), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "not a listening stream socket"));
    assert_int_equal(open_handed(f, make_socket(SOCK_DGRAM, NULL, 0), ""), UMB_E_ARGUMENT);
    assert_int_equal(open_handed(f, open("/dev/null", O_RDONLY), ""), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "descriptor 3"));
    assert_int_equal(open_handed(f, make_socket(SOCK_STREAM, NULL, 1), "tls"), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "--tls-cert"));
    assert_int_equal(open_handed(f, make_socket(SOCK_STREAM, f->path, 1), "tls"), UMB_E_ARGUMENT);
    assert_non_null(strstr(f->error.message, "neither TCP nor a plain Unix socket"));
}

static void a_handed_unix_socket_keeps_its_name_at_the_end(void **state)
{
    struct fixture *f = *state;
    struct stat facts;
    assert_int_equal(open_handed(f, make_socket(SOCK_STREAM, f->path, 1), ""), UMB_OK);
    assert_int_equal(stat(f->path, &facts), 0);
}

int main(void)
{
#define WITH_LOOP(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH_LOOP(unix_sockets_have_their_mode_whatever_the_umask),
        WITH_LOOP(a_stale_socket_is_replaced),
        WITH_LOOP(a_socket_that_answers_is_left_alone),
        WITH_LOOP(a_file_or_a_link_at_the_path_is_left_alone),
        WITH_LOOP(tcp_addresses_in_use_unknown_or_open_to_all_are_refused),
        WITH_LOOP(the_loopback_of_ipv6_is_this_machine),
        WITH_LOOP(handed_sockets_must_listen_and_be_what_their_names_say),
        WITH_LOOP(a_handed_unix_socket_keeps_its_name_at_the_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
