/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Command line of umbraged: one table of options, each with its kind and limits, so that every
 * check and every message is made in one place.
 */
#include "daemon/daemon_options.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/log.h"
#include "daemon/config_file.h"
#include "daemon/loop_group.h"
#include "daemon/net_address.h"

enum kind {
    KIND_TEXT,
    KIND_LISTEN,
    KIND_STORE,
    KIND_COUNT, /* uint32 */
    KIND_TOTAL, /* uint64 */
    KIND_BYTES, /* uint64 */
    KIND_TIME,  /* uint64, milliseconds */
    KIND_LEVEL,
    KIND_LOG_FORMAT,
    KIND_FLAG,
    KIND_MODE, /* uint32, octal */
};

struct option {
    const char *name;
    enum kind kind;
    size_t offset;
    uint64_t minimum, maximum;
    const char *value, *help;
};

#define AT(field) offsetof(struct umbd_options, field)
#define HOUR_MS   ((uint64_t)3600 * 1000)

static const struct option table[] = {
    {"--store", KIND_STORE, 0, 0, 0, "DIR",
     "folder of packed assets (required); may be repeated, the first that has a name serves it"},
    {"--listen", KIND_LISTEN, 0, 0, 0, "ADDRESS",
     "tcp:HOST:PORT, tls:HOST:PORT or unix:PATH; may be repeated; default tcp:127.0.0.1:7420; "
     "port 0 picks one"},
    {"--cache", KIND_TEXT, AT(cache), 0, 0, "DIR",
     "folder of mapped files that only this user can change; if not given, CACHE_DIRECTORY of "
     "systemd, else .umbrage-cache in each store that no other user can change, else memory"},
    {"--load-memory", KIND_BYTES, AT(load_memory), 1 << 20, (uint64_t)1 << 50, "BYTES",
     "limit of one asset's packed and expanded size together while it is loaded; three quarters "
     "of this machine's memory if not given"},
    {"--socket-mode", KIND_MODE, AT(socket_mode), 0600, 0777, "MODE",
     "permissions of unix: sockets, in octal, regardless of the umask; default 0660"},
    {"--copy", KIND_FLAG, AT(copy), 0, 0, NULL,
     "hold assets in memory, so that nothing done to their files matters"},
    {"--warm-up", KIND_FLAG, AT(warm_up), 0, 0, NULL,
     "read an asset's file ahead when it is opened"},
    {"--scrub-interval", KIND_TIME, AT(scrub_interval_ms), 0, 31 * 24 * HOUR_MS, "TIME",
     "longest time between two checks of a mapped asset, 0 = no checks; default 60m"},
    {"--tls-cert", KIND_TEXT, AT(tls_cert), 0, 0, "FILE",
     "certificate chain (PEM) of the tls: addresses; read again on SIGHUP"},
    {"--tls-key", KIND_TEXT, AT(tls_key), 0, 0, "FILE", "its private key (PEM)"},
    {"--tls-client-ca", KIND_TEXT, AT(tls_client_ca), 0, 0, "FILE",
     "clients of tls: must show a certificate of these authorities (PEM)"},
    {"--tls-crl", KIND_TEXT, AT(tls_crl), 0, 0, "FILE",
     "revocation lists (PEM), one for each authority of --tls-client-ca; read again on SIGHUP"},
    {"--loops", KIND_COUNT, AT(loops), 1, UMBD_LOOPS_MAX, "N",
     "threads that own connections; one for four cores if not given"},
    {"--workers", KIND_COUNT, AT(workers), 1, 1024, "N",
     "threads that answer; default: one a core"},
    {"--admin", KIND_TEXT, AT(admin), 0, 0, "HOST:PORT",
     "plain HTTP for /metrics, /livez, /readyz; loopback only; off by default"},
    {"--max-points", KIND_TOTAL, AT(max_points), 1, (uint64_t)1 << 28, "N",
     "points in a batch; default 4194304"},
    {"--max-message", KIND_BYTES, AT(max_message), 1024, (uint64_t)2 << 30, "BYTES",
     "size of a request message; default 64MiB"},
    {"--max-buffer", KIND_BYTES, AT(max_buffer), 1 << 20, (uint64_t)1 << 40, "BYTES",
     "requests and replies held at once; default 1GiB"},
    {"--connection-buffer", KIND_BYTES, AT(connection_buffer), 1 << 16, (uint64_t)1 << 40, "BYTES",
     "the same for one connection; default 256MiB"},
    {"--max-connections", KIND_COUNT, AT(max_connections), 1, 1000000, "N",
     "connections at once; default 4096"},
    {"--max-address-connections", KIND_COUNT, AT(max_address_connections), 1, 1000000, "N",
     "connections of one address (IPv6: of its /64) at once; a quarter of --max-connections if not "
     "given"},
    {"--address-handshakes", KIND_TOTAL, AT(address_handshakes), 0, 1000000, "N",
     "TLS handshakes a second of one address, 0 = no limit; default 100"},
    {"--max-watches", KIND_COUNT, AT(max_watches), 0, 1000000, "N",
     "health Watches of all connections without rights; each has at most one; default 64"},
    {"--address-rate", KIND_TOTAL, AT(address_rate), 0, (uint64_t)1000000000000, "N",
     "points a second that one address may ask; default 0; then any number"},
    {"--token-file", KIND_TEXT, AT(token_file), 0, 0, "FILE",
     "tokens of callers: lines of NAME SCOPES TOKEN [POINTS_PER_SECOND]; read again on SIGHUP"},
    {"--without-tokens", KIND_FLAG, AT(without_tokens), 0, 0, NULL,
     "let other machines query without --token-file and --tls-client-ca"},
    {"--jobs", KIND_TEXT, AT(jobs), 0, 0, "DIR",
     "take scenes over the network and bake them; all about them is in DIR, which is no --store"},
    {"--jobs-db", KIND_TEXT, AT(jobs_db), 0, 0, "FILE",
     "job table, on a local disk; jobs.db in the folder of --jobs if not given"},
    {"--bake-program", KIND_TEXT, AT(bake_program), 0, 0, "FILE",
     "umbrage-bake; the one beside this program if not given"},
    {"--job-sandbox", KIND_TEXT, AT(job_sandbox), 0, 0, "MODE",
     "sandbox of the bakes of jobs: required (every layer, or the job fails), available (the "
     "layers that the kernel has) or off; default required"},
    {"--bake-workers", KIND_COUNT, AT(bake_workers), 1, 256, "N", "bakes at once; default 1"},
    {"--executor", KIND_TEXT, AT(executor), 0, 0, "NAME",
     "place of bakes: local (this machine, the default) or slurm (tiles as array jobs)"},
    {"--executor-interval", KIND_TIME, AT(executor_interval_ms), 100, HOUR_MS, "TIME",
     "between status requests to slurm; default 2s"},
    {"--slurm-options", KIND_TEXT, AT(slurm_options), 0, 0, "TEXT",
     "more options of sbatch, with blanks between, as --partition=bake"},
    {"--bake-tile", KIND_COUNT, AT(bake_tile), 64, 32768, "N",
     "texels a side of a tile, the unit of work, a power of two; default 2048"},
    {"--bake-threads", KIND_COUNT, AT(bake_threads), 1, 256, "N",
     "threads of one bake; default: one a core"},
    {"--bake-memory", KIND_BYTES, AT(bake_memory), 16 << 20, (uint64_t)1 << 50, "BYTES",
     "memory of one bake; default 4GiB"},
    {"--tile-cache", KIND_BYTES, AT(tile_cache), 0, (uint64_t)1 << 50, "BYTES",
     "baked tiles kept for each owner, so that retries and edits go faster; default 10GiB"},
    {"--job-time", KIND_TIME, AT(job_time_ms), 1000, 31 * 24 * HOUR_MS, "TIME",
     "longest that one bake may take; default 240m"},
    {"--job-lease", KIND_TIME, AT(job_lease_ms), 1000, 31 * 24 * HOUR_MS, "TIME",
     "longest that a bake may give no sign of life; default 15m"},
    {"--job-keep", KIND_TIME, AT(job_keep_ms), 60000, 3660 * 24 * HOUR_MS, "TIME",
     "for jobs that are over, then they are forgotten; default 43200m (30 days)"},
    {"--max-bundle", KIND_BYTES, AT(max_bundle), 1024, (uint64_t)1 << 44, "BYTES",
     "files of one submission together; default 1GiB"},
    {"--max-asset", KIND_BYTES, AT(max_asset), 1024, (uint64_t)1 << 44, "BYTES",
     "size of what one bake makes; default 16GiB"},
    {"--owner-jobs", KIND_COUNT, AT(owner_jobs), 1, 1000000, "N",
     "unfinished jobs of one owner; default 64"},
    {"--owner-bytes", KIND_BYTES, AT(owner_bytes), 1024, (uint64_t)1 << 50, "BYTES",
     "files of all of them together; default 4GiB"},
    {"--owner-assets", KIND_BYTES, AT(owner_assets), 1024, (uint64_t)1 << 50, "BYTES",
     "size of the assets kept for one owner's jobs; default 64GiB"},
    {"--owner-history", KIND_COUNT, AT(owner_history), 1, 1000000, "N",
     "finished jobs listed for one owner, the oldest are forgotten; default 10000"},
    {"--job-bytes", KIND_BYTES, AT(job_bytes), 1024, (uint64_t)1 << 50, "BYTES",
     "files of all owners' unfinished jobs together; default 16GiB"},
    {"--queue", KIND_COUNT, AT(queue), 1, 1000000, "N",
     "batches that may wait for a worker; default 1024"},
    {"--log-level", KIND_LEVEL, AT(log_level), 0, 0, "LEVEL",
     "error, warn, info or debug; default info"},
    {"--log-format", KIND_LOG_FORMAT, AT(log_format), 0, 0, "FORMAT",
     "text (key=value) or json, one line an event; default text"},
    {"--drain-delay", KIND_TIME, AT(drain_delay_ms), 0, HOUR_MS, "TIME",
     "from SIGTERM to the end of listening; default 5s"},
    {"--drain-timeout", KIND_TIME, AT(drain_timeout_ms), 0, HOUR_MS, "TIME",
     "for calls under way after that; default 30s"},
    {"--handshake-timeout", KIND_TIME, AT(handshake_timeout_ms), 100, HOUR_MS, "TIME",
     "from connect to HTTP/2 settings; default 10s"},
    {"--idle-timeout", KIND_TIME, AT(idle_timeout_ms), 100, 24 * HOUR_MS, "TIME",
     "of a connection without calls; default 5m"},
    {"--max-age", KIND_TIME, AT(max_age_ms), 0, 31 * 24 * HOUR_MS, "TIME",
     "after which a connection is asked to go, give or take a tenth, so that balancers spread "
     "their clients anew, 0 = never; default 0"},
    {"--body-timeout", KIND_TIME, AT(body_timeout_ms), 100, HOUR_MS, "TIME",
     "for a request to arrive, and 1 s more a 64 KiB; default 30s"},
    {"--stall-timeout", KIND_TIME, AT(stall_timeout_ms), 100, HOUR_MS, "TIME",
     "for a reply that the peer does not take, or takes at below 16 KiB/s; default 30s"},
    {"--address-file", KIND_TEXT, AT(address_file), 0, 0, "FILE",
     "gets the addresses listened on, one a line, once they are open"},
    {"--config", KIND_TEXT, AT(config), 0, 0, "FILE",
     "options as lines of name = value; the command line goes before it"},
    {"--check", KIND_FLAG, AT(check_files), 0, 0, NULL,
     "check the options and the files and folders that they name, and exit"},
    {"--check-config", KIND_FLAG, AT(check), 0, 0, NULL, "check the options alone, and exit"},
    {"--print-config", KIND_FLAG, AT(print_config), 0, 0, NULL,
     "print every setting as a config file and exit"},
    {"--help", KIND_FLAG, AT(help), 0, 0, NULL, "this text"},
    {"--version", KIND_FLAG, AT(version), 0, 0, NULL, "the version"},
};
#define OPTION_COUNT (sizeof table / sizeof table[0])

