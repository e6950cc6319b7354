/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The optional layers of the kernel: namespaces and Landlock. glibc has no functions for Landlock.
 * Sources: unshare(2), user_namespaces(7), landlock(7).
 */
#define _GNU_SOURCE /* unshare, syscall */
#include <errno.h>
#include <linux/landlock.h>
#include <sched.h>
#include <stdint.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/sandbox_parts.h"

/* Rights over paths that Landlock knows, by the ABI that brought them. */
#define RIGHTS_ABI1    ((1ULL << 13) - 1)
#define RIGHT_REFER    (1ULL << 13) /* ABI 2 */
#define RIGHT_TRUNCATE (1ULL << 14) /* ABI 3 */
#define RIGHT_IOCTL    (1ULL << 15) /* ABI 5 */
#define NET_RIGHTS     3ULL         /* ABI 4: bind and connect TCP */
#define SCOPES         3ULL         /* ABI 6: abstract sockets and signals */

/* The kernel's structure as of ABI 6; an older kernel takes a shorter one. */
struct ruleset {
    uint64_t paths, net, scopes;
};

int umbb_namespaces_enter(void)
{
    const int others = CLONE_NEWNET | CLONE_NEWIPC | CLONE_NEWUTS | CLONE_NEWNS;
    return unshare(CLONE_NEWUSER | others) == 0 || unshare(others) == 0;
}

int umbb_landlock_enter(void)
{
    long abi =
        syscall(SYS_landlock_create_ruleset, NULL, (size_t)0, LANDLOCK_CREATE_RULESET_VERSION);
    if (abi < 1) {
        return 0;
    }
    struct ruleset rules = {.paths = RIGHTS_ABI1};
    size_t size = sizeof(rules.paths);
    if (abi >= 2) {
        rules.paths |= RIGHT_REFER;
    }
    if (abi >= 3) {
        rules.paths |= RIGHT_TRUNCATE;
    }
    if (abi >= 5) {
        rules.paths |= RIGHT_IOCTL;
    }
    if (abi >= 4) {
        rules.net = NET_RIGHTS;
        size += sizeof(rules.net);
    }
    if (abi >= 6) {
        rules.scopes = SCOPES;
        size += sizeof(rules.scopes);
    }
    long fd = syscall(SYS_landlock_create_ruleset, &rules, size, 0U);
    if (fd < 0) {
        return 0;
    }
    long code = syscall(SYS_landlock_restrict_self, (int)fd, 0U);
    int saved = errno;
    (void)close((int)fd);
    errno = saved;
    return code == 0 ? (int)abi : 0;
}
