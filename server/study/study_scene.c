/* SPDX-License-Identifier: Apache-2.0 */
/* A scene beside an asset; see study_scene.h. */
#include "study/study_scene.h"

#include <math.h>
#include <stdlib.h>
#include <stdio.h>
#include <string.h>
#include "base/try.h"
#include "study/study_math.h"

static void box_measure(struct umbt_scene *scene)
{
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < scene->count; i++) {
            for (int c = 0; c < 3; c++) {
                low = fmin(low, scene->corners[i][c][k]);
                high = fmax(high, scene->corners[i][c][k]);
            }
        }
        scene->box.min[k] = low;
        scene->box.max[k] = high;
        sum += (high - low) * (high - low);
    }
    scene->diagonal_m = sqrt(sum);
}

/* The material or the part of a triangle; UINT32_MAX if it has none. */
static uint32_t surface_group(const struct umbt_scene *scene, size_t triangle)
{
    return scene->by_material ? scene->materials[triangle] : scene->parts.part_of[triangle];
}

static double triangle_area(const double corners[3][3])
{
    double normal[3];
    umb__triangle_cross(corners, normal);
    return 0.5 * umb__length(normal);
}

/* Decides whether materials or parts distinguish surfaces, and which surface is the main one. */
static enum umb_status surfaces_find(struct umbt_scene *scene, struct umb_error *error)
{
    for (size_t i = 1; i < scene->count && !scene->by_material; i++) {
        scene->by_material = scene->materials[i] != scene->materials[0];
    }
    const size_t group_count =
        scene->by_material ? scene->scene->view.material_count : scene->parts.part_count;
    double *areas = calloc(group_count + 1, sizeof *areas);
    if (areas == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu surfaces do not fit in memory", group_count);
    }
    for (size_t i = 0; i < scene->count; i++) {
        const uint32_t group = surface_group(scene, i);
        /* Triangles without a group share the last place. */
        areas[group < group_count ? group : group_count] +=
            triangle_area((const double(*)[3])scene->corners[i]);
    }
    size_t largest = group_count;
    for (size_t g = 0; g < group_count; g++) {
        largest = areas[g] > areas[largest] ? g : largest;
    }
    scene->main_surface = largest < group_count ? (uint32_t)largest : UINT32_MAX;
    free(areas);
    return UMB_OK;
}

/* Builds the hierarchies of a tracer whose cuts are set. */
static enum umb_status tracer_build(const struct umbt_scene *scene, struct umbt_tracer *tracer,
                                    struct umb_error *error)
{
    const double(*corners)[3][3] = (const double(*)[3][3])scene->corners;
    const struct umbr_rays_options options = {.cuts = &tracer->cuts};
    UMB__TRY(umbr_layers_build(corners, scene->count, &tracer->cuts, 0, &tracer->layers, error));
    return umbr_rays_build(corners, scene->count, &options, &tracer->rays, error);
}

static void tracer_finish(struct umbt_tracer *tracer)
{
    umbr_rays_destroy(tracer->rays);
    umbr_layers_destroy(tracer->layers);
    umbs_cuts_finish(&tracer->cuts);
}

/* Makes the tracer of cameras for a scene whose casters are not as the file has them. Parts that
 * the bake turns around have other corners than the file, so their coordinates follow. */
static enum umb_status as_file_make(struct umbt_scene *scene, struct umb_error *error)
{
    struct umbs_cuts *cuts = &scene->as_file.cuts;
    UMB__TRY(umbs_cuts_find(&scene->scene->view, cuts, error));
    for (size_t i = 0; cuts->of != NULL && i < scene->count; i++) {
        if (cuts->of[i] < UMBS_CUT_CLEAR && umbt_scene_is_turned(scene, i)) {
            float(*uv)[2] = cuts->cuts[cuts->of[i]].uv, kept[2];
            memcpy(kept, uv[1], sizeof kept);
            memcpy(uv[1], uv[2], sizeof kept);
            memcpy(uv[2], kept, sizeof kept);
        }
    }
    scene->seen = &scene->as_file;
    return tracer_build(scene, &scene->as_file, error);
}

