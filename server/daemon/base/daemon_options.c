/* SPDX-License-Identifier: Apache-2.0 */
/* The options of umbraged as a table, and the checks that concern several options. */
#include "daemon/base/daemon_options.h"

#include <errno.h>
#include <ini.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "common/log.h"
#include "daemon/base/net_address.h"

#define AT(field)       UMBU_AT(struct umbd_options, field)
#define CONFIG_LINE_MAX 198 /* bytes; libinih reads no longer ones */
#define HOUR_MS         ((uint64_t)3600 * 1000)
#define MONTH_MS        (31 * 24 * HOUR_MS)
#define MIB             ((uint64_t)1 << 20)
#define GIB             ((uint64_t)1 << 30)
#define PIB             ((uint64_t)1 << 50)

static enum umb_status check_listen(const struct umbu_option *option, const char *text, void *field,
                                    struct umb_error *error)
{
    struct umbn_address address;
    (void)option;
    (void)field;
    return umbn_address_parse("--listen", text, &address, error);
}

static enum umb_status check_http(const struct umbu_option *option, const char *text, void *field,
                                  struct umb_error *error)
{
    struct umbn_address address;
    (void)option;
    (void)field;
    return umbn_address_parse("--http", text, &address, error);
}

/* An origin is compared byte by byte with what browsers send: SCHEME://HOST[:PORT] in small
 * letters. */
static enum umb_status check_origin(const struct umbu_option *option, const char *text, void *field,
                                    struct umb_error *error)
{
    static const char scheme[] = "abcdefghijklmnopqrstuvwxyz0123456789+.-";
    static const char host[] = "abcdefghijklmnopqrstuvwxyz0123456789.-_:[]";
    const char *colon = strstr(text, "://");
    const char *rest = colon != NULL ? colon + 3 : "";
    const size_t length = strspn(rest, host);
    (void)option;
    (void)field;
    if (strcmp(text, "*") == 0 ||
        (colon != NULL && colon > text && strspn(text, scheme) == (size_t)(colon - text) &&
         length > 0 && rest[length] == '\0' && strlen(text) < UMBD_ORIGIN_SIZE)) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "--http-origin: '%.100s'; give * or SCHEME://HOST[:PORT] in small letters, "
                    "without a path",
                    text);
}

static const struct umbu_option SERVING[] = {
    {"store", "DIR",
     "folder of packed assets (required); may be repeated, the first that has a name serves it",
     UMBU_LIST(UMBS_STORE_FOLDERS_MAX - 1), AT(stores)},
    {"listen", "ADDRESS",
     "tcp:HOST:PORT, tls:HOST:PORT or unix:PATH; may be repeated; port 0 picks one",
     UMBU_LIST(UMBD_LISTEN_MAX), AT(listen), .read = check_listen,
     .otherwise = "tcp:127.0.0.1:7420"},
    {"http", "ADDRESS",
     "address, as of --listen, that serves packed assets over HTTP/1.1; may be repeated",
     UMBU_LIST(UMBD_LISTEN_MAX), AT(http), .read = check_http, .otherwise = "off"},
    {"http-origin", "ORIGIN",
     "origin, as https://HOST, whose web pages may read assets over --http; * = every origin; may "
     "be repeated",
     UMBU_LIST(UMBD_LISTEN_MAX), AT(http_origins), .read = check_origin, .otherwise = "none",
     .needs = "http"},
    {"cache", "DIR",
     "folder of mapped files that only this user can change; if not given, CACHE_DIRECTORY of "
     "systemd, else .umbrage-cache in each store that no other user can change, else memory",
     UMBU_TEXT, AT(cache)},
    {"load-memory", "BYTES",
     "limit of one asset's packed and expanded size together while it is loaded",
     UMBU_BYTES(MIB, PIB), AT(load_memory), .otherwise = "three quarters of this machine's memory"},
    {"socket-mode", "MODE", "permissions of unix: sockets, in octal, regardless of the umask",
     UMBU_MODE(0600, 0777), AT(socket_mode), .standard = "0660"},
    {"copy", NULL, "copy assets into memory; later changes of their files have no effect",
     UMBU_FLAG, AT(copy)},
    {"warm-up", NULL, "read an asset's file ahead when it is opened", UMBU_FLAG, AT(warm_up)},
    {"scrub-interval", "TIME", "longest time between two checks of a mapped asset, 0 = no checks",
     UMBU_TIME(0, MONTH_MS), AT(scrub_interval_ms), .standard = "60m"},
    {"loops", "N", "event-loop threads; each serves a share of the connections",
     UMBU_COUNT(1, UMBD_LOOPS_MAX), AT(loops), .otherwise = "one for four cores"},
    {"workers", "N", "worker threads, which answer all but small batches", UMBU_COUNT(1, 1024),
     AT(workers), .otherwise = "one a core"},
    {"queue", "N", "batches that may wait for a worker", UMBU_COUNT(1, 1000000), AT(queue),
     .standard = "1024"},
    {"admin", "HOST:PORT", "plain HTTP for /metrics, /livez, /readyz; loopback only", UMBU_TEXT,
     AT(admin), .otherwise = "off"},
    {"address-file", "FILE", "file to which the open addresses are written, one a line", UMBU_TEXT,
     AT(address_file)},
    {"log-level", NULL, "events to log: this level and above", UMBU_CHOICE("error|warn|info|debug"),
     AT(log_level), .standard = "info"},
    {"log-format", NULL, "one line an event: key=value, or a JSON object", UMBU_CHOICE("text|json"),
     AT(log_format), .standard = "text"},
};

