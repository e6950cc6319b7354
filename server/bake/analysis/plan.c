/* SPDX-License-Identifier: Apache-2.0 */
/* Writing the plan. Every line states its reason; effects that this version cannot do are listed,
 * not hidden. */
#include "bake/analysis/plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/options/bake_options.h"
#include "bake/base/print_text.h"
#include "base/vec.h"
#include "format/receiver_mask.h"

/* Relative rounding error of a coordinate stored as a float. */
#define FLOAT_HALF_STEP 0x1p-24

static const char *closed_name(enum umbb_closed_mode mode)
{
    static const char *const names[] = {"auto", "on", "off", "parts"};
    return names[mode];
}

/* Writes bytes with two digits, in the unit that suits them. */
static void write_bytes(FILE *to, double bytes)
{
    static const char *const units[] = {"bytes", "kB", "MB", "GB", "TB"};
    int unit = 0;
    while (bytes >= 995.0 && unit < 4) {
        bytes /= 1000.0;
        unit++;
    }
    fprintf(to, "%.*f %s", unit > 0 && bytes < 9.95, bytes, units[unit]);
}

/* Writes what the closed rule saves. The share is equal on every machine. Bytes depend on the
 * compression, so they are known only for a plan that is printed, and no asset contains them. */
static void write_price(FILE *to, const struct umbb_closed_price *price)
{
    const double percent = floor(100.0 * price->saved + 0.5);
    if (percent >= 0.0) {
        fprintf(to, "; closed saves about %.0f %% of the nodes", percent);
    } else {
        fprintf(to, "; closed takes about %.0f %% more nodes", -percent);
    }
    if (!(price->open_bytes > 0.0)) {
        return;
    }
    fputs(price->exact ? ": voxels take " : ": voxels take about ", to);
    write_bytes(to, price->closed_bytes);
    fputs(" closed, ", to);
    write_bytes(to, price->open_bytes);
    fputs(" open", to);
    if (!price->exact) {
        fprintf(to, " (within a factor of %.1f), going by %u voxels a side", price->factor,
                1U << price->sample_log2);
    }
}

/* Writes what the closed rule takes away or, if it is off by its price, how to switch it on. */
static void write_closed_cost(FILE *to, const struct umbb_analysis *a,
                              const struct umbb_options *options)
{
    if (!a->closed_rule) {
        fputs(a->closed_price.known
                  ? "none: penumbras, columns and derived maps stay (--closed parts switches it "
                    "on)"
                  : "none",
              to);
        return;
    }
    fprintf(to, "a second depth layer in the bake; answers inside solids unspecified%s",
            options->occluder_depth ? ""
                                    : "; no penumbras, columns and derived maps (--effect front=on "
                                      "keeps the first two for more bytes, --closed off all)");
}

static void write_closed(FILE *to, const struct umbb_analysis *a,
                         const struct umbb_options *options)
{
    char why[4 * sizeof a->open_reason];
    umbb_escape(a->open_reason, why, sizeof why);
    const size_t open_parts = a->part_count - a->closed_part_count;
    fprintf(to, "effect=closed state=%s reason=\"", a->closed_rule ? "on" : "off");
    if (options->closed != UMBB_CLOSED_AUTO) {
        fprintf(to, "--closed %s%s; ", closed_name(options->closed),
                options->closed == UMBB_CLOSED_ON ? ": all parts on the caller's word" : "");
    }
    fprintf(to, "%zu of %zu parts closed and consistently oriented, %zu of %zu triangles",
            a->closed_part_count, a->part_count, a->closed_triangles, a->count);
    if (a->closed_price.known) {
        write_price(to, &a->closed_price);
    }
    if (a->flipped_part_count > 0) {
        fprintf(to, "; %zu wound inside out and turned around", a->flipped_part_count);
    }
    if (open_parts > 0) {
        fprintf(to, "; largest open part, number %zu: %s", a->open_reason_part, why);
    }
    fputs("\" cost=\"", to);
    write_closed_cost(to, a, options);
    fputs("\"\n", to);
}

