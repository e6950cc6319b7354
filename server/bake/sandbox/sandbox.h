/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
/*
 * The sandbox of the importer's process. Inside, the importer may compute, allocate and free
 * memory, ask its parent for a file (scene/scene_broker.h), and write the scene and one message. It
 * enters the sandbox before it reads a foreign byte.
 *
 * Layers, from the outside in:
 *     limits      resource limits that the parent sets (scene/scene_process.h). Required.
 *     namespaces  own users, network, IPC, host name, mounts. If the kernel allows them.
 *     landlock    no path can be opened, even if the filter allows a call. If the kernel has it.
 *     seccomp     a list of allowed system calls. Calls that libraries try and can do without are
 *                 refused, all others kill the process. No page becomes executable. Required.
 *
 * Sanitizer builds need calls that the filter forbids, so they run without the sandbox
 * (umbb_sandbox_exempt).
 * Sources: seccomp(2), landlock(7), unshare(2).
 */
#include "umbrage/status.h"

struct umbb_sandbox {
    int namespaces;   /* 1: the process has its own namespaces */
    int landlock_abi; /* ABI of the kernel's Landlock; 0: it has none */
    int seccomp;      /* 1: the filter is loaded */
};

/* Returns 1 in a sanitizer build, where umbb_sandbox_enter does nothing. */
int umbb_sandbox_exempt(void);

/*
 * Enters the sandbox, for good, with the calling thread, which must be the only one.
 *
 * Out:   out: the entered layers, also on failure.
 * Fails: E_UNAVAILABLE if a required layer is missing. The caller must not read the scene then.
 */
UMB_CHECKED enum umb_status umbb_sandbox_enter(struct umbb_sandbox *out, struct umb_error *error);

/* "full", "reduced" (an optional layer is missing), "exempt" or "none". */
const char *umbb_sandbox_level(const struct umbb_sandbox *sandbox);

#endif