struct suffix {
    const char *text;
    uint64_t factor;
};

static const struct suffix byte_suffixes[] = {
    {"", 1}, {"KiB", 1024}, {"MiB", 1 << 20}, {"GiB", 1 << 30}, {NULL, 0}};
static const struct suffix time_suffixes[] = {
    {"", 1000}, {"ms", 1}, {"s", 1000}, {"m", 60000}, {NULL, 0}};
static const struct suffix no_suffixes[] = {{"", 1}, {NULL, 0}};

/* Reads digits and a suffix; returns 1, or 0 for anything else and for overflow. */
static int parse_number(const char *text, const struct suffix *suffixes, uint64_t *value)
{
    uint64_t number = 0;
    size_t at = 0;
    for (; text[at] >= '0' && text[at] <= '9'; at++) {
        uint64_t digit = (uint64_t)(text[at] - '0');
        if (number > (UINT64_MAX - digit) / 10) {
            return 0;
        }
        number = number * 10 + digit;
    }
    if (at == 0) {
        return 0;
    }
    for (; suffixes->text != NULL; suffixes++) {
        if (strcmp(text + at, suffixes->text) == 0) {
            if (number > UINT64_MAX / suffixes->factor) {
                return 0;
            }
            *value = number * suffixes->factor;
            return 1;
        }
    }
    return 0;
}