/* First occluders behind closed parts, as occluder depth maps. */
static void write_occluder_depth(FILE *to, const struct umbb_analysis *a,
                                 const struct umbb_options *options)
{
    if (!a->closed_rule && !options->occluder_depth) {
        return;
    }
    const int on = a->closed_rule && options->occluder_depth;
    fprintf(to, "effect=front state=%s reason=\"%s\" cost=\"%s\"\n", on ? "on" : "off",
            on && options->penumbra == UMBB_PENUMBRA_ON
                ? "switched on: first occluders of closed solids, for penumbras and columns"
            : on ? "switched on: first occluders of closed solids, for columns"
            : a->closed_rule
                ? "nothing was said to need first occluders of closed solids (columns do)"
                : "switched on, but closed is off: what is baked holds first occluders itself",
            on ? "every texel is drawn in the bake; planes of the fronts in the asset's head"
               : "none");
}

/* The static rule: nothing moves. */
static void write_static(FILE *to, const struct umbb_analysis *a,
                         const struct umbb_options *options)
{
    if (!options->static_rule) {
        return;
    }
    double most = 0.0;
    for (uint32_t i = 0; i < a->frustum_count; i++) {
        double edges[3];
        umb_frustum_voxel_edges(&a->frusta[i], edges);
        const double cell =
            (double)((uint64_t)1 << a->frusta[i].log2_size >> UMB__RECEIVER_MASK_LOG2);
        most = fmax(most,
                    cell * sqrt(edges[0] * edges[0] + edges[1] * edges[1] + edges[2] * edges[2]));
    }
    fprintf(to,
            "effect=static state=on reason=\"switched on: nothing moves, only points on surfaces "
            "are asked\" cost=\"every texel is drawn twice; 32 KiB a light in the asset, which is "
            "more than small maps save; points more than %.4g m from every "
            "surface are undefined and counted, a look-up a point; no levels, footprints, "
            "penumbras, segments, columns or boxes\"\n",
            2 * most);
}

/* Writes the line of effect "origin". The effect is on if floats in world space would be off by
 * more than a hundredth of the smallest voxel edge. */
static void write_origin(FILE *to, const struct umbb_analysis *a)
{
    double most = 0.0, voxel = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        most = fmax(most, fmax(fabs(a->bounds.min[axis]), fabs(a->bounds.max[axis])));
    }
    for (uint32_t i = 0; i < a->frustum_count; i++) {
        double edges[3];
        umb_frustum_voxel_edges(&a->frusta[i], edges);
        voxel = fmin(voxel, fmin(fmin(edges[0], edges[1]), edges[2]));
    }
    const double off = most * FLOAT_HALF_STEP;
    const int on = off > 0.01 * voxel;
    fprintf(to,
            "effect=origin state=%s reason=\"coordinates up to %.6g m as floats are off by %.3g m, "
            "%.3g of the smallest voxel edge of %.3g m\" cost=\"none measurable\"\n",
            on ? "on" : "off", most, off, off / voxel, voxel);
}

static int has_extent(const struct umbb_analysis *a)
{
    int any = 0;
    for (uint32_t i = 0; i < a->choice.count; i++) {
        any |= a->choice.lights[i].extent > 0.0;
    }
    return any;
}

/* Returns the width of a light's penumbras, in metres and in voxels. Under a directional light the
 * receiver is taken to lie behind the whole depth of the frustum. Under other lights the caster is
 * taken to lie halfway between light and receiver. */
static double penumbra_width(const struct umbb_analysis *a, const struct umb_light_info *light,
                             double *voxels)
{
    const struct umb_frustum_info *frustum = &a->frusta[light->first_frustum];
    double edges[3], width = fmax(light->extent, umb__length(light->side));
    umb_frustum_voxel_edges(frustum, edges);
    if (light->kind == UMB_LIGHT_DIRECTIONAL) {
        width *= (double)((uint64_t)1 << frustum->log2_size) * edges[2];
    }
    *voxels = width / fmin(edges[0], edges[1]);
    return width;
}

