/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_CHOICE_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_LIGHT_CHOICE_H
/*
 * Choice of the lights to bake. Lights of the options (light_options.h) are taken in the order
 * given. Without such options all lights of the file are baked. If the file has no lights either, a
 * sun at azimuth 135 degrees, elevation 45 degrees is baked. Each assumption becomes a notice.
 */
#include "bake/options/bake_options.h"
#include "scene/scene.h"

/* The chosen lights, and notices about the choice. */
struct umbb_light_choice {
    /* [count] Lights with name, kind, unit direction, position and extent; without frusta. */
    struct umb_light_info *lights;
    double *cones; /* [count] half the angle of a spot light's cone, radians */
    uint32_t count;
    size_t capacity, cone_capacity;
    char *notices; /* lines, or NULL */
    size_t notice_bytes;
};

/*
 * Chooses the lights.
 *
 * Out:   choice: to be finished by the caller; zeroed on failure.
 * Fails: E_ARGUMENT (--light names no light of the file, --sun-path has no sun above the horizon,
 *        more than UMB_LIGHTS_MAX), E_BAD_SCENE (a direction has no length), E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_lights_choose(const struct umbs_scene_view *view,
                                               const struct umbb_options *options, int z_up,
                                               struct umbb_light_choice *choice,
                                               struct umb_error *error);
void umbb_light_choice_finish(struct umbb_light_choice *choice);

#endif
