/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage fetch: downloads an asset that a job of the caller made. A fetch that ends early leaves
 * its bytes beside the output as OUT.part, and the next fetch continues after them. OUT appears
 * only after all pages are proven to belong to the id.
 */
#include "cli/shared/cli_common.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>
#include "tool/json.h"
#include "tool/output.h"
#include "tool/progress.h"
#include "tool/tool_try.h"
#include "umbrage/jobs.h"
#include "umbrage/region.h"

#define OUTPUT_SIZE 4096
#define TRIES       5 /* tries in a row that bring no byte */

struct fetch_settings {
    uint8_t asset[UMB_ID_BYTES];
    const char *output; /* Name of the file; NULL: ASSET.umb */
    uint64_t max_bytes; /* Largest file in bytes that is fetched */
    struct umbu_session session;
    bool json, quiet;
};
#define AT(field) UMBU_AT(struct fetch_settings, field)

static const struct umbu_option OPTIONS[] = {
    {"ASSET", NULL, "id of the asset", UMBC_ID, AT(asset), .needed = true},
    {"output", "FILE", "name of the file",
     UMBU_NAME("a file name of 1 to 4095 bytes (a file is proven before it gets its name: it "
               "cannot go to stdout; name a file, ./- for one of that name)"),
     AT(output), .otherwise = "ASSET.umb", .letter = 'o'},
    {"max-bytes", "BYTES", "largest file in bytes that is accepted",
     UMBU_BYTES(1, (uint64_t)1 << 62), AT(max_bytes), .standard = "64G"},
    UMBU_STALL_ROW(struct fetch_settings),
    {UMBU_JSON_ROW(struct fetch_settings)},
    {UMBU_QUIET_ROW(struct fetch_settings, "no progress, no summary")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage fetch",
    .usage = "umbrage fetch ASSET [-o FILE] [options]",
    .summary = "Downloads the packed file of an asset that a job of yours made. ASSET is its id.\n"
               "Bytes that an earlier fetch left in FILE.part are not fetched again.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct fetch_settings, session)},
};

struct fetch {
    int fd;
    uint64_t at; /* number of bytes in the file */
    const char *part;
    const uint8_t *asset;
    uint64_t max_bytes; /* --max-bytes */
    uint64_t size; /* Size of the whole file in bytes, as the server announced it; 0: unknown */
    bool head_checked;
    struct umbu_progress progress;
    struct umb_error error;
};

/* Checks the size that the server announces against --max-bytes and the room on the disk. The bytes
 * are proven only at the end, so a lying server could otherwise fill the disk. */
static enum umb_status check_size(struct fetch *fetch, uint64_t size)
{
    struct statvfs disk;
    fetch->size = size;
    if (size > fetch->max_bytes) {
        return umb_fail(&fetch->error, UMB_E_TOO_LARGE,
                        "asset: the server announces %llu bytes, the limit is %llu (--max-bytes)",
                        (unsigned long long)size, (unsigned long long)fetch->max_bytes);
    }
    if (size > fetch->at && fstatvfs(fetch->fd, &disk) == 0 && disk.f_blocks > 0 &&
        (size - fetch->at) / disk.f_frsize >= disk.f_bavail) {
        return umb_fail_errno(&fetch->error, UMB_E_IO, ENOSPC,
                              "'%.200s': %llu bytes are missing, the disk has room for %llu",
                              fetch->part, (unsigned long long)(size - fetch->at),
                              (unsigned long long)disk.f_bavail * disk.f_frsize);
    }
    return UMB_OK;
}

/* Checks the file's first bytes once they have arrived: they name the asset and the file's length.
 */
static enum umb_status check_head(struct fetch *fetch)
{
    uint8_t bytes[UMB_FILE_HEAD_BYTES];
    struct umb_file_head head;
    if (fetch->head_checked || fetch->at < sizeof bytes) {
        return UMB_OK;
    }
    if (pread(fetch->fd, bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes) {
        return umb_fail_errno(&fetch->error, UMB_E_IO, errno, "cannot read '%.200s'", fetch->part);
    }
    fetch->head_checked = true;
    if (umb_file_read_head(bytes, sizeof bytes, &head, NULL) != UMB_OK ||
        head.encoding != UMB_ENCODING_PACKED || memcmp(head.id, fetch->asset, UMB_ID_BYTES) != 0) {
        return umb_fail(&fetch->error, UMB_E_CORRUPT, "'%.200s' belongs to another asset",
                        fetch->part);
    }
    return head.file_bytes == fetch->size
               ? UMB_OK
               : umb_fail(&fetch->error, UMB_E_CORRUPT,
                          "'%.200s': %llu bytes by its head, the server announces %llu",
                          fetch->part, (unsigned long long)head.file_bytes,
                          (unsigned long long)fetch->size);
}

static enum umb_status take(void *user, uint64_t offset, const void *bytes, size_t count,
                            uint64_t size)
{
    struct fetch *fetch = user;
    const char *from = bytes;
    (void)offset; /* the library gives them in order */
    if (size != fetch->size) {
        UMB__TRY(check_size(fetch, size));
    }
    while (count > 0) {
        ssize_t written = write(fetch->fd, from, count);
        if (written < 0 && errno == EINTR) {
            continue;
        }
        if (written <= 0) {
            return umb_fail_errno(&fetch->error, UMB_E_IO, errno, "cannot write '%.200s'",
                                  fetch->part);
        }
        from += written;
        count -= (size_t)written;
        fetch->at += (uint64_t)written;
    }
    umbu_progress_show(&fetch->progress, 1e-6 * (double)fetch->at,
                       size > 0 ? (double)fetch->at / (double)size : 1);
    return check_head(fetch);
}

/* Fetches the missing bytes. After a lost connection it goes on, as long as each new connection
 * brings bytes. */
static enum umb_status fetch_rest(struct umb_client *client, struct fetch *fetch,
                                  struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    int tries = 0;
    fetch->error = (struct umb_error){.status = UMB_OK};
    fetch->head_checked = false;
    do {
        const uint64_t before = fetch->at;
        status = umb_client_fetch(client, fetch->asset, fetch->at, take, fetch, NULL, error);
        tries = fetch->at > before ? 0 : tries + 1;
        if (status == UMB_E_UNAVAILABLE) {
            (void)nanosleep(&(struct timespec){.tv_nsec = 300000000}, NULL);
        }
    } while (status == UMB_E_UNAVAILABLE && tries < TRIES);
    if (status != UMB_OK && fetch->error.status != UMB_OK) {
        *error = fetch->error;
        status = error->status;
    }
    return status;
}

/* Opens the part of an earlier fetch, or a new file, and moves to the end. */
static enum umb_status open_part(struct fetch *fetch, struct umb_error *error)
{
    struct stat info;
    fetch->fd =
        open(fetch->part,
             O_RDWR | O_CREAT | O_APPEND | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC, 0666);
    if (fetch->fd < 0 || fstat(fetch->fd, &info) != 0) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, errno, "cannot create '%.200s'",
                              fetch->part);
    }
    if (!S_ISREG(info.st_mode)) {
        (void)close(fetch->fd);
        fetch->fd = -1;
        return umb_fail(error, UMB_E_CANNOT_CREATE, "'%.200s' is not a regular file", fetch->part);
    }
    fetch->at = (uint64_t)info.st_size;
    return UMB_OK;
}