/* Reason why penumbras are off; NULL if they are on. */
static const char *penumbra_refusal(const struct umbb_analysis *a,
                                    const struct umbb_options *options)
{
    if (options->static_rule) {
        return "the static rule leaves out what lies off the surfaces: ";
    }
    return a->closed_rule && !options->occluder_depth
               ? "the closed rule leaves out the first occluders that it needs (--effect "
                 "penumbra=on keeps them): "
               : NULL;
}

/* Writes the line of effect "penumbra", for the light with the widest penumbras. */
static void write_penumbra(FILE *to, const struct umbb_analysis *a,
                           const struct umbb_options *options)
{
    const struct umb_light_info *worst = &a->choice.lights[0];
    double most = 0.0, voxels;
    if (options->penumbra != UMBB_PENUMBRA_AUTO && !has_extent(a)) {
        fprintf(to, "effect=penumbra state=off reason=\"%s\" cost=\"none\"\n",
                options->penumbra == UMBB_PENUMBRA_OFF
                    ? "switched off: lights are kept without an extent"
                    : "switched on, but no light has an extent (--light-size)");
        return;
    }
    /* Lamps count only if no sun calls for penumbras. */
    for (int lamps = 0; lamps < 2 && !(most > 1.0); lamps++) {
        for (uint32_t i = 0; i < a->choice.count; i++) {
            const struct umb_light_info *light = &a->choice.lights[i];
            (void)penumbra_width(a, light, &voxels);
            if ((light->kind != UMB_LIGHT_DIRECTIONAL) == lamps && voxels > most) {
                most = voxels;
                worst = light;
            }
        }
    }
    if (!(most > 1.0)) {
        return;
    }
    const double width = penumbra_width(a, worst, &voxels);
    const char *refusal = penumbra_refusal(a, options);
    fprintf(to, "effect=penumbra state=%s reason=\"%s", refusal ? "off" : "on",
            refusal ? refusal : "");
    if (worst->kind == UMB_LIGHT_DIRECTIONAL) {
        fprintf(to, "a light %.3g degrees across over %.6g m makes half shadows up to %.3g m",
                worst->extent * 57.29577951308232, width / worst->extent, width);
    } else {
        fprintf(to,
                "a light %.3g m across makes half shadows %.3g m wide behind a caster halfway to "
                "the receiver",
                worst->extent, width);
    }
    fprintf(to, " or %.3g voxels wide%s\" cost=\"%s\"\n", voxels,
            refusal ? "; edges stay sharp" : "",
            refusal ? "none" : "none in the bake; a blocker search in queries that ask for it");
}

/* Several directional lights, and the frusta of spot and point lights. */
static void write_lights(FILE *to, const struct umbb_analysis *a)
{
    uint32_t directional = 0, flat = 0;
    for (uint32_t i = 0; i < a->choice.count; i++) {
        const enum umb_light_kind kind = a->choice.lights[i].kind;
        directional += kind == UMB_LIGHT_DIRECTIONAL;
        flat += kind == UMB_LIGHT_RECTANGLE || kind == UMB_LIGHT_DISC;
    }
    if (directional > 1) {
        fprintf(to,
                "effect=suns state=on reason=\"%u directional lights\" cost=\"a frustum of depth, "
                "build and nodes each; equal nodes are stored once\"\n",
                directional);
    }
    if (directional < a->choice.count) {
        const uint32_t others = a->choice.count - directional;
        fprintf(to,
                "effect=faces state=on reason=\"%u %s lights see casters in %u frusta; "
                "the other cube faces are left out\" cost=\"a frustum of depth, build and nodes "
                "each; %d texels of guard band at each face's edge; each query picks a face\"\n",
                others, flat > 0 ? "spot, point or area" : "spot or point",
                a->frustum_count - directional, UMBB_GUARD_TEXELS);
    }
}

/* Writes the name of the only material, or the number of materials and the name of the first. */
static void write_materials(FILE *to, size_t count, const char *first)
{
    if (count == 1) {
        fprintf(to, "material '%s': ", first);
    } else {
        fprintf(to, "%zu materials, the first '%s': ", count, first);
    }
}

