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
#include "rays/layers.h"

/* Surfaces for rays to meet: opaque ones, which stop rays, and translucent ones, which let them
 * pass. */
struct umbt_tracer {
    struct umbs_cuts cuts;      /* triangles with holes, and translucent ones */
    struct umbr_rays *rays;     /* pass holes and translucent surfaces */
    struct umbr_layers *layers; /* the translucent surfaces; NULL: none */
};

struct umbt_scene {
    const char *path; /* borrowed */
    struct umbs_scene *scene;
    double (*corners)[3][3]; /* [count] world space, metres; closed parts are wound outwards */
    uint32_t *materials;     /* [count] number of each triangle's material */
    size_t count;            /* number of triangles, at least 1 */
    struct umbs_parts parts;
    struct umbt_tracer casts;       /* for rays of light: casters as the flags take them */
    const struct umbt_tracer *seen; /* for rays of cameras: `casts` or `as_file`; NULL: `rays` */
    struct umbt_tracer as_file;     /* zeroed unless UMBT_SCENE_SEEN needs it */
    struct umbr_rays *rays;         /* casts.rays, borrowed */
    struct umb_box box;             /* bounds of all triangles */
    double diagonal_m;              /* diagonal of the box */
    /* [count] unit normals of the corners, world, on the front of the triangle; all 0: the file has
     * none there. NULL: none at all */
    float (*normals)[3][3];
    int has_colors; /* 1: materials of the file have colours that tell surfaces apart */
    uint8_t hash[UMB_ID_BYTES];
    int by_material;       /* 1: surfaces are distinguished by material, 0: by part */
    uint32_t main_surface; /* the material or part of the largest area */
};

/* Surfaces that cameras see: the opaque ones, and the translucent ones or NULL. */
static inline const struct umbr_rays *umbt_seen_rays(const struct umbt_scene *scene)
{
    return scene->seen != NULL ? scene->seen->rays : scene->rays;
}

static inline const struct umbr_layers *umbt_seen_layers(const struct umbt_scene *scene)
{
    return scene->seen != NULL ? scene->seen->layers : NULL;
}

/* Returns 1 if a plan says that an effect is on. Material names in the reasons do not count. */
int umbt_plan_has(const char *plan, const char *effect);

/* Returns 1 if the corners of a triangle have changed places, as its closed part was wound
 * inwards. */
static inline int umbt_scene_is_turned(const struct umbt_scene *scene, size_t triangle)
{
    const uint32_t part = scene->parts.part_of[triangle];
    return part < scene->parts.part_count && scene->parts.parts[part].flipped;
}

/* Finds what pictures need of a loaded scene: normals and has_colors. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_scene_look(struct umbt_scene *scene, struct umb_error *error);

enum umbt_scene_flags {
    UMBT_SCENE_WHOLE = 1,   /* triangles with holes are whole */
    UMBT_SCENE_THROUGH = 2, /* translucent triangles let light through; else they are opaque */
    UMBT_SCENE_SEEN = 4,    /* cameras see holes and translucent triangles whatever casts */
    UMBT_SCENE_LOOK = 8,    /* reads colours and normals, too */
    UMBT_SCENE_SHARP = 16,  /* sharp BLEND materials are cut-outs (scene_alpha.h) */
};

/* Returns the flags that take casters as an asset of this plan does. */
unsigned umbt_scene_flags_of(const char *plan);

/* Loads a scene. flags: of enum umbt_scene_flags. Fails: the errors of umbs_scene_import,
 * umbs_cuts_find, umbs_scene_flatten, umbs_parts_find and umbr_rays_build. */
UMB_CHECKED enum umb_status umbt_scene_init(struct umbt_scene *scene, const char *path,
                                            unsigned flags, struct umb_error *error);
void umbt_scene_finish(struct umbt_scene *scene); /* a zeroed struct is allowed */

/* Returns the key of a triangle's surface colour, by material if several are used, else by part.
 * The largest surface, usually the ground, has key 0. */
uint32_t umbt_scene_surface_key(const struct umbt_scene *scene, size_t triangle);

#endif
