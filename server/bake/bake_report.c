/* SPDX-License-Identifier: Apache-2.0 */
/* Key figures of a bake. */
#include "bake/bake_report.h"

#include "bake/analysis/plan.h"
#include "common/json_text.h"

/* Bytes of 16-bit shadow maps of the same resolution, one a frustum. */
static double shadow_map_bytes(const struct umbb_report *r)
{
    return 2.0 *
           (double)((uint64_t)r->analysis->frustum_count << (2 * r->options->resolution_log2));
}

void umbb_report_print(FILE *to, const struct umbb_report *r)
{
    const struct umbb_analysis *a = r->analysis;
    const struct umbr_verify_result *v = &r->publish->verified;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(r->publish->id, id);
    fprintf(to, "asset       %s\n", id);
    fprintf(to, "file        %s: %llu bytes, %.3g %% of 16-bit shadow maps\n", r->options->output,
            (unsigned long long)r->publish->bytes,
            100.0 * (double)r->publish->bytes / shadow_map_bytes(r));
    fprintf(to, "scene       %zu triangles, %zu degenerate dropped, %zu of %zu parts closed\n",
            a->count, a->degenerate_count, a->closed_part_count, a->part_count);
    fprintf(to, "resolution  %u, closed rule %s\n", 1U << r->options->resolution_log2,
            a->closed_rule ? "on" : "off");
    fprintf(to, "lights      %u in %u frusta\n", a->choice.count, a->frustum_count);
    fprintf(to, "nodes       %llu bricks",
            (unsigned long long)r->publish->info.level_nodes[UMB_LEVEL_BRICK]);
    for (uint32_t level = UMB_LEVEL_BRICK + 1; level <= r->options->resolution_log2; level++) {
        fprintf(to, ", %llu", (unsigned long long)r->publish->info.level_nodes[level]);
    }
    fprintf(to, "\n");
    if (r->transmittance_level > 0) {
        fprintf(to, "translucent %zu triangles, maps of %u texels a side, %llu bytes\n",
                a->translucent_count, 1U << r->transmittance_level,
                (unsigned long long)r->publish->info.transmittance_bytes);
    }
    if (r->options->cache != NULL) {
        fprintf(to, "tiles       %llu of %u texels a side, %llu of them from the cache\n",
                (unsigned long long)r->figures.tiles, 1U << r->tile_log2,
                (unsigned long long)r->figures.tiles_found);
    }
    fprintf(to,
            "seconds     %.2f: import %.2f, analysis %.2f, bake %.2f, write %.2f, verify %.2f\n",
            r->seconds_total, r->seconds_import, r->seconds_analysis, r->seconds_bake,
            r->seconds_write, r->seconds_verify);
    if (r->figures.texels > 0) { /* 0 if the cache had every tile */
        fprintf(to, "rate        %.1f Mtexel/s, depth by %s\n",
                1e-6 * (double)r->figures.texels / (r->seconds_bake > 0.0 ? r->seconds_bake : 1e-9),
                r->depth_path);
    }
    if (r->options->verify_points > 0) {
        fprintf(to,
                "verified    %llu points against rays: %llu differ within a voxel of a boundary, "
                "%llu elsewhere\n",
                (unsigned long long)v->points, (unsigned long long)v->inside_band,
                (unsigned long long)v->outside_band);
    }
}

static void print_scene_json(FILE *to, const struct umbb_report *r)
{
    const struct umbb_analysis *a = r->analysis;
    fprintf(to,
            "\"triangles\":%zu,\"degenerate\":%zu,\"duplicate\":%zu,\"parts\":%zu,"
            "\"closed_parts\":%zu,\"closed\":%s,\"up\":\"%c\",\"resolution\":%u,\"frusta\":%u,",
            a->count, a->degenerate_count, a->duplicate_count, a->part_count, a->closed_part_count,
            a->closed_rule ? "true" : "false", a->z_up ? 'z' : 'y',
            1U << r->options->resolution_log2, a->frustum_count);
    umbb_lights_print_json(to, a->choice.lights, a->choice.count);
    fputc(',', to);
}

