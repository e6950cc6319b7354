/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `deep`: deep shadow maps of a scene with translucent casters, against brute-force products of
 * traced rays, and what neighbour links are worth.
 */
#include "study/study_command.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "common/json_text.h"
#include "study/gbuffer.h"
#include "study/parallel_for.h"
#include "study/study_args.h"
#include "study/study_vec.h"
#include "study/view_options.h"
#include "umbrage/maps.h"

#define HITS_MAX   64U  /* of a ray; what lies behind is left out */
#define STEP_SHARE 1e-7 /* of the range of depth: beyond a hit, to find the next */
#define REPEATS    3

static const char help[] =
    "usage: umbrage-study deep SCENE [options]\n"
    "\n"
    "Builds deep shadow maps of a scene and compares them with products over traced hits.\n"
    "A surface whose material is BLEND takes --alpha of the light, or its own constant alpha "
    "where\n"
    "that is less than 1; every other surface takes all.\n"
    "\n"
    "  --alpha A           of BLEND surfaces, 0 to 1 (default 0.5)\n"
    "  --resolution N      texels a side, 16 to 2048 (default 512)\n"
    "  --taps N            width of the filter, odd, 1 to 17 (default 7)\n"
    "  --epsilon E         a list ends when less is left, 0 to 1 (default 0.001)\n"
    "  --sun AZ,EL  --camera WHERE  --size WxH  --up y|z  --threads N\n"
    "                      as `umbrage-study techniques` takes them\n"
    "  --json              print one JSON object\n"
    "  -q, --quiet         print nothing but errors\n"
    "  --help\n";

struct deep {
    const char *scene_path, *alpha_text, *epsilon_text;
    struct umbt_view_options options;
    uint64_t resolution, taps, threads;
    double alpha, epsilon;
    int json, quiet, help;
    struct umbt_view view;
    struct umbt_gbuffer buffer;
    struct umb_map_frustum frustum;
    struct umb_map_fragment *hits; /* [texels][HITS_MAX] */
    uint32_t *hit_counts;          /* [texels] */
    uint64_t *first;               /* [texels + 1] */
    float *values, *other;         /* [receivers] */
};

static enum umb_status share_parse(const char *name, const char *text, double *value,
                                   struct umb_error *error)
{
    const char *at = text;
    if (text != NULL &&
        (!umbt_number_read(&at, value) || *at != '\0' || !(*value >= 0.0 && *value <= 1.0))) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.60s' is not a number of 0 to 1", name, text);
    }
    return UMB_OK;
}

static enum umb_status options_parse(int argc, char **argv, struct deep *d, struct umb_error *error)
{
    const struct umbt_option table[] = {
        {"--alpha", UMBT_TEXT, &d->alpha_text, 0, 0},
        {"--epsilon", UMBT_TEXT, &d->epsilon_text, 0, 0},
        {"--resolution", UMBT_COUNT, &d->resolution, 16, 2048},
        {"--taps", UMBT_COUNT, &d->taps, 1, 17},
        {"--sun", UMBT_TEXT, &d->options.sun, 0, 0},
        {"--camera", UMBT_TEXT, &d->options.camera, 0, 0},
        {"--size", UMBT_TEXT, &d->options.size, 0, 0},
        {"--up", UMBT_TEXT, &d->options.up, 0, 0},
        {"--threads", UMBT_COUNT, &d->threads, 1, 256},
        {"--json", UMBT_FLAG, &d->json, 0, 0},
        {"--quiet", UMBT_FLAG, &d->quiet, 0, 0},
        {"--help", UMBT_FLAG, &d->help, 0, 0},
    };
    struct umbt_positionals positionals = {.max = 1};
    d->resolution = 512;
    d->taps = 7;
    d->alpha = 0.5;
    d->epsilon = 0.001;
    d->threads = umbt_processor_count();
    d->options = (struct umbt_view_options){.width = 320, .height = 200, .size_max = 2048};
    enum umb_status status =
        umbt_args_parse(argc, argv, table, sizeof table / sizeof table[0], &positionals, error);
    if (status != UMB_OK || d->help) {
        return status;
    }
    if (positionals.count != 1) {
        return umb_fail(error, UMB_E_ARGUMENT, "SCENE: is needed; see --help");
    }
    if (d->taps % 2 == 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--taps: %" PRIu64 " is even", d->taps);
    }
    d->scene_path = positionals.values[0];
    status = share_parse("--alpha", d->alpha_text, &d->alpha, error);
    return status == UMB_OK ? share_parse("--epsilon", d->epsilon_text, &d->epsilon, error)
                            : status;
}

