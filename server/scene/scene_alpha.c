/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Samples of a texture's alpha, and which triangles are cut out (scene_alpha.h).
 *
 * A triangle's class follows from the least and greatest texel that sampling could touch anywhere
 * in the box of its texture coordinates (alpha_pyramid.h). The box is larger than the triangle, so
 * some whole triangles count as cut: that costs time and changes no answer.
 */
#include "scene/scene_alpha.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/sha256.h"
#include "scene/alpha_pyramid.h"

/* Greatest numbers of samples for the cut share: of one triangle, and of all triangles together.
 * Among many triangles each gets fewer. */
#define EACH_MAX      64U
#define SAMPLES_MAX   4000000U
#define SHARP_SAMPLES 16U /* the most samples of a triangle in the search for sharp materials */

/* Returns the texel number for the whole double i along an axis of n texels, by the wrap mode. Far
 * outside the image, where doubles are coarser than texels, this is an arbitrary texel. */
static size_t wrapped(double i, uint32_t n, uint32_t wrap)
{
    const double count = (double)n;
    if (wrap == UMBS_WRAP_REPEAT) {
        i -= count * floor(i / count);
    } else if (wrap == UMBS_WRAP_MIRROR) {
        i -= 2.0 * count * floor(i / (2.0 * count));
        i = i < count ? i : 2.0 * count - 1.0 - i;
    }
    i = i > 0.0 ? i : 0.0; /* NaN becomes 0 too */
    return (size_t)(i < count - 1.0 ? i : count - 1.0);
}

double umbs_alpha_at(const struct umbs_scene_view *view, const struct umbs_texture *texture,
                     double u, double v)
{
    const uint8_t *pixels = view->alpha + texture->offset;
    const size_t width = texture->width;
    double x = u * (double)texture->width, y = v * (double)texture->height;
    if (texture->nearest) {
        const size_t row = wrapped(floor(y), texture->height, texture->wrap_t);
        return (double)pixels[row * width + wrapped(floor(x), texture->width, texture->wrap_s)];
    }
    x -= 0.5;
    y -= 0.5;
    const double left = floor(x), below = floor(y), fx = x - left, fy = y - below;
    const size_t x0 = wrapped(left, texture->width, texture->wrap_s);
    const size_t x1 = wrapped(left + 1.0, texture->width, texture->wrap_s);
    const uint8_t *row0 = pixels + wrapped(below, texture->height, texture->wrap_t) * width;
    const uint8_t *row1 = pixels + wrapped(below + 1.0, texture->height, texture->wrap_t) * width;
    const double low = (double)row0[x0] + fx * ((double)row0[x1] - (double)row0[x0]);
    const double high = (double)row1[x0] + fx * ((double)row1[x1] - (double)row1[x0]);
    return low + fy * (high - low);
}

int umbs_cut_keeps(const struct umbs_cuts *cuts, uint32_t cut, double u, double v)
{
    const struct umbs_scene_view *view = cuts->view;
    const struct umbs_material *material = &cuts->materials[cuts->cuts[cut].material];
    const double alpha = umbs_alpha_at(view, &view->textures[material->texture], u, v);
    return alpha * (double)material->base_alpha >= 255.0 * (double)material->alpha_cutoff;
}

int umbs_is_translucent(const struct umbs_material *material)
{
    return material->alpha_mode == UMBS_ALPHA_BLEND || material->transmission > 0.0F;
}

int umbs_cut_is_translucent(const struct umbs_cuts *cuts, uint32_t number)
{
    return number == UMBS_CUT_CLEAR ||
           (number < UMBS_CUT_CLEAR &&
            umbs_is_translucent(&cuts->materials[cuts->cuts[number].material]));
}

double umbs_material_opacity(const struct umbs_material *material, double alpha)
{
    const double own = alpha * (double)material->base_alpha / 255.0;
    const double kept = material->alpha_mode == UMBS_ALPHA_BLEND ? own
                        : material->alpha_mode == UMBS_ALPHA_MASK
                            ? own >= (double)material->alpha_cutoff
                            : 1.0;
    return kept * (1.0 - (double)material->transmission);
}

double umbs_cut_opacity(const struct umbs_cuts *cuts, uint32_t cut, double u, double v)
{
    const struct umbs_scene_view *view = cuts->view;
    const struct umbs_material *material = &cuts->materials[cuts->cuts[cut].material];
    const double alpha = material->texture == UMBS_NO_INDEX
                             ? 255.0
                             : umbs_alpha_at(view, &view->textures[material->texture], u, v);
    return umbs_material_opacity(material, alpha);
}