static const struct umbu_option ACCESS[] = {
    {"token-file", "FILE",
     "callers and their rights: lines of NAME SCOPES TOKEN [POINTS_PER_SECOND]; read again on "
     "SIGHUP",
     UMBU_TEXT, AT(token_file)},
    {"without-tokens", NULL, "let other machines query without --token-file and --tls-client-ca",
     UMBU_FLAG, AT(without_tokens)},
    {"tls-cert", "FILE", "certificate chain (PEM) of the tls: addresses; read again on SIGHUP",
     UMBU_TEXT, AT(tls_cert)},
    {"tls-key", "FILE", "private key (PEM) of the certificate", UMBU_TEXT, AT(tls_key)},
    {"tls-client-ca", "FILE", "clients of tls: must show a certificate of these authorities (PEM)",
     UMBU_TEXT, AT(tls_client_ca)},
    {"tls-crl", "FILE",
     "revocation lists (PEM), one for each authority of --tls-client-ca; read again on SIGHUP",
     UMBU_TEXT, AT(tls_crl), .needs = "tls-client-ca"},
};

static const struct umbu_option LIMITS[] = {
    {"max-points", "N", "points in a batch", UMBU_COUNT(1, (uint64_t)1 << 28), AT(max_points),
     .standard = "4194304"},
    {"max-message", "BYTES", "size of a request message", UMBU_BYTES(1024, 2 * GIB),
     AT(max_message), .standard = "64MiB"},
    {"max-buffer", "BYTES", "requests and replies held at once", UMBU_BYTES(MIB, GIB << 10),
     AT(max_buffer), .standard = "1GiB"},
    {"connection-buffer", "BYTES", "requests and replies of one connection held at once",
     UMBU_BYTES(1 << 16, GIB << 10), AT(connection_buffer), .standard = "256MiB"},
    {"max-connections", "N", "connections at once", UMBU_COUNT(1, 1000000), AT(max_connections),
     .standard = "4096"},
    {"max-address-connections", "N", "connections of one address (IPv6: of its /64) at once",
     UMBU_COUNT(1, 1000000), AT(max_address_connections),
     .otherwise = "a quarter of --max-connections"},
    {"address-handshakes", "N", "TLS handshakes a second of one address, 0 = no limit",
     UMBU_COUNT(0, 1000000), AT(address_handshakes), .standard = "100"},
    {"address-rate", "N", "points a second that one address may ask, 0 = any number",
     UMBU_COUNT(0, 1000000000000), AT(address_rate), .standard = "0"},
    {"max-watches", "N", "health Watches of all connections without rights; each has at most one",
     UMBU_COUNT(0, 1000000), AT(max_watches), .standard = "64"},
    {"handshake-timeout", "TIME", "time from the connect to the HTTP/2 settings",
     UMBU_TIME(100, HOUR_MS), AT(handshake_timeout_ms), .standard = "10s"},
    {"idle-timeout", "TIME", "longest time of a connection without calls",
     UMBU_TIME(100, 24 * HOUR_MS), AT(idle_timeout_ms), .standard = "5m"},
    {"max-age", "TIME",
     "age at which a connection is asked to leave, give or take a tenth, so that balancers spread "
     "their clients again; 0 = never",
     UMBU_TIME(0, MONTH_MS), AT(max_age_ms), .standard = "0"},
    {"body-timeout", "TIME", "time for a request to arrive, and 1 s more for each 64 KiB",
     UMBU_TIME(100, HOUR_MS), AT(body_timeout_ms), .standard = "30s"},
    {"stall-timeout", "TIME",
     "longest time that a reply waits for a peer that takes nothing, or less than 16 KiB/s",
     UMBU_TIME(100, HOUR_MS), AT(stall_timeout_ms), .standard = "30s"},
    {"drain-delay", "TIME", "time from SIGTERM to the end of listening", UMBU_TIME(0, HOUR_MS),
     AT(drain_delay_ms), .standard = "5s"},
    {"drain-timeout", "TIME", "time for calls to finish after that", UMBU_TIME(0, HOUR_MS),
     AT(drain_timeout_ms), .standard = "30s"},
};

