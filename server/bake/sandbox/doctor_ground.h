/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_GROUND_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_DOCTOR_GROUND_H
/*
 * Temporary folder for the doctor, arranged as a job service arranges it: a scene, a work folder,
 * and beside them files that no bake may touch.
 *
 *     scene/scene.ply    may be read
 *     work/mine.umb      may be written; work/link leads to other/tokens
 *     other/tokens, other/jobs.db, other/tile.umbt
 */
#include "bake/sandbox/sandbox_parts.h"
#include "umbrage/status.h"

#define UMBB_GROUND_PATH 4096

struct umbb_ground {
    char folder[64];
    char scene[UMBB_GROUND_PATH], work[UMBB_GROUND_PATH]; /* paths of these folders */
};

#define UMBB_GROUND_RULES 2

/* Makes the folder below TMPDIR, /tmp or /var/tmp. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_ground_make(struct umbb_ground *ground, struct umb_error *error);

void umbb_ground_remove(struct umbb_ground *ground);

/* The path of a name below the folder; an absolute name stays as it is. */
void umbb_ground_path(const struct umbb_ground *ground, const char *name,
                      char path[UMBB_GROUND_PATH]);

/* Paths that a bake of the scene into the work folder may open. */
void umbb_ground_rules(const struct umbb_ground *ground,
                       struct umbb_path_rule rules[UMBB_GROUND_RULES]);

#endif
