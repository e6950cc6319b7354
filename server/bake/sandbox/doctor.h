/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_H
/* `umbrage-bake doctor`: layers that this machine has, and tests of the sandboxes by actions of an
 * importer or a bake that a scene controls, each as one call to the kernel. */
#include <stddef.h>
#include <sys/types.h>
#include "bake/sandbox/sandbox.h"

/*
 * Temporary folder for the doctor, arranged as a job service arranges it: a scene, a work folder,
 * and beside them files that no bake may touch.
 *
 *     scene/scene.ply    may be read
 *     work/mine.umb      may be written; work/link leads to other/tokens
 *     other/tokens, other/jobs.db, other/tile.umbt
 */
#define UMBB_GROUND_PATH 4096

struct umbb_ground {
    char folder[64];
    char scene[UMBB_GROUND_PATH], work[UMBB_GROUND_PATH]; /* paths of these folders */
};

/* Makes the folder below TMPDIR, /tmp or /var/tmp. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_ground_make(struct umbb_ground *ground, struct umb_error *error);

void umbb_ground_remove(struct umbb_ground *ground);

/* Cages in which an act must be denied; bits. */
enum umbb_act_place {
    UMBB_IN_IMPORTER = 1,
    UMBB_IN_LANDLOCK = 2, /* by the importer's Landlock alone, without its filter */
    UMBB_IN_BAKE = 4,
    UMBB_IN_BAKE_PATHS = 8, /* by the bake's Landlock alone, without its filter */
};

/* An action to try: a system call, one of the functions below, or the opening of a path. The result
 * is at least 0 if the action was allowed; else -1 and errno. */
struct umbb_act {
    const char *name;   /* "connect to the network" */
    unsigned places;    /* enum umbb_act_place */
    const char *path;   /* absolute, or below the ground */
    unsigned flags;     /* flags of open, or the mode for on_mode */
    const char *target; /* second path of on_two */
    long call[7];       /* number of the system call, and its arguments; 0: none */
    long (*attempt)(void);
    int (*on_one)(const char *path);
    int (*on_two)(const char *path, const char *target);
    int (*on_mode)(const char *path, mode_t mode);
};

extern const struct umbb_act umbb_acts[];
extern const size_t umbb_act_count;

/* Acts of the bake, on files of the ground. */
extern const struct umbb_act umbb_bake_acts[];
extern const size_t umbb_bake_act_count;

/* Actions that a bake needs. They must be allowed, or the tests prove nothing. */
extern const struct umbb_act umbb_bake_needs[];
extern const size_t umbb_bake_need_count;

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
 * In: ground: the temporary folder. Only the cages (sandboxes) of a bake and acts with paths use
 * it.
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