static const struct umbu_option JOBS[] = {
    {"jobs", "DIR",
     "accept scenes over the network and bake them; DIR has their files and must not be a --store",
     UMBU_TEXT, AT(bakes.folder), .otherwise = "off"},
    {"jobs-db", "FILE", "job table, on a local disk", UMBU_TEXT, AT(bakes.table),
     .otherwise = "DIR/jobs.db"},
    {"bake-program", "FILE", "umbrage-bake", UMBU_TEXT, AT(bakes.tries.program),
     .otherwise = "beside umbraged"},
    {"job-sandbox", NULL,
     "sandbox of the bakes of jobs: every layer, or the job fails; the layers that the kernel has; "
     "or none",
     UMBU_CHOICE("required|available|off"), AT(bakes.tries.sandbox), .standard = "required"},
    {"bake-workers", "N", "bakes at once", UMBU_COUNT(1, 256), AT(bakes.tries.workers),
     .standard = "1"},
    {"executor", NULL, "bakes run on this machine, or as tiles in array jobs of Slurm",
     UMBU_CHOICE("local|slurm"), AT(bakes.slurm), .standard = "local"},
    {"executor-interval", "TIME", "time between two questions to Slurm about tasks",
     UMBU_TIME(100, HOUR_MS), AT(bakes.tries.interval_ms), .standard = "2s"},
    {"slurm-options", "TEXT", "more options of sbatch, with blanks between, as --partition=bake",
     UMBU_TEXT, AT(bakes.slurm_words)},
    {"bake-tile", "N", "texels a side of a tile, the unit of work", UMBU_POWER(64, 32768),
     AT(bakes.tries.tile), .standard = "2048"},
    {"bake-threads", "N", "threads of one bake", UMBU_COUNT(1, 256), AT(bakes.tries.threads),
     .otherwise = "one a core"},
    {"bake-memory", "BYTES", "memory of one bake", UMBU_BYTES(16 * MIB, PIB),
     AT(bakes.tries.memory_bytes), .standard = "4GiB"},
    {"tile-cache", "BYTES", "baked tiles kept for each owner, so that retries and edits go faster",
     UMBU_BYTES(0, PIB), AT(bakes.tries.cache_bytes), .standard = "10GiB"},
    {"job-time", "TIME", "longest time of one bake", UMBU_TIME(1000, MONTH_MS),
     AT(bakes.tries.timeout_ms), .standard = "240m"},
    {"job-lease", "TIME", "longest time that a bake may give no sign of life",
     UMBU_TIME(1000, MONTH_MS), AT(bakes.limits.lease_ms), .standard = "15m"},
    {"job-keep", "TIME", "time for which finished jobs are kept: 30 days",
     UMBU_TIME(60000, 3660 * 24 * HOUR_MS), AT(bakes.keep_ms), .standard = "43200m"},
    {"max-bundle", "BYTES", "files of one submission together", UMBU_BYTES(1024, GIB << 14),
     AT(bakes.max_bundle_bytes), .standard = "1GiB"},
    {"max-asset", "BYTES", "size of the asset that one bake makes", UMBU_BYTES(1024, GIB << 14),
     AT(bakes.tries.max_output_bytes), .standard = "16GiB"},
    {"owner-jobs", "N", "unfinished jobs of one owner", UMBU_COUNT(1, 1000000),
     AT(bakes.limits.owner_jobs), .standard = "64"},
    {"owner-bytes", "BYTES", "files of all unfinished jobs of one owner together",
     UMBU_BYTES(1024, PIB), AT(bakes.limits.owner_bytes), .standard = "4GiB"},
    {"owner-assets", "BYTES", "size of the assets kept for one owner's jobs", UMBU_BYTES(1024, PIB),
     AT(bakes.limits.owner_assets), .standard = "64GiB"},
    {"owner-history", "N", "finished jobs listed for one owner, the oldest are forgotten",
     UMBU_COUNT(1, 1000000), AT(bakes.limits.owner_history), .standard = "10000"},
    {"job-bytes", "BYTES", "files of all owners' unfinished jobs together", UMBU_BYTES(1024, PIB),
     AT(bakes.limits.total_bytes), .standard = "16GiB"},
};

