/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage info: describes an asset of a file or a daemon, as text or as JSON. */
#include "cli/shared/cli_common.h"
#include "cli_partial.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "tool/json.h"
#include "umbrage/curve.h"

struct options {
    struct umbc_settings settings; /* First: rows of other tables are about its fields */
    bool pages;
};

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct umbc_settings, "FILE|ASSET", "asset file, or asset of the daemon")},
    {"pages", NULL, "list the pages of a packed or partial file: hash, levels, bytes", UMBU_FLAG,
     UMBU_AT(struct options, pages)},
    {UMBU_JSON_ROW(struct umbc_settings)},
    {UMBU_QUIET_ROW(struct umbc_settings, "print only the id")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage info",
    .usage = "umbrage info FILE|ASSET [options]",
    .summary = "Describes an asset. An argument that is an existing file, a path as ./NAME or\n"
               "/DIR/NAME, or ends in .umb or .umbm is a file; NAME and FOLDER/NAME are assets of\n"
               "the daemon. A file may be a partial file of `umbrage stream -o`.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct umbc_settings, session)},
};

/* Number of times stated for each row of an accuracy curve: nanoseconds a point for scattered
 * points, and for neighbouring points. */
#define CURVE_COSTS 2

/* Prints a light's curve as an indented table; prints nothing if it has no rows. In: ns: for each
 * kind of times an array of `count` times, or NULL if the kind has none; NULL if there are no times
 * at all. */
static void print_curve(const struct umb_curve_row *rows, const double *const ns[CURVE_COSTS],
                        size_t count)
{
    if (count == 0) {
        return;
    }
    (void)printf("  level taps     bound, m  visibility error  nodes  cache lines");
    for (int k = 0; k < CURVE_COSTS && ns != NULL; k++) {
        (void)printf("%s", ns[k] == NULL ? "" : k == 0 ? "  ns, scattered" : "  ns, coherent");
    }
    (void)putchar('\n');
    for (size_t i = 0; i < count; i++) {
        const struct umb_curve_row *row = &rows[i];
        (void)printf("  %5" PRIu32 " %4" PRIu32 " %12.4g %17.4f %6.2f %12.2f", row->level,
                     row->taps, row->bound_m, row->visibility_error, row->nodes, row->lines);
        for (int k = 0; k < CURVE_COSTS && ns != NULL; k++) {
            if (ns[k] != NULL) {
                (void)printf(" %*.1f", k == 0 ? 14 : 13, ns[k][i]);
            }
        }
        (void)putchar('\n');
    }
}

/* Writes a light's curve as the array "curve"; empty without rows. */
static void put_curve(struct umbu_json *json, const struct umb_curve_row *rows,
                      const double *const ns[CURVE_COSTS], size_t count)
{
    umbu_json_begin(json, "curve", '[');
    for (size_t i = 0; i < count; i++) {
        umbu_json_begin(json, NULL, '{');
        UMBU_JSON_COUNTS(json, {"level", rows[i].level}, {"taps", rows[i].taps});
        UMBU_JSON_VALUES(json, 17, {"bound_m", rows[i].bound_m},
                         {"visibility_error", rows[i].visibility_error}, {"nodes", rows[i].nodes},
                         {"lines", rows[i].lines});
        for (int k = 0; k < CURVE_COSTS && ns != NULL; k++) {
            if (ns[k] != NULL) {
                umbu_json_number(json, k == 0 ? "scattered_ns" : "coherent_ns", ns[k][i]);
            }
        }
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

/* Prints the lines of a text, indented under a title. */
static void print_lines(const char *title, const char *text)
{
    (void)printf("%s\n", title);
    while (*text != '\0') {
        size_t length = strcspn(text, "\n");
        (void)fputs("  ", stdout);
        umbc_print_text(stdout, text, length);
        (void)putchar('\n');
        text += length + (text[length] == '\n');
    }
}

static void print_place(const double origin[3], const struct umb_box *bounds)
{
    (void)printf("origin         %.9g %.9g %.9g m\n", origin[0], origin[1], origin[2]);
    (void)printf("bounds         %.9g %.9g %.9g to %.9g %.9g %.9g m\n", bounds->min[0],
                 bounds->min[1], bounds->min[2], bounds->max[0], bounds->max[1], bounds->max[2]);
}

static void print_light(uint32_t index, const struct umb_light_info *light)
{
    (void)printf("light %-8" PRIu32 " %s '", index, umb_light_kind_name(light->kind));
    umbc_print_text(stdout, light->name, strlen(light->name));
    (void)putchar('\'');
    if (light->kind != UMB_LIGHT_POINT) {
        (void)printf(", towards %.6g %.6g %.6g", light->direction[0], light->direction[1],
                     light->direction[2]);
    }
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        (void)printf(", at %.9g %.9g %.9g m", light->position[0], light->position[1],
                     light->position[2]);
    }
    if (light->kind == UMB_LIGHT_RECTANGLE) {
        const double *s = light->side;
        (void)printf(", extent %.4g x %.4g m, the first along %.6g %.6g %.6g",
                     sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]), light->extent, s[0], s[1],
                     s[2]);
    } else if (light->extent > 0) {
        (void)printf(", extent %.4g %s", light->extent,
                     light->kind == UMB_LIGHT_DIRECTIONAL ? "rad" : "m");
    }
    (void)putchar('\n');
}