/* Texel numbers along an axis: up to two runs, first .. last each. */
struct runs {
    uint32_t count, first[2], last[2];
};

struct finder {
    const struct umbs_scene_view *view;
    struct umbs_cuts *cuts;
    /* [texture_count] pyramids of the textures of materials with alpha. */
    struct umbs_alpha_pyramid *pyramids;
    /* [material_count] 1: a texel below the cut-off, or a translucent one, was found. */
    uint8_t *seen;
    uint32_t samples; /* samples of one triangle */
    size_t capacity;  /* capacity of cuts->cuts */
    /* Number of texels of triangles that are cut or cast nothing, and of those below the
     * cut-off. */
    double texels, below;
};

/* Finds the texels that samples between `low` * n and `high` * n along an axis may touch. */
static struct runs axis_runs(double low, double high, uint32_t n, uint32_t wrap)
{
    const double count = (double)n, most = count - 1.0;
    const double slack = 1e-9 * (1.0 + fmax(fabs(low), fabs(high)) * count);
    double a = floor(low * count - 0.5 - slack), b = floor(high * count - 0.5 + slack) + 1.0;
    struct runs runs = {1, {0, 0}, {n - 1, 0}};
    if (wrap == UMBS_WRAP_CLAMP) {
        a = fmin(fmax(a, 0.0), most);
        b = fmin(fmax(b, 0.0), most);
    } else {
        const double period = wrap == UMBS_WRAP_MIRROR ? 2.0 * count : count;
        const double length = b - a;
        if (!(length < most)) {
            return runs;
        }
        a -= period * floor(a / period);
        if (!(a >= 0.0 && a < period)) { /* by rounding, far outside the image */
            return runs;
        }
        b = a + length;
        if (wrap == UMBS_WRAP_MIRROR && a >= count && b < period) {
            const double turned = period - 1.0 - b;
            b = period - 1.0 - a;
            a = turned;
        } else if (wrap == UMBS_WRAP_MIRROR && b > most) {
            return runs; /* the range crosses a mirror: take all texels */
        } else if (b > most) {
            runs = (struct runs){2, {(uint32_t)a, 0}, {n - 1, (uint32_t)(b - count)}};
            return runs;
        }
    }
    runs.first[0] = (uint32_t)a;
    runs.last[0] = (uint32_t)b;
    return runs;
}

/* Range of all texels that a sample within the triangle may touch. */
static struct umbs_alpha_range triangle_range(const struct finder *f, uint32_t number,
                                              const float uv[3][2])
{
    const struct umbs_texture *texture = &f->view->textures[number];
    double low[2], high[2];
    for (int k = 0; k < 2; k++) {
        const double a = (double)uv[0][k], b = (double)uv[1][k], c = (double)uv[2][k];
        low[k] = fmin(fmin(a, b), c);
        high[k] = fmax(fmax(a, b), c);
    }
    const struct runs across = axis_runs(low[0], high[0], texture->width, texture->wrap_s);
    const struct runs up = axis_runs(low[1], high[1], texture->height, texture->wrap_t);
    struct umbs_alpha_range range = {UINT8_MAX, 0};
    for (uint32_t i = 0; i < across.count; i++) {
        for (uint32_t k = 0; k < up.count; k++) {
            const uint32_t x[2] = {across.first[i], across.last[i]};
            const uint32_t y[2] = {up.first[k], up.last[k]};
            umbs_alpha_pyramid_range(&f->pyramids[number], x, y, &range);
        }
    }
    return range;
}

/* Number of texels that a triangle covers. */
static double texel_area(const struct umbs_texture *texture, const float uv[3][2])
{
    const double ux = (double)uv[1][0] - (double)uv[0][0], uy = (double)uv[1][1] - (double)uv[0][1];
    const double wx = (double)uv[2][0] - (double)uv[0][0], wy = (double)uv[2][1] - (double)uv[0][1];
    const double area = 0.5 * fabs(ux * wy - uy * wx) * texture->width * texture->height;
    return area < 1e12 ? area : 1e12; /* NaN becomes 1e12 too */
}

/*
 * Computes the texture coordinates of sample number `place` within a triangle. One sequence runs on
 * from triangle to triangle: a fixed grid would meet a repeating texture at the same phase each
 * time.
 * Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018: multiples of
 * the powers of 1 / g, g * g * g = g + 1.
 */
