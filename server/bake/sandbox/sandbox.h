/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_H
/*
 * The sandboxes of the importer's process and of the bake.
 *
 * Inside its sandbox, the importer may compute, allocate and free memory, ask its parent for a file
 * (scene/scene_broker.h), and write the scene and one message. It enters before it reads a foreign
 * byte. Layers, from the outside in:
 *     limits      resource limits that the parent sets (scene/scene_import.c). Required.
 *     namespaces  own users, network, IPC, host name, mounts. If the kernel allows them.
 *     landlock    no path can be opened, even if the filter allows a call. If the kernel has it.
 *     seccomp     a list of allowed system calls. Calls that libraries try and can do without are
 *                 refused, all others kill the process. No page becomes executable. Required.
 *
 * In the bake analysis, depth, build, self-check and publishing work on numbers of an untrusted
 * scene, so they run with the rights of one bake only:
 *     limits      no core files, few descriptors, memory in proportion to --memory.
 *     landlock    paths: the scene's folder can be read, the folders of output and tiles written,
 *                 this program and its libraries run (the importer is this program), a few tables
 *                 of the system read.
 *     seccomp     the calls that Landlock does not see: no program, socket, other process or
 *                 executable page, no change of rights (sandbox_filters.c).
 *
 * The bake enters in two steps, because the importer starts between them. The first step restricts
 * paths. The second restricts calls, when the importer runs and before a byte of the scene or of
 * the importer's answers is read (umbs_import_options.shut_in).
 *
 * Sanitizer builds need calls that the filters forbid, so they run without the sandboxes
 * (umbb_sandbox_exempt).
 * Sources: seccomp(2), landlock(7), unshare(2).
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Returns 1 in a sanitizer build, where no sandbox is entered. */
int umbb_sandbox_exempt(void);

struct umbb_sandbox {
    int namespaces;   /* 1: the process has its own namespaces */
    int landlock_abi; /* ABI of the kernel's Landlock; 0: it has none */
    int seccomp;      /* 1: the filter is loaded */
};

/*
 * Enters the importer's sandbox, for good, with the calling thread, which must be the only one.
 *
 * Out:   out: the entered layers, also on failure.
 * Fails: E_UNAVAILABLE if a required layer is missing. The caller must not read the scene then.
 */
UMB_CHECKED enum umb_status umbb_sandbox_enter(struct umbb_sandbox *out, struct umb_error *error);

/* "full", "reduced" (an optional layer is missing), "exempt" or "none". */
const char *umbb_sandbox_level(const struct umbb_sandbox *sandbox);

enum umbb_sandbox_mode {
    UMBB_SANDBOX_AVAILABLE = 0, /* the layers that the kernel has, with a notice for each other */
    UMBB_SANDBOX_REQUIRED = 1,  /* all layers; if one is missing, the bake fails */
    UMBB_SANDBOX_OFF = 2,       /* no layer */
};

struct umbb_bake_sandbox {
    enum umbb_sandbox_mode mode;
    int landlock_abi; /* ABI of the entered Landlock; 0: not entered */
    int seccomp;      /* 1: the filter is loaded */
};

/* Rights that a rule gives over a file, or over everything below a folder. */
enum umbb_path_use {
    UMBB_PATH_READ = 0,
    UMBB_PATH_RUN = 1,   /* read and run as a program */
    UMBB_PATH_WRITE = 2, /* read, and make, write, rename and remove files; no folders */
};

struct umbb_path_rule {
    const char *path;
    enum umbb_path_use use;
};

/*
 * Enters the first layers with the calling thread, which must be the only one.
 *
 * In:    sandbox: mode set, the rest 0. rules: paths in addition to the program's own files.
 * Out:   sandbox: the layers that were entered, also on failure.
 * Fails: E_UNAVAILABLE if a layer is missing that mode requires: the message names the layer, and
 *        the option that bakes without it.
 */
UMB_CHECKED enum umb_status umbb_bake_sandbox_paths(struct umbb_bake_sandbox *sandbox,
                                                    const struct umbb_path_rule *rules,
                                                    size_t count, struct umb_error *error);

/* Enters the last layer with all threads. importer: process number of the importer, 0: none runs.
 * files: the socket to the importer. Fails: the errors of umbb_bake_sandbox_paths. */
UMB_CHECKED enum umb_status umbb_bake_sandbox_calls(struct umbb_bake_sandbox *sandbox, int importer,
                                                    int files, struct umb_error *error);

/* Sets the limits: writable memory of twice --memory and some slack, descriptors, no core files.
 * Fails: E_UNAVAILABLE. */
UMB_CHECKED enum umb_status umbb_bake_sandbox_limits(uint64_t memory_bytes, unsigned threads,
                                                     struct umb_error *error);

/* "full", "reduced" (a layer is missing), "exempt" or "off". */
const char *umbb_bake_sandbox_level(const struct umbb_bake_sandbox *sandbox);

/* The layers. Each returns 0 and errno if it was not entered. */

/* Enters the importer's filter. Returns 1 if the calling process is now inside. */
int umbb_filter_enter(void);

/* Enters the bake's filter; importer and socket as for umbb_bake_sandbox_calls. Returns 1. */
int umbb_bake_filter_enter(int importer, int socket);

/* Denies every path but those of the rules to the calling thread. Returns the ABI of the kernel's
 * Landlock. */
int umbb_landlock_enter(const struct umbb_path_rule *rules, size_t count);

#endif