static void json_light(struct umbu_json *json, const struct umb_light_info *light)
{
    umbu_json_text(json, "name", light->name);
    umbu_json_text(json, "kind", umb_light_kind_name(light->kind));
    umbu_json_vector(json, "direction", light->direction);
    umbu_json_vector(json, "position", light->position);
    umbu_json_number(json, "extent", light->extent);
    if (light->kind == UMB_LIGHT_RECTANGLE) {
        umbu_json_vector(json, "side", light->side);
    }
}

static void json_box(struct umbu_json *json, const struct umb_box *bounds)
{
    umbu_json_begin(json, "bounds", '{');
    umbu_json_vector(json, "min", bounds->min);
    umbu_json_vector(json, "max", bounds->max);
    umbu_json_end(json, '}');
}

/* --- a file --- */

static void print_frusta(const struct umb_asset *asset, const struct umb_light_info *light)
{
    for (uint32_t i = 0; i < light->frustum_count; i++) {
        struct umb_frustum_info frustum;
        double metres[3];
        if (umb_asset_get_frustum(asset, light->first_frustum + i, &frustum) != UMB_OK) {
            return;
        }
        umb_frustum_voxel_edges(&frustum, metres);
        (void)printf("  frustum %-4" PRIu32 " %llu^3 voxels of %.4g x %.4g x %.4g m%s, %s\n",
                     light->first_frustum + i, 1ULL << frustum.log2_size, metres[0], metres[1],
                     metres[2], light->kind == UMB_LIGHT_DIRECTIONAL ? "" : " at its far end",
                     frustum.closed ? "closed" : "open");
    }
}

/* Prints a line with a number of bytes in a readable unit; nothing for 0. exactly: also prints the
 * exact number. */
static void print_bytes(const char *title, uint64_t bytes, const char *what, bool exactly)
{
    char text[32];
    if (bytes == 0) {
        return;
    }
    umbc_format_bytes(bytes, text);
    (void)printf("%-14s %s", title, text);
    if (exactly) {
        (void)printf(" (%" PRIu64 " bytes)", bytes);
    }
    (void)printf("%s\n", what);
}

static void print_file_sizes(const struct umb_asset_info *info)
{
    char memory[32], grid[32], node[32], brick[32];
    umbc_format_bytes(info->memory_bytes, memory);
    umbc_format_bytes(info->grid_bytes, grid);
    umbc_format_bytes(info->node_bytes, node);
    umbc_format_bytes(info->brick_bytes, brick);
    print_bytes("file", info->file_bytes,
                info->encoding == UMB_ENCODING_PACKED ? ", packed" : ", mapped", true);
    (void)printf("memory         %s: grids %s, nodes %s, bricks %s\n", memory, grid, node, brick);
    print_bytes("front", info->occluder_depth_bytes, " of first occluders in closed solids", false);
    print_bytes("transmittance", info->transmittance_bytes, " of translucent casters", false);
    print_bytes("near", info->receiver_mask_bytes, " of receiver mask: baked under the static rule",
                false);
    print_bytes("packed form", info->packed_bytes, "", true);
    print_bytes("2014 encoding", info->bytes_2014, "", true);
}

/* Prints how much of its asset a partial file has. */
static void print_held(const struct umb_partial_stats *stats)
{
    (void)printf("pages          %" PRIu32 " of %" PRIu32 "%s\n", stats->pages_held,
                 stats->page_count, stats->pages_held == stats->page_count ? ": complete" : "");
    print_bytes("pages' bytes", stats->held_bytes, "", true);
}

