/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_CHOICE_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_CHOICE_H
/*
 * Which light is baked: --sun; else the file's light that --light names; else the file's first
 * directional light; else a sun at azimuth 135, elevation 45. What was left out or assumed becomes
 * a notice.
 */
#include "bake/bake_options.h"
#include "common/scene.h"

/*
 * Chooses the light.
 *
 * Out:   light: name, kind, unit direction, extent; frustum 0.
 *        notices: lines, malloced, or NULL; their length in notice_bytes.
 * Fails: E_ARGUMENT (--light names none), E_UNSUPPORTED (--light names a spot or point light),
 *        E_BAD_SCENE (its direction has no length), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_light_choose(const struct umbs_scene_view *view,
                                              const struct umbb_options *options, int z_up,
                                              struct umb_light_info *light, char **notices,
                                              size_t *notice_bytes, struct umb_error *error);

#endif