static enum umb_status set_number(const struct option *option, const char *text,
                                  struct umbd_options *options, struct umb_error *error)
{
    uint64_t value = 0;
    const struct suffix *suffixes = option->kind == KIND_BYTES  ? byte_suffixes
                                    : option->kind == KIND_TIME ? time_suffixes
                                                                : no_suffixes;
    const char *unit = option->kind == KIND_BYTES  ? " bytes (KiB, MiB, GiB)"
                       : option->kind == KIND_TIME ? " milliseconds (ms, s, m; bare: s)"
                                                   : "";
    if (!parse_number(text, suffixes, &value) || value < option->minimum ||
        value > option->maximum) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.80s' is not in %llu..%llu%s", option->name,
                        text, (unsigned long long)option->minimum,
                        (unsigned long long)option->maximum, unit);
    }
    char *field = (char *)options + option->offset;
    if (option->kind == KIND_COUNT) {
        uint32_t narrow = (uint32_t)value;
        memcpy(field, &narrow, sizeof narrow);
    } else {
        memcpy(field, &value, sizeof value);
    }
    return UMB_OK;
}

static enum umb_status set_listen(const char *text, struct umbd_options *options,
                                  struct umb_error *error)
{
    struct umbn_address address;
    if (options->listen_count == UMBD_LISTEN_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "--listen: more than %d addresses", UMBD_LISTEN_MAX);
    }
    enum umb_status status = umbn_address_parse("--listen", text, &address, error);
    if (status == UMB_OK) {
        options->listen[options->listen_count++] = text;
    }
    return status;
}

