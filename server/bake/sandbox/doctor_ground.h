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

#define UMBB_GROUND_PATH 256

struct umbb_ground {
    char folder[64];
    char scene[UMBB_GROUND_PATH], scene_file[UMBB_GROUND_PATH];
    char work[UMBB_GROUND_PATH], mine[UMBB_GROUND_PATH], link[UMBB_GROUND_PATH];
    char other[UMBB_GROUND_PATH], tokens[UMBB_GROUND_PATH], table[UMBB_GROUND_PATH],
        tile[UMBB_GROUND_PATH];
};

#define UMBB_GROUND_RULES 2

/* Makes the folder below TMPDIR, /tmp or /var/tmp. Fails: E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbb_ground_make(struct umbb_ground *ground, struct umb_error *error);

void umbb_ground_remove(struct umbb_ground *ground);

/* Paths that a bake of the scene into the work folder may open. */
void umbb_ground_rules(const struct umbb_ground *ground,
                       struct umbb_path_rule rules[UMBB_GROUND_RULES]);

#endif
