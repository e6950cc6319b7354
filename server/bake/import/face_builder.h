/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_IMPORT_FACE_BUILDER_H
#define UMBRAGE_SERVER_BAKE_IMPORT_FACE_BUILDER_H
/*
 * Faces of any number of corners into triangles of a scene; faces that cannot be used are dropped
 * and counted in scene->dropped_faces.
 *
 *     umbb_face_corner(&faces, vertex, &error) for each corner; umbb_face_end(&faces, &error);
 */
#include "bake/import/import_job.h"
#include "bake/import/polygon_clip.h"

#define UMBB_BAD_CORNER UINT64_MAX

/* Why a face cannot be used. */
enum umbb_face_fault {
    UMBB_FACE_GOOD,
    UMBB_FACE_INDEX, /* a corner names no vertex */
    UMBB_FACE_PLACE, /* a coordinate is no number, not finite or too large */
    UMBB_FACE_SHORT, /* fewer than three corners */
    UMBB_FACE_FAULTS
};

/* Zero it, but for `scene`, before its first use. */
struct umbb_faces {
    struct umbs_scene_builder *scene;   /* borrowed */
    struct umbs_array corners;          /* uint32_t: vertices of the face so far */
    unsigned bad;                       /* enum umbb_face_fault of the current face */
    uint64_t count;                     /* number of faces so far, dropped ones included */
    uint64_t line;                      /* line of the current face; 0: the file has no lines */
    uint64_t first, first_line;         /* first dropped face, from 1, and its line */
    uint32_t dropped[UMBB_FACE_FAULTS]; /* number of faces dropped for each reason */
    struct umbb_polygon polygon;
};

/* Frees the object. Dropped faces become a warning of the scene, and so do those that were cut
 * roughly (polygon_clip.h). */
void umbb_faces_finish(struct umbb_faces *faces);

/* Adds a corner. vertex: index into scene->positions; anything beyond is a bad index. */
UMB_CHECKED enum umb_status umbb_face_corner(struct umbb_faces *faces, uint64_t vertex,
                                             struct umb_error *error);

/* Ends the face: appends its triangles or drops it. Fails: E_LIMIT (triangles, or as many dropped
 * faces), E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbb_face_end(struct umbb_faces *faces, struct umb_error *error);

/*
 * Makes all triangles one mesh without material and places it once.
 *
 * Fails: E_BAD_SCENE (no face, or none that can be used), E_LIMIT, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbb_faces_end_scene(struct umbb_faces *faces, struct umb_error *error);

/* Fails with E_BAD_SCENE if there are no triangles. */
UMB_CHECKED enum umb_status umbb_faces_check(const struct umbb_faces *faces,
                                             struct umb_error *error);

#endif
