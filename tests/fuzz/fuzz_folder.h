/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FUZZ_FOLDER_H
#define UMBRAGE_TESTS_FUZZ_FOLDER_H
/* A folder in memory for targets whose input is a file; removed at the end of the process. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fuzz.h"

static char fuzz_folder_path[256];

static inline void fuzz_remove_folder(void)
{
    pid_t child = fork();
    if (child == 0) {
        execl("/bin/rm", "rm", "-rf", fuzz_folder_path, (char *)NULL);
        _exit(127);
    }
    if (child > 0) {
        (void)waitpid(child, NULL, 0);
    }
}

/* Makes it once. */
static inline const char *fuzz_folder(void)
{
    if (fuzz_folder_path[0] == '\0') {
        struct stat facts;
        const int memory = stat("/dev/shm", &facts) == 0 && access("/dev/shm", W_OK) == 0;
        (void)snprintf(fuzz_folder_path, sizeof fuzz_folder_path, "%s/umbrage-fuzz%ld",
                       memory ? "/dev/shm" : "/tmp", (long)getpid());
        fuzz_remove_folder();
        FUZZ_DEMAND(mkdir(fuzz_folder_path, 0700) == 0);
        FUZZ_DEMAND(atexit(fuzz_remove_folder) == 0);
    }
    return fuzz_folder_path;
}

/* Replaces a file's bytes. */
static inline void fuzz_write(const char *path, const void *bytes, size_t size)
{
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    FUZZ_DEMAND(fd >= 0 && write(fd, bytes, size) == (ssize_t)size);
    (void)close(fd);
}

#endif