static void sample_place(double place, const float uv[3][2], double at[2])
{
    double b = place * 0.7548776662466927, c = place * 0.5698402909980532;
    b -= floor(b);
    c -= floor(c);
    if (b + c > 1.0) {
        b = 1.0 - b;
        c = 1.0 - c;
    }
    for (int axis = 0; axis < 2; axis++) {
        at[axis] =
            (1.0 - b - c) * (double)uv[0][axis] + b * (double)uv[1][axis] + c * (double)uv[2][axis];
    }
}

/* Returns the share of the last cut triangle that is below the cut-off, from samples. */
static double cut_share(const struct finder *f)
{
    const uint32_t number = (uint32_t)f->cuts->count - 1;
    const struct umbs_cut *cut = &f->cuts->cuts[number];
    uint32_t below = 0;
    for (uint32_t i = 0; i < f->samples; i++) {
        double at[2];
        sample_place((double)number * f->samples + i + 1, (const float(*)[2])cut->uv, at);
        below += !umbs_cut_keeps(f->cuts, number, at[0], at[1]);
    }
    return (double)below / (double)f->samples;
}

/* Makes the table's next cut from a triangle. */
static enum umb_status add_cut(struct finder *f, const float uv[3][2], uint32_t material,
                               struct umb_error *error)
{
    struct umbs_cuts *cuts = f->cuts;
    if (cuts->count == f->capacity) {
        const size_t capacity = f->capacity == 0 ? 256 : f->capacity * 3 / 2;
        struct umbs_cut *grown = realloc(cuts->cuts, capacity * sizeof *grown);
        if (grown == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: memory for %zu triangles refused",
                            capacity);
        }
        cuts->cuts = grown;
        f->capacity = capacity;
    }
    struct umbs_cut *cut = &cuts->cuts[cuts->count++];
    memcpy(cut->uv, uv, sizeof cut->uv);
    cut->material = material;
    return UMB_OK;
}

/* Sets the class `tag` of triangle number `at`. */
static enum umb_status note(struct finder *f, size_t at, uint32_t tag, struct umb_error *error)
{
    struct umbs_cuts *cuts = f->cuts;
    if (cuts->of == NULL) {
        const size_t bytes = (size_t)f->view->world_triangle_count * sizeof *cuts->of;
        cuts->of = malloc(bytes);
        if (cuts->of == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: %zu bytes refused", bytes);
        }
        memset(cuts->of, 0xff, bytes); /* UMBS_CUT_NONE */
    }
    cuts->of[at] = tag;
    return UMB_OK;
}

/* Counts a triangle and, once, its material. */
static void count(struct finder *f, uint32_t material, size_t *triangles, size_t *materials,
                  uint32_t *first)
{
    ++*triangles;
    if (!f->seen[material]) {
        f->seen[material] = 1;
        *first = *materials == 0 ? material : *first;
        ++*materials;
    }
}

/* Returns the range of alpha over a triangle in the material's texture. texels: receives the number
 * of texels that the triangle covers. */
static struct umbs_alpha_range alpha_range(const struct finder *f,
                                           const struct umbs_material *material,
                                           const float uv[3][2], double *texels)
{
    *texels = 1.0;
    if (material->texture == UMBS_NO_INDEX) {
        return (struct umbs_alpha_range){UINT8_MAX, UINT8_MAX};
    }
    *texels = texel_area(&f->view->textures[material->texture], uv);
    return triangle_range(f, material->texture, uv);
}

/* Classifies triangle number `at` of the flattened scene, which has a translucent material. */
static enum umb_status judge_translucent(struct finder *f, size_t at, const float uv[3][2],
                                         uint32_t number, struct umb_error *error)
{
    const struct umbs_material *material = &f->cuts->materials[number];
    struct umbs_translucent_figures *figures = &f->cuts->translucent;
    double texels;
    const struct umbs_alpha_range range = alpha_range(f, material, uv, &texels);
    const double least = umbs_material_opacity(material, (double)range.low);
    const double most = umbs_material_opacity(material, (double)range.high);
    if (least >= 1.0) {
        return UMB_OK;
    }
    figures->least = figures->triangles == 0 ? least : fmin(figures->least, least);
    figures->most = fmax(figures->most, most);
    count(f, number, &figures->triangles, &figures->materials, &figures->first);
    if (!(most > 0.0)) {
        return note(f, at, UMBS_CUT_CLEAR, error);
    }
    UMB__TRY(add_cut(f, uv, number, error));
    return note(f, at, (uint32_t)f->cuts->count - 1, error);
}