static enum umb_status set_store(const char *text, struct umbd_options *options,
                                 struct umb_error *error)
{
    size_t count = 0;
    while (options->stores[count] != NULL) {
        count++;
    }
    if (count == UMBS_STORE_FOLDERS_MAX - 1 || text[0] == '\0') {
        return umb_fail(error, UMB_E_ARGUMENT, "--store: empty, or more than %d folders",
                        UMBS_STORE_FOLDERS_MAX - 1);
    }
    options->stores[count] = text;
    return UMB_OK;
}

/* Octal permissions; the daemon's user always has its own. */
static enum umb_status set_mode(const struct option *option, const char *text,
                                struct umbd_options *options, struct umb_error *error)
{
    const size_t length = strspn(text, "01234567");
    const uint32_t mode = (uint32_t)strtoul(text, NULL, 8);
    if (length == 0 || length > 4 || text[length] != '\0' || mode > option->maximum ||
        (mode & option->minimum) != option->minimum) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.80s' is not an octal mode from 0600 to 0777",
                        option->name, text);
    }
    memcpy((char *)options + option->offset, &mode, sizeof mode);
    return UMB_OK;
}

static enum umb_status set_option(const struct option *option, const char *text,
                                  struct umbd_options *options, struct umb_error *error)
{
    char *field = (char *)options + option->offset;
    switch (option->kind) {
    case KIND_TEXT:
        if (text[0] == '\0') {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: must not be empty", option->name);
        }
        memcpy(field, &text, sizeof text);
        return UMB_OK;
    case KIND_LISTEN:
        return set_listen(text, options, error);
    case KIND_STORE:
        return set_store(text, options, error);
    case KIND_LEVEL:
        if (umbs_log_level_parse(text, &options->log_level) != UMB_OK) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "%s: '%.80s' is not one of error, warn, info, debug", option->name,
                            text);
        }
        return UMB_OK;
    case KIND_LOG_FORMAT:
        options->log_format = strcmp(text, "json") == 0 ? UMBS_LOG_JSON : UMBS_LOG_TEXT;
        if (options->log_format == UMBS_LOG_TEXT && strcmp(text, "text") != 0) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.80s' is not text or json", option->name,
                            text);
        }
        return UMB_OK;
    case KIND_MODE:
        return set_mode(option, text, options, error);
    default:
        return set_number(option, text, options, error);
    }
}

