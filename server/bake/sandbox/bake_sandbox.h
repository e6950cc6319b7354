/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_BAKE_SANDBOX_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_BAKE_SANDBOX_H
/*
 * The sandbox of the bake itself. Analysis, depth, build, self-check and publishing work on numbers
 * of an untrusted scene, so they run with the rights of one bake only.
 *
 *     limits      no core files, few descriptors, memory in proportion to --memory.
 *     landlock    paths: the scene's folder can be read, the folders of output and tiles written,
 *                 this program and its libraries run (the importer is this program), a few tables
 *                 of the system read.
 *     seccomp     the calls that Landlock does not see: no program, socket, other process or
 *                 executable page, no change of rights (bake_filter.c).
 *
 * The bake enters in two steps, because the importer starts between them. The first step restricts
 * paths. The second restricts calls, when the importer runs and before a byte of the scene or of
 * the importer's answers is read (umbs_import_options.shut_in).
 *
 * Sanitizer builds need calls that the filter forbids, so they run without the sandbox
 * (umbb_sandbox_exempt).
 */
#include <stdint.h>
#include "bake/sandbox/sandbox_parts.h"
#include "umbrage/status.h"

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

#endif