/* Materials whose textures cut holes. */
static void write_cut_out(FILE *to, const struct umbb_analysis *a,
                          const struct umbs_scene_view *view, const struct umbb_options *options)
{
    const struct umbs_cut_figures *figures = &a->cuts.figures;
    if (figures->mask_triangles == 0) {
        return;
    }
    char name[UMBB_ESCAPED_NAME_SIZE];
    umbb_escape(view->materials[figures->first].name, name, sizeof name);
    const int on = figures->triangles > 0 && !options->opaque_cut_outs;
    fprintf(to, "effect=cut-out state=%s reason=\"%s", on ? "on" : "off",
            figures->triangles > 0 && !on ? "switched off: " : "");
    if (figures->triangles == 0) {
        fprintf(to,
                "%zu triangles of MASK materials, the first '%s', without a texel below their "
                "cut-off\" cost=\"none\"\n",
                figures->mask_triangles, name);
        return;
    }
    write_materials(to, figures->materials, name);
    fprintf(to, "%zu triangles with alpha below ", figures->triangles);
    if (figures->materials == 1) {
        fprintf(to, "%.3g", (double)view->materials[figures->first].alpha_cutoff);
    } else {
        fputs("their cut-off", to);
    }
    fprintf(to, " on %.3g %% of their texels\" cost=\"%s\"\n", 100.0 * figures->share,
            on ? "a look at the texture for each of their texels in the bake; finer shadows take "
                 "more bytes"
               : "none");
}

/* Materials that transmit a part of the light. */
static void write_transmittance(FILE *to, const struct umbb_analysis *a,
                                const struct umbs_scene_view *view,
                                const struct umbb_options *options)
{
    const struct umbs_translucent_figures *figures = &a->cuts.translucent;
    if (figures->triangles == 0) {
        return;
    }
    const int on = !options->opaque_translucents;
    char name[UMBB_ESCAPED_NAME_SIZE];
    umbb_escape(view->materials[figures->first].name, name, sizeof name);
    fprintf(to, "effect=transmittance state=%s reason=\"%s", on ? "on" : "off",
            on ? "" : "switched off, they are baked as opaque: ");
    write_materials(to, figures->materials, name);
    fprintf(to, "%zu triangles take %.3g to %.3g %% of the light\" cost=\"%s\"\n",
            figures->triangles, 100.0 * figures->least, 100.0 * figures->most,
            on ? "lists of depths for the texels that they cover, in the asset's head; a second "
                 "look-up in queries"
               : "none");
}

/* BLEND materials that could be cut-outs, or are. */
static void write_blend_cut_out(FILE *to, const struct umbb_analysis *a,
                                const struct umbs_scene_view *view,
                                const struct umbb_options *options)
{
    const struct umbs_sharp_figures *figures = &a->cuts.sharp;
    const int on = options->sharp_cut_outs;
    if (figures->triangles == 0 || (!on && a->cuts.translucent.triangles == 0)) {
        return;
    }
    char name[UMBB_ESCAPED_NAME_SIZE];
    umbb_escape(view->materials[figures->first].name, name, sizeof name);
    fprintf(to, "effect=blend-cut-out state=%s reason=\"", on ? "on" : "off");
    write_materials(to, figures->materials, name);
    fprintf(to, "%.3g %% of the texels of %zu BLEND triangles are clear or opaque\" cost=\"",
            100.0 * figures->share, figures->triangles);
    if (on) {
        fputs("the other texels become clear or opaque too\"\n", to);
        return;
    }
    fputs("lists of depths instead of voxels: ", to);
    if (a->sharp_price.known) {
        fputs("about ", to);
        write_bytes(to, a->sharp_price.blend_bytes);
        fputs(", and ", to);
        write_bytes(to, a->sharp_price.cut_bytes);
        fputs(" as cut-outs (--effect blend-cut-out=on)\"\n", to);
    } else {
        fputs("--effect blend-cut-out=on takes them as cut-outs\"\n", to);
    }
}

