/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_PICTURE_LIGHT_H
#define UMBRAGE_SERVER_STUDY_PICTURE_LIGHT_H
/*
 * The lights of a picture, and how much of each reaches a receiver.
 *
 * A receiver gets power * cosine from parallel light, and power * cosine * (reference / distance)^2
 * from a lamp; of a spot light less towards the border of its cone. Where the scene file has the
 * asset's lights, in the same order, powers are in proportion to the file's intensities (lux,
 * candela) and have its colours. Else each light is as bright as every other. All powers are then
 * scaled together: 15 % of the points that the camera sees would get more than 1 if no surface cast
 * a shadow. A single sun keeps the power 1.
 */
#include "study/gbuffer.h"
#include "study/setup.h"
#include "study/shadow_source.h"
#include "study/traced_shadow.h"

struct umbt_picture_light {
    const struct umbt_shadow_source *source; /* NULL: no shadows from an asset */
    const struct umbt_truth *truth;          /* NULL: no traced shadows; at least one of both */
    const struct umb_light_info *lamp;       /* a spot or point light; NULL: parallel light */
    double to_light[3];                      /* unit; of parallel light */
    double power[3];                         /* Power of red, green and blue */
    double reference_m;                      /* distance from a lamp where power holds */
    double cone[2]; /* cosines of a spot's inner and outer angle by the file; equal: no border */
};

/* Parallel light of power 1 from the setup's direction. */
struct umbt_picture_light umbt_picture_sun(const struct umbt_setup *setup);

/*
 * Returns the cosine between a normal and the light.
 *
 * Out: share: share of power * cosine that a receiver at the place gets.
 */
double umbt_picture_light_at(const struct umbt_picture_light *light, const double position[3],
                             const double normal[3], double *share);

/*
 * Sets the powers, reference distances and colours of a picture's lights.
 *
 * In:    numbers: uint32[count], indices of the lights in the asset. total: number of lights of the
 *        asset. lights: with lamp or to_light. ground: as the picture has it.
 * Fails: E_NO_MEMORY.
 * Cost:  some thousand rays of the camera.
 */
UMB_CHECKED enum umb_status umbt_picture_lights_weigh(const struct umbt_setup *setup,
                                                      const struct umbt_ground *ground,
                                                      const uint32_t *numbers, uint32_t total,
                                                      struct umbt_picture_light *lights,
                                                      uint32_t count, struct umb_error *error);

#endif
