/* SPDX-License-Identifier: Apache-2.0 */
/* Enters the layers in their order (sandbox.h): each one forbids calls that the earlier ones need.
 * Sources: unshare(2), user_namespaces(7). */
#define _GNU_SOURCE /* unshare */
#include "bake/sandbox/sandbox.h"

#include <errno.h>
#include <sched.h>
#include <string.h>
#include <sys/prctl.h>

#include "bake/sandbox/sandbox_parts.h"
#include "base/compat.h"

#ifndef EXEMPT /* coverage builds set it: the filter would kill a process that writes its counts */
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