/* Options that replace serving: they are not allowed in a file. */
static const struct umbu_option OTHERS[] = {
    {"config", "FILE", "file of options, lines of name = value; the command line overrides it",
     UMBU_TEXT, AT(config), .not_in_file = true},
    {"check", NULL, "check the options and the files and folders that they name, and exit",
     UMBU_FLAG, AT(check_files), .not_in_file = true},
    {"check-config", NULL, "check the options alone, and exit", UMBU_FLAG, AT(check),
     .not_in_file = true},
    {"print-config", NULL, "print every setting as a config file and exit", UMBU_FLAG,
     AT(print_config), .not_in_file = true},
    {"version", NULL, "the version", UMBU_FLAG, AT(version), .alone = true, .not_in_file = true},
};

const struct umbu_command umbd_command = {
    .name = "umbraged",
    .usage = "umbraged --store DIR [options]",
    .summary = "Answers shadow queries on the assets of a folder, over gRPC.",
    .notes = "SIGTERM drains and exits, a second one exits at once; SIGHUP reads the config\n"
             "file again and rescans the store.",
    .sections = {{"options", UMBU_ROWS(SERVING)},
                 {"access", UMBU_ROWS(ACCESS)},
                 {"limits", UMBU_ROWS(LIMITS)},
                 {"bake jobs", UMBU_ROWS(JOBS)},
                 {"others", UMBU_ROWS(OTHERS)}},
};

/* Limit for memory options: three quarters of this machine's memory. */
static uint64_t most_memory(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES);
    const long page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages / 4 * 3 * (uint64_t)page : 4 * GIB;
}

/* Sets the defaults that depend on the machine, then those of the table. */
static void set_defaults(struct umbd_options *options, struct umbu_parsed *parsed)
{
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    *options = (struct umbd_options){
        .workers = cores >= 1 && cores <= 1024 ? (uint32_t)cores : 1,
        .loops =
            cores >= 8 ? (uint32_t)(cores < 4 * UMBD_LOOPS_MAX ? cores / 4 : UMBD_LOOPS_MAX) : 1,
        .bakes.tries.threads = cores >= 1 && cores <= 256 ? (uint32_t)cores : 1,
        .load_memory = most_memory(),
    };
    umbu_begin(parsed, &umbd_command, options);
}

