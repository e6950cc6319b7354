/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_LAMP_RACE_H
#define UMBRAGE_TESTS_LAMP_RACE_H
/*
 * Races bakes of a point light against bakes of the scene's sun, from triangles to the octree:
 *
 *   point_vs_sun       CPU seconds of the light, all its faces together, over those of the sun
 *   point_face_vs_sun  the same for a mean face
 *
 * The light hangs over the middle of a street of the city, 8 m above the ground. Both have one
 * thread, one right after the other. Projecting the triangles is part of the light's time.
 */
#include "bench_scene.h"

void lamp_race(const struct bench_scene *scene, int closed_rule, const char *name);

#endif
