/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Opens names beneath a folder (open_beneath.h).
 *
 * openat2 with RESOLVE_BENEATH lets the kernel prove, without a race, that a name does not leave
 * the folder (Linux 5.6). On older kernels each component is opened separately, and symbolic links
 * are refused. Source: openat2(2).
 */
#define _GNU_SOURCE /* openat2's number, O_PATH, syscall */
#include "common/open_beneath.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "common/file_system.h"

/* Most attempts of an opening. A rename elsewhere makes at worst one attempt in dozens fail, so
 * this many failures in a row mean an attack. */
#define TRIES_MAX 1000

/* Opens one component at a time, following no symbolic links. */
static int walk_beneath(int folder, const char *name)
{
    char copy[UMBS_BENEATH_NAME_BYTES];
    size_t length = strlen(name);
    memcpy(copy, name, length + 1);
    if (copy[0] == '/') {
        errno = EXDEV;
        return -1;
    }
    int at = dup(folder);
    char *rest = copy;
    while (at >= 0) {
        char *slash = strchr(rest, '/');
        if (slash != NULL) {
            *slash = '\0';
        }
        int flags = slash != NULL ? O_PATH | O_DIRECTORY : O_RDONLY | O_NONBLOCK | O_NOCTTY;
        int next = -1;
        if (strcmp(rest, "..") == 0) {
            errno = EXDEV;
        } else {
            next = openat(at, *rest != '\0' ? rest : ".", flags | O_NOFOLLOW | O_CLOEXEC);
        }
        umbs_hang_up(&at);
        at = next;
        if (slash == NULL) {
            break;
        }
        rest = slash + 1;
    }
    return at;
}

/* Calls openat2 again while a rename elsewhere on the machine keeps it from resolving a "..". */
static int open_retrying(int folder, const char *name, const struct open_how *how)
{
    int fd = -1;
    for (int tries = 0; tries < TRIES_MAX; tries++) {
        fd = (int)syscall(SYS_openat2, folder, name, how, sizeof(*how));
        if (fd >= 0 || (errno != EAGAIN && errno != EINTR)) {
            break;
        }
    }
    return fd;
}

int umbs_open_beneath(int folder, const char *name)
{
    struct open_how how = {
        .flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY,
        .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS,
    };
    if (strlen(name) >= UMBS_BENEATH_NAME_BYTES) {
        errno = ENAMETOOLONG;
        return -1;
    }
    int fd = open_retrying(folder, name, &how);
    if (fd < 0 && (errno == ENOSYS || errno == EPERM)) {
        fd = walk_beneath(folder, name);
    }
    struct stat facts;
    if (fd < 0) {
        return -1;
    }
    if (fstat(fd, &facts) != 0) {
        umbs_hang_up(&fd);
        return -1;
    }
    if (!S_ISREG(facts.st_mode)) {
        (void)close(fd);
        errno = S_ISDIR(facts.st_mode) ? EISDIR : ENODEV;
        return -1;
    }
    return fd;
}