static void json_held(struct umbu_json *json, const struct umb_partial_stats *stats)
{
    UMBU_JSON_COUNTS(json, {"page_count", stats->page_count}, {"pages_held", stats->pages_held},
                     {"held_bytes", stats->held_bytes});
}

static void print_file(const struct umb_asset *asset, const struct umb_asset_info *info,
                       const struct umb_partial_stats *held)
{
    char id[UMB_ID_TEXT_SIZE];
    char scene[UMB_ID_TEXT_SIZE];
    umb_id_to_text(info->id, id);
    umb_id_to_text(info->scene_hash, scene);
    (void)printf("asset          %s\nscene          %s\n", id, scene);
    print_file_sizes(info);
    if (held) {
        print_held(held);
    }
    print_place(info->origin, &info->bounds);
    for (uint32_t i = 0; i < info->light_count; i++) {
        struct umb_light_info light;
        if (umb_asset_get_light(asset, i, &light) == UMB_OK) {
            print_light(i, &light);
            print_frusta(asset, &light);
            struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
            size_t count;
            (void)umb_asset_get_curve(asset, i, rows, &count);
            print_curve(rows, NULL, count);
        }
    }
    (void)printf("unique nodes  ");
    for (uint32_t level = UMB_LEVEL_BRICK; level <= UMB_LEVEL_MAX; level++) {
        if (info->level_nodes[level] != 0) {
            (void)printf(" level %" PRIu32 ": %" PRIu64, level, info->level_nodes[level]);
        }
    }
    (void)putchar('\n');
    print_lines("plan", info->plan);
    print_lines("settings", info->settings);
    print_lines("notes", info->notes);
}

static void json_frusta(struct umbu_json *json, const struct umb_asset *asset,
                        const struct umb_light_info *light)
{
    umbu_json_begin(json, "frusta", '[');
    for (uint32_t i = 0; i < light->frustum_count; i++) {
        struct umb_frustum_info frustum;
        double metres[3];
        if (umb_asset_get_frustum(asset, light->first_frustum + i, &frustum) != UMB_OK) {
            break;
        }
        umb_frustum_voxel_edges(&frustum, metres);
        umbu_json_begin(json, NULL, '{');
        umbu_json_integer(json, "resolution", 1ULL << frustum.log2_size);
        umbu_json_vector(json, "voxel_m", metres);
        umbu_json_bool(json, "closed", frustum.closed != 0);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
}

static void json_sizes(struct umbu_json *json, const struct umb_asset_info *info)
{
    umbu_json_text(json, "encoding", info->encoding == UMB_ENCODING_PACKED ? "packed" : "mapped");
    UMBU_JSON_COUNTS(json, {"file_bytes", info->file_bytes}, {"packed_bytes", info->packed_bytes},
                     {"bytes_2014", info->bytes_2014}, {"memory_bytes", info->memory_bytes},
                     {"grid_bytes", info->grid_bytes}, {"node_bytes", info->node_bytes},
                     {"brick_bytes", info->brick_bytes},
                     {"front_bytes", info->occluder_depth_bytes},
                     {"transmittance_bytes", info->transmittance_bytes},
                     {"near_bytes", info->receiver_mask_bytes});
    umbu_json_begin(json, "level_nodes", '[');
    for (uint32_t level = 0; level <= UMB_LEVEL_MAX; level++) {
        umbu_json_integer(json, NULL, info->level_nodes[level]);
    }
    umbu_json_end(json, ']');
}

static void print_file_json(const struct umb_asset *asset, const struct umb_asset_info *info,
                            const struct umb_partial_stats *held)
{
    struct umbu_json json = umbu_json_open(stdout);
    umbc_json_id(&json, "asset", info->id);
    umbc_json_id(&json, "scene", info->scene_hash);
    json_sizes(&json, info);
    if (held) {
        json_held(&json, held);
    }
    umbu_json_vector(&json, "origin", info->origin);
    json_box(&json, &info->bounds);
    umbu_json_begin(&json, "lights", '[');
    for (uint32_t i = 0; i < info->light_count; i++) {
        struct umb_light_info light;
        if (umb_asset_get_light(asset, i, &light) == UMB_OK) {
            umbu_json_begin(&json, NULL, '{');
            json_light(&json, &light);
            json_frusta(&json, asset, &light);
            struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
            size_t count;
            (void)umb_asset_get_curve(asset, i, rows, &count);
            put_curve(&json, rows, NULL, count);
            umbu_json_end(&json, '}');
        }
    }
    umbu_json_end(&json, ']');
    umbu_json_text(&json, "plan", info->plan);
    umbu_json_text(&json, "settings", info->settings);
    umbu_json_text(&json, "notes", info->notes);
    umbu_json_close(&json);
}

static void print_id(const uint8_t id[UMB_ID_BYTES])
{
    char text[UMB_ID_TEXT_SIZE];
    umb_id_to_text(id, text);
    (void)puts(text);
}

/* In: held: pages of a partial file; NULL: a whole file. */
static void print_asset(const struct umb_asset *asset, const struct umb_partial_stats *held,
                        const struct umbc_settings *settings)
{
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    if (settings->json) {
        print_file_json(asset, &info, held);
    } else if (settings->quiet) {
        print_id(info.id);
    } else {
        print_file(asset, &info, held);
    }
}

static int info_file(const char *path, const struct umbc_settings *settings)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_asset *asset;
    if (umb_asset_open_file(path, NULL, &asset, &error) != UMB_OK) {
        return umbc_complain_file(path, &error);
    }
    print_asset(asset, NULL, settings);
    umb_asset_close(asset);
    return umbc_finish_stdout(0);
}

