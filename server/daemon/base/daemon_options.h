/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_DAEMON_OPTIONS_H
#define UMBRAGE_SERVER_DAEMON_BASE_DAEMON_OPTIONS_H
/*
 * The command line and the config file of umbraged, checked. Text fields point into argv or into
 * memory of the options. The command line overrides the file. If it has store or listen addresses,
 * they replace all of the file's.
 *
 * Numbers take suffixes: bytes KiB, MiB, GiB; times ms, s, m (a bare number is in seconds).
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "common/log.h"
#include "jobs/service.h"
#include "store/store.h"
#include "daemon/base/net_address.h"
#include "tool/options.h"
#include "umbrage/log.h"
#include "umbrage/status.h"

#define UMBD_LISTEN_MAX  16
#define UMBD_LOOPS_MAX   64
#define UMBD_ORIGIN_SIZE 256 /* bytes of an origin, NUL included */

struct umbd_option_text; /* opaque */

struct umbd_options {
    const char *stores[UMBS_STORE_FOLDERS_MAX]; /* Folders, NULL after the last */
    const char *listen[UMBD_LISTEN_MAX + 1];    /* Addresses, NULL after the last */
    size_t listen_count;
    const char *http[UMBD_LISTEN_MAX + 1]; /* Addresses of HTTP/1.1, NULL after the last */
    size_t http_count;
    const char *http_origins[UMBD_LISTEN_MAX + 1]; /* Origins whose pages may read assets, or "*" */
    const char *admin;                             /* Admin port as HOST:PORT, or NULL */
    const char *address_file;                      /* File, or NULL */
    int copy, warm_up;                /* 1: hold assets in memory; read files ahead (store.h) */
    const char *cache;                /* Folder of mapped files; NULL: one in each store */
    uint64_t load_memory;             /* Bytes of an asset while it is loaded, packed and mapped */
    uint32_t socket_mode;             /* Permissions of Unix sockets */
    const char *token_file;           /* File, or NULL */
    int without_tokens;               /* 1: other machines may query without a token */
    uint64_t address_rate;            /* Points a second for one address, 0 = no limit */
    uint32_t max_address_connections; /* Connections of one address */
    uint64_t address_handshakes;      /* TLS handshakes a second for one address, 0 = no limit */
    uint32_t max_watches;             /* Number of health Watches of connections without rights */
    const char *tls_cert, *tls_key, *tls_client_ca, *tls_crl; /* Files, or NULL */
    uint32_t loops;   /* Number of threads that own connections */
    uint32_t workers; /* Number of threads of the worker pool */
    uint32_t queue;   /* Number of tasks that may wait for a worker */
    uint32_t max_connections;
    uint64_t max_points;        /* Points of a batch */
    uint64_t max_message;       /* Bytes of a request message */
    uint64_t max_buffer;        /* Bytes of requests and replies held in the process */
    uint64_t connection_buffer; /* Bytes of requests and replies held for a connection */
    uint64_t drain_delay_ms, drain_timeout_ms;
    uint64_t scrub_interval_ms; /* Longest time between checks of an asset, 0 = no checks */
    uint64_t max_age_ms;        /* Longest life of a connection, 0 = no limit */
    uint64_t handshake_timeout_ms, idle_timeout_ms, body_timeout_ms, stall_timeout_ms;
    struct umbj_service_options bakes; /* Options of the job service; folder NULL: there is none */
    enum umb_log_level log_level;
    enum umbs_log_format log_format;
    const char *config; /* Config file, or NULL */
    int config_bad;     /* 1: a line of the config file was refused */
    int check, check_files, print_config, help, version; /* 1: requests that replace serving */
    struct umbd_option_text *texts;                      /* Texts of the config file, owned */
    int argc;                                            /* Command line, read again on SIGHUP */
    char **argv;
};

/*
 * Reads argv, and the config file that argv names. With help or version set, no option is required.
 * Finish the options after a failure too. Fails: E_ARGUMENT with a message that names the option,
 * the value, its limits and the file's line; as umbd_config_read.
 */
UMB_CHECKED enum umb_status umbd_options_parse(int argc, char **argv, struct umbd_options *options,
                                               struct umb_error *error);

/* Frees what the options own. */
void umbd_options_finish(struct umbd_options *options);

/*
 * Returns 1 if a listener on that address would serve other machines without any check of callers:
 * there is no token file, no client certificate is required, and --without-tokens is not given.
 */
int umbd_options_serve_anyone(const struct umbd_options *options, enum umbn_transport transport,
                              const struct sockaddr_storage *address);

/* Prints every setting in the form of a config file, in the order of the usage text. */
void umbd_options_print(const struct umbd_options *options, FILE *out);

/* The table of options. */
extern const struct umbu_command umbd_command;

#endif
