/* SPDX-License-Identifier: Apache-2.0 */
/* Key figures of a bake. */
#include "bake/bake_report.h"

#include <time.h>

#include "bake/analysis/plan.h"

/* Bytes of 16-bit shadow maps of the same resolution, one map a frustum. */
static double shadow_map_bytes(const struct umbb_report *r)
{
    return 2.0 *
           (double)((uint64_t)r->analysis->frustum_count << (2 * r->options->resolution_log2));
}

/* Prints what the self-check inherited from earlier bakes, and what it compared instead. */
static void print_inherited(FILE *to, const struct umbb_checked *checked)
{
    const time_t oldest = (time_t)checked->oldest_s;
    struct tm utc;
    char stamp[32] = "";
    if (oldest > 0 && gmtime_r(&oldest, &utc) != NULL) {
        strftime(stamp, sizeof stamp, ", the oldest %Y-%m-%d", &utc);
    }
    fprintf(to,
            "proven      before: %llu of %llu tiles, and %llu squares%s; now: %llu squares by %llu "
            "columns\n",
            (unsigned long long)checked->tiles_inherited, (unsigned long long)checked->tiles,
            (unsigned long long)checked->squares_inherited, stamp,
            (unsigned long long)checked->squares, (unsigned long long)checked->columns);
}

void umbb_report_print(FILE *to, const struct umbb_report *r)
{
    const struct umbb_analysis *a = r->analysis;
    const struct umbb_checked *checked = &r->publish->checked;
    const struct umbr_verify_result *v = &checked->verified;
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
    if (checked->tiles > 0) {
        print_inherited(to, checked);
    }
    if (checked->sampled) {
        fprintf(to,
                "verified    %llu points against rays: %llu differ within a voxel of a boundary, "
                "%llu elsewhere\n",
                (unsigned long long)v->points, (unsigned long long)v->inside_band,
                (unsigned long long)v->outside_band);
    }
}

static void put_scene(struct umbu_json *json, const struct umbb_report *r)
{
    const struct umbb_analysis *a = r->analysis;
    UMBU_JSON_COUNTS(json, {"triangles", a->count}, {"degenerate", a->degenerate_count},
                     {"duplicate", a->duplicate_count}, {"parts", a->part_count},
                     {"closed_parts", a->closed_part_count});
    umbu_json_bool(json, "closed", a->closed_rule);
    umbu_json_text(json, "up", a->z_up ? "z" : "y");
    umbu_json_integer(json, "resolution", 1U << r->options->resolution_log2);
    umbu_json_integer(json, "frusta", a->frustum_count);
    umbb_lights_put(json, a->choice.lights, a->choice.count);
    umbu_json_integer(json, "translucent_triangles", a->translucent_count);
}

static void put_asset(struct umbu_json *json, const struct umbb_report *r)
{
    const struct umb_asset_info *info = &r->publish->info;
    umbu_json_integer(json, "transmittance_texels",
                      r->transmittance_level > 0 ? 1U << r->transmittance_level : 0U);
    umbu_json_integer(json, "transmittance_bytes", info->transmittance_bytes);
    umbu_json_integer(json, "bytes", r->publish->bytes);
    umbu_json_rounded(json, "share_of_shadow_map", (double)r->publish->bytes / shadow_map_bytes(r),
                      9);
    umbu_json_begin(json, "level_nodes", '{');
    for (uint32_t level = UMB_LEVEL_BRICK; level <= r->options->resolution_log2; level++) {
        char key[16];
        (void)snprintf(key, sizeof key, "%u", level);
        umbu_json_integer(json, key, info->level_nodes[level]);
    }
    umbu_json_end(json, '}');
}

static void put_verified(struct umbu_json *json, const struct umbb_checked *checked)
{
    const struct umbr_verify_result *v = &checked->verified;
    umbu_json_begin(json, "verify", '{');
    UMBU_JSON_COUNTS(json, {"points", v->points}, {"near_boundary", v->near_boundary},
                     {"skipped_inside", v->skipped_inside}, {"inside_band", v->inside_band},
                     {"outside_band", v->outside_band});
    umbu_json_bool(json, "sampled", checked->sampled);
    UMBU_JSON_COUNTS(json, {"tiles_inherited", checked->tiles_inherited},
                     {"squares_inherited", checked->squares_inherited},
                     {"squares_compared", checked->squares}, {"columns", checked->columns},
                     {"oldest", checked->oldest_s});
}

void umbb_report_print_json(FILE *to, const struct umbb_report *r)
{
    struct umbu_json json = {.file = to};
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(r->publish->id, id);
    umbu_json_begin(&json, NULL, '{');
    umbu_json_text(&json, "asset", id);
    umbu_json_text(&json, "output", r->options->output);
    put_scene(&json, r);
    put_asset(&json, r);
    UMBU_JSON_COUNTS(&json, {"texels", r->figures.texels}, {"tile", 1U << r->tile_log2},
                     {"tiles", r->figures.tiles}, {"tiles_found", r->figures.tiles_found},
                     {"tiles_of_base", r->base_tiles}, {"tiles_damaged", r->damaged_tiles});
    umbu_json_text(&json, "depth", r->depth_path);
    umbu_json_begin(&json, "seconds", '{');
    UMBU_JSON_VALUES(&json, 6, {"import", r->seconds_import}, {"analysis", r->seconds_analysis},
                     {"bake", r->seconds_bake}, {"depth_wait", r->figures.seconds_depth},
                     {"build", r->figures.seconds_build}, {"write", r->seconds_write},
                     {"verify", r->seconds_verify}, {"total", r->seconds_total});
    umbu_json_end(&json, '}');
    put_verified(&json, &r->publish->checked);
    umbu_json_close(&json);
}

void umbb_report_print_tiles(FILE *to, const struct umbb_report *r)
{
    const unsigned long long tiles = r->figures.tiles, found = r->figures.tiles_found;
    const unsigned long long first = r->options->only_given ? r->options->only_first : 0;
    if (r->options->json) {
        struct umbu_json json = {.file = to};
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "output", r->options->output);
        UMBU_JSON_COUNTS(&json, {"tile", 1U << r->tile_log2}, {"first", first}, {"tiles", tiles},
                         {"tiles_found", found}, {"tiles_damaged", r->damaged_tiles});
        umbu_json_begin(&json, "seconds", '{');
        UMBU_JSON_VALUES(&json, 6, {"import", r->seconds_import}, {"analysis", r->seconds_analysis},
                         {"bake", r->seconds_bake}, {"total", r->seconds_total});
        umbu_json_close(&json);
    } else if (!r->options->quiet) {
        fprintf(to, "tiles       %llu to %llu of %u texels a side: %llu baked, %llu were there\n",
                first, first + tiles - 1, 1U << r->tile_log2, tiles - found, found);
        fprintf(to, "seconds     %.2f: import %.2f, analysis %.2f, bake %.2f\n", r->seconds_total,
                r->seconds_import, r->seconds_analysis, r->seconds_bake);
    }
}
