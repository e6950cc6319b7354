/* SPDX-License-Identifier: Apache-2.0 */
/* Writing the plan. Every line states its reason; what this version cannot do is said, not hidden.
 */
#include "bake/analysis/plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/print_text.h"
#include "common/json_text.h"

/* Changes when equal settings would give other voxels. */
#define BAKE_VERSION 1

/* Share of a float's significand: what a coordinate in floats may be off. */
#define FLOAT_HALF_STEP 0x1p-24

static const char *closed_name(enum umbb_closed_mode mode)
{
    static const char *const names[] = {"auto", "on", "off"};
    return names[mode];
}

static double edge_length(const struct umb_frustum_info *frustum, int axis)
{
    const double *step = frustum->voxel_step[axis];
    return sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
}

static void write_closed(FILE *to, const struct umbb_analysis *a, enum umbb_closed_mode mode)
{
    char why[4 * sizeof a->open_reason];
    umbb_escape(a->open_reason, why, sizeof why);
    const size_t open_parts = a->part_count - a->closed_part_count;
    fprintf(to, "effect=closed state=%s reason=\"", a->closed_rule ? "on" : "off");
    if (mode == UMBB_CLOSED_OFF) {
        fprintf(to, "--closed off; ");
    } else if (mode == UMBB_CLOSED_ON) {
        fprintf(to, "--closed on: all parts on the caller's word; ");
    }
    fprintf(to, "%zu of %zu parts closed and consistently oriented, %zu of %zu triangles",
            a->closed_part_count, a->part_count, a->closed_triangles, a->count);
    if (a->flipped_part_count > 0) {
        fprintf(to, "; %zu wound inside out and turned around", a->flipped_part_count);
    }
    if (open_parts > 0) {
        fprintf(to, "; largest open part, number %zu: %s", a->open_reason_part, why);
    }
    fprintf(to, "\" cost=\"%s\"\n",
            a->closed_rule ? "a second depth layer in the bake; answers inside solids unspecified"
                           : "none");
}

/* Whether floats in world space would be off by more than a voxel's hundredth. */
static void write_origin(FILE *to, const struct umbb_analysis *a)
{
    double most = 0.0, voxel = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        most = fmax(most, fmax(fabs(a->bounds.min[axis]), fabs(a->bounds.max[axis])));
        for (uint32_t i = 0; i < a->frustum_count; i++) {
            voxel = fmin(voxel, edge_length(&a->frusta[i], axis));
        }
    }
    const double off = most * FLOAT_HALF_STEP;
    const int on = off > 0.01 * voxel;
    fprintf(to,
            "effect=origin state=%s reason=\"coordinates up to %.6g m as floats are off by %.3g m, "
            "%.3g of the smallest voxel edge of %.3g m\" cost=\"none measurable\"\n",
            on ? "on" : "off", most, off, off / voxel, voxel);
}

/* How wide half shadows can become behind casters, and the voxel's edge across the light. */
static double penumbra_width(const struct umbb_analysis *a, const struct umb_light_info *light,
                             double *voxel)
{
    const struct umb_frustum_info *frustum = &a->frusta[light->first_frustum];
    const double depth = (double)((uint64_t)1 << frustum->log2_size) * edge_length(frustum, 2);
    *voxel = fmin(edge_length(frustum, 0), edge_length(frustum, 1));
    return depth * light->extent;
}

/* The sun is no point: what its half shadows would be, of the light that has the widest. */
static void write_penumbra(FILE *to, const struct umbb_analysis *a)
{
    const struct umb_light_info *worst = &a->choice.lights[0];
    double most = 0.0, voxel;
    for (uint32_t i = 0; i < a->choice.count; i++) {
        const double width = penumbra_width(a, &a->choice.lights[i], &voxel);
        if (width / voxel > most) {
            most = width / voxel;
            worst = &a->choice.lights[i];
        }
    }
    if (most > 1.0) {
        const double width = penumbra_width(a, worst, &voxel);
        fprintf(to,
                "effect=penumbra state=off reason=\"not in this version: a light %.3g degrees "
                "across over %.6g m makes half shadows up to %.3g m or %.3g voxels wide; edges are "
                "baked sharp\" cost=\"none\"\n",
                worst->extent * 57.29577951308232, width / worst->extent, width, most);
    }
}