/* --- pages --- */

static void print_page(uint32_t number, const struct umb_partial_page *page)
{
    char hash[UMB_ID_TEXT_SIZE];
    umb_id_to_text(page->hash, hash);
    (void)printf("%8" PRIu32 "  %s  %2" PRIu32 " to %2" PRIu32 " %8" PRIu32 " %8" PRIu32
                 " %8" PRIu32 " %12" PRIu64 "  %s\n",
                 number, hash, page->level_high, page->level_low, page->node_count,
                 page->stored_bytes, page->raw_bytes, page->offset, page->held ? "held" : "");
}

static void json_page(struct umbu_json *json, uint32_t number, const struct umb_partial_page *page)
{
    umbu_json_begin(json, NULL, '{');
    umbu_json_integer(json, "page", number);
    umbc_json_id(json, "hash", page->hash);
    UMBU_JSON_COUNTS(json, {"level_high", page->level_high}, {"level_low", page->level_low},
                     {"nodes", page->node_count}, {"stored_bytes", page->stored_bytes},
                     {"raw_bytes", page->raw_bytes}, {"offset", page->offset});
    umbu_json_bool(json, "held", page->held != 0);
    umbu_json_end(json, '}');
}

/* Lists the pages whose entries the file has. */
static void print_pages(const struct umb_partial *partial, bool as_json)
{
    struct umb_partial_stats stats;
    struct umbu_json json = {0};
    umb_partial_get_stats(partial, &stats);
    if (as_json) {
        json = umbu_json_open(stdout);
        json_held(&json, &stats);
        umbu_json_begin(&json, "pages", '[');
    } else {
        print_held(&stats);
        (void)printf("%8s  %-64s  %8s %8s %8s %8s %12s\n", "page", "hash", "levels", "nodes",
                     "stored", "raw", "offset");
    }
    for (uint32_t number = 0; number < stats.page_count; number++) {
        struct umb_partial_page page;
        if (umb_partial_get_page(partial, number, &page) == UMB_OK && as_json) {
            json_page(&json, number, &page);
        } else if (page.stored_bytes > 0) {
            print_page(number, &page);
        }
    }
    if (as_json) {
        umbu_json_end(&json, ']');
        umbu_json_close(&json);
    }
}

/* Describes a partial file, or lists the pages of a packed or partial file. */
static int info_partial(const char *path, const struct options *options)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_partial *partial;
    struct umb_partial_stats stats;
    if (umbc_partial_open(path, &partial, &error) != UMB_OK) {
        return umbc_complain_file(path, &error);
    }
    if (partial == NULL) {
        return umbc_complain_as(UMB_E_UNSUPPORTED, "%.200s: a mapped file has no pages", path);
    }
    if (options->pages) {
        print_pages(partial, options->settings.json);
    } else {
        umb_partial_get_stats(partial, &stats);
        print_asset(umb_partial_lower(partial), &stats, &options->settings);
    }
    umb_partial_close(partial);
    return umbc_finish_stdout(0);
}

