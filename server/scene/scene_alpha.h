/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_SCENE_SCENE_ALPHA_H
#define UMBRAGE_SERVER_SCENE_SCENE_ALPHA_H
/*
 * Cut-out and translucent materials: which part of a triangle casts a shadow. Bakes, traced rays
 * and studies share this one definition.
 *
 * A material of alphaMode MASK casts where alpha = texture(u, v) * base_alpha is not below
 * alpha_cutoff (glTF 2.0, section 3.9.4). Texel (i, j) of a texture of w x h has its centre at u =
 * (i + 0.5) / w, v = (j + 0.5) / h; between centres alpha is bilinear, in doubles, unless the
 * sampler asks for the nearest texel. No mip level is ever used, because a shadow does not depend
 * on the screen's pixels.
 *
 * A triangle whose texels never fall below the cut-off counts as opaque; one whose texels never
 * reach the cut-off casts nothing. Only the other triangles are tested texel by texel.
 *
 * Translucent materials, of alphaMode BLEND or with a transmission (KHR_materials_transmission),
 * absorb a part of the incident light: opacity = a (1 - transmission). Here a is the alpha of BLEND
 * materials, 0 or 1 by the cut-off of MASK ones, and 1 otherwise. Their triangles have the same
 * three classes: opaque all over, clear all over, or tested.
 *
 * A BLEND material is *sharp* if nearly all texels of its triangles are clear or opaque, as in
 * leaves from an exporter without cut-outs. It can be taken as a cut-out with the cut-off 0.5.
 *
 *     umbs_cuts_find(&scene->view, &cuts, &error);
 *     ... umbs_cut_keeps(&cuts, cuts.of[triangle], u, v) ...
 *     umbs_cuts_finish(&cuts);
 *
 * Threads: a found table is immutable.
 */
#include "scene/parts.h"
#include "scene/scene.h"

#define UMBS_CUT_NONE UINT32_MAX        /* casts all over */
#define UMBS_CUT_GONE (UINT32_MAX - 1U) /* casts nothing: alpha is below the cut-off all over */
#define UMBS_CUT_CLEAR                                                                             \
    (UINT32_MAX - 2U) /* casts nothing: its translucent material is clear all over */

/* A triangle that is tested texel by texel. */
struct umbs_cut {
    float uv[3][2]; /* texture coordinates of the triangle's corners, in the order of
                       umbs_scene_flatten */
    uint32_t material;
};

/* Statistics of a scene's cut-out triangles. */
struct umbs_cut_figures {
    size_t mask_triangles; /* number of triangles of MASK materials */
    size_t materials;      /* number of MASK materials with a part below the cut-off */
    uint32_t first;        /* index of the first such material, else of the first MASK material */
    size_t triangles;      /* number of triangles with a part below the cut-off */
    double share; /* share of these triangles' texels below the cut-off, 0..1, by sampling */
};

/* Statistics of a scene's translucent triangles. */
struct umbs_translucent_figures {
    size_t triangles;   /* number of translucent triangles that are not opaque all over */
    size_t materials;   /* number of their materials */
    uint32_t first;     /* index of the first such material */
    double least, most; /* range of their opacity, 0..1 */
};

/* Least share of a sharp material's texels that are clear or opaque, and the greatest opacity that
 * counts as clear. An opacity above 1 minus that counts as opaque. */
#define UMBS_SHARP_SHARE 0.9
#define UMBS_SHARP_CLEAR 0.1

/* Statistics of a scene's sharp materials. */
struct umbs_sharp_figures {
    size_t materials; /* number of sharp materials */
    size_t triangles; /* number of their triangles */
    uint32_t first;   /* index of the first of them */
    double share;     /* share of their texels that are clear or opaque, by sampling */
};

struct umbs_cuts {
    const struct umbs_scene_view *view; /* borrowed: textures, and the materials as in the file */
    /* [view->material_count] The materials by which triangles cast: the view's, or `own`. */
    const struct umbs_material *materials;
    struct umbs_material *own; /* a copy with sharp materials as cut-outs; NULL: not wanted */
    uint32_t *of;          /* [triangles] number in cuts, or UMBS_CUT_*; NULL: all UMBS_CUT_NONE */
    struct umbs_cut *cuts; /* [count] triangles that are tested texel by texel */
    size_t count;
    /* [texture_count] Hash of everything that a sample depends on, for each texture that a cut
     * refers to. NULL: no cut. */
    uint8_t (*digests)[UMB_ID_BYTES];
    struct umbs_cut_figures figures;
    struct umbs_translucent_figures translucent;
    struct umbs_sharp_figures sharp;
};

/* Returns a texture's alpha, 0..255. u, v: finite. Cost: four bytes of the texture. */
double umbs_alpha_at(const struct umbs_scene_view *view, const struct umbs_texture *texture,
                     double u, double v);

/* 1 if a material lets a part of the light through. */
int umbs_is_translucent(const struct umbs_material *material);

/* Returns 1 if `number`, a triangle's entry in `of`, marks a translucent triangle. */
int umbs_cut_is_translucent(const struct umbs_cuts *cuts, uint32_t number);

/* Returns the share of light that a material absorbs where its texture has `alpha`, 0..255. */
double umbs_material_opacity(const struct umbs_material *material, double alpha);

/* Returns the share of light that a cut triangle absorbs at texture coordinates u, v: 0..1. */
double umbs_cut_opacity(const struct umbs_cuts *cuts, uint32_t cut, double u, double v);

/* Treats cut-out triangles, translucent ones, or both as opaque. The figures in `cuts` stay. */
void umbs_cuts_take_as_opaque(struct umbs_cuts *cuts, int cut_outs, int translucents);

/* Returns 1 if the cut triangle, of a cut-out material, casts at texture coordinates u, v. */
int umbs_cut_keeps(const struct umbs_cuts *cuts, uint32_t cut, double u, double v);

/*
 * Finds the triangles that are cut out.
 *
 * Out:   cuts: `of` in the order of umbs_scene_flatten.
 * Fails: E_NO_MEMORY; cuts is zeroed then.
 * Cost:  if any triangle is cut, 4 bytes a triangle and 28 for each cut one. Reads the texels along
 *        the edge of each MASK triangle's area in its texture, and at most 64 samples of a cut
 *        triangle.
 */
UMB_CHECKED enum umb_status umbs_cuts_find(const struct umbs_scene_view *view,
                                           struct umbs_cuts *cuts, struct umb_error *error);
/* Works like umbs_cuts_find, with sharp materials as cut-outs. */
UMB_CHECKED enum umb_status umbs_cuts_find_sharp(const struct umbs_scene_view *view,
                                                 struct umbs_cuts *cuts, struct umb_error *error);
void umbs_cuts_finish(struct umbs_cuts *cuts); /* a zeroed struct is allowed */

/* Marks the parts with cut triangles as open: a solid with holes bounds no volume. In: parts: found
 * from the same triangles. */
void umbs_cuts_open_parts(const struct umbs_cuts *cuts, struct umbs_parts *parts, size_t count);

#endif