/* Finds the casters and the parts. A part with a hole is not closed, so it is never turned. */
static enum umb_status casters_find(struct umbt_scene *scene, unsigned flags,
                                    struct umb_error *error)
{
    struct umbs_cuts *cuts = &scene->casts.cuts;
    const struct umbs_scene_view *view = &scene->scene->view;
    UMB__TRY((flags & UMBT_SCENE_SHARP) != 0 ? umbs_cuts_find_sharp(view, cuts, error)
                                             : umbs_cuts_find(view, cuts, error));
    umbs_cuts_take_as_opaque(cuts, (flags & UMBT_SCENE_WHOLE) != 0,
                             (flags & UMBT_SCENE_THROUGH) == 0);
    UMB__TRY(
        umbs_parts_find((const double(*)[3][3])scene->corners, scene->count, &scene->parts, error));
    umbs_cuts_open_parts(cuts, &scene->parts, scene->count);
    umbs_parts_orient(&scene->parts, scene->corners, scene->count);
    return UMB_OK;
}

static enum umb_status tracers_make(struct umbt_scene *scene, unsigned flags,
                                    struct umb_error *error)
{
    const struct umbs_cuts *cuts = &scene->casts.cuts;
    const int differs = ((flags & UMBT_SCENE_WHOLE) != 0 && cuts->figures.materials > 0) ||
                        ((flags & UMBT_SCENE_THROUGH) == 0 && cuts->translucent.triangles > 0) ||
                        ((flags & UMBT_SCENE_SHARP) != 0 && cuts->sharp.materials > 0);
    UMB__TRY(tracer_build(scene, &scene->casts, error));
    scene->rays = scene->casts.rays;
    scene->seen = &scene->casts;
    return (flags & UMBT_SCENE_SEEN) != 0 && differs ? as_file_make(scene, error) : UMB_OK;
}

static enum umb_status scene_load(struct umbt_scene *scene, unsigned flags, struct umb_error *error)
{
    const struct umbs_import_options options = {.look = (flags & UMBT_SCENE_LOOK) != 0};
    UMB__TRY(umbs_scene_import(scene->path, &options, &scene->scene, error));
    const struct umbs_scene_view *view = &scene->scene->view;
    umbs_scene_hash(view, scene->hash);
    UMB__TRY(umbs_scene_flatten(view, &scene->corners, &scene->materials, &scene->count, error));
    if (scene->count == 0) {
        return umb_fail(error, UMB_E_BAD_SCENE, "%s: no triangles", scene->path);
    }
    UMB__TRY(casters_find(scene, flags, error));
    box_measure(scene);
    UMB__TRY(surfaces_find(scene, error));
    UMB__TRY((flags & UMBT_SCENE_LOOK) != 0 ? umbt_scene_look(scene, error) : UMB_OK);
    return tracers_make(scene, flags, error);
}

enum umb_status umbt_scene_init(struct umbt_scene *scene, const char *path, unsigned flags,
                                struct umb_error *error)
{
    *scene = (struct umbt_scene){.path = path};
    const enum umb_status status = scene_load(scene, flags, error);
    if (status != UMB_OK) {
        umbt_scene_finish(scene);
    }
    return status;
}

unsigned umbt_scene_flags_of(const char *plan)
{
    return (umbt_plan_has(plan, "cut-out") ? 0U : (unsigned)UMBT_SCENE_WHOLE) |
           (umbt_plan_has(plan, "transmittance") ? (unsigned)UMBT_SCENE_THROUGH : 0U) |
           (umbt_plan_has(plan, "blend-cut-out") ? (unsigned)UMBT_SCENE_SHARP : 0U);
}

int umbt_plan_has(const char *plan, const char *effect)
{
    char wanted[64];
    const int length = snprintf(wanted, sizeof wanted, "effect=%s state=on ", effect);
    for (const char *line = plan; line != NULL; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, wanted, (size_t)length) == 0) {
            return 1;
        }
    }
    return 0;
}

void umbt_scene_finish(struct umbt_scene *scene)
{
    tracer_finish(&scene->casts);
    tracer_finish(&scene->as_file);
    umbs_parts_finish(&scene->parts);
    free(scene->corners);
    free(scene->materials);
    free(scene->normals);
    if (scene->scene != NULL) {
        umbs_scene_destroy(scene->scene);
    }
    memset(scene, 0, sizeof *scene);
}

uint32_t umbt_scene_surface_key(const struct umbt_scene *scene, size_t triangle)
{
    const uint32_t group = surface_group(scene, triangle);
    if (group == scene->main_surface) {
        return 0;
    }
    return group < UINT32_MAX ? group + 1 : group;
}
