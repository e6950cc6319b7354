/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbraged: answers shadow queries over gRPC on the assets of a folder.
 *
 * Exit codes: 0 after a drain or an information option, 2 for bad arguments, else those of
 * docs/reference/operations.md by status.
 */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sysexits.h>
#include <unistd.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "base/compat.h"
#include "base/try.h"
#include "common/child_process.h"
#include "daemon/daemon.h"
#include "daemon/base/service_manager.h"
#include "daemon/transport/listener.h"
#include "daemon/transport/loop.h"
#include "daemon/work/pool.h"
#include "tool/exit_code.h"
#include "tool/output.h"
#include "umbrage/version.h"

/* Thresholds of malloc. Request and reply blocks are big and short-lived (65536 points are 786 kB).
 * Keeping their pages avoids new page faults for each batch; without this, batches take 1.1 to 1.2
 * times the CPU time (measured). */
#define KEEP_BYTES (32 * 1024 * 1024) /* the most that glibc takes */

#define OTHER_DESCRIPTORS 128   /* besides connections: listeners, the store, the admin port */
#define ASSET_DESCRIPTORS 16384 /* one for each mapped asset */

#if UMB__TSAN
/*
 * Suppressions for ThreadSanitizer. libuv closes descriptors by a bare system call that the
 * sanitizer does not see. The sanitizer then reports the next use of the same number, in the
 * store's thread, as a race on the descriptor. Only reports whose innermost frame is one of these
 * calls are silenced, never one on our own memory.
 */
__attribute__((visibility("default"))) const char *__tsan_default_suppressions(void);
const char *__tsan_default_suppressions(void)
{
    return "race_top:closedir\nrace_top:opendir\nrace_top:close\nrace_top:open\n";
}
#endif

static void keep_pages(void)
{
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, KEEP_BYTES);
    mallopt(M_TRIM_THRESHOLD, 4 * KEEP_BYTES);
#endif
}

/* Descriptors that a connection may take: its socket, and with --http the file that it sends. */
static uint64_t connection_descriptors(const struct umbd_options *options)
{
    return options->http_count > 0 ? 2 : 1;
}

/*
 * Sets the limit of descriptors and returns it. Each connection and each mapped asset takes a
 * descriptor, and the soft limit of many systems is 1024. So the limit is raised before the first
 * scan, which maps the assets. A far higher limit is lowered, because the loops' tables have an
 * entry for every possible descriptor.
 */
static uint64_t raise_descriptors(const struct umbd_options *options)
{
    struct rlimit limit;
    uint64_t wanted = options->max_connections * connection_descriptors(options) +
                      OTHER_DESCRIPTORS + ASSET_DESCRIPTORS;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) {
        return wanted;
    }
    limit.rlim_cur = limit.rlim_max == RLIM_INFINITY || limit.rlim_max > wanted ? (rlim_t)wanted
                                                                                : limit.rlim_max;
    (void)setrlimit(RLIMIT_NOFILE, &limit); /* read again */
    (void)getrlimit(RLIMIT_NOFILE, &limit);
    return limit.rlim_cur;
}

/* Limits connections to the number of descriptors. Without this limit a new connection could wait
 * for a descriptor; closing an idle connection or refusing the new one is better. */
static void limit_connections(struct umbd_daemon *daemon, uint64_t descriptors)
{
    const uint64_t each = connection_descriptors(&daemon->server.options);
    uint64_t needed = daemon->server.options.max_connections * each + OTHER_DESCRIPTORS;
    if (descriptors < needed) {
        daemon->server.max_connections =
            (uint32_t)((descriptors > 2 * OTHER_DESCRIPTORS ? descriptors - OTHER_DESCRIPTORS
                                                            : descriptors / 2) /
                       each);
        umbs_log_event(&daemon->server.log, UMB_LOG_WARN, "descriptors_limited",
                       "limit=%llu wanted=%llu connections=%u option=--max-connections",
                       (unsigned long long)descriptors, (unsigned long long)needed,
                       daemon->server.max_connections);
    }
}

static int complain(enum umb_status status, const struct umb_error *error)
{
    fprintf(stderr, "umbraged: %s\n", error->message);
    return umbu_exit_code(status);
}

static enum umb_status write_line(struct umbu_output *file, const char *text,
                                  struct umb_error *error)
{
    UMB__TRY(umbu_output_write(file, text, strlen(text), error));
    return umbu_output_write(file, "\n", 1, error);
}

/* Writes the chosen addresses, one a line. The file appears complete, so no reader sees half of
 * it. */
static enum umb_status write_addresses(const struct umbd_daemon *daemon, struct umb_error *error)
{
    const char *path = daemon->server.options.address_file;
    const char *admin = umbd_admin_text(daemon);
    struct umbu_output file;
    if (path == NULL) {
        return UMB_OK;
    }
    UMB__TRY(umbu_output_begin(path, 0, &file, error));
    enum umb_status status = UMB_OK;
    const struct umbd_listener *listener = daemon->server.loops->listeners;
    for (; status == UMB_OK && listener != NULL; listener = listener->next) {
        status = write_line(&file, listener->text, error);
    }
    if (status == UMB_OK && admin != NULL) {
        status = write_line(&file, admin, error);
    }
    if (status == UMB_OK) {
        return umbu_output_commit(&file, error);
    }
    umbu_output_abandon(&file);
    return status;
}

