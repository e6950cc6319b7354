/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_FRAME_CASTERS_H
#define UMBRAGE_SERVER_STUDY_FRAME_CASTERS_H
/*
 * Framing: the part of a scene that a fitted camera shows.
 *
 * Most scenes are shown whole. A few houses on a plain of kilometres, or a town and a stray
 * triangle far away, would be a speck: then the camera is fitted to a part. Two shares of a coarse
 * picture decide, by rays:
 *
 * - shadow: pixels in shadow, and those whose surface casts on another one
 * - things: pixels of triangles whose edges are short compared with the scene's ground plan; a
 *   ground has long ones
 *
 * The whole scene is shown if its share of shadow is 4 %. Else the camera takes a part by things,
 * if their share is below 3 %, or by shadow, if most casters stand close together. Parts are
 * squares of the ground plan, each with a quarter of the area of the one before, where most
 * candidates are. The widest one with 3 % of things, or 12 % of shadow, is shown.
 */
#include "study/camera.h"
#include "study/study_scene.h"

/*
 * Chooses the geometry for a fitted camera: the scene, or a part of it.
 *
 * In:    whole: all of the scene. with_ground: 1: shadows on a plane at its foot are shown, too.
 * Out:   subject: whole, or a part. points: its points, or NULL; free() them after its last use.
 * Fails: E_NO_MEMORY; the errors of umbt_camera_make.
 * Cost:  a second or less for a million triangles.
 */
UMB_CHECKED enum umb_status umbt_frame_casters(const struct umbt_scene *scene,
                                               const struct umbt_camera_request *request,
                                               const struct umbt_camera_subject *whole,
                                               const uint32_t size[2], int with_ground,
                                               struct umbt_camera_subject *subject,
                                               double (**points)[3], struct umb_error *error);

#endif