/* Share of the light that a triangle takes. */
static float triangle_alpha(const struct deep *d, uint32_t triangle)
{
    const struct umbs_scene_view *scene = &d->view.scene.scene->view;
    const uint32_t material = d->view.scene.materials[triangle];
    if (material >= scene->material_count ||
        scene->materials[material].alpha_mode != UMBS_ALPHA_BLEND) {
        return 1.0F;
    }
    const float own = scene->materials[material].base_alpha;
    return own < 1.0F ? own : (float)d->alpha;
}

/* All hits of a texel's ray, nearest first. */
static enum umb_status texel_block(void *user, size_t first, size_t count, struct umb_error *error)
{
    struct deep *d = user;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        const double x = (double)(i % d->resolution) + 0.5, y = (double)(i / d->resolution) + 0.5;
        double start[3], end[3], direction[3], reached = 0.0;
        if (!umb_map_frustum_point(&d->frustum, x, y, 0.0, start) ||
            !umb_map_frustum_point(&d->frustum, x, y, 1.0, end)) {
            continue;
        }
        umb__subtract(end, start, direction);
        const double length = umbt_normalize(direction);
        while (d->hit_counts[i] < HITS_MAX) {
            struct umbr_hit hit;
            umbr_nearest(d->view.scene.rays, start, direction, reached, length, &hit);
            if (hit.distance < 0.0) {
                break;
            }
            d->hits[i * HITS_MAX + d->hit_counts[i]++] = (struct umb_map_fragment){
                (float)fmin(hit.distance / length, 1.0), triangle_alpha(d, hit.triangle)};
            reached = hit.distance + STEP_SHARE * length;
        }
    }
    return UMB_OK;
}

/* Moves the hits together: fragments in `hits`, list i from first[i]. */
static void hits_gather(struct deep *d, size_t texels)
{
    uint64_t used = 0;
    for (size_t i = 0; i < texels; i++) {
        d->first[i] = used;
        memmove(d->hits + used, d->hits + i * HITS_MAX, d->hit_counts[i] * sizeof *d->hits);
        used += d->hit_counts[i];
    }
    d->first[texels] = used;
}

static enum umb_status scene_open(struct deep *d, struct umb_error *error)
{
    const size_t texels = (size_t)d->resolution * d->resolution;
    enum umb_status status = umbt_view_open(&d->options, d->scene_path, &d->view, error);
    if (status == UMB_OK) {
        status = umb_map_frustum_fit(d->view.to_light, &d->view.scene.box, (uint32_t)d->resolution,
                                     (uint32_t)d->resolution, &d->frustum, error);
    }
    if (status == UMB_OK) {
        status = umbt_gbuffer_init(&d->buffer, d->options.width, 1, d->options.height, error);
    }
    if (status == UMB_OK) {
        status = umbt_gbuffer_fill(&d->buffer, &d->view.scene, &d->view.camera, d->options.height,
                                   0, d->options.height, (unsigned)d->threads, error);
    }
    if (status == UMB_OK && d->buffer.receiver_count == 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--camera: sees nothing of the scene");
    }
    if (status != UMB_OK) {
        return status;
    }
    d->hits = malloc(texels * HITS_MAX * sizeof *d->hits);
    d->hit_counts = calloc(texels, sizeof *d->hit_counts);
    d->first = calloc(texels + 1, sizeof *d->first);
    d->values = calloc(d->buffer.receiver_count, sizeof *d->values);
    d->other = calloc(d->buffer.receiver_count, sizeof *d->other);
    if (d->hits == NULL || d->hit_counts == NULL || d->first == NULL || d->values == NULL ||
        d->other == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "%zu texels do not fit in memory", texels);
    }
    status = umbt_parallel_for((unsigned)d->threads, texels, 1024, texel_block, d, error);
    if (status == UMB_OK) {
        hits_gather(d, texels);
    }
    return status;
}

