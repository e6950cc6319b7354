/* SPDX-License-Identifier: Apache-2.0 */
/* Enters the layers in their order (sandbox.h): each one forbids calls that the earlier ones need.
 * Sources: unshare(2), user_namespaces(7). */
#define _GNU_SOURCE /* unshare, dl_iterate_phdr */
#include "bake/sandbox/sandbox.h"

#include <errno.h>
#include <link.h>
#include <sched.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>

#include "base/compat.h"
#include "common/child_process.h"

#ifndef EXEMPT /* coverage builds define EXEMPT as 1, because the filter would kill a process that
                  writes its counts */
#define EXEMPT UMB__SANITIZED
#endif

static int enter_namespaces(void)
{
    const int others = CLONE_NEWNET | CLONE_NEWIPC | CLONE_NEWUTS | CLONE_NEWNS;
    return unshare(CLONE_NEWUSER | others) == 0 || unshare(others) == 0;
}

int umbb_sandbox_exempt(void)
{
    return EXEMPT;
}

enum umb_status umbb_sandbox_enter(struct umbb_sandbox *out, struct umb_error *error)
{
    memset(out, 0, sizeof(*out));
    if (EXEMPT) {
        return UMB_OK;
    }
    /* Without it an ordinary user gets neither Landlock nor a filter. */
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "sandbox: prctl");
    }
    out->namespaces = enter_namespaces();
    out->landlock_abi = umbb_landlock_enter(NULL, 0);
    out->seccomp = umbb_filter_enter();
    if (!out->seccomp && errno == ENOMEM) {
        return umb_fail(error, UMB_E_NO_MEMORY, "sandbox: out of memory for its filter");
    }
    if (!out->seccomp) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno,
                              "sandbox: the kernel takes no system call filter (seccomp)");
    }
    return UMB_OK;
}

const char *umbb_sandbox_level(const struct umbb_sandbox *sandbox)
{
    if (EXEMPT) {
        return "exempt";
    }
    if (!sandbox->seccomp) {
        return "none";
    }
    return sandbox->namespaces && sandbox->landlock_abi > 0 ? "full" : "reduced";
}

#define RULES_MAX 192U
#define FILES_MAX 256U /* limit of descriptors; a bake has a dozen */
/* Bytes in addition to --memory: stacks, libraries, the allocator. */
#define SLACK_BYTES  ((uint64_t)2 << 30)
#define THREAD_BYTES ((uint64_t)48 << 20) /* bytes of a thread's stack and arena of malloc */

/* Tables of the system that the C library and Embree's threads read: processors, pages, paths of
 * libraries. No table contains data of a user. */
static const struct umbb_path_rule system_rules[] = {
    {"/etc/ld.so.cache", UMBB_PATH_READ},
    {"/sys/devices/system/cpu", UMBB_PATH_READ},
    {"/sys/kernel/mm/transparent_hugepage", UMBB_PATH_READ},
    {"/proc/meminfo", UMBB_PATH_READ},
    {"/proc/sys/vm", UMBB_PATH_READ},
    {"/dev/null", UMBB_PATH_WRITE},
};

struct rule_list {
    struct umbb_path_rule rules[RULES_MAX];
    size_t count;
};

static void add_rule(struct rule_list *list, const char *path, enum umbb_path_use use)
{
    if (list->count < RULES_MAX) {
        list->rules[list->count++] = (struct umbb_path_rule){path, use};
    }
}

/* Allows a loaded library. In the loader's list the program has no name, and the kernel's vDSO has
 * no path; both are passed over. */
static int add_library(struct dl_phdr_info *info, size_t size, void *user)
{
    (void)size;
    if (info->dlpi_name != NULL && strchr(info->dlpi_name, '/') != NULL) {
        add_rule(user, info->dlpi_name, UMBB_PATH_RUN);
    }
    return 0;
}

static enum umb_status lacks(const char *what, struct umb_error *error)
{
    return umb_fail_errno(
        error, UMB_E_UNAVAILABLE, errno,
        "--sandbox required: the bake's sandbox lacks a layer: %s (see umbrage-bake doctor; "
        "--sandbox available, or umbraged --job-sandbox available, bakes without it)",
        what);
}

static int is_out(const struct umbb_bake_sandbox *sandbox)
{
    return sandbox->mode == UMBB_SANDBOX_OFF || umbb_sandbox_exempt();
}

enum umb_status umbb_bake_sandbox_paths(struct umbb_bake_sandbox *sandbox,
                                        const struct umbb_path_rule *rules, size_t count,
                                        struct umb_error *error)
{
    struct rule_list list = {.count = 0};
    if (is_out(sandbox)) {
        return UMB_OK;
    }
    add_rule(&list, "/proc/self/exe", UMBB_PATH_RUN);
    (void)dl_iterate_phdr(add_library, &list);
    for (size_t i = 0; i < sizeof system_rules / sizeof system_rules[0]; i++) {
        add_rule(&list, system_rules[i].path, system_rules[i].use);
    }
    for (size_t i = 0; i < count; i++) {
        add_rule(&list, rules[i].path, rules[i].use);
    }
    errno = ENOSYS;
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0) {
        sandbox->landlock_abi = umbb_landlock_enter(list.rules, list.count);
    }
    return sandbox->landlock_abi > 0 || sandbox->mode != UMBB_SANDBOX_REQUIRED
               ? UMB_OK
               : lacks("no Landlock here (Linux 5.13 or later with lsm=landlock)", error);
}

enum umb_status umbb_bake_sandbox_calls(struct umbb_bake_sandbox *sandbox, int importer, int files,
                                        struct umb_error *error)
{
    if (is_out(sandbox)) {
        return UMB_OK;
    }
    /* Other processes of the same user cannot read the memory of this one. */
    const int hidden = prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) == 0;
    sandbox->seccomp = hidden && umbb_bake_filter_enter(importer, files);
    return sandbox->seccomp || sandbox->mode != UMBB_SANDBOX_REQUIRED
               ? UMB_OK
               : lacks("the kernel takes no system call filter (seccomp)", error);
}

enum umb_status umbb_bake_sandbox_limits(uint64_t memory_bytes, unsigned threads,
                                         struct umb_error *error)
{
    const uint64_t memory = 2 * memory_bytes + threads * THREAD_BYTES + SLACK_BYTES;
    if (umbb_sandbox_exempt()) { /* sanitizers reserve terabytes */
        return UMB_OK;
    }
    if (umbs_child_limit(RLIMIT_CORE, 0, 0) != 0 ||
        umbs_child_limit(RLIMIT_NOFILE, FILES_MAX, FILES_MAX) != 0 ||
        umbs_child_limit(RLIMIT_DATA, memory, memory) != 0) {
        return umb_fail_errno(error, UMB_E_UNAVAILABLE, errno, "sandbox: cannot set its limits");
    }
    return UMB_OK;
}

const char *umbb_bake_sandbox_level(const struct umbb_bake_sandbox *sandbox)
{
    if (sandbox->mode == UMBB_SANDBOX_OFF) {
        return "off";
    }
    if (umbb_sandbox_exempt()) {
        return "exempt";
    }
    return sandbox->landlock_abi > 0 && sandbox->seccomp ? "full" : "reduced";
}