static const struct option *find_option(const char *text, size_t length)
{
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        if (strlen(table[i].name) == length && memcmp(table[i].name, text, length) == 0) {
            return &table[i];
        }
    }
    return NULL;
}

/* Limit for memory options: three quarters of this machine's memory. */
static uint64_t most_memory(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES);
    const long page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages / 4 * 3 * (uint64_t)page : (uint64_t)4 << 30;
}

static void set_defaults(struct umbd_options *options)
{
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    *options = (struct umbd_options){
        .workers = cores >= 1 && cores <= 1024 ? (uint32_t)cores : 1,
        .loops =
            cores >= 8 ? (uint32_t)(cores < 4 * UMBD_LOOPS_MAX ? cores / 4 : UMBD_LOOPS_MAX) : 1,
        .queue = 1024,
        .load_memory = most_memory(),
        .socket_mode = 0660,
        .max_connections = 4096,
        .address_handshakes = 100,
        .max_watches = 64,
        .max_points = 4194304,
        .max_message = (uint64_t)64 << 20,
        .max_buffer = (uint64_t)1 << 30,
        .connection_buffer = (uint64_t)256 << 20,
        .drain_delay_ms = 5000,
        .drain_timeout_ms = 30000,
        .handshake_timeout_ms = 10000,
        .idle_timeout_ms = 300000,
        .body_timeout_ms = 30000,
        .stall_timeout_ms = 30000,
        .scrub_interval_ms = HOUR_MS,
        .bake_workers = 1,
        .executor = "local",
        .job_sandbox = "required",
        .executor_interval_ms = 2000,
        .bake_tile = 2048,
        .bake_threads = cores >= 1 && cores <= 256 ? (uint32_t)cores : 1,
        .bake_memory = (uint64_t)4 << 30,
        .tile_cache = (uint64_t)10 << 30,
        .job_time_ms = 4 * HOUR_MS,
        .job_lease_ms = HOUR_MS / 4,
        .job_keep_ms = 30 * 24 * HOUR_MS,
        .max_bundle = (uint64_t)1 << 30,
        .max_asset = (uint64_t)16 << 30,
        .owner_jobs = 64,
        .owner_bytes = (uint64_t)4 << 30,
        .owner_assets = (uint64_t)64 << 30,
        .owner_history = 10000,
        .job_bytes = (uint64_t)16 << 30,
        .log_level = UMB_LOG_INFO,
    };
}