static double cpu_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The points, without normals: a hair's own strands shadow it by their depth alone. */
static struct umb_points points_of(const struct deep *d)
{
    return (struct umb_points){.positions = d->buffer.positions,
                               .format = UMB_POINT_F64,
                               .count = d->buffer.receiver_count};
}

static struct umb_map_filter filter_of(const struct deep *d)
{
    return (struct umb_map_filter){.width = (double)d->taps,
                                   .bias_m = d->frustum.depth_m / 65536.0};
}

/* One map: built, asked a few times, best time kept. */
struct result {
    struct umb_map_info info;
    double query_ns;
};

static enum umb_status map_ask(struct deep *d, const struct umb_map_deep_settings *settings,
                               float *values, struct result *result, struct umb_error *error)
{
    const struct umb_map_fragments in = {d->first, d->hits};
    const struct umb_points points = points_of(d);
    const struct umb_map_filter filter = filter_of(d);
    struct umb_map *map;
    struct umb_map_query query;
    enum umb_status status = umb_map_build_deep(&d->frustum, &in, settings, NULL, &map, error);
    if (status != UMB_OK) {
        return status;
    }
    status = umb_map_prepare(map, &filter, &query, error);
    result->query_ns = INFINITY;
    for (int i = 0; i < REPEATS && status == UMB_OK; i++) {
        const double start = cpu_s();
        umb_map_run(&query, &points, 0, points.count, values);
        result->query_ns = fmin(result->query_ns, 1e9 * (cpu_s() - start) / (double)points.count);
    }
    umb_map_get_info(map, &result->info);
    umb_map_destroy(map);
    return status;
}

/* Light that a point gets by the fragments themselves: products in long double. */
static double brute_force(const struct deep *d, const double position[3])
{
    const double(*m)[4] = d->frustum.world_to_map;
    const int64_t side = (int64_t)d->resolution, taps = (int64_t)d->taps;
    double p[3], at[3];
    umb__subtract(position, d->frustum.origin, p);
    for (int k = 0; k < 3; k++) {
        at[k] = umb__dot(m[k], p) + m[k][3];
    }
    const double depth = at[2] - filter_of(d).bias_m / d->frustum.depth_m;
    long double sum = 0.0L;
    for (int64_t k = 0; k < taps * taps; k++) {
        const int64_t x = (int64_t)floor(at[0]) - taps / 2 + k % taps;
        const int64_t y = (int64_t)floor(at[1]) - taps / 2 + k / taps;
        long double left = 1.0L;
        if (x >= 0 && y >= 0 && x < side && y < side) {
            const size_t texel = (size_t)(y * side + x);
            for (uint64_t i = d->first[texel]; i < d->first[texel + 1]; i++) {
                left *=
                    (double)d->hits[i].depth < depth ? 1.0L - (long double)d->hits[i].alpha : 1.0L;
            }
        }
        sum += left;
    }
    return (double)(sum / (long double)(taps * taps));
}

static double worst_difference(const struct deep *d, const float *values)
{
    double worst = 0.0;
    for (size_t i = 0; i < d->buffer.receiver_count; i++) {
        worst = fmax(worst, fabs((double)values[i] - brute_force(d, &d->buffer.positions[3 * i])));
    }
    return worst;
}

/* What the command found out. */
struct findings {
    struct result exact, searched, linked, streamed;
    double exact_error, error;      /* farthest from the products: nothing left out; epsilon */
    int linked_same, streamed_same; /* 1: the bits of the search */
    size_t occupied;                /* lists with a fragment */
};

