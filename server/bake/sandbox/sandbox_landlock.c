/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Landlock: a path is denied unless a rule allows it. glibc has no functions for Landlock.
 *
 * A rule applies to the file that its path leads to when the rule is made. Rights unknown to this
 * kernel's Landlock are neither allowed nor denied: the system call filter covers them.
 * Source: landlock(7).
 */
#define _GNU_SOURCE /* O_PATH, syscall */
#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <stdint.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "bake/sandbox/sandbox.h"

/* Rights over paths, by the Landlock ABI that introduced them. */
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

/* Rights that apply to a file; all rights apply to a folder. */
#define FILE_RIGHTS                                                                                \
    (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE |   \
     RIGHT_TRUNCATE)

static const uint64_t rights_of[] = {
    [UMBB_PATH_READ] = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR,
    [UMBB_PATH_RUN] = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_EXECUTE,
    [UMBB_PATH_WRITE] = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR |
                        LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_MAKE_REG |
                        LANDLOCK_ACCESS_FS_REMOVE_FILE | RIGHT_TRUNCATE,
};

/* Rights that the kernel's ABI knows, introduced by ABI `first`. */
static uint64_t known(long abi, long first, uint64_t rights)
{
    return abi >= first ? rights : 0;
}

/* Makes an empty ruleset that denies all that the kernel's ABI can. Returns a descriptor or -1. */
static int make_ruleset(long abi, struct ruleset *rules)
{
    const size_t size = abi >= 6   ? sizeof(*rules)
                        : abi >= 4 ? offsetof(struct ruleset, scopes)
                                   : offsetof(struct ruleset, net);
    *rules = (struct ruleset){
        .paths = RIGHTS_ABI1 | known(abi, 2, RIGHT_REFER) | known(abi, 3, RIGHT_TRUNCATE) |
                 known(abi, 5, RIGHT_IOCTL),
        .net = known(abi, 4, NET_RIGHTS),
        .scopes = known(abi, 6, SCOPES),
    };
    return (int)syscall(SYS_landlock_create_ruleset, rules, size, 0U);
}

/* Allows a path; a path without a file needs no rule. Out: 0, or -1 and errno. */
static int add_rule(int ruleset, uint64_t handled, const struct umbb_path_rule *rule)
{
    struct stat facts;
    struct landlock_path_beneath_attr beneath = {.allowed_access = rights_of[rule->use] & handled};
    beneath.parent_fd = open(rule->path, O_PATH | O_CLOEXEC);
    if (beneath.parent_fd < 0) {
        return errno == ENOENT || errno == ENOTDIR || errno == EACCES ? 0 : -1;
    }
    long code = fstat(beneath.parent_fd, &facts);
    if (code == 0 && !S_ISDIR(facts.st_mode)) {
        beneath.allowed_access &= FILE_RIGHTS;
    }
    if (code == 0) {
        code = syscall(SYS_landlock_add_rule, ruleset, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0U);
    }
    const int saved = errno;
    (void)close(beneath.parent_fd);
    errno = saved;
    return code == 0 ? 0 : -1;
}

int umbb_landlock_enter(const struct umbb_path_rule *rules, size_t count)
{
    struct ruleset denied;
    const long abi =
        syscall(SYS_landlock_create_ruleset, NULL, (size_t)0, LANDLOCK_CREATE_RULESET_VERSION);
    const int fd = abi >= 1 ? make_ruleset(abi, &denied) : -1;
    if (fd < 0) {
        return 0;
    }
    int good = 1;
    for (size_t i = 0; good && i < count; i++) {
        good = add_rule(fd, denied.paths, &rules[i]) == 0;
    }
    good = good && syscall(SYS_landlock_restrict_self, fd, 0U) == 0;
    const int saved = errno;
    (void)close(fd);
    errno = saved;
    return good ? (int)abi : 0;
}
