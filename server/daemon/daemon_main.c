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
#include "common/child_process.h"
#include "daemon/admin.h"
#include "daemon/listener.h"
#include "daemon/loop_group.h"
#include "daemon/service_manager.h"
#include "tool/exit_code.h"
#include "tool/output.h"
#include "umbrage/version.h"

/* Request and reply blocks are big and short-lived. Keeping their pages avoids new page faults for
 * each batch (65536 points are 786 kB; measured: 1.1 to 1.2 times the CPU otherwise). */
#define KEEP_BYTES (32 * 1024 * 1024) /* the most that glibc takes */

#define OTHER_DESCRIPTORS 128   /* besides connections: listeners, the store, the admin port */
#define ASSET_DESCRIPTORS 16384 /* one for each mapped asset */

#if UMB__TSAN
/*
 * libuv closes descriptors by a bare system call that ThreadSanitizer does not see. It then reports
 * the next use of the same number, in the store's thread, as a race on the descriptor. Only reports
 * whose innermost frame is one of these calls are silenced: never one on our own memory.
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

/*
 * Sets the limit of descriptors. Each connection and each mapped asset takes one; the soft limit of
 * many systems is 1024. The limit is raised before the first scan, which maps the assets. If it is
 * far higher it is lowered: the loops' tables have a place for every descriptor (loop_reserve.h).
 * Returns the limit.
 */
static uint64_t raise_descriptors(const struct umbd_options *options)
{
    struct rlimit limit;
    uint64_t wanted = (uint64_t)options->max_connections + OTHER_DESCRIPTORS + ASSET_DESCRIPTORS;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) {
        return wanted;
    }
    limit.rlim_cur = limit.rlim_max == RLIM_INFINITY || limit.rlim_max > wanted ? (rlim_t)wanted
                                                                                : limit.rlim_max;
    (void)setrlimit(RLIMIT_NOFILE, &limit); /* read again */
    (void)getrlimit(RLIMIT_NOFILE, &limit);
    return limit.rlim_cur;
}

/* Limits connections to the number of descriptors. Closing an idle connection, or refusing a new
 * one, is better than letting it wait for a descriptor. */
static void limit_connections(struct umbd_daemon *daemon, uint64_t descriptors)
{
    uint64_t needed = (uint64_t)daemon->options.max_connections + OTHER_DESCRIPTORS;
    if (descriptors < needed) {
        daemon->max_connections =
            (uint32_t)(descriptors > 2 * OTHER_DESCRIPTORS ? descriptors - OTHER_DESCRIPTORS
                                                           : descriptors / 2);
        umbs_log_event(&daemon->log, UMB_LOG_WARN, "descriptors_limited",
                       "limit=%llu wanted=%llu connections=%u option=--max-connections",
                       (unsigned long long)descriptors, (unsigned long long)needed,
                       daemon->max_connections);
    }
}

static int complain(enum umb_status status, const struct umb_error *error)
{
    fprintf(stderr, "umbraged: %s\n", error->message);
    return umbu_exit_code(status);
}

/* Writes the chosen addresses, one a line. The file appears whole, so no reader sees half of it. */
static enum umb_status write_addresses(const struct umbd_loop *loop, struct umb_error *error)
{
    const char *path = loop->daemon->options.address_file;
    struct umbu_output file;
    if (path == NULL) {
        return UMB_OK;
    }
    enum umb_status status = umbu_output_begin(path, 0, &file, error);
    if (status != UMB_OK) {
        return status;
    }
    const struct umbd_listener *listener = loop->listeners;
    while (status == UMB_OK && listener != NULL) {
        status = umbu_output_write(&file, listener->text, strlen(listener->text), error);
        if (status == UMB_OK) {
            status = umbu_output_write(&file, "\n", 1, error);
        }
        listener = listener->next;
    }
    const char *admin = umbd_admin_text(loop);
    if (status == UMB_OK && admin != NULL) {
        status = umbu_output_write(&file, admin, strlen(admin), error);
        if (status == UMB_OK) {
            status = umbu_output_write(&file, "\n", 1, error);
        }
    }
    if (status == UMB_OK) {
        return umbu_output_commit(&file, error);
    }
    umbu_output_abandon(&file);
    return status;
}

/* Tells that clients are served: the threads of all loops run. */
static enum umb_status announce(struct umbd_daemon *daemon, struct umb_error *error)
{
    const struct umbd_options *options = &daemon->options;
    const enum umb_status status = write_addresses(daemon->loops, error);
    if (status == UMB_OK) {
        umbs_log_event(&daemon->log, UMB_LOG_INFO, "ready",
                       "version=%s loops=%u workers=%u pid=%ld", UMB_VERSION_TEXT, options->loops,
                       options->workers, (long)getpid());
        umbd_notify("READY=1\nSTATUS=serving");
    }
    return status;
}

/* Takes the daemon down; does not return if its store is still loading. */
static void take_down(struct umbd_daemon *daemon, enum umb_status status)
{
    umbs_log_event(&daemon->log, UMB_LOG_INFO, "stopped", NULL);
    if (!umbd_daemon_finish(daemon)) {
        umbs_log_event(&daemon->log, UMB_LOG_WARN, "load_abandoned", NULL);
        _exit(status == UMB_OK ? 0 : umbu_exit_code(status));
    }
}

static enum umb_status serve(const struct umbd_options *options, struct umb_error *error)
{
    struct umbd_daemon daemon;
    uint64_t descriptors = raise_descriptors(options);
    enum umb_status status = umbd_daemon_init(&daemon, options, error);
    if (status != UMB_OK) {
        complain(status, error);
        return status;
    }
    limit_connections(&daemon, descriptors);
    status = umbd_loops_init(&daemon, error);
    struct umbd_loop *loop = daemon.loops; /* the loop that listens */
    if (status == UMB_OK) {
        status = umbd_listeners_open(loop, error);
    }
    if (status == UMB_OK) {
        status = umbd_admin_open(loop, error);
    }
    if (status == UMB_OK) {
        status = umbd_loops_run(&daemon, announce, error);
    }
    umbd_daemon_end_jobs(&daemon);
    umbd_loops_finish(&daemon);
    if (status != UMB_OK) {
        complain(status, error);
    }
    take_down(&daemon, status);
    return status;
}

int main(int argc, char **argv)
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
        status = serve(&options, &error);
        code = status == UMB_OK ? 0 : umbu_exit_code(status);
    }
    umbd_options_finish(&options);
    return code;
}
