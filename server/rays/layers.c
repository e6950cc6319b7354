/* SPDX-License-Identifier: Apache-2.0 */
/* Translucent surfaces along rays; see layers.h. */
#include "rays/layers.h"

#include <string.h>

#include "base/memory.h"

struct umbr_layers {
    struct umbr_rays *rays; /* over the translucent triangles alone */
    uint32_t *triangles;    /* [number of translucent triangles] index in the scene */
    const struct umbs_cuts *cuts;
};

/* Returns 1 if a triangle absorbs a part of the light somewhere, 0 if it is clear all over. */
static int is_layer(const struct umbs_cuts *cuts, size_t triangle)
{
    const uint32_t number = cuts->of[triangle];
    return number < UMBS_CUT_CLEAR && umbs_cut_is_translucent(cuts, number);
}

static size_t layer_count(const struct umbs_cuts *cuts, size_t count)
{
    size_t found = 0;
    for (size_t i = 0; cuts->of != NULL && i < count; i++) {
        found += (size_t)is_layer(cuts, i);
    }
    return found;
}

enum umb_status umbr_layers_build(const double (*corners)[3][3], size_t count,
                                  const struct umbs_cuts *cuts, unsigned threads,
                                  struct umbr_layers **out, struct umb_error *error)
{
    const struct umbr_rays_options options = {.threads = threads};
    const size_t wanted = layer_count(cuts, count);
    *out = NULL;
    if (wanted == 0) {
        return UMB_OK;
    }
    struct umbr_layers *layers = umb__alloc_zeroed(NULL, 1, sizeof *layers);
    double(*chosen)[3][3] = umb__alloc_zeroed(NULL, wanted, sizeof *chosen);
    uint32_t *triangles = umb__alloc_zeroed(NULL, wanted, sizeof *triangles);
    enum umb_status status = UMB_OK;
    if (layers == NULL || chosen == NULL || triangles == NULL) {
        umb__free(NULL, triangles);
        umb__free(NULL, layers);
        status =
            umb_fail(error, UMB_E_NO_MEMORY, "no memory for %zu translucent triangles", wanted);
    } else {
        size_t at = 0;
        for (size_t i = 0; i < count; i++) {
            if (is_layer(cuts, i)) {
                memcpy(chosen[at], corners[i], sizeof *chosen);
                triangles[at++] = (uint32_t)i;
            }
        }
        *layers = (struct umbr_layers){.triangles = triangles, .cuts = cuts};
        status =
            umbr_rays_build((const double(*)[3][3])chosen, wanted, &options, &layers->rays, error);
        if (status == UMB_OK) {
            *out = layers;
        } else {
            umbr_layers_destroy(layers);
        }
    }
    umb__free(NULL, chosen);
    return status;
}

void umbr_layers_destroy(struct umbr_layers *layers)
{
    if (layers != NULL) {
        umbr_rays_destroy(layers->rays);
        umb__free(NULL, layers->triangles);
        umb__free(NULL, layers);
    }
}

/* Share of light that the surface at a crossing absorbs. */
static double opacity_at(const struct umbr_layers *layers, const struct umbr_crossing *crossing)
{
    const uint32_t cut = layers->cuts->of[layers->triangles[crossing->triangle]];
    const float(*uv)[2] = layers->cuts->cuts[cut].uv;
    const double first = 1 - crossing->second - crossing->third;
    double at[2];
    for (int k = 0; k < 2; k++) {
        at[k] = first * (double)uv[0][k] + crossing->second * (double)uv[1][k] +
                crossing->third * (double)uv[2][k];
    }
    return umbs_cut_opacity(layers->cuts, cut, at[0], at[1]);
}

/* A walk along a ray. */
struct walk {
    const struct umbr_layers *layers;
    double left, least;       /* share of light: so far, and where the walk ends */
    struct umbr_layer *found; /* [max], or NULL: only the product is wanted */
    size_t count, max;
};

static int walk_visit(void *user, const struct umbr_crossing *crossing)
{
    struct walk *walk = user;
    const double opacity = opacity_at(walk->layers, crossing);
    if (!(opacity > 0)) {
        return 1;
    }
    walk->left *= 1 - opacity;
    if (walk->found != NULL) {
        walk->found[walk->count++] = (struct umbr_layer){
            crossing->distance, opacity, walk->layers->triangles[crossing->triangle]};
    }
    return walk->left > walk->least && (walk->found == NULL || walk->count < walk->max);
}

size_t umbr_layers_find(const struct umbr_layers *layers, const double from[3],
                        const double direction[3], double far_m, double least,
                        struct umbr_layer *found, size_t max)
{
    struct walk walk = {.layers = layers, .left = 1, .least = least, .found = found, .max = max};
    if (layers != NULL && max > 0) {
        umbr_each_crossing(layers->rays, from, direction, far_m, NULL, walk_visit, &walk);
    }
    return walk.count;
}

double umbr_layers_pass(const struct umbr_layers *layers, const double from[3],
                        const double direction[3], double far_m)
{
    struct walk walk = {.layers = layers, .left = 1};
    if (layers != NULL) {
        umbr_each_crossing(layers->rays, from, direction, far_m, NULL, walk_visit, &walk);
    }
    return walk.left;
}
