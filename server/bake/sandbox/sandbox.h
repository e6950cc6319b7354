/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
/*
 * The sandbox of the importer's process. Once it reads a foreign byte it may compute, allocate and
 * free memory, ask its parent for a file (scene/scene_broker.h), and write the scene and one
 * message.
 *
 * Layers, from the outside in:
 *     limits      resource limits that the parent sets (scene/scene_process.h). Required.
 *     namespaces  own users, network, IPC, host name, mounts. If the kernel allows them.
 *     landlock    no path can be opened, even if the filter allows a call. If the kernel has it.
 *     seccomp     a list of allowed system calls; calls that libraries try and can do without are
 *                 refused, all others kill the process. No page becomes executable. Required.
 *
 * Sanitizer builds need what the filter forbids and run without it; umbb_sandbox_exempt tells.
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
 * Out:   the entered layers, also on failure.
 * Fails: E_UNAVAILABLE if a required layer is missing: then no foreign byte may be read.
 */
UMB_CHECKED enum umb_status umbb_sandbox_enter(struct umbb_sandbox *out, struct umb_error *error);

/* "full", "reduced" (an optional layer is missing), "exempt" or "none". */
const char *umbb_sandbox_level(const struct umbb_sandbox *sandbox);

#endif
