/* SPDX-License-Identifier: Apache-2.0 */
/* Asset files as bytes: reading, writing in either encoding, and proof; see umbrage/file.h. */
#include "umbrage/file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "format/asset_parts.h"

enum umb_status umb_file_open(const char *path, struct umb_file *file, struct umb_error *error)
{
    *file = (struct umb_file){NULL, 0};
    /* O_NONBLOCK makes the open of a pipe without a writer fail instead of waiting. */
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "%.200s", path);
    }
    struct stat facts;
    enum umb_status status = UMB_OK;
    if (fstat(fd, &facts) != 0) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "%.200s", path);
    } else if (!S_ISREG(facts.st_mode)) {
        status = umb_fail(error, UMB_E_NO_INPUT, "%.200s: not a regular file", path);
    } else if (facts.st_size == 0) {
        status = umb_fail(error, UMB_E_TRUNCATED, "%.200s: empty file", path);
    } else if ((uint64_t)facts.st_size > SIZE_MAX) {
        status = umb_fail(error, UMB_E_TOO_LARGE, "%.200s: larger than the address space", path);
    } else {
        void *at = mmap(NULL, (size_t)facts.st_size, PROT_READ, MAP_SHARED, fd, 0);
        if (at == MAP_FAILED) {
            status = umb_fail_errno(error, UMB_E_IO, errno, "%.200s: cannot be mapped", path);
        } else {
            *file = (struct umb_file){at, (size_t)facts.st_size};
        }
    }
    (void)close(fd);
    return status;
}

void umb_file_close(struct umb_file *file)
{
    if (file->bytes) {
        (void)munmap((void *)(uintptr_t)file->bytes, file->size);
    }
    *file = (struct umb_file){NULL, 0};
}

enum umb_status umb_file_read_head(const void *bytes, size_t size, struct umb_file_head *head,
                                   struct umb_error *error)
{
    memset(head, 0, sizeof *head);
    return umb__head_measure(bytes, size, head, error);
}

static enum umb_status drop_bytes(void *user, const void *bytes, size_t count)
{
    (void)user;
    (void)bytes;
    (void)count;
    return UMB_OK;
}

/* Packs an asset and compares the id of the packed content with the id in the asset. */
static enum umb_status pack_again(const struct umb_asset *asset, const struct umb_sha256 *sha256,
                                  const struct umb_sink *sink, struct umb_error *error)
{
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    if (!sha256) {
        return umb_fail(error, UMB_E_ARGUMENT, "sha256: NULL, packing needs one");
    }
    UMB__TRY(umb__asset_export(asset, &octree, &content, error));
    enum umb_status status = umb__pack_write(&content, &octree, sha256, sink, id, error);
    umb__octree_finish(&octree);
    if (status == UMB_OK && memcmp(id, asset->id, sizeof id) != 0) {
        char made[UMB_ID_TEXT_SIZE], claimed[UMB_ID_TEXT_SIZE];
        umb_id_to_text(id, made);
        umb_id_to_text(asset->id, claimed);
        status =
            umb_fail(error, UMB_E_CORRUPT,
                     "id: the content has %s, the file claims %s: damaged or of another version",
                     made, claimed);
    }
    return status;
}

enum umb_status umb_asset_write(const struct umb_asset *asset, enum umb_encoding encoding,
                                const struct umb_sha256 *sha256, const struct umb_sink *sink,
                                struct umb_error *error)
{
    switch (encoding) {
    case UMB_ENCODING_PACKED:
        return pack_again(asset, sha256, sink, error);
    case UMB_ENCODING_MAPPED:
        return umb__mapped_write(asset, sink, error);
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "encoding: %d is unknown, give UMB_ENCODING_PACKED or "
                    "UMB_ENCODING_MAPPED",
                    (int)encoding);
}

enum umb_status umb_asset_prove(const struct umb_asset *asset, const struct umb_sha256 *sha256,
                                struct umb_error *error)
{
    const struct umb_sink nowhere = {.write = drop_bytes, .user = NULL};
    return pack_again(asset, sha256, &nowhere, error);
}
