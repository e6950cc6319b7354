/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_RENDER_LIGHTS_H
#define UMBRAGE_SERVER_STUDY_RENDER_LIGHTS_H
/*
 * The lights of `umbrage render`: which ones --light names, and for each the source of its shadows,
 * the truth by rays, and its part of the picture.
 */
#include "study/picture_light.h"

#define UMBT_LIGHTS_MAX 16 /* lights of a picture */

/* The lights of --light. */
struct umbt_light_list {
    uint32_t count; /* 0: the option was not given */
    uint32_t numbers[UMBT_LIGHTS_MAX];
};

struct umbt_render_lights {
    uint32_t count;
    uint32_t numbers[UMBT_LIGHTS_MAX];
    uint32_t left_out; /* lights of the asset that are not drawn, as it has too many */
    struct umbt_shadow_source sources[UMBT_LIGHTS_MAX];
    struct umbt_truth truths[UMBT_LIGHTS_MAX];
    struct umbt_picture_light lights[UMBT_LIGHTS_MAX];
};

/* Reader of --light: adds a number to a struct umbt_light_list. */
enum umb_status umbt_read_light(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error);
#define UMBT_READ_LIGHT                                                                            \
    UMBU_READ(umbt_read_light, "a number from 0 to 4095, each once and at most 16 of them")

/*
 * Opens the asset and the sources of its lights.
 *
 * In:    wanted: the lights; count 0: all of the asset if it has at most UMBT_LIGHTS_MAX, else its
 *        first. one: 1: with count 0 only the first light of the asset.
 * Out:   lights: close it. truths and lights are set by umbt_render_lights_set.
 * Fails: the errors of umbt_shadow_source_open.
 */
UMB_CHECKED enum umb_status
umbt_render_lights_open(struct umbt_render_lights *lights, const struct umbt_light_list *wanted,
                        int one, const char *asset, const struct umbu_session *daemon,
                        const struct umb_query_settings *settings, struct umb_error *error);
void umbt_render_lights_close(struct umbt_render_lights *lights); /* a zeroed one is allowed */

/*
 * Computes the unit direction to a light: of a spot light against its axis, of a point light
 * upwards.
 */
void umbt_direction_to(const struct umb_light_info *light, int z_up, double to_light[3]);

/* Sets truths and lights for a scene. kind, samples: of all truths. */
void umbt_render_lights_set(struct umbt_render_lights *lights, const struct umbt_scene *scene,
                            int z_up, enum umbt_truth_kind kind, uint32_t samples);

#endif
