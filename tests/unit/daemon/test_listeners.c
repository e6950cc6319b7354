/* SPDX-License-Identifier: Apache-2.0 */
/* Opening listeners, also those that a service manager hands over, and the admin port's answers. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/daemon.h"
#include "daemon/transport/listener.h"
#include "daemon/base/service_manager.h"

/* A daemon of which only the loop's listeners and the admin port work. */
struct place {
    struct umbd_daemon daemon;
    struct umbd_loop loop;
    char folder[64], path[96], unix_text[128];
};

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    assert_non_null(place);
    if (fcntl(UMBD_HANDED_FIRST, F_GETFD) < 0) { /* kept from the loop for what is handed over */
        assert_int_equal(dup2(STDERR_FILENO, UMBD_HANDED_FIRST), UMBD_HANDED_FIRST);
    }
    snprintf(place->folder, sizeof place->folder, "/tmp/umbrage-listeners-XXXXXX");
    assert_non_null(mkdtemp(place->folder));
    snprintf(place->path, sizeof place->path, "%s/socket", place->folder);
    snprintf(place->unix_text, sizeof place->unix_text, "unix:%s", place->path);
    umbs_log_init(&place->daemon.server.log, STDERR_FILENO, UMB_LOG_ERROR);
    place->daemon.server.loops = &place->loop;
    place->daemon.server.loop_count = 1;
    place->loop.server = &place->daemon.server;
    umbd_bucket_init(&place->loop.log_budget, 1, 1, uv_hrtime());
    assert_int_equal(uv_loop_init(&place->loop.uv), 0);
    *state = place;
    return 0;
}

static void close_all(struct place *place)
{
    umbd_listeners_close(&place->loop);
    umbd_admin_close(&place->daemon);
    (void)uv_run(&place->loop.uv, UV_RUN_DEFAULT);
}

static int tear_down(void **state)
{
    struct place *place = *state;
    close_all(place);
    assert_int_equal(uv_loop_close(&place->loop.uv), 0);
    (void)unlink(place->path);
    (void)rmdir(place->folder);
    free(place);
    return 0;
}

static enum umb_status open_at(struct place *place, const char *text, struct umb_error *error)
{
    place->daemon.server.options.listen[0] = text;
    place->daemon.server.options.listen_count = 1;
    return umbd_listeners_open(&place->loop, error);
}

static void port_0_becomes_a_real_one_that_nobody_else_gets(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    assert_int_equal(open_at(place, "tcp:127.0.0.1:0", &error), UMB_OK);
    char text[UMBD_ADDRESS_TEXT_SIZE];
    memcpy(text, place->loop.listeners->text, sizeof text);
    assert_int_equal(strncmp(text, "tcp:127.0.0.1:", 14), 0);
    assert_int_not_equal(strtol(text + 14, NULL, 10), 0);
    assert_int_equal(open_at(place, text, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "--listen"));
    assert_int_equal(open_at(place, "tcp:no.such.host.invalid:1", &error), UMB_E_ARGUMENT);
}

static void a_unix_socket_that_nobody_serves_is_replaced_one_that_is_served_is_not(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    snprintf(name.sun_path, sizeof name.sun_path, "%s", place->path);
    int stale = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(stale, (struct sockaddr *)&name, sizeof name), 0);
    close(stale); /* its file stays */
    assert_int_equal(open_at(place, place->unix_text, &error), UMB_OK);
    assert_string_equal(place->loop.listeners->text, place->unix_text);
    assert_int_equal(open_at(place, place->unix_text, &error), UMB_E_UNAVAILABLE);
    close_all(place);
    assert_int_not_equal(access(place->path, F_OK), 0); /* removed at the end */
    FILE *file = fopen(place->path, "w");
    assert_non_null(file);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(open_at(place, place->unix_text, &error), UMB_E_UNAVAILABLE);
    assert_int_equal(access(place->path, F_OK), 0); /* no socket: left alone */
}