/* Fails unless three limits are in ascending order. */
static enum umb_status check_order(const char *const names[3], uint64_t low, uint64_t middle,
                                   uint64_t high, struct umb_error *error)
{
    return low <= middle && middle <= high
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "%s (%llu) must not be above %s (%llu), nor that above %s (%llu)",
                          names[0], (unsigned long long)low, names[1], (unsigned long long)middle,
                          names[2], (unsigned long long)high);
}

/* Checks the addresses of an option. Out: has_tls: set if one of them is for TLS. */
static enum umb_status check_tls_addresses(const struct umbd_options *options, const char *name,
                                           const char *const *addresses, bool *has_tls,
                                           struct umb_error *error)
{
    for (size_t i = 0; addresses[i] != NULL; i++) {
        const bool is_tls = strncmp(addresses[i], "tls:", 4) == 0;
        *has_tls |= is_tls;
        if (is_tls && (options->tls_cert == NULL || options->tls_key == NULL)) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.100s' needs --tls-cert and --tls-key",
                            name, addresses[i]);
        }
    }
    return UMB_OK;
}

static enum umb_status check_tls(const struct umbd_options *options, struct umb_error *error)
{
    bool has_tls = false;
    UMB__TRY(check_tls_addresses(options, "--listen", options->listen, &has_tls, error));
    UMB__TRY(check_tls_addresses(options, "--http", options->http, &has_tls, error));
    return options->tls_client_ca == NULL || has_tls
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "--tls-client-ca: no client would be asked; give a --listen tls:...");
}

/* Counts the addresses. Refuses a list of origins that has others beside `*`, which stands for
 * all. */
static enum umb_status check_http_options(struct umbd_options *options, struct umb_error *error)
{
    size_t count = 0;
    bool has_all = false;
    while (options->http[options->http_count] != NULL) {
        options->http_count++;
    }
    for (; options->http_origins[count] != NULL; count++) {
        has_all |= strcmp(options->http_origins[count], "*") == 0;
    }
    return !has_all || count == 1
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "--http-origin: * stands for every origin; give it alone");
}

/* Checks combinations of options. */
static enum umb_status check_whole(struct umbd_options *options, struct umb_error *error)
{
    static const char *const buffers[] = {"--max-message", "--connection-buffer", "--max-buffer"};
    static const char *const files[] = {"--max-bundle", "--owner-bytes", "--job-bytes"};
    const struct umbj_service_options *bakes = &options->bakes;
    struct umbn_address address;
    if (options->stores[0] == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "--store: is needed; see --help");
    }
    UMB__TRY(check_order(buffers, options->max_message, options->connection_buffer,
                         options->max_buffer, error));
    UMB__TRY(check_order(files, bakes->max_bundle_bytes, (uint64_t)bakes->limits.owner_bytes,
                         (uint64_t)bakes->limits.total_bytes, error));
    while (options->listen[options->listen_count] != NULL) {
        options->listen_count++;
    }
    UMB__TRY(check_tls(options, error));
    UMB__TRY(check_http_options(options, error));
    if (options->admin != NULL) {
        UMB__TRY(umbd_address_parse_admin(options->admin, &address, error));
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

/* Takes one line of the file. */
static enum umb_status set_from_file(struct umbu_parsed *parsed, const char *name,
                                     const char *value, struct umb_error *error)
{
    struct umbd_options *options = parsed->settings;
    const size_t size = strlen(value) + 1;
    struct umbd_option_text *text = malloc(sizeof *text + size);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the config file");
    }
    memcpy(text->text, value, size);
    text->next = options->texts;
    options->texts = text;
    return umbu_take_setting(parsed, name, text->text, error);
}

/*
 * The config file (umbraged.conf, an INI file) is read by libinih: one `name = value` a line,
 * comments with ';', and an optional section [umbraged]. Names are those of the command line
 * without their dashes. `store` and `listen` may be repeated; flags take true or false.
 *
 * libinih gives no line numbers to its handler and cuts long lines. The line source here therefore
 * counts and measures the lines.
 */
struct reading {
    FILE *file;
    const char *path;
    unsigned line;
    struct umbu_parsed *parsed;
    enum umb_status status;
    struct umb_error *error;
};