/* Checks combinations of options. */
static enum umb_status check_whole(struct umbd_options *options, struct umb_error *error)
{
    struct umbn_address address;
    if (options->stores[0] == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "--store DIR is required");
    }
    if (options->max_message > options->connection_buffer ||
        options->connection_buffer > options->max_buffer) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--max-message (%llu) must not be above --connection-buffer (%llu), nor that "
            "above --max-buffer (%llu)",
            (unsigned long long)options->max_message,
            (unsigned long long)options->connection_buffer,
            (unsigned long long)options->max_buffer);
    }
    if (strcmp(options->executor, "local") != 0 && strcmp(options->executor, "slurm") != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--executor: '%.40s' is not local or slurm",
                        options->executor);
    }
    if (strcmp(options->job_sandbox, "required") != 0 &&
        strcmp(options->job_sandbox, "available") != 0 &&
        strcmp(options->job_sandbox, "off") != 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--job-sandbox: '%.40s' is not required, available or off",
                        options->job_sandbox);
    }
    if ((options->bake_tile & (options->bake_tile - 1)) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--bake-tile: '%u' is no power of two",
                        options->bake_tile);
    }
    if (options->max_bundle > options->owner_bytes || options->owner_bytes > options->job_bytes) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--max-bundle (%llu) must not be above --owner-bytes (%llu), nor that "
                        "above --job-bytes (%llu)",
                        (unsigned long long)options->max_bundle,
                        (unsigned long long)options->owner_bytes,
                        (unsigned long long)options->job_bytes);
    }
    int has_tls = 0;
    for (size_t i = 0; i < options->listen_count; i++) {
        int is_tls = strncmp(options->listen[i], "tls:", 4) == 0;
        has_tls |= is_tls;
        if (is_tls && (options->tls_cert == NULL || options->tls_key == NULL)) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "--listen: '%.100s' needs --tls-cert and --tls-key",
                            options->listen[i]);
        }
    }
    if (options->tls_client_ca != NULL && !has_tls) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--tls-client-ca: no --listen is tls:, so no client needs a certificate");
    }
    if (options->admin != NULL) {
        enum umb_status status = umbd_address_parse_admin(options->admin, &address, error);
        if (status != UMB_OK) {
            return status;
        }
    }
    if (options->tls_crl != NULL && options->tls_client_ca == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--tls-crl: needs --tls-client-ca, whose certificates it revokes");
    }
    if (options->listen_count == 0) {
        options->listen[options->listen_count++] = "tcp:127.0.0.1:7420";
    }
    if (options->max_address_connections == 0) {
        options->max_address_connections = (options->max_connections + 3) / 4;
    }
    return UMB_OK;
}

int umbd_options_serve_anyone(const struct umbd_options *options, enum umbn_transport transport,
                              const struct sockaddr_storage *address)
{
    return transport != UMBN_UNIX && !umbd_address_is_loopback(address) &&
           options->token_file == NULL && !options->without_tokens &&
           !(transport == UMBN_TLS && options->tls_client_ca != NULL);
}

/* A text of the config file, kept as long as the options. */
struct umbd_option_text {
    struct umbd_option_text *next;
    char text[];
};

void umbd_options_finish(struct umbd_options *options)
{
    while (options->texts != NULL) {
        struct umbd_option_text *text = options->texts;
        options->texts = text->next;
        free(text);
    }
}