/* Classifies triangle number `at` of the flattened scene, of a MASK material. */
static enum umb_status judge(struct finder *f, size_t at, const float uv[3][2], uint32_t number,
                             struct umb_error *error)
{
    const struct umbs_material *material = &f->cuts->materials[number];
    const double limit = 255.0 * (double)material->alpha_cutoff;
    double texels;
    const struct umbs_alpha_range range = alpha_range(f, material, uv, &texels);
    if ((double)range.low * (double)material->base_alpha >= limit) {
        return UMB_OK;
    }
    double share = 1.0;
    uint32_t tag = UMBS_CUT_GONE;
    if ((double)range.high * (double)material->base_alpha >= limit) {
        UMB__TRY(add_cut(f, uv, number, error));
        tag = (uint32_t)f->cuts->count - 1;
        share = cut_share(f);
    }
    f->texels += texels;
    f->below += share * texels;
    struct umbs_cut_figures *figures = &f->cuts->figures;
    count(f, number, &figures->triangles, &figures->materials, &figures->first);
    return note(f, at, tag, error);
}

/* Gets the texture coordinates of triangle i of a mesh, in the order of umbs_scene_flatten. */
static void triangle_uv(const struct umbs_scene_view *view, const struct umbs_mesh *mesh,
                        uint32_t i, int mirror, float uv[3][2])
{
    const uint32_t *triangle = view->triangles[mesh->first_triangle + i];
    memset(uv, 0, 3 * sizeof *uv);
    for (int k = 0; k < 3 && view->uvs != NULL; k++) {
        memcpy(uv[mirror && k > 0 ? 3 - k : k], view->uvs[(size_t)mesh->first_vertex + triangle[k]],
               sizeof uv[0]);
    }
}

/* Classifies all triangles of an instance, from number `at` of the flattened scene on. */
static enum umb_status judge_instance(struct finder *f, const struct umbs_instance *instance,
                                      size_t at, struct umb_error *error)
{
    const struct umbs_scene_view *view = f->view;
    const struct umbs_mesh *mesh = &view->meshes[instance->mesh];
    const uint32_t number = mesh->material;
    const int translucent =
        number != UMBS_NO_INDEX && umbs_is_translucent(&f->cuts->materials[number]);
    if (number == UMBS_NO_INDEX ||
        (!translucent && f->cuts->materials[number].alpha_mode != UMBS_ALPHA_MASK)) {
        return UMB_OK;
    }
    struct umbs_cut_figures *figures = &f->cuts->figures;
    if (!translucent) {
        figures->first = figures->mask_triangles == 0 ? number : figures->first;
        figures->mask_triangles += mesh->triangle_count;
    }
    if (view->materials[number].texture != UMBS_NO_INDEX) {
        const uint32_t texture = view->materials[number].texture;
        UMB__TRY(umbs_alpha_pyramid_find(view, texture, &f->pyramids[texture], error));
    }
    const int mirror = umbs_instance_mirrors(instance);
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        float uv[3][2];
        triangle_uv(view, mesh, i, mirror, uv);
        UMB__TRY((translucent ? judge_translucent : judge)(f, at + i, (const float(*)[2])uv, number,
                                                           error));
    }
    return UMB_OK;
}

/* Number of samples for each triangle. */
static uint32_t samples_each(const struct umbs_scene_view *view)
{
    const double each = floor((double)SAMPLES_MAX / (double)view->world_triangle_count);
    return each < 1.0 ? 1U : each < EACH_MAX ? (uint32_t)each : EACH_MAX;
}

/* Hashes the textures that cuts refer to. */
static enum umb_status digest_textures(const struct finder *f, struct umb_error *error)
{
    const struct umbs_scene_view *view = f->view;
    struct umbs_cuts *cuts = f->cuts;
    if (cuts->count == 0) {
        return UMB_OK;
    }
    cuts->digests = calloc(view->texture_count, sizeof *cuts->digests);
    if (cuts->digests == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: memory for %u textures refused",
                        view->texture_count);
    }
    for (uint32_t i = 0; i < view->texture_count; i++) {
        const struct umbs_texture *texture = &view->textures[i];
        const uint32_t shape[5] = {texture->width, texture->height, texture->wrap_s,
                                   texture->wrap_t, texture->nearest};
        const void *const parts[] = {shape, view->alpha + texture->offset};
        const size_t sizes[] = {sizeof shape, (size_t)texture->width * texture->height};
        /* A pyramid exists only if a MASK or translucent material uses the texture. */
        if (f->pyramids[i].levels > 0) {
            umbs_sha256.digest(umbs_sha256.user, parts, sizes, 2, cuts->digests[i]);
        }
    }
    return UMB_OK;
}

