/* SPDX-License-Identifier: Apache-2.0 */
/* Files on their way into the store, see staging.h. */
#include "jobs/staging.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/file_system.h"
#include "common/sha256.h"
#include "format/head.h"

struct block {
    uint8_t *bytes;
    size_t size;
};

/* Reads a regular file whole. */
static enum umb_status read_file(const char *path, uint64_t most, struct block *block,
                                 struct umb_error *error)
{
    struct stat info;
    enum umb_status status;
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read the asset that was baked");
    } else if ((uint64_t)info.st_size > most) {
        status = umb_fail(error, UMB_E_TOO_LARGE,
                          "the asset has %llu bytes, the server allows %llu (--max-asset)",
                          (unsigned long long)info.st_size, (unsigned long long)most);
    } else {
        block->size = (size_t)info.st_size;
        status = umbs_read_file(fd, block->size, "the asset that was baked", &block->bytes, error);
    }
    umbs_hang_up(&fd);
    return status == UMB_E_TRUNCATED ? UMB_E_IO : status; /* another try may help */
}

/* Reads a file and proves that it is a packed asset. */
static enum umb_status read_proven(const char *path, uint64_t most, struct block *block,
                                   uint8_t asset[UMBJ_HASH_BYTES], struct umb_error *error)
{
    struct umb__head head;
    UMB__TRY(read_file(path, most, block, error));
    UMB__TRY(umb__head_parse(block->bytes, block->size, &head, error));
    memcpy(asset, head.id, UMBJ_HASH_BYTES);
    return umb_packed_prove(block->bytes, block->size, NULL, &umbs_sha256, error);
}

void umbj_asset_path(const char *folder, const uint8_t asset[UMBJ_HASH_BYTES], char *path,
                     size_t size)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(asset, id);
    (void)snprintf(path, size, "%s/%s.umb", folder, id);
}

/* Compares a file with the bytes that were written to it. */
static enum umb_status compare(const struct block *block, const char *path, struct umb_error *error)
{
    struct block again = {NULL, 0};
    enum umb_status status = read_file(path, block->size, &again, error);
    if (status == UMB_OK &&
        (again.size != block->size || memcmp(again.bytes, block->bytes, block->size) != 0)) {
        status = umb_fail(error, UMB_E_IO, "the asset that was written does not read the same");
    }
    free(again.bytes);
    return status;
}

/* Writes the file, syncs it, reads it again and compares. */
static enum umb_status write_checked(const struct block *block, struct umbu_output *file,
                                     struct umb_error *error)
{
    UMB__TRY(umbu_output_write(file, block->bytes, block->size, error));
    if (fsync(file->fd) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot sync the asset");
    }
    return compare(block, file->temporary, error);
}

enum umb_status umbj_stage(const char *path, uint64_t most, const char *folder,
                           struct umbu_output *staged, uint8_t asset[UMBJ_HASH_BYTES],
                           struct umb_error *error)
{
    char target[4096];
    struct block block = {NULL, 0};
    *staged = (struct umbu_output){.fd = -1};
    enum umb_status status = read_proven(path, most, &block, asset, error);
    if (status == UMB_OK) {
        umbj_asset_path(folder, asset, target, sizeof target);
        status = umbu_output_begin(target, 0, staged, error);
        if (status == UMB_OK) {
            status = write_checked(&block, staged, error);
        }
        if (status != UMB_OK) {
            umbu_output_abandon(staged);
        }
    }
    free(block.bytes);
    return status;
}
