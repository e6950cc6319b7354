/* SPDX-License-Identifier: Apache-2.0 */
/* All hits along the light; see light_hits.h. */
#include "study/light_hits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "tool/threads.h"
#include "study/study_math.h"

#define STEP_SHARE 1e-7 /* step beyond a hit, to find the next, as a share of the depth range */

struct trace {
    const struct umbt_scene *scene;
    const struct umb_map_frustum *frustum;
    double alpha;
    struct umb_map_fragment *found; /* [texels][UMBT_HITS_MAX] */
    uint32_t *counts;               /* [texels] */
};

/* Share of the light that a triangle absorbs. */
static float triangle_alpha(const struct trace *trace, uint32_t triangle)
{
    const struct umbs_scene_view *scene = &trace->scene->scene->view;
    const uint32_t material = trace->scene->materials[triangle];
    if (material >= scene->material_count ||
        scene->materials[material].alpha_mode != UMBS_ALPHA_BLEND) {
        return 1.0F;
    }
    const float own = scene->materials[material].base_alpha;
    return own < 1.0F ? own : (float)trace->alpha;
}

double umbt_texel_ray(const struct umb_map_frustum *frustum, size_t texel, double start[3],
                      double direction[3])
{
    const double x = (double)(texel % frustum->width) + 0.5;
    const double y = (double)(texel / frustum->width) + 0.5;
    double end[3];
    if (umb_map_frustum_point(frustum, x, y, 0.0, start) != UMB_OK ||
        umb_map_frustum_point(frustum, x, y, 1.0, end) != UMB_OK) {
        return 0.0;
    }
    umb__subtract(end, start, direction);
    return umbt_normalize(direction);
}

/* Finds all hits of a texel's ray, nearest first. */
static void texel_item(void *user, size_t i)
{
    const struct trace *trace = user;
    double start[3], direction[3], reached = 0.0;
    const double length = umbt_texel_ray(trace->frustum, i, start, direction);
    while (length > 0.0 && trace->counts[i] < UMBT_HITS_MAX) {
        struct umbr_hit hit;
        umbr_nearest(trace->scene->rays, start, direction, reached, length, &hit);
        if (hit.distance < 0.0) {
            break;
        }
        trace->found[i * UMBT_HITS_MAX + trace->counts[i]++] = (struct umb_map_fragment){
            (float)fmin(hit.distance / length, 1.0), triangle_alpha(trace, hit.triangle)};
        reached = hit.distance + STEP_SHARE * length;
    }
}

/* Joins the lists: list i begins at first[i]. */
static void hits_gather(const struct trace *trace, size_t texels, struct umbt_light_hits *hits)
{
    uint64_t used = 0;
    hits->fragments = trace->found;
    for (size_t i = 0; i < texels; i++) {
        const uint32_t count = trace->counts[i];
        hits->first[i] = used;
        hits->occupied += count > 0;
        memmove(trace->found + used, trace->found + i * UMBT_HITS_MAX,
                count * sizeof *trace->found);
        used += count;
    }
    hits->first[texels] = used;
}

enum umb_status umbt_light_hits_trace(const struct umbt_scene *scene,
                                      const struct umb_map_frustum *frustum, double alpha,
                                      unsigned threads, struct umbt_light_hits *hits,
                                      struct umb_error *error)
{
    const size_t texels = (size_t)frustum->width * frustum->height;
    struct trace trace = {.scene = scene,
                          .frustum = frustum,
                          .alpha = alpha,
                          .found = malloc(texels * UMBT_HITS_MAX * sizeof *trace.found),
                          .counts = calloc(texels, sizeof *trace.counts)};
    *hits = (struct umbt_light_hits){.first = calloc(texels + 1, sizeof *hits->first)};
    enum umb_status status =
        trace.found != NULL && trace.counts != NULL && hits->first != NULL
            ? umbu_range_each(threads, texels, 1024, texel_item, &trace, error)
            : umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    if (status == UMB_OK) {
        hits_gather(&trace, texels, hits);
    } else {
        free(trace.found);
        umbt_light_hits_finish(hits);
    }
    free(trace.counts);
    return status;
}

void umbt_light_hits_finish(struct umbt_light_hits *hits)
{
    free(hits->fragments);
    free(hits->first);
    memset(hits, 0, sizeof *hits);
}