/* False for options that replace serving, such as --help: they are not allowed in a file. */
static int is_for_files(const struct option *option)
{
    static const char *const others[] = {"--config",       "--check", "--check-config",
                                         "--print-config", "--help",  "--version"};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        if (strcmp(option->name, others[i]) == 0) {
            return 0;
        }
    }
    return 1;
}

static int is_list(const struct option *option)
{
    return option->kind == KIND_LISTEN || option->kind == KIND_STORE;
}

struct file_reading {
    struct umbd_options *options;
    unsigned char seen[OPTION_COUNT];
};

static enum umb_status set_flag(const struct option *option, const char *text,
                                struct umbd_options *options, struct umb_error *error)
{
    int value = strcmp(text, "true") == 0;
    if (!value && strcmp(text, "false") != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.80s' is not true or false", option->name,
                        text);
    }
    memcpy((char *)options + option->offset, &value, sizeof value);
    return UMB_OK;
}

/* Takes one line of the file. */
static enum umb_status set_from_file(void *user, const char *name, const char *value,
                                     struct umb_error *error)
{
    struct file_reading *reading = user;
    char dashed[80];
    (void)snprintf(dashed, sizeof dashed, "--%s", name);
    const struct option *option = find_option(dashed, strlen(dashed));
    if (option == NULL || !is_for_files(option)) {
        return umb_fail(error, UMB_E_ARGUMENT, "unknown setting '%.60s'", name);
    }
    if (reading->seen[option - table] && !is_list(option)) {
        return umb_fail(error, UMB_E_ARGUMENT, "'%s' is given twice", name);
    }
    reading->seen[option - table] = 1;
    if (option->kind == KIND_FLAG) {
        return set_flag(option, value, reading->options, error);
    }
    size_t size = strlen(value) + 1;
    struct umbd_option_text *text = malloc(sizeof *text + size);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the config file");
    }
    memcpy(text->text, value, size);
    text->next = reading->options->texts;
    reading->options->texts = text;
    return set_option(option, text->text, reading->options, error);
}

/* Empties a list that the file filled, before the command line's first item. */
static void clear_list(const struct option *option, struct umbd_options *options)
{
    if (option->kind == KIND_LISTEN) {
        options->listen_count = 0;
    } else if (option->kind == KIND_STORE) {
        memset(options->stores, 0, sizeof options->stores);
    }
}

/* Takes argv[*at] and its value; *at is then the last word taken. only_config: skips all options
 * but --config. */
static enum umb_status take_word(char **argv, int argc, int *at, int only_config,
                                 struct file_reading *reading, struct umb_error *error)
{
    const char *text = strcmp(argv[*at], "-h") == 0 ? "--help" : argv[*at];
    const char *equals = strncmp(text, "--", 2) == 0 ? strchr(text, '=') : NULL;
    size_t length = equals != NULL ? (size_t)(equals - text) : strlen(text);
    const struct option *option = find_option(text, length);
    if (option == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "unknown argument '%.80s' (see --help)", text);
    }
    if (option->kind == KIND_FLAG) {
        if (equals != NULL) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s takes no value", option->name);
        }
        return only_config ? UMB_OK : set_flag(option, "true", reading->options, error);
    }
    const char *value = equals != NULL ? equals + 1 : *at + 1 < argc ? argv[++*at] : NULL;
    if (value == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s needs a value: %s", option->name, option->value);
    }
    if (only_config != (option->offset == AT(config) && option->kind == KIND_TEXT)) {
        return UMB_OK;
    }
    if (!reading->seen[option - table]) {
        clear_list(option, reading->options);
        reading->seen[option - table] = 1;
    }
    return set_option(option, value, reading->options, error);
}

