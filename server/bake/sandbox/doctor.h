/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
/* `umbrage-bake doctor`: layers that this machine has, and tests of the sandboxes. */
#include "bake/sandbox/bake_sandbox.h"
#include "bake/sandbox/doctor_acts.h"
#include "bake/sandbox/sandbox.h"

enum umbb_verdict {
    UMBB_ACT_ALLOWED = 0,
    UMBB_ACT_REFUSED = 1, /* the call failed for lack of a right */
    UMBB_ACT_KILLED = 2,  /* the filter killed the process */
    UMBB_ACT_FAILED = 3,  /* the call failed for another reason */
};

/* The cage in which an act is tried. */
enum umbb_cage {
    UMBB_CAGE_NONE = 0, /* no cage: tests that the act works at all */
    UMBB_CAGE_IMPORTER,
    UMBB_CAGE_LANDLOCK, /* the importer's Landlock alone */
    UMBB_CAGE_BAKE,
    UMBB_CAGE_BAKE_PATHS, /* the bake's Landlock alone */
};

/*
 * Tries an act in a separate process.
 *
 * In:  ground: folder for the cages of the bake and for paths of acts; else unused.
 * Out: the verdict, or -1 if no process could be started or entered the cage.
 */
int umbb_doctor_try(const struct umbb_act *act, enum umbb_cage cage,
                    const struct umbb_ground *ground);

/* Enters the sandboxes in separate processes, to learn their layers. Out: 0, or -1. */
int umbb_doctor_probe(struct umbb_sandbox *importer);
int umbb_doctor_probe_bake(const struct umbb_ground *ground, struct umbb_bake_sandbox *bake);

/*
 * Runs the command. argv is that of the process; argv[1] is "doctor".
 *
 * Out:  the exit code: 0 if every act is denied and a bake can work, else 1; 69 if a layer is
 *       missing that the importer or a job's bake requires, 73 without a folder for the tries, 2
 *       for wrong arguments, 0 in an exempt (sanitizer) build, which says so.
 */
int umbb_doctor(int argc, char **argv);

#endif