/* Number of texels of a material's triangles, and of those that are clear, and opaque. */
struct texels {
    double all, clear, opaque;
    size_t triangles;
};

/* Adds the texels of an instance of a mesh to those of its material. */
static void add_texels(const struct umbs_scene_view *view, const struct umbs_mesh *mesh,
                       struct texels *texels)
{
    const struct umbs_material *material = &view->materials[mesh->material];
    const struct umbs_texture *texture = &view->textures[material->texture];
    const uint32_t samples =
        samples_each(view) < SHARP_SAMPLES ? samples_each(view) : SHARP_SAMPLES;
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        float uv[3][2];
        double at[2];
        uint32_t clear = 0, opaque = 0;
        triangle_uv(view, mesh, i, 0, uv);
        const double area = texel_area(texture, (const float(*)[2])uv);
        for (uint32_t k = 0; k < samples; k++) {
            const double place = (double)texels->triangles * samples + k + 1;
            sample_place(place, (const float(*)[2])uv, at);
            const double opacity =
                umbs_material_opacity(material, umbs_alpha_at(view, texture, at[0], at[1]));
            clear += opacity <= UMBS_SHARP_CLEAR;
            opaque += opacity >= 1.0 - UMBS_SHARP_CLEAR;
        }
        texels->all += area;
        texels->clear += area * (double)clear / (double)samples;
        texels->opaque += area * (double)opaque / (double)samples;
        texels->triangles++;
    }
}

/* Returns 1 if a material may be *sharp* (scene_alpha.h), whatever its texels: it is BLEND, with a
 * texture and without a transmission. */
static int can_be_sharp(const struct umbs_scene_view *view, uint32_t number)
{
    return number != UMBS_NO_INDEX && view->materials[number].alpha_mode == UMBS_ALPHA_BLEND &&
           view->materials[number].texture != UMBS_NO_INDEX &&
           !(view->materials[number].transmission > 0.0F);
}

/* Returns the number of texels that are clear or opaque if a material is sharp, else 0. A material
 * that is clear or opaque all over needs no choice. */
static double sharp_texels(const struct texels *texels)
{
    const double sum = texels->clear + texels->opaque;
    return sum >= UMBS_SHARP_SHARE * texels->all && texels->clear < texels->all &&
                   texels->opaque < texels->all
               ? sum
               : 0.0;
}

/* Finds the sharp materials. If cuts->own exists, they become cut-outs in it. */
static enum umb_status find_sharp(struct umbs_cuts *cuts, struct umb_error *error)
{
    const struct umbs_scene_view *view = cuts->view;
    struct umbs_sharp_figures *figures = &cuts->sharp;
    struct texels *texels = calloc(view->material_count, sizeof *texels);
    double all = 0.0, sharp = 0.0;
    if (texels == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: memory for %u materials refused",
                        view->material_count);
    }
    for (uint32_t i = 0; i < view->instance_count; i++) {
        const struct umbs_mesh *mesh = &view->meshes[view->instances[i].mesh];
        if (can_be_sharp(view, mesh->material)) {
            add_texels(view, mesh, &texels[mesh->material]);
        }
    }
    for (uint32_t i = 0; i < view->material_count; i++) {
        if (!(sharp_texels(&texels[i]) > 0.0)) {
            continue;
        }
        figures->first = figures->materials++ == 0 ? i : figures->first;
        figures->triangles += texels[i].triangles;
        all += texels[i].all;
        sharp += sharp_texels(&texels[i]);
        if (cuts->own != NULL) {
            cuts->own[i].alpha_mode = UMBS_ALPHA_MASK;
            cuts->own[i].alpha_cutoff = 0.5F;
        }
    }
    figures->share = all > 0.0 ? sharp / all : 0.0;
    free(texels);
    return UMB_OK;
}

