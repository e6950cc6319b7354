/* SPDX-License-Identifier: Apache-2.0 */
/* Cuts faces into triangles (face_builder.h). Degenerate triangles stay: the bake drops and counts
 * them. */
#include "bake/import/face_builder.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "scene/scene_buffer.h"

/* Says how many faces were dropped, why, and where the first one is. */
static void warn_of_dropped(const struct umbb_faces *faces)
{
    char line[40] = "";
    if (faces->first == 0) {
        return;
    }
    if (faces->first_line > 0) {
        (void)snprintf(line, sizeof line, " in line %" PRIu64, faces->first_line);
    }
    umbs_scene_warn(faces->scene,
                    "%u of %" PRIu64 " faces dropped (%u with an index of no vertex, %u with a "
                    "coordinate that is not finite, %u with fewer than 3 corners); the first is "
                    "face %" PRIu64 "%s",
                    faces->scene->dropped_faces, faces->count, faces->dropped[UMBB_FACE_INDEX],
                    faces->dropped[UMBB_FACE_PLACE], faces->dropped[UMBB_FACE_SHORT], faces->first,
                    line);
}

void umbb_faces_finish(struct umbb_faces *faces)
{
    warn_of_dropped(faces);
    if (faces->polygon.rough > 0) {
        umbs_scene_warn(faces->scene,
                        "%u faces with too many crossing or tangled edges are cut only roughly",
                        faces->polygon.rough);
    }
    free(faces->corners.data);
    umbb_polygon_finish(&faces->polygon);
    memset(faces, 0, sizeof(*faces));
}

static enum umbb_face_fault fault_of(const struct umbs_scene_builder *scene, uint64_t vertex)
{
    if (vertex >= scene->positions.count) {
        return UMBB_FACE_INDEX;
    }
    const double *position = (const double *)scene->positions.data + 3 * vertex;
    for (int k = 0; k < 3; k++) {
        if (!(fabs(position[k]) <= UMBS_COORDINATE_MAX)) { /* NaN, too */
            return UMBB_FACE_PLACE;
        }
    }
    return UMBB_FACE_GOOD;
}

enum umb_status umbb_face_corner(struct umbb_faces *faces, uint64_t vertex, struct umb_error *error)
{
    if (faces->corners.count >= UMBB_POLYGON_CORNERS_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "a face has more than %u corners",
                        UMBB_POLYGON_CORNERS_MAX);
    }
    const enum umbb_face_fault fault = fault_of(faces->scene, vertex);
    /* A builder never holds more than 2^32 - 1 vertices. */
    const uint32_t corner = fault == UMBB_FACE_GOOD ? (uint32_t)vertex : 0;
    if (faces->bad == UMBB_FACE_GOOD) {
        faces->bad = fault;
    }
    return umbs_array_add(&faces->corners, &corner, sizeof corner, error);
}

static enum umb_status add_polygon(struct umbb_faces *faces, const uint32_t *corners,
                                   uint32_t count, struct umb_error *error)
{
    struct umbb_polygon *polygon = &faces->polygon;
    UMB__TRY(umbb_polygon_reserve(polygon, count, error));
    const double *positions = faces->scene->positions.data;
    for (uint32_t i = 0; i < count; i++) {
        memcpy(polygon->points[i], positions + 3 * (size_t)corners[i], 3 * sizeof(double));
    }
    umbb_polygon_triangulate(polygon, count);
    for (uint32_t i = 0; i + 2 < count; i++) {
        const uint32_t *made = polygon->triangles[i];
        uint32_t triangle[3] = {corners[made[0]], corners[made[1]], corners[made[2]]};
        UMB__TRY(umbs_scene_add_triangle(faces->scene, triangle, error));
    }
    return UMB_OK;
}

/* Counts the current face as dropped. */
static enum umb_status drop(struct umbb_faces *faces, struct umb_error *error)
{
    struct umbs_scene_builder *scene = faces->scene;
    /* A small glTF may use the same indices thousands of times. */
    if (scene->dropped_faces >= scene->max_triangles) {
        return umb_fail(error, UMB_E_LIMIT, "more than %llu faces cannot be used",
                        (unsigned long long)scene->max_triangles);
    }
    if (faces->first == 0) {
        faces->first = faces->count + 1;
        faces->first_line = faces->line;
    }
    faces->dropped[faces->bad] += scene->dropped_faces < UINT32_MAX;
    scene->dropped_faces += scene->dropped_faces < UINT32_MAX;
    return UMB_OK;
}

enum umb_status umbb_face_end(struct umbb_faces *faces, struct umb_error *error)
{
    const uint32_t *corners = faces->corners.data;
    const uint32_t count = (uint32_t)faces->corners.count;
    if (faces->bad == UMBB_FACE_GOOD && count < 3) {
        faces->bad = UMBB_FACE_SHORT;
    }
    if (faces->bad != UMBB_FACE_GOOD) {
        UMB__TRY(drop(faces, error));
    } else if (count == 3) {
        UMB__TRY(umbs_scene_add_triangle(faces->scene, corners, error));
    } else {
        UMB__TRY(add_polygon(faces, corners, count, error));
    }
    faces->corners.count = 0;
    faces->bad = UMBB_FACE_GOOD;
    faces->count++;
    return UMB_OK;
}

enum umb_status umbb_faces_check(const struct umbb_faces *faces, struct umb_error *error)
{
    if (faces->scene->triangles.count > 0) {
        return UMB_OK;
    }
    return faces->count == 0
               ? UMBB_REFUSE(error, "the file has no triangles")
               : UMBB_REFUSE(error,
                             "none of %" PRIu64
                             " faces can be used (not finite, bad index or fewer than 3 corners)",
                             faces->count);
}

enum umb_status umbb_faces_end_scene(struct umbb_faces *faces, struct umb_error *error)
{
    struct umbs_scene_builder *scene = faces->scene;
    UMB__TRY(umbb_faces_check(faces, error));
    UMB__TRY(umbs_scene_end_mesh(scene, 0, (uint32_t)scene->positions.count,
                                 (uint32_t)scene->triangles.count, UMBS_NO_INDEX, error));
    return umbs_scene_add_instance(scene, 0, NULL, error);
}