/* Puts a descriptor where a service manager puts it, and sets the variables of the environment. */
static void hand_over(int fd, const char *names)
{
    char number[24];
    assert_int_equal(dup2(fd, UMBD_HANDED_FIRST), UMBD_HANDED_FIRST);
    if (fd != UMBD_HANDED_FIRST) {
        close(fd);
    }
    snprintf(number, sizeof number, "%d", (int)getpid());
    assert_int_equal(setenv("LISTEN_PID", number, 1), 0);
    assert_int_equal(setenv("LISTEN_FDS", "1", 1), 0);
    assert_int_equal(names != NULL ? setenv("LISTEN_FDNAMES", names, 1) : 0, 0);
}

static int make_socket(int family, int type, int listens)
{
    struct sockaddr_in v4 = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct sockaddr_un local = {.sun_family = AF_UNIX}; /* no path: the kernel names it */
    int fd = socket(family, type | SOCK_CLOEXEC, 0);
    assert_true(fd >= 0);
    assert_int_equal(family == AF_INET ? bind(fd, (struct sockaddr *)&v4, sizeof v4)
                                       : bind(fd, (struct sockaddr *)&local, sizeof(sa_family_t)),
                     0);
    assert_int_equal(listens ? listen(fd, 4) : 0, 0);
    return fd;
}

static void handed_sockets_must_listen_and_be_what_their_name_says(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    static const struct {
        int family, type, listens;
        const char *names, *reason;
    } cases[] = {
        {AF_INET, SOCK_STREAM, 0, NULL, "not a listening"},
        {AF_INET, SOCK_DGRAM, 0, NULL, "not a listening"},
        {AF_UNIX, SOCK_STREAM, 1, "tls", "neither TCP nor a plain Unix"},
        {AF_INET, SOCK_STREAM, 1, "tls", "--tls-cert"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        hand_over(make_socket(cases[i].family, cases[i].type, cases[i].listens), cases[i].names);
        assert_int_equal(umbd_listeners_open(&place->loop, &error), UMB_E_ARGUMENT);
        assert_non_null(strstr(error.message, cases[i].reason));
        assert_null(getenv("LISTEN_FDS")); /* our children get none */
    }
    hand_over(make_socket(AF_INET, SOCK_STREAM, 1), "other");
    assert_int_equal(umbd_listeners_open(&place->loop, &error), UMB_OK);
    assert_int_equal(strncmp(place->loop.listeners->text, "tcp:127.0.0.1:", 14), 0);
    umbd_listeners_close(&place->loop);
    (void)uv_run(&place->loop.uv, UV_RUN_NOWAIT);
}

/* --- the admin port --- */

static int connect_admin(struct place *place)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    to.sin_port =
        htons((uint16_t)strtol(strrchr(umbd_admin_text(&place->daemon), ':') + 1, NULL, 10));
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    return fd;
}

/* Runs the loop until the peer has closed; returns what the peer sent. */
static const char *read_all(struct place *place, int fd)
{
    static char answer[4096];
    size_t size = 0;
    for (ssize_t got = -1; got != 0;) {
        (void)uv_run(&place->loop.uv, UV_RUN_NOWAIT);
        got = recv(fd, answer + size, sizeof answer - 1 - size, MSG_DONTWAIT);
        assert_true(got >= 0 || errno == EAGAIN || errno == ECONNRESET);
        if (got < 0 && errno == ECONNRESET) {
            break;
        }
        size += got > 0 ? (size_t)got : 0;
    }
    answer[size] = '\0';
    close(fd);
    return answer;
}

static const char *asked(struct place *place, const char *request)
{
    int fd = connect_admin(place);
    assert_int_equal(send(fd, request, strlen(request), MSG_NOSIGNAL), (ssize_t)strlen(request));
    return read_all(place, fd);
}