enum umb_status umbd_options_parse(int argc, char **argv, struct umbd_options *options,
                                   struct umb_error *error)
{
    set_defaults(options);
    for (int only_config = 1; only_config >= 0; only_config--) {
        struct file_reading reading = {.options = options};
        for (int i = 1; i < argc; i++) {
            enum umb_status status = take_word(argv, argc, &i, only_config, &reading, error);
            if (status != UMB_OK) {
                return status;
            }
        }
        if (only_config && options->config != NULL) {
            enum umb_status status =
                umbd_config_read(options->config, set_from_file, &reading, error);
            if (status != UMB_OK) {
                options->config_bad = status == UMB_E_ARGUMENT;
                return status;
            }
        }
    }
    return options->help || options->version ? UMB_OK : check_whole(options, error);
}

/* Prints a text. In the file a ';' after a blank begins a comment, and lines have a limit. */
static void print_text(FILE *out, const char *name, const char *text)
{
    const int tight = text[0] == ';' || strlen(name) + strlen(text) + 3 > UMBD_CONFIG_LINE_MAX;
    (void)fprintf(out, "%s%s%s\n", name, tight ? "=" : " = ", text);
}

/* Prints one setting: a list as one line an item, an unset text as a comment. */
static void print_option(const struct option *option, const struct umbd_options *options, FILE *out)
{
    const char *name = option->name + 2;
    const char *field = (const char *)options + option->offset;
    const char *text = NULL;
    uint64_t number = 0;
    uint32_t narrow = 0;
    switch (option->kind) {
    case KIND_TEXT:
        memcpy(&text, field, sizeof text);
        if (text != NULL) {
            print_text(out, name, text);
        } else {
            (void)fprintf(out, "; %s = \n", name);
        }
        break;
    case KIND_LISTEN:
        for (size_t i = 0; i < options->listen_count; i++) {
            print_text(out, name, options->listen[i]);
        }
        break;
    case KIND_STORE:
        for (size_t i = 0; i < UMBS_STORE_FOLDERS_MAX && options->stores[i] != NULL; i++) {
            print_text(out, name, options->stores[i]);
        }
        break;
    case KIND_COUNT:
    case KIND_FLAG:
    case KIND_MODE:
        memcpy(&narrow, field, sizeof narrow);
        if (option->kind == KIND_FLAG) {
            (void)fprintf(out, "%s = %s\n", name, narrow ? "true" : "false");
        } else {
            (void)fprintf(out, option->kind == KIND_MODE ? "%s = %04o\n" : "%s = %u\n", name,
                          narrow);
        }
        break;
    case KIND_TOTAL:
    case KIND_BYTES:
    case KIND_TIME:
        memcpy(&number, field, sizeof number);
        (void)fprintf(out, "%s = %llu%s\n", name, (unsigned long long)number,
                      option->kind == KIND_TIME ? "ms" : "");
        break;
    case KIND_LEVEL:
        (void)fprintf(out, "%s = %s\n", name, umbs_log_level_name(options->log_level));
        break;
    case KIND_LOG_FORMAT:
        (void)fprintf(out, "%s = %s\n", name,
                      options->log_format == UMBS_LOG_JSON ? "json" : "text");
        break;
    }
}

void umbd_options_print(const struct umbd_options *options, FILE *out)
{
    (void)fprintf(out, "[umbraged]\n");
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        if (is_for_files(&table[i])) {
            print_option(&table[i], options, out);
        }
    }
}

void umbd_options_usage(FILE *out)
{
    fprintf(out, "usage: umbraged --store DIR [options]\n"
                 "Answers shadow queries on the assets of a folder, over gRPC.\n\n");
    for (size_t i = 0; i < OPTION_COUNT; i++) {
        char left[48];
        snprintf(left, sizeof left, "%s%s%s", table[i].name, table[i].value != NULL ? " " : "",
                 table[i].value != NULL ? table[i].value : "");
        fprintf(out, "  %-28s %s\n", left, table[i].help);
    }
    fprintf(out,
            "\nSIGTERM drains and exits, a second one exits at once; SIGHUP reads the config file\n"
            "again and rescans the store.\n");
}
