/* SPDX-License-Identifier: Apache-2.0 */
/* One sample of a texture's alpha (scene_alpha.h). */
#include "scene/scene_alpha.h"

#include <math.h>

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
    const struct umbs_material *material = &view->materials[cuts->cuts[cut].material];
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
            umbs_is_translucent(&cuts->view->materials[cuts->cuts[number].material]));
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
    const struct umbs_material *material = &view->materials[cuts->cuts[cut].material];
    const double alpha = material->texture == UMBS_NO_INDEX
                             ? 255.0
                             : umbs_alpha_at(view, &view->textures[material->texture], u, v);
    return umbs_material_opacity(material, alpha);
}