static void the_admin_port_answers_what_it_should_and_refuses_the_rest(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    place->daemon.server.options.admin = "127.0.0.1:0";
    assert_int_equal(umbd_admin_open(&place->daemon, &error), UMB_OK);
    static const struct {
        const char *request, *answer;
    } cases[] = {
        {"GET /livez HTTP/1.1\r\nHost: localhost:1\r\n\r\n", "HTTP/1.1 200"},
        {"GET /livez?x HTTP/1.0\r\n\r\n", "ok\n"},
        {"GET /readyz HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n", "HTTP/1.1 200"},
        {"GET /readyz HTTP/1.1\r\nHost: [::1]:9\r\n\r\n", "HTTP/1.1 200"},
        {"GET /nope HTTP/1.1\r\n\r\n", "HTTP/1.1 404"},
        {"POST /livez HTTP/1.1\r\n\r\n", "HTTP/1.1 405"},
        {"GET /livez HTTP/1.1\r\nHost: evil.example\r\n\r\n", "HTTP/1.1 421"},
        {"GET /livez HTTP/1.1\r\nHost: 127.0.0.1.evil\r\n\r\n", "HTTP/1.1 421"},
        {"GET /livez HTTP/1.1\r\nHost: localhost.evil\r\n\r\n", "HTTP/1.1 421"},
        {"nonsense\r\n\r\n", "HTTP/1.1 400"},
        {"GET /livez HTTP/2\r\n\r\n", "HTTP/1.1 400"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *answer = asked(place, cases[i].request);
        if (strstr(answer, cases[i].answer) == NULL) {
            fail_msg("%s: %s", cases[i].request, answer);
        }
    }
    const char *head = asked(place, "HEAD /livez HTTP/1.1\r\n\r\n");
    assert_non_null(strstr(head, "Content-Length: 3"));
    assert_null(strstr(head, "ok\n"));
    atomic_store(&place->daemon.server.draining, 1);
    assert_non_null(strstr(asked(place, "GET /readyz HTTP/1.1\r\n\r\n"), "HTTP/1.1 503"));
    char line[8192];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = '\0';
    assert_string_equal(asked(place, line), ""); /* longer than a request may be */
}

static void a_silent_client_of_the_admin_port_makes_room_and_has_its_time(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    place->daemon.server.options.admin = "127.0.0.1:0";
    assert_int_equal(umbd_admin_open(&place->daemon, &error), UMB_OK);
    int silent[40];
    for (size_t i = 0; i < sizeof silent / sizeof silent[0]; i++) {
        silent[i] = connect_admin(place);
        (void)uv_run(&place->loop.uv, UV_RUN_NOWAIT); /* its queue is short */
    }
    assert_non_null(strstr(asked(place, "GET /livez HTTP/1.1\r\n\r\n"), "HTTP/1.1 200"));
    assert_string_equal(read_all(place, silent[0]), ""); /* made room */
    umbd_admin_tick(&place->daemon, uv_now(&place->loop.uv) + 6000);
    for (size_t i = 1; i < sizeof silent / sizeof silent[0]; i++) {
        assert_string_equal(read_all(place, silent[i]), ""); /* their time is over */
    }
}

static void the_admin_port_listens_on_loopback_only_and_on_a_free_port(void **state)
{
    struct place *place = *state;
    struct umb_error error;
    assert_int_equal(umbd_admin_open(&place->daemon, &error), UMB_OK); /* none is asked for */
    assert_null(umbd_admin_text(&place->daemon));
    place->daemon.server.options.admin = "0.0.0.0:0";
    assert_int_equal(umbd_admin_open(&place->daemon, &error), UMB_E_ARGUMENT);
    assert_int_equal(open_at(place, "tcp:127.0.0.1:0", &error), UMB_OK);
    place->daemon.server.options.admin = place->loop.listeners->text + 4;
    assert_int_equal(umbd_admin_open(&place->daemon, &error), UMB_E_UNAVAILABLE);
    assert_non_null(strstr(error.message, "--admin"));
}

int main(void)
{
#define AT_A_PLACE(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        AT_A_PLACE(port_0_becomes_a_real_one_that_nobody_else_gets),
        AT_A_PLACE(a_unix_socket_that_nobody_serves_is_replaced_one_that_is_served_is_not),
        AT_A_PLACE(handed_sockets_must_listen_and_be_what_their_name_says),
        AT_A_PLACE(the_admin_port_answers_what_it_should_and_refuses_the_rest),
        AT_A_PLACE(a_silent_client_of_the_admin_port_makes_room_and_has_its_time),
        AT_A_PLACE(the_admin_port_listens_on_loopback_only_and_on_a_free_port),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