/* --- an asset of a daemon --- */

/* Times of the rows on the daemon's machine; NULL until a query with a budget calibrates them. */
static void costs_of(const struct umb_client_light *light, const double *ns[CURVE_COSTS])
{
    ns[0] = light->scattered_ns[0] > 0 ? light->scattered_ns : NULL;
    ns[1] = light->coherent_ns[0] > 0 ? light->coherent_ns : NULL;
}

static void print_description(const struct umb_client_description *about)
{
    char id[UMB_ID_TEXT_SIZE];
    char packed[32];
    char memory[32];
    umb_id_to_text(about->asset.id, id);
    (void)printf("asset          %s\nname           ", id);
    umbc_print_text(stdout, about->asset.name, strlen(about->asset.name));
    (void)putchar('\n');
    umb_id_to_text(about->scene_hash, id);
    umbc_format_bytes(about->asset.packed_bytes, packed);
    umbc_format_bytes(about->asset.memory_bytes, memory);
    (void)printf("scene          %s\npacked form    %s\nmemory         %s\n", id, packed, memory);
    print_place(about->origin, &about->bounds);
    for (uint32_t i = 0; i < about->light_count; i++) {
        const struct umb_client_light *light = &about->lights[i];
        print_light(i, &light->info);
        (void)printf("  %" PRIu64 "^3 voxels of %.4g x %.4g x %.4g m, %s\n", light->resolution,
                     light->voxel_m[0], light->voxel_m[1], light->voxel_m[2],
                     light->closed ? "closed" : "open");
        const double *ns[CURVE_COSTS];
        costs_of(light, ns);
        print_curve(light->curve, ns, light->curve_count);
    }
    print_lines("plan", about->plan);
    print_lines("settings", about->settings);
}

static void print_description_json(const struct umb_client_description *about)
{
    struct umbu_json json = umbu_json_open(stdout);
    umbc_json_id(&json, "asset", about->asset.id);
    umbu_json_text(&json, "name", about->asset.name);
    umbc_json_id(&json, "scene", about->scene_hash);
    umbu_json_integer(&json, "packed_bytes", about->asset.packed_bytes);
    umbu_json_integer(&json, "memory_bytes", about->asset.memory_bytes);
    umbu_json_vector(&json, "origin", about->origin);
    json_box(&json, &about->bounds);
    umbu_json_begin(&json, "lights", '[');
    for (uint32_t i = 0; i < about->light_count; i++) {
        const struct umb_client_light *light = &about->lights[i];
        umbu_json_begin(&json, NULL, '{');
        json_light(&json, &light->info);
        umbu_json_integer(&json, "resolution", light->resolution);
        umbu_json_vector(&json, "voxel_m", light->voxel_m);
        umbu_json_bool(&json, "closed", light->closed != 0);
        const double *ns[CURVE_COSTS];
        costs_of(light, ns);
        put_curve(&json, light->curve, ns, light->curve_count);
        umbu_json_end(&json, '}');
    }
    umbu_json_end(&json, ']');
    umbu_json_text(&json, "plan", about->plan);
    umbu_json_text(&json, "settings", about->settings);
    umbu_json_close(&json);
}

static int info_asset(const char *name, struct umbc_settings *settings)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_client *client;
    struct umb_client_description *about;
    if (umbu_connect(&settings->session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    enum umb_status status = umb_client_describe(client, name, &about, NULL, &error);
    umb_client_close(client);
    if (status != UMB_OK) {
        return umbc_complain(&error);
    }
    if (settings->json) {
        print_description_json(about);
    } else if (settings->quiet) {
        char id[UMB_ID_TEXT_SIZE];
        umb_id_to_text(about->asset.id, id);
        (void)puts(id);
    } else {
        print_description(about);
    }
    umb_free(about);
    return umbc_finish_stdout(0);
}

int umbc_info(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct options options = {0};
    struct umbc_settings *settings = &options.settings;
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &options);
    if (code >= 0) {
        return code;
    }
    if (!umbc_is_file(settings->target)) {
        return options.pages
                   ? umbc_usage_error("info", "--pages: '%.200s' is no file", settings->target)
                   : info_asset(settings->target, settings);
    }
    return options.pages || umbc_is_partial(settings->target)
               ? info_partial(settings->target, &options)
               : info_file(settings->target, settings);
}
