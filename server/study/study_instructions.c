/* SPDX-License-Identifier: Apache-2.0 */
/* The processor's counter of instructions; see study_probe.h. */
#define _GNU_SOURCE /* syscall */
#include "study/study_probe.h"

#include <errno.h>
#include <linux/perf_event.h>
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Words for the errors that users meet. */
static const char *why(int code)
{
    switch (code) {
    case ENOENT:
    case EOPNOTSUPP:
        return "this machine has no counter for them";
    case EACCES:
    case EPERM:
        return "the system does not allow it (kernel.perf_event_paranoid)";
    case ENOSYS:
        return "the system has no perf_event_open";
    default:
        return strerror(code);
    }
}

int umbt_instructions_open(char *reason, size_t size)
{
    struct perf_event_attr attributes = {
        .type = PERF_TYPE_HARDWARE,
        .size = sizeof attributes,
        .config = PERF_COUNT_HW_INSTRUCTIONS,
        .exclude_kernel = 1,
        .exclude_hv = 1,
    };
    const long counter = syscall(SYS_perf_event_open, &attributes, 0, -1, -1, PERF_FLAG_FD_CLOEXEC);
    reason[0] = '\0';
    if (counter < 0) {
        (void)snprintf(reason, size, "%s", why(errno));
        return -1;
    }
    return (int)counter;
}

uint64_t umbt_instructions_read(int counter)
{
    uint64_t count = 0;
    return counter >= 0 && read(counter, &count, sizeof count) == (ssize_t)sizeof count ? count : 0;
}
