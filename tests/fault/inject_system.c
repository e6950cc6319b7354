/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Stand-ins for calls about sockets, descriptors and threads, and for reads at an offset: the calls
 * of a daemon that concern neither files nor memory (inject.c says when they fail).
 */
#define _GNU_SOURCE /* RTLD_NEXT, accept4, pread64 */
#include "inject.h"

#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stddef.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

static int (*real_pthread_create)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);

/* Converts a data pointer to a function pointer in the way that POSIX gives for dlsym. */
__attribute__((constructor)) static void look_up_originals(void)
{
    void *found = dlsym(RTLD_NEXT, "pthread_create");
    memcpy(&real_pthread_create, &found, sizeof found);
}

/* -1 and errno if the call is to fail. */
#define FAIL_IF_CHOSEN(function)                                                                   \
    if (fault_system(function)) {                                                                  \
        return -1;                                                                                 \
    }

EXPORT int socket(int domain, int type, int protocol)
{
    FAIL_IF_CHOSEN(SOCKET)
    return (int)syscall(SYS_socket, domain, type, protocol);
}

EXPORT int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    FAIL_IF_CHOSEN(BIND)
    return (int)syscall(SYS_bind, fd, address, size);
}

EXPORT int listen(int fd, int backlog)
{
    FAIL_IF_CHOSEN(LISTEN)
    return (int)syscall(SYS_listen, fd, backlog);
}

EXPORT int accept4(int fd, struct sockaddr *address, socklen_t *size, int flags)
{
    FAIL_IF_CHOSEN(ACCEPT)
    return (int)syscall(SYS_accept4, fd, address, size, flags);
}

EXPORT int getsockname(int fd, struct sockaddr *address, socklen_t *size)
{
    FAIL_IF_CHOSEN(GETSOCKNAME)
    return (int)syscall(SYS_getsockname, fd, address, size);
}

EXPORT int getsockopt(int fd, int level, int name, void *value, socklen_t *size)
{
    FAIL_IF_CHOSEN(GETSOCKOPT)
    return (int)syscall(SYS_getsockopt, fd, level, name, value, size);
}

EXPORT int setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
    FAIL_IF_CHOSEN(SETSOCKOPT)
    return (int)syscall(SYS_setsockopt, fd, level, name, value, size);
}

EXPORT int chmod(const char *path, mode_t mode)
{
    FAIL_IF_CHOSEN(CHMOD)
    return (int)syscall(SYS_fchmodat, -100 /* AT_FDCWD */, path, mode);
}

EXPORT int getrlimit(__rlimit_resource_t resource, struct rlimit *limit)
{
    FAIL_IF_CHOSEN(GETRLIMIT)
    return (int)syscall(SYS_prlimit64, 0, resource, NULL, limit);
}

EXPORT int epoll_create1(int flags)
{
    FAIL_IF_CHOSEN(EPOLL)
    return (int)syscall(SYS_epoll_create1, flags);
}

EXPORT ssize_t pread(int fd, void *bytes, size_t count, off_t offset)
{
    FAIL_IF_CHOSEN(PREAD)
    return syscall(SYS_pread64, fd, bytes, count, offset);
}

EXPORT ssize_t pread64(int fd, void *bytes, size_t count, off64_t offset)
{
    FAIL_IF_CHOSEN(PREAD)
    return syscall(SYS_pread64, fd, bytes, count, offset);
}

EXPORT int pthread_create(pthread_t *thread, const pthread_attr_t *attributes,
                          void *(*begin)(void *), void *argument)
{
    if (fault_system(PTHREAD_CREATE)) {
        return errno;
    }
    return real_pthread_create(thread, attributes, begin, argument);
}
