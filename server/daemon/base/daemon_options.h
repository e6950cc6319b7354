/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_DAEMON_OPTIONS_H
#define UMBRAGE_SERVER_DAEMON_BASE_DAEMON_OPTIONS_H
/*
 * The command line and the config file of umbraged, checked. Text fields point into argv, or into
 * memory of the options. The command line overrides the file; a list (store, listen) of the command
 * line replaces the file's.
 * Numbers take suffixes: bytes KiB, MiB, GiB; times ms, s, m (a bare number is seconds).
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "common/log.h"
#include "store/store.h"
#include "daemon/base/net_address.h"
#include "tool/options.h"
#include "umbrage/log.h"
#include "umbrage/status.h"

#define UMBD_LISTEN_MAX 16

struct umbd_option_text; /* opaque */

struct umbd_options {
    const char *stores[UMBS_STORE_FOLDERS_MAX]; /* NULL after the last; there is room for it */
    const char *listen[UMBD_LISTEN_MAX + 1];    /* NULL behind the last */
    size_t listen_count;
    const char *admin;                /* HOST:PORT or NULL */
    const char *address_file;         /* or NULL */
    int copy, warm_up;                /* how assets are held: store.h */
    const char *cache;                /* folder of mapped files, or NULL: in each store */
    uint64_t load_memory;             /* bytes, packed and mapped, of an asset that is loaded */
    uint32_t socket_mode;             /* permissions of Unix sockets */
    const char *token_file;           /* or NULL */
    int without_tokens;               /* allows listening beyond this machine without tokens */
    uint64_t address_rate;            /* points a second for one address, 0 = no limit */
    uint32_t max_address_connections; /* 0 only while options are read: a quarter of all */
    uint64_t address_handshakes;      /* TLS handshakes a second for one address, 0 = no limit */
    uint32_t max_watches;             /* health Watches of connections without rights */
    const char *tls_cert, *tls_key, *tls_client_ca, *tls_crl; /* files, or NULL */
    uint32_t loops;                                           /* threads that own connections */
    uint32_t workers;                                         /* threads of the pool */
    uint32_t queue; /* batches that may wait for the pool */
    uint32_t max_connections;
    uint64_t max_points;        /* a batch */
    uint64_t max_message;       /* bytes */
    uint64_t max_buffer;        /* bytes of requests and replies held, process */
    uint64_t connection_buffer; /* bytes of requests and replies held, one connection */
    uint64_t drain_delay_ms, drain_timeout_ms;
    uint64_t scrub_interval_ms; /* 0 = never */
    uint64_t max_age_ms;        /* longest life of a connection, 0 = no limit */
    uint64_t handshake_timeout_ms, idle_timeout_ms, body_timeout_ms, stall_timeout_ms;
    const char *jobs;                   /* folder of the job service, or NULL */
    const char *jobs_db;                /* file of the job table, NULL = in the folder */
    const char *bake_program;           /* umbrage-bake, NULL = beside this program */
    uint32_t bake_workers;              /* bakes at once */
    uint32_t bake_threads;              /* threads of one bake */
    const char *job_sandbox;            /* required, available, off: of umbrage-bake */
    const char *executor;               /* local, slurm */
    uint64_t executor_interval_ms;      /* between questions to slurm */
    const char *slurm_options;          /* options of sbatch; may be NULL */
    uint32_t bake_tile;                 /* texels along a tile's side: the unit of work */
    uint32_t owner_jobs;                /* unfinished jobs of one owner */
    uint32_t owner_history;             /* Number of finished jobs listed for one owner */
    uint64_t tile_cache;                /* bytes, of one owner's tiles; 0 = none */
    uint64_t bake_memory;               /* bytes, of one bake */
    uint64_t max_bundle, max_asset;     /* bytes */
    uint64_t owner_bytes, job_bytes;    /* bytes of unfinished jobs' bundles: one owner's, all */
    uint64_t owner_assets;              /* Bytes of one owner's assets */
    uint64_t job_time_ms, job_lease_ms; /* time limit and lease of one try */
    uint64_t job_keep_ms;               /* time for which finished jobs are kept */
    enum umb_log_level log_level;
    enum umbs_log_format log_format;
    const char *config;                                  /* file or NULL */
    int config_bad;                                      /* the failure was a line of the file */
    int check, check_files, print_config, help, version; /* requests that replace serving */
    struct umbd_option_text *texts;                      /* texts of the file; owned */
    int argc; /* command line, to be read again on SIGHUP */
    char **argv;
};

/*
 * Reads argv, and the file that it names. Fails: E_ARGUMENT with a message that names the option,
 * the value, its limits, and the file's line; as umbd_config_read. With help or version set no
 * option is required. Finish the options also after a failure.
 */
UMB_CHECKED enum umb_status umbd_options_parse(int argc, char **argv, struct umbd_options *options,
                                               struct umb_error *error);

/* Frees what the options own. */
void umbd_options_finish(struct umbd_options *options);

/*
 * 1 if a listener on that address would serve other machines without any check of callers: no token
 * file, no client certificates, and no --without-tokens.
 */
int umbd_options_serve_anyone(const struct umbd_options *options, enum umbn_transport transport,
                              const struct sockaddr_storage *address);

/* Prints every setting as a config file has it, in the order of the usage. */
void umbd_options_print(const struct umbd_options *options, FILE *out);

/* The table of options. */
extern const struct umbu_command umbd_command;

#endif