/* --- Events of the loops: the server is the daemon's first field --- */

static struct umbd_daemon *daemon_of(struct umbd_server *server)
{
    return (struct umbd_daemon *)(void *)server;
}

/* Sends the service manager a sign of life when one is due. If any loop has not ticked for the
 * watchdog interval, nothing is sent, so the manager notices a hanging loop. */
static void on_tick(struct umbd_server *server, uint64_t now_ms)
{
    struct umbd_daemon *daemon = daemon_of(server);
    umbd_admin_tick(daemon, now_ms);
    if (daemon->watchdog_ms > 0 && now_ms >= daemon->watchdog_at_ms &&
        umbd_loops_tick_age_ms(server) < daemon->watchdog_ms) {
        daemon->watchdog_at_ms = now_ms + daemon->watchdog_ms;
        umbd_notify("WATCHDOG=1");
    }
}

static void on_reload(struct umbd_server *server)
{
    umbd_daemon_reload(daemon_of(server));
}

static void on_drained(struct umbd_server *server)
{
    umbd_admin_close(daemon_of(server));
}

const struct umbd_daemon_events umbd_daemon_events = {on_tick, on_reload, on_drained};

/* Tells that clients are served: the threads of all loops run. */
static enum umb_status announce(struct umbd_server *server, struct umb_error *error)
{
    UMB__TRY(write_addresses(daemon_of(server), error));
    umbs_log_event(&server->log, UMB_LOG_INFO, "ready", "version=%s loops=%u workers=%u pid=%ld",
                   UMB_VERSION_TEXT, server->options.loops, server->options.workers,
                   (long)getpid());
    umbd_notify("READY=1\nSTATUS=serving");
    return UMB_OK;
}

/* Takes the daemon down; does not return if its store is still loading. */
static void take_down(struct umbd_daemon *daemon, enum umb_status status)
{
    umbs_log_event(&daemon->server.log, UMB_LOG_INFO, "stopped", NULL);
    if (!umbd_daemon_finish(daemon)) {
        umbs_log_event(&daemon->server.log, UMB_LOG_WARN, "load_abandoned", NULL);
        _exit(status == UMB_OK ? 0 : umbu_exit_code(status));
    }
}

static enum umb_status run_loops(struct umbd_daemon *daemon, struct umb_error *error)
{
    UMB__TRY(umbd_loops_init(&daemon->server, error));
    UMB__TRY(umbd_listeners_open(daemon->server.loops, error));
    UMB__TRY(umbd_admin_open(daemon, error));
    return umbd_loops_run(&daemon->server, announce, error);
}

static enum umb_status serve(const struct umbd_options *options, const struct umbd_method *methods,
                             struct umb_error *error)
{
    struct umbd_daemon daemon;
    uint64_t descriptors = raise_descriptors(options);
    enum umb_status status = umbd_daemon_init(&daemon, options, methods, error);
    if (status != UMB_OK) {
        complain(status, error);
        return status;
    }
    daemon.server.daemon = &umbd_daemon_events;
    limit_connections(&daemon, descriptors);
    status = run_loops(&daemon, error);
    umbd_daemon_end_jobs(&daemon);
    umbd_admin_close(&daemon);
    umbd_loops_stop(&daemon.server);
    /* Workers may still run tasks of ended calls. These tasks must return before the loops are
     * freed. */
    umbd_pool_destroy(daemon.backend.pool);
    daemon.backend.pool = NULL;
    umbd_loops_finish(&daemon.server);
    if (status != UMB_OK) {
        complain(status, error);
    }
    take_down(&daemon, status);
    return status;
}

int umbd_run(int argc, char **argv, const struct umbd_method *methods)
{
    struct umbd_options options;
    struct umb_error error = {0};
    umbs_standard_streams_open();
    if (argc == 2 && strcmp(argv[1], "--print-options") == 0) {
        umbu_print_rows(&umbd_command, stdout);
        return 0;
    }
    enum umb_status status = umbd_options_parse(argc, argv, &options, &error);
    int code = 0;
    if (status != UMB_OK) {
        code = complain(status, &error);
        code = options.config_bad ? EX_CONFIG : code;
    } else if (options.help) {
        umbu_print_help(&umbd_command, stdout);
    } else if (options.version) {
        printf("umbraged %s\n", UMB_VERSION_TEXT);
    } else if (options.print_config) {
        umbd_options_print(&options, stdout);
    } else if (options.check_files) {
        status = umbd_daemon_check(&options, &error);
        code = status == UMB_OK ? 0 : complain(status, &error);
    } else if (!options.check) {
        signal(SIGPIPE, SIG_IGN);
        keep_pages();
        options.argc = argc;
        options.argv = argv;
        status = serve(&options, methods, &error);
        code = status == UMB_OK ? 0 : umbu_exit_code(status);
    }
    umbd_options_finish(&options);
    return code;
}