/* Several lights, and those of the file that this version does not know. */
static void write_lights(FILE *to, const struct umbb_analysis *a)
{
    if (a->choice.count > 1) {
        fprintf(to,
                "effect=suns state=on reason=\"%u directional lights\" cost=\"a frustum of depth, "
                "build and nodes each; equal nodes are stored once\"\n",
                a->choice.count);
    }
    if (a->choice.left_out > 0) {
        fprintf(to,
                "effect=faces state=off reason=\"not in this version: %u spot or point lights of "
                "the file are left out\" cost=\"none\"\n",
                a->choice.left_out);
    }
}

/* An effect this version does not have, for materials that call for it. */
static void write_missing(FILE *to, const char *effect, const char *mode,
                          const struct umbb_material_use *use, const struct umbs_scene_view *view)
{
    if (use->triangles == 0) {
        return;
    }
    char name[UMBB_ESCAPED_NAME_SIZE];
    umbb_escape(view->materials[use->first].name, name, sizeof name);
    fprintf(to,
            "effect=%s state=off reason=\"not in this version: %zu triangles of %zu %s materials, "
            "the first '%s', are baked as opaque\" cost=\"none\"\n",
            effect, use->triangles, use->materials, mode, name);
}

/* Closes a memory stream; its text is freed on failure. */
static enum umb_status close_text(FILE *stream, char **text, struct umb_error *error)
{
    const int failed = ferror(stream);
    /* glibc closes well even if the last realloc fails, and then there is no text. */
    if (fclose(stream) != 0 || failed || *text == NULL) {
        free(*text);
        *text = NULL;
        return umb_fail(error, UMB_E_NO_MEMORY, "plan: memory refused");
    }
    return UMB_OK;
}

enum umb_status umbb_plan_text(const struct umbb_analysis *analysis,
                               const struct umbs_scene_view *view,
                               const struct umbb_options *options, char **text,
                               struct umb_error *error)
{
    size_t size;
    *text = NULL;
    FILE *to = open_memstream(text, &size);
    if (to == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "plan: memory refused");
    }
    write_closed(to, analysis, options->closed);
    write_origin(to, analysis);
    write_penumbra(to, analysis);
    write_lights(to, analysis);
    write_missing(to, "cut-out", "MASK", &analysis->mask, view);
    write_missing(to, "transmittance", "BLEND", &analysis->blend, view);
    return close_text(to, text, error);
}

enum umb_status umbb_settings_text(const struct umbb_analysis *analysis,
                                   const struct umbb_options *options, char **text,
                                   struct umb_error *error)
{
    size_t size;
    *text = NULL;
    FILE *to = open_memstream(text, &size);
    if (to == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "settings: memory refused");
    }
    fprintf(to, "bake=%d\n", BAKE_VERSION);
    fprintf(to, "closed=%s\n", closed_name(options->closed));
    for (uint32_t i = 0; i < analysis->choice.count; i++) {
        const double *d = analysis->choice.lights[i].direction;
        fprintf(to, "light.%u.direction=%.17g,%.17g,%.17g\n", i, d[0], d[1], d[2]);
    }
    fprintf(to, "resolution=%u\n", 1U << options->resolution_log2);
    fprintf(to, "up=%c\n", analysis->z_up ? 'z' : 'y');
    return close_text(to, text, error);
}

