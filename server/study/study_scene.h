/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_SCENE_H
#define UMBRAGE_SERVER_STUDY_STUDY_SCENE_H
/*
 * A scene in addition to an asset: imported, flattened, split into parts and ready for rays.
 *
 * Closed parts that the bake turns around (umbs_part.flipped) are turned around here too, so that
 * "outside" means the same to the rays and to the bake.
 */
#include "scene/parts.h"
#include "scene/scene.h"
#include "rays/rays.h"

struct umbt_scene {
    const char *path; /* borrowed */
    struct umbs_scene *scene;
    double (*corners)[3][3]; /* [count] world space, metres; closed parts are wound outwards */
    uint32_t *materials;     /* [count] number of each triangle's material */
    size_t count;            /* number of triangles, at least 1 */
    struct umbs_parts parts;
    /* Triangles with holes, or translucent; rays pass through those places. */
    struct umbs_cuts cuts;
    struct umbr_rays *rays;
    struct umb_box box; /* bounds of all triangles */
    double diagonal_m;  /* diagonal of the box */
    uint8_t hash[UMB_ID_BYTES];
    int by_material;       /* 1: surfaces are distinguished by material, 0: by part */
    uint32_t main_surface; /* the material or part of the largest area */
};

/* Returns 1 if a plan says that an effect is on. Material names in the reasons do not count. */
int umbt_plan_has(const char *plan, const char *effect);

enum umbt_scene_flags {
    UMBT_SCENE_WHOLE = 1,   /* triangles with holes are whole */
    UMBT_SCENE_THROUGH = 2, /* rays pass through translucent triangles */
    UMBT_SCENE_SHARP = 4,   /* sharp BLEND materials are cut-outs (scene_alpha.h) */
};

/* Loads a scene. flags: of enum umbt_scene_flags. Fails: the errors of umbs_scene_import,
 * umbs_cuts_find, umbs_scene_flatten, umbs_parts_find and umbr_rays_build. */
UMB_CHECKED enum umb_status umbt_scene_init(struct umbt_scene *scene, const char *path,
                                            unsigned flags, struct umb_error *error);
void umbt_scene_finish(struct umbt_scene *scene); /* a zeroed struct is allowed */

/* Returns the key of a triangle's surface colour, by material if several are used, else by part.
 * The largest surface, usually the ground, has key 0. */
uint32_t umbt_scene_surface_key(const struct umbt_scene *scene, size_t triangle);

#endif