static enum umb_status deep_run(struct deep *d, struct findings *f, struct umb_error *error)
{
    struct umb_map_deep_settings settings = {.epsilon = d->epsilon, .way = UMB_MAP_DEEP_SEARCH};
    enum umb_status status = scene_open(d, error);
    if (status == UMB_OK) {
        status = map_ask(d, &(struct umb_map_deep_settings){0}, d->values, &f->exact, error);
    }
    if (status == UMB_OK) {
        f->exact_error = worst_difference(d, d->values);
        status = map_ask(d, &settings, d->other, &f->searched, error);
    }
    const size_t bytes = d->buffer.receiver_count * sizeof *d->values;
    if (status == UMB_OK) {
        f->error = worst_difference(d, d->other);
        settings.way = UMB_MAP_DEEP_LINKS;
        status = map_ask(d, &settings, d->values, &f->linked, error);
        f->linked_same = status == UMB_OK && memcmp(d->values, d->other, bytes) == 0;
    }
    if (status == UMB_OK) {
        settings.way = UMB_MAP_DEEP_STREAM;
        status = map_ask(d, &settings, d->values, &f->streamed, error);
        f->streamed_same = status == UMB_OK && memcmp(d->values, d->other, bytes) == 0;
    }
    for (size_t i = 0; status == UMB_OK && i < (size_t)d->resolution * d->resolution; i++) {
        f->occupied += d->first[i + 1] > d->first[i];
    }
    return status;
}

/* What a way costs beside searching every list. */
static void way_print(const char *name, const struct result *way, const struct result *searched,
                      int same)
{
    printf("%-18s %" PRIu64 " bytes, %.0f ns a point, %.2f times as fast, %s bits\n", name,
           way->info.bytes, way->query_ns, searched->query_ns / way->query_ns,
           same ? "the same" : "OTHER");
}

static void print_text(const struct deep *d, const struct findings *f)
{
    printf("%s: %" PRIu64 " texels a side, %" PRIu64 " fragments in %zu lists, %zu points, %" PRIu64
           " x %" PRIu64 " texels\n",
           d->scene_path, d->resolution, d->first[d->resolution * d->resolution], f->occupied,
           d->buffer.receiver_count, d->taps, d->taps);
    printf("nothing left out:  %" PRIu64 " nodes, %" PRIu64 " bytes, off by at most %.3g\n",
           f->exact.info.fragments, f->exact.info.bytes, f->exact_error);
    printf("epsilon %-9g  %" PRIu64 " nodes, off by at most %.3g\n", d->epsilon,
           f->searched.info.fragments, f->error);
    printf("searched:          %" PRIu64 " bytes, %.0f ns a point\n", f->searched.info.bytes,
           f->searched.query_ns);
    way_print("linked:", &f->linked, &f->searched, f->linked_same);
    way_print("streamed:", &f->streamed, &f->searched, f->streamed_same);
}

static void json_map(const char *name, const struct result *map)
{
    printf(",\"%s\":{\"nodes\":%" PRIu64 ",\"bytes\":%" PRIu64 ",\"ns_per_point\":%.6g}", name,
           map->info.fragments, map->info.bytes, map->query_ns);
}

static void print_json(const struct deep *d, const struct findings *f)
{
    fputs("{\"scene\":", stdout);
    umbs_json_text(stdout, d->scene_path);
    printf(",\"resolution\":%" PRIu64 ",\"taps\":%" PRIu64
           ",\"epsilon\":%.9g,\"fragments\":%" PRIu64 ",\"lists\":%zu,\"points\":%zu",
           d->resolution, d->taps, d->epsilon, d->first[d->resolution * d->resolution], f->occupied,
           d->buffer.receiver_count);
    printf(",\"exact_error\":%.6g,\"error\":%.6g", f->exact_error, f->error);
    json_map("exact", &f->exact);
    json_map("searched", &f->searched);
    json_map("linked", &f->linked);
    json_map("streamed", &f->streamed);
    printf(",\"same_bits\":%s}\n", f->linked_same && f->streamed_same ? "true" : "false");
}

int umbt_deep_command(int argc, char **argv)
{
    struct deep d;
    struct findings findings = {0};
    struct umb_error error = {0};
    memset(&d, 0, sizeof d);
    enum umb_status status = options_parse(argc, argv, &d, &error);
    if (status == UMB_OK && d.help) {
        fputs(help, stdout);
        return 0;
    }
    if (status == UMB_OK) {
        status = deep_run(&d, &findings, &error);
    }
    if (status == UMB_OK && d.json) {
        print_json(&d, &findings);
    } else if (status == UMB_OK && !d.quiet) {
        print_text(&d, &findings);
    }
    free(d.hits);
    free(d.hit_counts);
    free(d.first);
    free(d.values);
    free(d.other);
    umbt_gbuffer_finish(&d.buffer);
    umbt_view_close(&d.view);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage-study deep: %s\n", error.message);
    }
    return umb_status_exit(status);
}
