/* SPDX-License-Identifier: Apache-2.0 */
/* See file_system.h. */
#include "common/file_system.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/vfs.h>
#include <unistd.h>

void umbs_hang_up(int *fd)
{
    const int cause = errno;
    if (*fd >= 0) {
        (void)close(*fd);
    }
    *fd = -1;
    errno = cause;
}

ssize_t umbs_read_full(int fd, void *bytes, size_t size)
{
    size_t have = 0;
    while (have < size) {
        const ssize_t count = read(fd, (char *)bytes + have, size - have);
        if (count == 0) {
            break;
        }
        if (count < 0 && errno != EINTR) {
            return -1;
        }
        have += count > 0 ? (size_t)count : 0;
    }
    return (ssize_t)have;
}

enum umb_status umbs_read_file(int fd, size_t size, const char *what, uint8_t **bytes,
                               struct umb_error *error)
{
    *bytes = NULL;
    uint8_t *block = malloc(size + 1);
    if (block == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory to read %zu bytes of %.210s", size,
                        what);
    }
    const ssize_t count = umbs_read_full(fd, block, size);
    if (count == (ssize_t)size) {
        *bytes = block;
        return UMB_OK;
    }
    const int cause = errno;
    free(block);
    return count < 0 ? umb_fail_errno(error, UMB_E_IO, cause, "cannot read %.210s", what)
                     : umb_fail(error, UMB_E_TRUNCATED, "%.210s ended at byte %zd of %zu", what,
                                count, size);
}

static const struct known {
    uint32_t magic;
    enum umbs_reach reach;
    const char *name;
} known[] = {
    {0xEF53, UMBS_REACH_LOCAL, "ext4"},           {0x58465342, UMBS_REACH_LOCAL, "XFS"},
    {0x9123683E, UMBS_REACH_LOCAL, "Btrfs"},      {0x2FC12FC1, UMBS_REACH_LOCAL, "ZFS"},
    {0x01021994, UMBS_REACH_LOCAL, "tmpfs"},      {0x858458F6, UMBS_REACH_LOCAL, "ramfs"},
    {0xF2F52010, UMBS_REACH_LOCAL, "F2FS"},       {0xCA451A4E, UMBS_REACH_LOCAL, "bcachefs"},
    {0x6969, UMBS_REACH_NETWORK, "NFS"},          {0x517B, UMBS_REACH_NETWORK, "SMB"},
    {0xFF534D42, UMBS_REACH_NETWORK, "CIFS"},     {0xFE534D42, UMBS_REACH_NETWORK, "SMB"},
    {0x0BD00BD0, UMBS_REACH_NETWORK, "Lustre"},   {0x65735546, UMBS_REACH_NETWORK, "FUSE"},
    {0x00C36400, UMBS_REACH_NETWORK, "Ceph"},     {0x01021997, UMBS_REACH_NETWORK, "9p"},
    {0x47504653, UMBS_REACH_NETWORK, "GPFS"},     {0x19830326, UMBS_REACH_NETWORK, "BeeGFS"},
    {0x5346414F, UMBS_REACH_NETWORK, "AFS"},      {0x6B414653, UMBS_REACH_NETWORK, "AFS"},
    {0x73757245, UMBS_REACH_NETWORK, "Coda"},     {0x01161970, UMBS_REACH_NETWORK, "GFS2"},
    {0x7461636F, UMBS_REACH_NETWORK, "OCFS2"},    {0xAAD7AAEA, UMBS_REACH_NETWORK, "PanFS"},
    {0x20030528, UMBS_REACH_NETWORK, "OrangeFS"}, {0x786F4256, UMBS_REACH_NETWORK, "vboxsf"},
    {0xBACBACBC, UMBS_REACH_NETWORK, "vmhgfs"},
};

enum umbs_reach umbs_file_system(int fd, const char **name)
{
    struct statfs facts;
    const int have = fstatfs(fd, &facts) == 0;
    enum umbs_reach reach = UMBS_REACH_UNKNOWN;
    const char *found = "an unknown file system";
    for (size_t i = 0; have && i < sizeof known / sizeof known[0]; i++) {
        if (known[i].magic == (uint32_t)facts.f_type) {
            reach = known[i].reach;
            found = known[i].name;
        }
    }
    if (name != NULL) {
        *name = found;
    }
    return reach;
}
