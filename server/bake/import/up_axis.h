/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_UP_AXIS_H
#define UMBRAGE_SERVER_BAKE_IMPORT_UP_AXIS_H
/*
 * The up axis of formats that do not fix it: OBJ, PLY and STL.
 *
 * Words of the file decide first, then the scene's shape. Evidence of one kind that speaks for both
 * axes counts for neither. If nothing decides, z is taken, and umbs_scene_up_warning tells the
 * user. The rules are in docs/explained/lights.md.
 */
#include "bake/import/import_job.h"

enum umbb_up {
    UMBB_UP_UNKNOWN = -1,
    UMBB_UP_IS_Y = 0,
    UMBB_UP_IS_Z = 1,
};

/* Sets z_up and up_evidence of job->scene, whose triangles and vertices are complete. */
void umbb_up_decide(struct umbb_import *job);

/* The axis that a comment names: "z up", "up axis: y", "x=east y=north z=up". Negative axes, x, and
 * comments that contradict each other tell nothing. */
enum umbb_up umbb_up_of_comment(struct umbb_cursor comment);

/* The axis that a program always writes, if a comment names the program. */
enum umbb_up umbb_up_of_program(struct umbb_cursor comment);

/*
 * The axis that the shape of a scene tells.
 *
 * Out: evidence: enum umbs_up_evidence of the strongest reason; set if the axis is known.
 */
enum umbb_up umbb_up_of_shape(const struct umbs_scene_builder *scene, uint32_t *evidence);

#endif
