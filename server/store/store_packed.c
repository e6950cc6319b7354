/* SPDX-License-Identifier: Apache-2.0 */
/* Packed files for sending: opened anew each time, and only if the file still is the version that
 * was proven when the entry was loaded. */
#include "store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "format/layout.h"

/* True if the file has the proven stamp, or if its head carries the entry's id. A copy of the same
 * asset serves as well: the receiver proves its pages. */
static int is_of(const struct umbs_entry *entry, int fd, uint64_t *size)
{
    uint8_t head[UMB__HEAD_SIZE];
    struct stat stat_buffer;
    if (fstat(fd, &stat_buffer) != 0 || !S_ISREG(stat_buffer.st_mode) ||
        pread(fd, head, sizeof head, 0) != (ssize_t)sizeof head) {
        return 0;
    }
    *size = (uint64_t)stat_buffer.st_size;
    return memcmp(head, UMB__MAGIC_PACKED, 8) == 0 &&
           memcmp(head + UMB__HEAD_ID, entry->item.id, UMB_ID_BYTES) == 0;
}

enum umb_status umbs_entry_open_packed(const struct umbs_entry *entry, int *fd, uint64_t *size,
                                       struct umb_error *error)
{
    struct umbs_name name = {.folder = entry->folder};
    snprintf(name.text, sizeof name.text, "%s", entry->item.name);
    *fd = -1;
    *size = 0;
    char *path = umbs__packed_path(entry->store, &name);
    if (path == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a path");
    }
    const int opened = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    const int reason = errno;
    free(path);
    if (opened < 0 && reason != ENOENT) {
        return umb_fail_errno(error, UMB_E_IO, reason, "cannot open '%.64s.umb'", entry->item.name);
    }
    if (opened < 0 || !is_of(entry, opened, size)) {
        if (opened >= 0) {
            close(opened);
        }
        return umb_fail(error, UMB_E_STATE,
                        "asset: the packed file of this version of '%.64s' is gone",
                        entry->item.name);
    }
    *fd = opened;
    return UMB_OK;
}
