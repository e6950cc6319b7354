/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
/* Actions of an importer or a bake that a scene controls, each as one call to the kernel. */
#include <stddef.h>
#include "bake/sandbox/doctor_ground.h"

/* Cages in which an act must be denied; bits. */
enum umbb_act_place {
    UMBB_IN_IMPORTER = 1,
    UMBB_IN_LANDLOCK = 2, /* by the importer's Landlock alone, without its filter */
    UMBB_IN_BAKE = 4,
    UMBB_IN_BAKE_PATHS = 8, /* by the bake's Landlock alone, without its filter */
};

struct umbb_act {
    const char *name;      /* "connect to the network" */
    long (*attempt)(void); /* at least 0 if it was allowed; else -1 and errno */
    unsigned places;       /* enum umbb_act_place */
};

extern const struct umbb_act umbb_acts[];
extern const size_t umbb_act_count;

/* Of the bake, on the ground that umbb_bake_acts_on names. */
extern const struct umbb_act umbb_bake_acts[];
extern const size_t umbb_bake_act_count;

/* Actions that a bake needs. They must be allowed, or the tests prove nothing. */
extern const struct umbb_act umbb_bake_needs[];
extern const size_t umbb_bake_need_count;

/* Sets the ground, and the file of the act "read FILE"; borrowed. */
void umbb_bake_acts_on(const struct umbb_ground *on);
void umbb_bake_acts_forbid(const char *file);
extern const struct umbb_act umbb_bake_act_forbidden;

#endif
