/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
/*
 * What the importer's process may do once it looks at a foreign byte: compute, get and return
 * memory, ask its parent for a file (scene/scene_broker.h), write the scene and one sentence.
 *
 * Layers, from the outside in:
 *     limits      resource limits that the parent sets (scene/scene_process.h). Required.
 *     namespaces  own users, network, IPC, host name, mounts. Where the kernel lets us.
 *     landlock    no path can be opened, whatever the filter lets through. Where the kernel has it.
 *     seccomp     a list of allowed system calls; what libraries only try is refused, all else
 *                 kills the process. No page becomes executable. Required.
 *
 * Sanitizer builds need what the filter forbids and go without; umbb_sandbox_exempt says so.
 * Sources: seccomp(2), landlock(7), unshare(2).
 */
#include "umbrage/status.h"

struct umbb_sandbox {
    int namespaces;   /* 1: entered */
    int landlock_abi; /* 0: the kernel has none */
    int seccomp;      /* 1: loaded */
};

/* 1 in a sanitizer build: umbb_sandbox_enter does nothing there. */
int umbb_sandbox_exempt(void);

/*
 * Enters the sandbox, for good, with the calling thread, which must be the only one.
 *
 * Out:   what was entered, also when it fails.
 * Fails: E_UNAVAILABLE if a required layer is missing: then no foreign byte may be looked at.
 */
UMB_CHECKED enum umb_status umbb_sandbox_enter(struct umbb_sandbox *out, struct umb_error *error);

/* "full", "reduced" (an optional layer is missing), "exempt" or "none". */
const char *umbb_sandbox_level(const struct umbb_sandbox *sandbox);

#endif
