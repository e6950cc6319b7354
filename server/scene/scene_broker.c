/* SPDX-License-Identifier: Apache-2.0 */
/* Passing of descriptors by name (scene_broker.h). Source: unix(7), cmsg(3). */
#define _GNU_SOURCE /* MSG_CMSG_CLOEXEC */
#include "scene/scene_broker.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include "common/file_system.h"
#include "common/open_beneath.h"

/* Room for one descriptor, aligned as the header of a control message must be. */
union control {
    struct cmsghdr header;
    char bytes[CMSG_SPACE(sizeof(int))];
};

int umbs_broker_pair(int ends[2])
{
    return socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends);
}

static void answer(int end, int fd, int32_t code)
{
    union control control = {.bytes = {0}};
    struct iovec data = {.iov_base = &code, .iov_len = sizeof(code)};
    struct msghdr message = {.msg_iov = &data, .msg_iovlen = 1};
    if (fd >= 0) {
        message.msg_control = control.bytes;
        message.msg_controllen = sizeof(control.bytes);
        struct cmsghdr *header = CMSG_FIRSTHDR(&message);
        header->cmsg_level = SOL_SOCKET;
        header->cmsg_type = SCM_RIGHTS;
        header->cmsg_len = CMSG_LEN(sizeof(int));
        memcpy(CMSG_DATA(header), &fd, sizeof(int));
    }
    /* The answer is dropped if the importer reads none of those before it. */
    (void)sendmsg(end, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
}

int umbs_broker_serve(int end, int folder, uint32_t *left)
{
    char name[UMBS_BENEATH_NAME_BYTES];
    ssize_t length = recv(end, name, sizeof(name), MSG_DONTWAIT | MSG_TRUNC);
    if (length < 0) {
        return errno == EAGAIN || errno == EINTR;
    }
    if (length == 0) {
        return 0;
    }
    if (*left == 0) {
        return -1;
    }
    --*left;
    int fd = -1;
    errno = ENAMETOOLONG;
    if ((size_t)length < sizeof(name)) {
        name[length] = '\0';
        errno = EINVAL;
        fd = memchr(name, '\0', (size_t)length) == NULL ? umbs_open_beneath(folder, name) : -1;
    }
    answer(end, fd, fd >= 0 ? 0 : errno);
    umbs_hang_up(&fd);
    return 1;
}

static int take_answer(int end)
{
    int32_t code = 0;
    union control control;
    struct iovec data = {.iov_base = &code, .iov_len = sizeof(code)};
    struct msghdr message = {
        .msg_iov = &data,
        .msg_iovlen = 1,
        .msg_control = control.bytes,
        .msg_controllen = sizeof(control.bytes),
    };
    ssize_t got;
    do {
        got = recvmsg(end, &message, MSG_CMSG_CLOEXEC);
    } while (got < 0 && errno == EINTR);
    if (got != (ssize_t)sizeof(code)) {
        errno = got < 0 ? errno : EPIPE;
        return -1;
    }
    struct cmsghdr *header = CMSG_FIRSTHDR(&message);
    if (code != 0 || header == NULL || header->cmsg_type != SCM_RIGHTS) {
        errno = code != 0 ? code : EPIPE;
        return -1;
    }
    int fd;
    memcpy(&fd, CMSG_DATA(header), sizeof(fd));
    return fd;
}

int umbs_broker_open(int end, const char *name)
{
    size_t length = strlen(name);
    if (length == 0 || length >= UMBS_BENEATH_NAME_BYTES) {
        errno = length == 0 ? ENOENT : ENAMETOOLONG;
        return -1;
    }
    struct iovec data = {.iov_base = (void *)(uintptr_t)name, .iov_len = length};
    struct msghdr message = {.msg_iov = &data, .msg_iovlen = 1};
    ssize_t sent;
    do {
        sent = sendmsg(end, &message, MSG_NOSIGNAL);
    } while (sent < 0 && errno == EINTR);
    return sent < 0 ? -1 : take_answer(end);
}
