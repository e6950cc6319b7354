/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_ACTS_H
/* What an importer taken over by its scene would try, each as one call to the kernel. */
#include <stddef.h>

struct umbb_act {
    const char *name;      /* "connect to the network" */
    long (*attempt)(void); /* at least 0 if it was let through; else -1 and errno */
};

extern const struct umbb_act umbb_acts[];
extern const size_t umbb_act_count;

#endif