void umbb_report_print_json(FILE *to, const struct umbb_report *r)
{
    const struct umb_asset_info *info = &r->publish->info;
    const struct umbr_verify_result *v = &r->publish->verified;
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(r->publish->id, id);
    fprintf(to, "{\"asset\":\"%s\",\"output\":", id);
    umbs_json_text(to, r->options->output);
    fputc(',', to);
    print_scene_json(to, r);
    fprintf(to,
            "\"translucent_triangles\":%zu,\"transmittance_texels\":%u,"
            "\"transmittance_bytes\":%llu,",
            r->analysis->translucent_count,
            r->transmittance_level > 0 ? 1U << r->transmittance_level : 0U,
            (unsigned long long)info->transmittance_bytes);
    fprintf(to,
            "\"bytes\":%llu,\"share_of_shadow_map\":%.9g,\"memory_bytes\":%llu,\"level_nodes\":{",
            (unsigned long long)r->publish->bytes, (double)r->publish->bytes / shadow_map_bytes(r),
            (unsigned long long)info->memory_bytes);
    for (uint32_t level = UMB_LEVEL_BRICK; level <= r->options->resolution_log2; level++) {
        fprintf(to, "%s\"%u\":%llu", level == UMB_LEVEL_BRICK ? "" : ",", level,
                (unsigned long long)info->level_nodes[level]);
    }
    fprintf(to,
            "},\"texels\":%llu,\"tile\":%u,\"tiles\":%llu,\"tiles_found\":%llu,"
            "\"tiles_damaged\":%llu,\"depth\":\"%s\",\"seconds\":{\"import\":%.6f,"
            "\"analysis\":%.6f,\"bake\":%.6f,\"depth_wait\":%.6f,\"build\":%.6f,\"write\":%.6f,"
            "\"verify\":%.6f,\"total\":%.6f},",
            (unsigned long long)r->figures.texels, 1U << r->tile_log2,
            (unsigned long long)r->figures.tiles, (unsigned long long)r->figures.tiles_found,
            (unsigned long long)r->damaged_tiles, r->depth_path, r->seconds_import,
            r->seconds_analysis, r->seconds_bake, r->figures.seconds_depth,
            r->figures.seconds_build, r->seconds_write, r->seconds_verify, r->seconds_total);
    fprintf(to,
            "\"verify\":{\"points\":%llu,\"near_boundary\":%llu,\"skipped_inside\":%llu,"
            "\"inside_band\":%llu,\"outside_band\":%llu}}\n",
            (unsigned long long)v->points, (unsigned long long)v->near_boundary,
            (unsigned long long)v->skipped_inside, (unsigned long long)v->inside_band,
            (unsigned long long)v->outside_band);
}

void umbb_report_print_tiles(FILE *to, const struct umbb_report *r)
{
    const unsigned long long tiles = r->figures.tiles, found = r->figures.tiles_found;
    const unsigned long long first = r->options->only_given ? r->options->only_first : 0;
    if (r->options->json) {
        fprintf(to, "{\"output\":");
        umbs_json_text(to, r->options->output);
        fprintf(to,
                ",\"tile\":%u,\"first\":%llu,\"tiles\":%llu,\"tiles_found\":%llu,"
                "\"tiles_damaged\":%llu,\"seconds\":{\"import\":%.6f,\"analysis\":%.6f,"
                "\"bake\":%.6f,\"total\":%.6f}}\n",
                1U << r->tile_log2, first, tiles, found, (unsigned long long)r->damaged_tiles,
                r->seconds_import, r->seconds_analysis, r->seconds_bake, r->seconds_total);
    } else if (!r->options->quiet) {
        fprintf(to, "tiles       %llu to %llu of %u texels a side: %llu baked, %llu were there\n",
                first, first + tiles - 1, 1U << r->tile_log2, tiles - found, found);
        fprintf(to, "seconds     %.2f: import %.2f, analysis %.2f, bake %.2f\n", r->seconds_total,
                r->seconds_import, r->seconds_analysis, r->seconds_bake);
    }
}