/* Verifies that every byte of the file belongs to the asset with the id. */
static enum umb_status prove_file(const char *path, const uint8_t *asset, struct umb_error *error)
{
    struct umb_file file;
    UMB__TRY(umb_file_open(path, &file, error));
    const enum umb_status status =
        umb_packed_prove(file.bytes, file.size, asset, umb_sha256_openssl(), error);
    umb_file_close(&file);
    return status;
}

static enum umb_status give_name(struct fetch *fetch, const char *output, struct umb_error *error)
{
    if (fsync(fetch->fd) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot sync '%.200s'", fetch->part);
    }
    return umbu_output_rename(fetch->part, output, error);
}

/* Fetches the file, verifies it and renames it to its final name. If the part of an earlier fetch
 * belongs to another asset, the fetch begins anew, once. */
static enum umb_status fetch_file(struct umb_client *client, struct fetch *fetch,
                                  const char *output, struct umb_error *error)
{
    enum umb_status status = open_part(fetch, error);
    for (int round = 0; status == UMB_OK; round++) {
        const uint64_t found = round == 0 ? fetch->at : 0;
        status = fetch_rest(client, fetch, error);
        if (status == UMB_OK) {
            status = prove_file(fetch->part, fetch->asset, error);
        }
        const bool stale = found > 0 && (status == UMB_E_ARGUMENT || status == UMB_E_CORRUPT ||
                                         status == UMB_E_FORMAT || status == UMB_E_TRUNCATED);
        if (!stale) {
            break;
        }
        status = ftruncate(fetch->fd, 0) == 0
                     ? UMB_OK
                     : umb_fail_errno(error, UMB_E_IO, errno, "cannot write '%.200s'", fetch->part);
        fetch->at = 0;
    }
    return status == UMB_OK ? give_name(fetch, output, error) : status;
}

static int report(const struct fetch_settings *settings, const char *output, uint64_t bytes)
{
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", settings->asset);
        umbu_json_text(&json, "output", output);
        umbu_json_integer(&json, "bytes", bytes);
        umbu_json_close(&json);
    } else if (!settings->quiet) {
        char text[32];
        umbc_format_bytes(bytes, text);
        (void)printf("file        %s: %s\n", output, text);
    }
    return umbc_finish_stdout(0);
}

int umbc_fetch(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct fetch_settings settings = {.output = NULL};
    struct umb_client *client;
    struct umb_error error = {.status = UMB_OK};
    char output[OUTPUT_SIZE], part[OUTPUT_SIZE + 16], id[UMB_ID_TEXT_SIZE];
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
    if (code >= 0) {
        return code;
    }
    umb_id_to_text(settings.asset, id);
    (void)snprintf(output, sizeof output, "%s%s", settings.output != NULL ? settings.output : id,
                   settings.output != NULL ? "" : ".umb");
    (void)snprintf(part, sizeof part, "%s.part", output);
    struct fetch fetch = {
        .fd = -1, .part = part, .asset = settings.asset, .max_bytes = settings.max_bytes};
    if (umbu_connect(&settings.session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    umbu_progress_begin(&fetch.progress, "MB", settings.quiet || settings.json);
    enum umb_status status = fetch_file(client, &fetch, output, &error);
    umbu_progress_end(&fetch.progress);
    if (fetch.fd >= 0) {
        (void)close(fetch.fd);
        if (status != UMB_OK && fetch.at == 0) {
            (void)unlink(part);
        }
    }
    umb_client_close(client);
    return status == UMB_OK ? report(&settings, output, fetch.at) : umbc_complain(&error);
}