/* A light and the voxels of its first frustum. */
static void print_light(FILE *to, const struct umbb_analysis *a, const struct umb_light_info *light)
{
    const struct umb_frustum_info *frustum = &a->frusta[light->first_frustum];
    char name[UMBB_ESCAPED_NAME_SIZE];
    umbb_escape(light->name, name, sizeof name);
    fprintf(to, "light=\"%s\" kind=%s direction=%.9g,%.9g,%.9g extent=%.6g\n", name,
            umbb_light_kind_text(light->kind), light->direction[0], light->direction[1],
            light->direction[2], light->extent);
    fprintf(to, "resolution=%u voxel_m=%.6g,%.6g,%.6g\n", 1U << frustum->log2_size,
            edge_length(frustum, 0), edge_length(frustum, 1), edge_length(frustum, 2));
}

void umbb_plan_print(FILE *to, const struct umbb_analysis *a, const struct umbs_scene_view *view,
                     const char *plan)
{
    const struct umb_box *b = &a->bounds;
    fprintf(to, "triangles=%zu degenerate=%zu duplicate=%zu unusable_faces=%u\n", a->count,
            a->degenerate_count, a->duplicate_count, view->dropped_faces);
    fprintf(to, "parts=%zu closed=%zu\n", a->part_count, a->closed_part_count);
    fprintf(to, "up=%c\n", a->z_up ? 'z' : 'y');
    fprintf(to, "bounds=%.9g,%.9g,%.9g..%.9g,%.9g,%.9g\n", b->min[0], b->min[1], b->min[2],
            b->max[0], b->max[1], b->max[2]);
    fprintf(to, "origin=%.17g,%.17g,%.17g\n", a->origin[0], a->origin[1], a->origin[2]);
    for (uint32_t i = 0; i < a->choice.count; i++) {
        print_light(to, a, &a->choice.lights[i]);
    }
    fputs(plan, to);
}

void umbb_lights_print_json(FILE *to, const struct umb_light_info *lights, uint32_t count)
{
    fputs("\"lights\":[", to);
    for (uint32_t i = 0; i < count; i++) {
        const double *d = lights[i].direction;
        fputs(i == 0 ? "{\"name\":" : ",{\"name\":", to);
        umbs_json_text(to, lights[i].name);
        fprintf(to, ",\"kind\":\"%s\",\"direction\":[%.17g,%.17g,%.17g],\"extent\":%.17g}",
                umbb_light_kind_text(lights[i].kind), d[0], d[1], d[2], lights[i].extent);
    }
    fputs("]", to);
}

void umbb_plan_print_json(FILE *to, const struct umbb_analysis *a,
                          const struct umbs_scene_view *view, const char *plan)
{
    const struct umb_box *b = &a->bounds;
    fprintf(to,
            "{\"triangles\":%zu,\"degenerate\":%zu,\"duplicate\":%zu,\"unusable_faces\":%u,"
            "\"parts\":%zu,\"closed_parts\":%zu,\"closed\":%s,\"up\":\"%c\",",
            a->count, a->degenerate_count, a->duplicate_count, view->dropped_faces, a->part_count,
            a->closed_part_count, a->closed_rule ? "true" : "false", a->z_up ? 'z' : 'y');
    fprintf(to, "\"bounds\":{\"min\":[%.17g,%.17g,%.17g],\"max\":[%.17g,%.17g,%.17g]},", b->min[0],
            b->min[1], b->min[2], b->max[0], b->max[1], b->max[2]);
    const struct umb_frustum_info *frustum = &a->frusta[0];
    fprintf(to, "\"origin\":[%.17g,%.17g,%.17g],", a->origin[0], a->origin[1], a->origin[2]);
    umbb_lights_print_json(to, a->choice.lights, a->choice.count);
    fprintf(to, ",\"resolution\":%u,\"voxel_m\":[%.9g,%.9g,%.9g],\"plan\":[",
            1U << frustum->log2_size, edge_length(frustum, 0), edge_length(frustum, 1),
            edge_length(frustum, 2));
    for (const char *line = plan; *line != '\0';) {
        const size_t length = strcspn(line, "\n");
        fputs(line == plan ? "" : ",", to);
        umbs_json_bytes(to, line, length);
        line += length + (line[length] == '\n');
    }
    fputs("]}\n", to);
}
