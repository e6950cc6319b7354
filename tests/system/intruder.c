/* SPDX-License-Identifier: Apache-2.0 */
/*
 * intruder.so: imitates a bake that its scene controls. Preloaded, never linked.
 *
 *     LD_PRELOAD=intruder.so INTRUDER_FILES=/a:/b umbrage-bake ...
 *
 * The bake's first sync of a file comes after its work and inside its sandbox. At that moment each
 * file of the list is opened to read and to write. The result is a notice: "intruder: PATH
 * read=ERRNO write=ERRNO", 0 for a success.
 */
#define _GNU_SOURCE /* syscall */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

int fsync(int fd);

static int try_open(const char *path, int flags)
{
    const int fd = open(path, flags | O_NONBLOCK | O_CLOEXEC);
    const int code = fd >= 0 ? 0 : errno;
    if (fd >= 0) {
        (void)close(fd);
    }
    return code;
}

static void intrude(const char *list)
{
    char path[4096], line[4400];
    while (*list != '\0') {
        const size_t length = strcspn(list, ":");
        (void)snprintf(path, sizeof path, "%.*s", (int)length, list);
        const int count =
            snprintf(line, sizeof line, "umbrage-bake: notice: intruder: %s read=%d write=%d\n",
                     path, try_open(path, O_RDONLY), try_open(path, O_WRONLY));
        (void)!write(STDERR_FILENO, line, (size_t)count);
        list += length + (list[length] != '\0');
    }
}

__attribute__((visibility("default"))) int fsync(int fd)
{
    static int done;
    const char *list = getenv("INTRUDER_FILES");
    if (!done && list != NULL) {
        done = 1;
        intrude(list);
    }
    return (int)syscall(SYS_fsync, fd);
}