/* libinih's source of lines: fgets, counted. */
static char *next_line(char *line, int size, void *stream)
{
    struct reading *reading = stream;
    if (reading->status != UMB_OK || fgets(line, size, reading->file) == NULL) {
        return NULL;
    }
    size_t length = strlen(line);
    reading->line++;
    if (length > 0 && line[length - 1] != '\n' && !feof(reading->file)) {
        reading->status =
            umb_fail(reading->error, UMB_E_ARGUMENT, "%.120s line %u: longer than %d bytes",
                     reading->path, reading->line, CONFIG_LINE_MAX);
        return NULL;
    }
    /* libinih would append an indented line to the one before it. */
    size_t blanks = strspn(line, " \t");
    memmove(line, line + blanks, length - blanks + 1);
    return line;
}

static int on_value(void *user, const char *section, const char *name, const char *value)
{
    struct reading *reading = user;
    struct umb_error cause = {0};
    if (reading->status != UMB_OK) {
        return 0;
    }
    if (section[0] != '\0' && strcmp(section, "umbraged") != 0) {
        reading->status = umb_fail(reading->error, UMB_E_ARGUMENT,
                                   "%.120s line %u: section [%.40s], not [umbraged]", reading->path,
                                   reading->line, section);
        return 0;
    }
    enum umb_status status = set_from_file(reading->parsed, name, value, &cause);
    if (status != UMB_OK) {
        reading->status = umb_fail(reading->error, status, "%.120s line %u: %s", reading->path,
                                   reading->line, cause.message);
    }
    return status == UMB_OK;
}

/*
 * Applies each setting of the file. Fails: E_NO_INPUT, E_PERMISSION or E_IO for the file;
 * E_ARGUMENT for a line, which the message names.
 */
static enum umb_status read_config(const char *path, struct umbu_parsed *parsed,
                                   struct umb_error *error)
{
    struct stat facts;
    struct reading reading = {.path = path, .parsed = parsed, .status = UMB_OK, .error = error};
    reading.file = fopen(path, "re");
    if (reading.file == NULL) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "--config: '%.200s'", path);
    }
    if (fstat(fileno(reading.file), &facts) == 0 && S_ISDIR(facts.st_mode)) {
        (void)fclose(reading.file);
        return umb_fail(error, UMB_E_NO_INPUT, "--config: '%.200s' is a folder", path);
    }
    int bad_line = ini_parse_stream(next_line, &reading, on_value, &reading);
    if (reading.status == UMB_OK && ferror(reading.file)) {
        reading.status = umb_fail_errno(error, UMB_E_IO, errno, "--config: '%.200s'", path);
    } else if (reading.status == UMB_OK && bad_line != 0) {
        reading.status = umb_fail(error, UMB_E_ARGUMENT,
                                  "%.120s line %d: not of the form name = value", path, bad_line);
    }
    (void)fclose(reading.file);
    return reading.status;
}

enum umb_status umbd_options_parse(int argc, char **argv, struct umbd_options *options,
                                   struct umb_error *error)
{
    struct umbu_parsed parsed;
    set_defaults(options, &parsed);
    enum umb_status status = umbu_take_arguments(&parsed, argc, argv, error);
    const char *config = options->config;
    if (status == UMB_OK && config != NULL && !parsed.help && parsed.alone == NULL) {
        set_defaults(options, &parsed); /* the file first, then the arguments once more */
        status = read_config(config, &parsed, error);
        options->config_bad = status == UMB_E_ARGUMENT;
        if (status == UMB_OK) {
            status = umbu_take_arguments(&parsed, argc, argv, error);
        }
    }
    options->help = parsed.help;
    if (status != UMB_OK || parsed.help || parsed.alone != NULL) {
        return status;
    }
    status = umbu_check(&parsed, error);
    return status == UMB_OK ? check_whole(options, error) : status;
}

void umbd_options_print(const struct umbd_options *options, FILE *out)
{
    (void)fprintf(out, "[umbraged]\n");
    umbu_print_settings(&umbd_command, options, CONFIG_LINE_MAX, out);
}