/* Classifies the triangles of all instances by cuts->materials: opaque, clear, or cut. */
static enum umb_status find_cuts(struct umbs_cuts *cuts, struct umb_error *error)
{
    const struct umbs_scene_view *view = cuts->view;
    struct finder f = {.view = view, .cuts = cuts, .samples = samples_each(view)};
    f.pyramids = calloc((size_t)view->texture_count + 1, sizeof *f.pyramids);
    f.seen = calloc(view->material_count, 1);
    enum umb_status status = UMB_OK;
    if (f.pyramids == NULL || f.seen == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "cut-out: memory for %u materials refused",
                          view->material_count);
    }
    size_t at = 0;
    for (uint32_t i = 0; i < view->instance_count && status == UMB_OK; i++) {
        status = judge_instance(&f, &view->instances[i], at, error);
        at += view->meshes[view->instances[i].mesh].triangle_count;
    }
    if (status == UMB_OK) {
        status = digest_textures(&f, error);
    }
    for (uint32_t i = 0; f.pyramids != NULL && i < view->texture_count; i++) {
        umbs_alpha_pyramid_finish(&f.pyramids[i]);
    }
    free(f.pyramids);
    free(f.seen);
    cuts->figures.share = f.texels > 0.0 ? f.below / f.texels : 0.0;
    return status;
}

/* Finds sharp materials and cuts. In: sharp_as_cut_outs: 1: sharp materials are cut-outs. */
static enum umb_status find(const struct umbs_scene_view *view, int sharp_as_cut_outs,
                            struct umbs_cuts *cuts, struct umb_error *error)
{
    const size_t bytes = view->material_count * sizeof *cuts->own;
    *cuts = (struct umbs_cuts){.view = view, .materials = view->materials};
    if (view->material_count == 0) {
        return UMB_OK;
    }
    if (sharp_as_cut_outs) {
        cuts->materials = cuts->own = malloc(bytes);
        if (cuts->own == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "cut-out: %zu bytes refused", bytes);
        }
        memcpy(cuts->own, view->materials, bytes);
    }
    enum umb_status status = find_sharp(cuts, error);
    if (status == UMB_OK) {
        status = find_cuts(cuts, error);
    }
    if (status != UMB_OK) {
        umbs_cuts_finish(cuts);
    }
    return status;
}

enum umb_status umbs_cuts_find(const struct umbs_scene_view *view, struct umbs_cuts *cuts,
                               struct umb_error *error)
{
    return find(view, 0, cuts, error);
}

enum umb_status umbs_cuts_find_sharp(const struct umbs_scene_view *view, struct umbs_cuts *cuts,
                                     struct umb_error *error)
{
    return find(view, 1, cuts, error);
}

void umbs_cuts_finish(struct umbs_cuts *cuts)
{
    free(cuts->of);
    free(cuts->cuts);
    free(cuts->digests);
    free(cuts->own);
    memset(cuts, 0, sizeof *cuts);
}

void umbs_cuts_open_parts(const struct umbs_cuts *cuts, struct umbs_parts *parts, size_t count)
{
    for (size_t i = 0; cuts->of != NULL && i < count; i++) {
        if (cuts->of[i] != UMBS_CUT_NONE && parts->part_of[i] != UINT32_MAX) {
            struct umbs_part *part = &parts->parts[parts->part_of[i]];
            if (umbs_cut_is_translucent(cuts, cuts->of[i])) {
                part->translucent_triangles++;
            } else {
                part->cut_triangles++;
            }
            part->closed = 0;
            part->flipped = 0;
        }
    }
    for (size_t i = 0; cuts->of != NULL && i < count; i++) {
        if (parts->closed[i] && !parts->parts[parts->part_of[i]].closed) {
            parts->closed[i] = 0;
            parts->closed_triangles--;
        }
    }
}

void umbs_cuts_take_as_opaque(struct umbs_cuts *cuts, int cut_outs, int translucents)
{
    const size_t count = cuts->of != NULL ? (size_t)cuts->view->world_triangle_count : 0;
    int any = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t number = cuts->of[i];
        if (number != UMBS_CUT_NONE &&
            (umbs_cut_is_translucent(cuts, number) ? translucents : cut_outs)) {
            cuts->of[i] = UMBS_CUT_NONE;
        }
        any |= cuts->of[i] != UMBS_CUT_NONE;
    }
    if (!any) {
        const struct umbs_cuts figures = {.view = cuts->view,
                                          .materials = cuts->view->materials,
                                          .figures = cuts->figures,
                                          .translucent = cuts->translucent,
                                          .sharp = cuts->sharp};
        umbs_cuts_finish(cuts);
        *cuts = figures;
    }
}
