/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_PLAN_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_PLAN_H
/*
 * The plan in words, the settings in canonical form, the facts of the scene. All texts are
 * functions of scene and settings alone, because plan and settings enter the asset's id.
 */
#include <stdio.h>
#include "bake/analysis/analysis.h"
#include "tool/json.h"

/* Version of the bake's voxels. It changes when equal settings would give other voxels, undefined
 * ones included; it is in every asset and in the keys of tile results. */
#define UMBB_BAKE_VERSION 2

/*
 * Makes the plan: one line for each effect that the scene calls for or that an option overruled:
 * effect=NAME state=on|off reason="..." cost="...".
 * Out: text: malloced. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_plan_text(const struct umbb_analysis *analysis,
                                           const struct umbs_scene_view *view,
                                           const struct umbb_options *options, char **text,
                                           struct umb_error *error);

/*
 * Makes the text of the settings that the voxels depend on, one key=value on each line. Numbers
 * read back exactly.
 * Out: text: malloced. Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_settings_text(const struct umbb_analysis *analysis,
                                               const struct umbb_options *options, char **text,
                                               struct umb_error *error);

/* Prints the scene's facts, one key=value a line, then the plan. tiles: number in all frusta. */
void umbb_plan_print(FILE *to, const struct umbb_analysis *analysis,
                     const struct umbs_scene_view *view, const char *plan, uint64_t tiles);

/* Prints "lights":[...] with one object for each light. An object has name, kind and direction, the
 * position of a spot or point light, and the extent in radians or metres. */
void umbb_lights_put(struct umbu_json *json, const struct umb_light_info *lights, uint32_t count);

/* Prints the content of umbb_plan_print as one JSON object. */
void umbb_plan_print_json(FILE *to, const struct umbb_analysis *analysis,
                          const struct umbs_scene_view *view, const char *plan, uint64_t tiles);

#endif