/* Closes a memory stream; its text is freed on failure. */
static enum umb_status close_text(FILE *stream, char **text, struct umb_error *error)
{
    const int failed = ferror(stream);
    /* glibc's fclose succeeds even if its last realloc failed; *text is NULL then. */
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
    write_closed(to, analysis, options);
    write_occluder_depth(to, analysis, options);
    write_static(to, analysis, options);
    write_origin(to, analysis);
    write_penumbra(to, analysis, options);
    write_lights(to, analysis);
    write_cut_out(to, analysis, view, options);
    write_transmittance(to, analysis, view, options);
    write_blend_cut_out(to, analysis, view, options);
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
    fprintf(to, "bake=%d\n", UMBB_BAKE_VERSION);
    if (analysis->cuts.sharp.triangles > 0 && options->sharp_cut_outs) {
        fputs("blend-cut-out=on\n", to);
    }
    fprintf(to, "closed=%s\n", closed_name(options->closed));
    if (options->occluder_depth && analysis->closed_rule) {
        fputs("front=on\n", to);
    }
    if (analysis->cuts.figures.triangles > 0 && !options->opaque_cut_outs) {
        fputs("cut-out=on\n", to);
    }
    for (uint32_t i = 0; i < analysis->choice.count; i++) {
        const struct umb_light_info *light = &analysis->choice.lights[i];
        const double *d = light->direction, *p = light->position;
        if (light->kind != UMB_LIGHT_POINT) {
            fprintf(to, "light.%u.direction=%.17g,%.17g,%.17g\n", i, d[0], d[1], d[2]);
        }
        if (light->kind != UMB_LIGHT_DIRECTIONAL) {
            fprintf(to, "light.%u.position=%.17g,%.17g,%.17g\n", i, p[0], p[1], p[2]);
        }
        if (light->kind != UMB_LIGHT_DIRECTIONAL && light->kind != UMB_LIGHT_POINT) {
            fprintf(to, "light.%u.cone=%.17g\n", i, analysis->choice.cones[i]);
        }
    }
    fprintf(to, "resolution=%u\n", 1U << options->resolution_log2);
    if (options->static_rule) {
        fputs("static=on\n", to);
    }
    if (analysis->cuts.translucent.triangles > 0 && !options->opaque_translucents) {
        fputs("transmittance=on\n", to);
    }
    fprintf(to, "up=%c\n", analysis->z_up ? 'z' : 'y');
    return close_text(to, text, error);
}

/* Prints a light and the voxels of its first frustum. */
static void print_light(FILE *to, const struct umbb_analysis *a, const struct umb_light_info *light)
{
    char name[UMBB_ESCAPED_NAME_SIZE];
    double edges[3];
    const double *d = light->direction, *p = light->position;
    umbb_escape(light->name, name, sizeof name);
    umb_frustum_voxel_edges(&a->frusta[light->first_frustum], edges);
    fprintf(to, "light=\"%s\" kind=%s", name, umb_light_kind_name(light->kind));
    if (light->kind != UMB_LIGHT_POINT) {
        fprintf(to, " direction=%.9g,%.9g,%.9g", d[0], d[1], d[2]);
    }
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        fprintf(to, " position=%.9g,%.9g,%.9g frusta=%u", p[0], p[1], p[2], light->frustum_count);
    }
    if (light->kind == UMB_LIGHT_RECTANGLE) {
        fprintf(to, " side=%.6g,%.6g,%.6g", light->side[0], light->side[1], light->side[2]);
    }
    fprintf(to, " extent=%.6g voxel_m=%.6g,%.6g,%.6g\n", light->extent, edges[0], edges[1],
            edges[2]);
}

void umbb_plan_print(FILE *to, const struct umbb_analysis *a, const struct umbs_scene_view *view,
                     const char *plan, uint64_t tiles)
{
    const struct umb_box *b = &a->bounds;
    fprintf(to, "triangles=%zu degenerate=%zu duplicate=%zu unusable_faces=%u\n", a->count,
            a->degenerate_count, a->duplicate_count, view->dropped_faces);
    fprintf(to, "parts=%zu closed=%zu\n", a->part_count, a->closed_part_count);
    fprintf(to, "up=%c reason=\"%s\"\n", a->z_up ? 'z' : 'y', a->up_reason);
    fprintf(to, "bounds=%.9g,%.9g,%.9g..%.9g,%.9g,%.9g\n", b->min[0], b->min[1], b->min[2],
            b->max[0], b->max[1], b->max[2]);
    fprintf(to, "origin=%.17g,%.17g,%.17g\n", a->origin[0], a->origin[1], a->origin[2]);
    fprintf(to, "resolution=%u tiles=%llu\n", 1U << a->frusta[0].log2_size,
            (unsigned long long)tiles);
    for (uint32_t i = 0; i < a->choice.count; i++) {
        print_light(to, a, &a->choice.lights[i]);
    }
    fputs(plan, to);
}

