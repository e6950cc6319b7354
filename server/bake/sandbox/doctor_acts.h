/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
/* Actions of an importer or a bake that a scene controls, each as one call to the kernel. */
#include <stddef.h>
#include <sys/types.h>
#include "bake/sandbox/doctor_ground.h"

/* Cages in which an act must be denied; bits. */
enum umbb_act_place {
    UMBB_IN_IMPORTER = 1,
    UMBB_IN_LANDLOCK = 2, /* by the importer's Landlock alone, without its filter */
    UMBB_IN_BAKE = 4,
    UMBB_IN_BAKE_PATHS = 8, /* by the bake's Landlock alone, without its filter */
};

/* An action to try: one of the functions below, or the opening of a path. The result is at least
 * 0 if the action was allowed; else -1 and errno. */
struct umbb_act {
    const char *name;   /* "connect to the network" */
    unsigned places;    /* enum umbb_act_place */
    const char *path;   /* absolute, or below the ground */
    unsigned flags;     /* flags of open, or the mode for on_mode */
    const char *target; /* second path of on_two */
    long (*attempt)(void);
    int (*on_one)(const char *path);
    int (*on_two)(const char *path, const char *target);
    int (*on_mode)(const char *path, mode_t mode);
};

/* Tries the act in this process, with its paths on the ground. Returns the act's own result. */
long umbb_act_attempt(const struct umbb_act *act, const struct umbb_ground *ground);

extern const struct umbb_act umbb_acts[];
extern const size_t umbb_act_count;

/* Acts of the bake, on files of the ground. */
extern const struct umbb_act umbb_bake_acts[];
extern const size_t umbb_bake_act_count;

/* Actions that a bake needs. They must be allowed, or the tests prove nothing. */
extern const struct umbb_act umbb_bake_needs[];
extern const size_t umbb_bake_need_count;

#endif
