/* SPDX-License-Identifier: Apache-2.0 */
/* Opens partial files; see cli_partial.h. */
#include "cli_partial.h"

#include "tool/tool_try.h"
#include "umbrage/file.h"
#include "umbrage/region.h"

/* Memory budget of a partial file, besides its own bytes. */
#define MEMORY_MAX ((uint64_t)16 << 30)

bool umbc_is_partial(const char *path)
{
    struct umb_file_head head;
    struct umb_file file;
    struct umb_error error;
    if (umb_file_open(path, &file, &error) != UMB_OK) {
        return false;
    }
    const enum umb_status status = umb_file_read_head(file.bytes, file.size, &head, &error);
    umb_file_close(&file);
    return status == UMB_E_UNSUPPORTED;
}

/* Adds all blocks of the directory of a packed file. */
static enum umb_status add_blocks(struct umb_partial *partial, const struct umb_file *file,
                                  struct umb_error *error)
{
    struct umb_partial_stats stats;
    umb_partial_get_stats(partial, &stats);
    for (uint32_t block = stats.blocks_held; block < stats.block_count; block++) {
        uint64_t offset;
        uint32_t length;
        umb_partial_locate_block(partial, block, &offset, &length);
        if (offset > file->size || length > file->size - offset) {
            return umb_fail(error, UMB_E_TRUNCATED, "directory: block %u is cut", block);
        }
        UMB__TRY(umb_partial_add_block(partial, block, (const uint8_t *)file->bytes + offset,
                                       length, error));
    }
    return UMB_OK;
}

static enum umb_status open_bytes(const struct umb_file *file, struct umb_partial **partial,
                                  struct umb_error *error)
{
    const struct umb_partial_options options = {.sha256 = umb_sha256_openssl(),
                                                .max_memory_bytes = MEMORY_MAX};
    struct umb_file_head head;
    enum umb_status status = umb_file_read_head(file->bytes, file->size, &head, error);
    if (status == UMB_E_UNSUPPORTED) {
        return umb_partial_open_saved(file->bytes, file->size, &options, partial, error);
    }
    if (status != UMB_OK || head.encoding != UMB_ENCODING_PACKED) {
        return status;
    }
    UMB__TRY(umb_partial_open(file->bytes, file->size, &options, partial, error));
    status = add_blocks(*partial, file, error);
    if (status != UMB_OK) {
        umb_partial_close(*partial);
        *partial = NULL;
    }
    return status;
}

enum umb_status umbc_partial_open(const char *path, struct umb_partial **partial,
                                  struct umb_error *error)
{
    struct umb_file file;
    *partial = NULL;
    UMB__TRY(umb_file_open(path, &file, error));
    const enum umb_status status = open_bytes(&file, partial, error);
    umb_file_close(&file);
    return status;
}