void umbb_lights_put(struct umbu_json *json, const struct umb_light_info *lights, uint32_t count)
{
    umbu_json_begin(json, "lights", '[');
    for (uint32_t i = 0; i < count; i++) {
        umbu_json_begin(json, NULL, '{');
        umbu_json_text(json, "name", lights[i].name);
        umbu_json_text(json, "kind", umb_light_kind_name(lights[i].kind));
        umbu_json_vector(json, "direction", lights[i].direction);
        umbu_json_vector(json, "position", lights[i].position);
        umbu_json_number(json, "extent", lights[i].extent);
        if (lights[i].kind == UMB_LIGHT_RECTANGLE) {
            umbu_json_vector(json, "side", lights[i].side);
        }
        umbu_json_integer(json, "frusta", lights[i].frustum_count);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

/* The plan's lines. */
static void put_lines(struct umbu_json *json, const char *key, const char *line)
{
    umbu_json_begin(json, key, '[');
    while (*line != '\0') {
        const size_t length = strcspn(line, "\n");
        umbu_json_bytes(json, NULL, line, length);
        line += length + (line[length] == '\n');
    }
    umbu_json_end(json, ']');
}

/* The prices of a printed plan, in bytes. */
static void put_prices(struct umbu_json *json, const struct umbb_analysis *a)
{
    if (a->closed_price.known) {
        umbu_json_begin(json, "closed_price", '{');
        umbu_json_number(json, "saved", a->closed_price.saved);
        umbu_json_number(json, "closed_bytes", rint(a->closed_price.closed_bytes));
        umbu_json_number(json, "open_bytes", rint(a->closed_price.open_bytes));
        umbu_json_number(json, "factor", a->closed_price.factor);
        umbu_json_bool(json, "exact", a->closed_price.exact);
        umbu_json_end(json, '}');
    }
    if (a->sharp_price.known) {
        umbu_json_begin(json, "blend_price", '{');
        umbu_json_number(json, "blend_bytes", rint(a->sharp_price.blend_bytes));
        umbu_json_number(json, "cut_out_bytes", rint(a->sharp_price.cut_bytes));
        umbu_json_end(json, '}');
    }
}

void umbb_plan_print_json(FILE *to, const struct umbb_analysis *a,
                          const struct umbs_scene_view *view, const char *plan, uint64_t tiles)
{
    struct umbu_json json = {.file = to};
    double edges[3];
    umb_frustum_voxel_edges(&a->frusta[0], edges);
    umbu_json_begin(&json, NULL, '{');
    UMBU_JSON_COUNTS(&json, {"triangles", a->count}, {"degenerate", a->degenerate_count},
                     {"duplicate", a->duplicate_count}, {"unusable_faces", view->dropped_faces},
                     {"parts", a->part_count}, {"closed_parts", a->closed_part_count});
    umbu_json_bool(&json, "closed", a->closed_rule);
    umbu_json_text(&json, "up", a->z_up ? "z" : "y");
    umbu_json_text(&json, "up_reason", a->up_reason);
    umbu_json_begin(&json, "bounds", '{');
    umbu_json_vector(&json, "min", a->bounds.min);
    umbu_json_vector(&json, "max", a->bounds.max);
    umbu_json_end(&json, '}');
    umbu_json_vector(&json, "origin", a->origin);
    umbb_lights_put(&json, a->choice.lights, a->choice.count);
    UMBU_JSON_COUNTS(&json, {"frusta", a->frustum_count},
                     {"resolution", 1U << a->frusta[0].log2_size}, {"tiles", tiles});
    umbu_json_vector(&json, "voxel_m", edges);
    put_prices(&json, a);
    put_lines(&json, "plan", plan);
    umbu_json_close(&json);
}
