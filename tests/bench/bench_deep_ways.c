/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench-deep-ways races ways to sum the lists under a window of a deep shadow map, for several mean
 * lengths of lists.
 *
 * Fuerst, Mattausch and Scherzer (2013) keep linked lists and race links between neighbours against
 * walking each list from its head. Both are built here as they describe them, in nodes of one
 * buffer, in the order in which a rasteriser delivers fragments. The library's own arrays race
 * beside them, with four ways: binary search, links, streams, and a walk from the head of each
 * array. All ways sum the same whole numbers, and must agree. Times are CPU time; a row is a median
 * over the runs of one ratio.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench_arguments.h"
#include "bench_machine.h"
#include "bench_report.h"
#include "maps/deep_parts.h"

#define BENCH  "deep-ways"
#define SIDE   512
#define TEXELS ((size_t)SIDE * SIDE)
#define TAPS   7
#define HALF   (TAPS / 2)
#define ACROSS 200 /* receivers in a row */
#define POINTS ((size_t)ACROSS * ACROSS)
#define NONE   UINT32_MAX

enum way {
    HEADS,      /* linked lists, each from its head */
    NEIGHBOURS, /* linked lists, by links to the right and upper list */
    ARRAYS,     /* arrays, each from its head */
    SEARCHED,
    LINKED,
    STREAMED,
    WAYS
};

static const char *const way_names[WAYS] = {"heads",    "neighbours", "arrays",
                                            "searched", "linked",     "streamed"};

/* Table 1.1 of the paper: a fragment and its links, in one buffer. */
struct fragment_node {
    float depth;
    uint32_t left; /* transmittance behind it, in units of 2^-30 */
    uint32_t next, previous, right, upper;
};

struct receiver {
    uint32_t x, y;
    double depth;
};

struct lists {
    uint64_t *first; /* [TEXELS + 1] */
    struct umb_map_fragment *fragments;
    uint32_t *heads; /* [TEXELS] */
    struct fragment_node *nodes;
    struct umb_map *maps[WAYS]; /* SEARCHED and after it */
    struct umb_map_query queries[WAYS];
    struct receiver *receivers; /* [POINTS] */
    double (*positions)[3];
    float *answers[WAYS]; /* [POINTS] */
};

/* ---- lists ---- */

static double unit(uint64_t *state)
{
    *state = *state * 6364136223846793005U + 1442695040888963407U;
    return (double)(*state >> 11) * 0x1p-53;
}

/* Returns the depth of strand `k` of `count` over a texel. Cards: smooth sheets, one behind the
 * other. Hair: the same with strands that begin and end, and waver by several sheets from texel to
 * texel. */
static double strand_depth(int hair, uint32_t k, uint32_t count, double x, double y, uint64_t *seed)
{
    const double sheet = 0.2 + 0.6 * ((double)k + 0.5) / (double)count;
    const double wave = 0.05 * sin(9.0 * x + 0.7 * k) * cos(7.0 * y - 0.4 * k);
    return sheet + wave + (hair ? 0.1 * (unit(seed) - 0.5) : 0.0);
}

static void lists_fill(struct lists *l, int hair, uint32_t mean, float alpha)
{
    uint64_t seed = 2013 + mean;
    uint64_t used = 0;
    l->fragments = calloc(TEXELS * 2 * (mean + 1), sizeof *l->fragments);
    l->first = calloc(TEXELS + 1, sizeof *l->first);
    if (l->fragments == NULL || l->first == NULL) {
        bench_fail("lists: out of memory");
    }
    for (size_t i = 0; i < TEXELS; i++) {
        const double x = (double)(i % SIDE) / SIDE, y = (double)(i / SIDE) / SIDE;
        /* Hair is thicker in some places: from half to one and a half times the mean. */
        const double share = hair ? 1.0 + 0.5 * sin(11.0 * x) * sin(13.0 * y) : 1.0;
        const uint32_t count = (uint32_t)(share * mean + (hair ? unit(&seed) : 0.0));
        l->first[i] = used;
        for (uint32_t k = 0; k < count; k++) {
            l->fragments[used++] =
                (struct umb_map_fragment){(float)strand_depth(hair, k, count, x, y, &seed), alpha};
        }
    }
    l->first[TEXELS] = used;
}

static void maps_build(struct lists *l, double epsilon)
{
    const struct umb_map_fragments in = {l->first, l->fragments};
    struct umb_map_frustum frustum = {
        .width = SIDE, .height = SIDE, .depth_m = 1.0, .directional = 1, .light = {0, 0, -1}};
    struct umb_error error;
    for (int k = 0; k < 4; k++) {
        frustum.world_to_map[k][k] = 1.0;
    }
    for (int way = SEARCHED; way < WAYS; way++) {
        const struct umb_map_deep_settings settings = {
            .epsilon = epsilon,
            .way = (enum umb_map_deep_way)(UMB_MAP_DEEP_SEARCH + way - SEARCHED)};
        const struct umb_map_filter filter = {.width = TAPS};
        bench_must(umb_map_build_deep(&frustum, &in, &settings, NULL, &l->maps[way], &error),
                   &error, "deep map");
        bench_must(umb_map_prepare(l->maps[way], &filter, &l->queries[way], &error), &error,
                   "filter");
    }
}

/* Copies the lists of a map into one buffer of linked nodes, strand by strand, since a rasteriser
 * delivers a strand over all its texels before the next strand. */
static void nodes_link(struct lists *l)
{
    const struct umb__deep *deep = l->maps[SEARCHED]->deep;
    const struct umb__deep *linked = l->maps[LINKED]->deep;
    const uint64_t count = deep->first[TEXELS];
    uint32_t *places = calloc(count + 1, sizeof *places);
    l->nodes = bench_large((count + 1) * sizeof *l->nodes);
    l->heads = calloc(TEXELS, sizeof *l->heads);
    if (places == NULL || l->heads == NULL) {
        bench_fail("nodes: out of memory");
    }
    uint32_t used = 0;
    for (uint64_t k = 0, more = 1; more > 0; k++) {
        more = 0;
        for (size_t i = 0; i < TEXELS; i++) {
            if (deep->first[i] + k < deep->first[i + 1]) {
                places[deep->first[i] + k] = used++;
                more = 1;
            }
        }
    }
    for (size_t i = 0; i < TEXELS; i++) {
        const uint64_t from = deep->first[i], to = deep->first[i + 1];
        l->heads[i] = from < to ? places[from] : NONE;
        for (uint64_t n = from; n < to; n++) {
            const struct umb__deep_linked *node =
                (const struct umb__deep_linked *)(const void *)linked->nodes + n;
            const size_t right = i % SIDE + 1 < SIDE ? i + 1 : i;
            const size_t upper = i / SIDE + 1 < SIDE ? i + SIDE : i;
            const uint64_t r = deep->first[right] + node->right,
                           u = deep->first[upper] + node->upper;
            l->nodes[places[n]] = (struct fragment_node){
                node->node.depth,
                node->node.left,
                n + 1 < to ? places[n + 1] : NONE,
                n > from ? places[n - 1] : NONE,
                r < deep->first[right + 1] ? places[r] : NONE,
                u < deep->first[upper + 1] ? places[u] : NONE,
            };
        }
    }
    free(places);
}

/* Receivers as a picture has them: neighbours in the picture are neighbours on the map, at depths
 * of a surface within the strands. */
static void receivers_make(struct lists *l)
{
    l->receivers = calloc(POINTS, sizeof *l->receivers);
    l->positions = calloc(POINTS, sizeof *l->positions);
    if (l->receivers == NULL || l->positions == NULL) {
        bench_fail("receivers: out of memory");
    }
    uint64_t seed = 7;
    for (size_t i = 0; i < POINTS; i++) {
        const double u = (double)(i % ACROSS) / ACROSS, v = (double)(i / ACROSS) / ACROSS;
        struct receiver *r = &l->receivers[i];
        r->x = (uint32_t)(HALF + u * (SIDE - TAPS));
        r->y = (uint32_t)(HALF + v * (SIDE - TAPS));
        r->depth = 0.5 + 0.3 * sin(5.0 * u + 3.0 * v) + 0.05 * (unit(&seed) - 0.5);
        l->positions[i][0] = (double)r->x + 0.5;
        l->positions[i][1] = (double)r->y + 0.5;
        l->positions[i][2] = r->depth;
    }
    for (int way = 0; way < WAYS; way++) {
        l->answers[way] = calloc(POINTS, sizeof *l->answers[way]);
    }
}

/* ---- the paper's ways ---- */

static double answer_of(uint64_t sum)
{
    return (double)sum / (double)UMB__DEEP_ONE / (double)(TAPS * TAPS);
}

/* Returns the share of light left at a depth, by a walk from the head of a linked list. */
static uint32_t head_left(const struct lists *l, size_t texel, double depth)
{
    uint32_t left = UMB__DEEP_ONE;
    for (uint32_t n = l->heads[texel]; n != NONE && (double)l->nodes[n].depth < depth;
         n = l->nodes[n].next) {
        left = l->nodes[n].left;
    }
    return left;
}

static void heads_run(const struct lists *l, float *answers)
{
    for (size_t i = 0; i < POINTS; i++) {
        const struct receiver *r = &l->receivers[i];
        uint64_t sum = 0;
        for (uint32_t y = r->y - HALF; y <= r->y + HALF; y++) {
            for (uint32_t x = r->x - HALF; x <= r->x + HALF; x++) {
                sum += head_left(l, (size_t)y * SIDE + x, r->depth);
            }
        }
        answers[i] = (float)answer_of(sum);
    }
}

static void arrays_run(const struct lists *l, float *answers)
{
    const struct umb__deep *deep = l->maps[SEARCHED]->deep;
    const struct umb__deep_node *nodes = (const struct umb__deep_node *)(const void *)deep->nodes;
    for (size_t i = 0; i < POINTS; i++) {
        const struct receiver *r = &l->receivers[i];
        uint64_t sum = 0;
        for (uint32_t y = r->y - HALF; y <= r->y + HALF; y++) {
            for (uint32_t x = r->x - HALF; x <= r->x + HALF; x++) {
                const size_t texel = (size_t)y * SIDE + x;
                uint32_t left = UMB__DEEP_ONE;
                for (uint64_t n = deep->first[texel];
                     n < deep->first[texel + 1] && (double)nodes[n].depth < r->depth; n++) {
                    left = nodes[n].left;
                }
                sum += left;
            }
        }
        answers[i] = (float)answer_of(sum);
    }
}

/* Returns the last node nearer than a depth, searched from a guess in the same list; NONE if even
 * the first node is not nearer. */
static uint32_t walk(const struct fragment_node *nodes, uint32_t n, double depth)
{
    if (n == NONE) {
        return NONE;
    }
    if ((double)nodes[n].depth < depth) {
        while (nodes[n].next != NONE && (double)nodes[nodes[n].next].depth < depth) {
            n = nodes[n].next;
        }
        return n;
    }
    while (n != NONE && !((double)nodes[n].depth < depth)) {
        n = nodes[n].previous;
    }
    return n;
}

/* Sums a window: walks the lower left list from its head, then follows links up the left column and
 * along each row. A list whose neighbour has no node nearer starts at its head. */
static void neighbours_run(const struct lists *l, float *answers)
{
    for (size_t i = 0; i < POINTS; i++) {
        const struct receiver *r = &l->receivers[i];
        uint32_t row = NONE;
        uint64_t sum = 0;
        for (uint32_t y = r->y - HALF; y <= r->y + HALF; y++) {
            const size_t texel = (size_t)y * SIDE + r->x - HALF;
            row = walk(l->nodes, row != NONE ? l->nodes[row].upper : l->heads[texel], r->depth);
            uint32_t n = row;
            for (size_t x = 0; x < TAPS; x++) {
                if (x > 0) {
                    n = walk(l->nodes, n != NONE ? l->nodes[n].right : l->heads[texel + x],
                             r->depth);
                }
                sum += n != NONE ? l->nodes[n].left : UMB__DEEP_ONE;
            }
        }
        answers[i] = (float)answer_of(sum);
    }
}

/* ---- the race ---- */

static double way_run(const struct lists *l, int way)
{
    const struct umb_points points = {
        .positions = l->positions, .format = UMB_POINT_F64, .count = POINTS};
    const double start = bench_cpu_s();
    if (way == HEADS) {
        heads_run(l, l->answers[way]);
    } else if (way == NEIGHBOURS) {
        neighbours_run(l, l->answers[way]);
    } else if (way == ARRAYS) {
        arrays_run(l, l->answers[way]);
    } else {
        umb_map_run(&l->queries[way], &points, 0, POINTS, l->answers[way]);
    }
    return (bench_cpu_s() - start) / (double)POINTS;
}

static void lists_free(struct lists *l)
{
    for (int way = 0; way < WAYS; way++) {
        umb_map_destroy(l->maps[way]);
        free(l->answers[way]);
    }
    free(l->first);
    free(l->fragments);
    free(l->heads);
    free(l->nodes);
    free(l->receivers);
    free(l->positions);
}

static void rows_report(const char *name, const struct bench_samples *times)
{
    static const struct {
        const char *figure;
        int over, under;
    } figures[] = {
        {"neighbours_vs_heads", HEADS, NEIGHBOURS}, {"linked_vs_heads", HEADS, LINKED},
        {"linked_vs_arrays", ARRAYS, LINKED},       {"linked_vs_searched", SEARCHED, LINKED},
        {"streamed_vs_heads", HEADS, STREAMED},     {"streamed_vs_linked", LINKED, STREAMED},
    };
    for (size_t f = 0; f < sizeof figures / sizeof figures[0]; f++) {
        struct bench_samples ratios = {0};
        for (int run = 0; run < times[0].count; run++) {
            bench_add(&ratios,
                      times[figures[f].over].values[run] / times[figures[f].under].values[run]);
        }
        bench_row(BENCH, name, figures[f].figure, "higher", &ratios);
    }
}

/* Times the ways from number `from` on, on lists of one kind. */
static void ways_time(const char *name, int from, int hair, uint32_t mean, float alpha,
                      double epsilon, struct bench_samples *times)
{
    struct lists l = {0};
    char line[256];
    lists_fill(&l, hair, mean, alpha);
    maps_build(&l, epsilon);
    if (from <= NEIGHBOURS) {
        nodes_link(&l);
    }
    receivers_make(&l);
    for (int run = -1; run < BENCH_RUNS; run++) { /* the first fills the caches */
        for (int way = from; way < WAYS; way++) {
            const double seconds = way_run(&l, way);
            if (run >= 0) {
                bench_add(&times[way], seconds);
            } else if (memcmp(l.answers[way], l.answers[from], POINTS * sizeof(float)) != 0) {
                bench_fail("%s: %s differs from %s", name, way_names[way], way_names[from]);
            }
        }
    }
    int at = snprintf(line, sizeof line, "%s: mean %.1f; ns a point:", name,
                      (double)l.maps[SEARCHED]->deep->first[TEXELS] / (double)TEXELS);
    for (int way = from; way < WAYS; way++) {
        at += snprintf(line + at, sizeof line - (size_t)at, " %s %.0f", way_names[way],
                       1e9 * bench_median(&times[way]));
    }
    bench_say("%s", line);
    lists_free(&l);
}

static void race(int hair, uint32_t mean)
{
    struct bench_samples times[WAYS] = {0};
    const char *name = bench_text("%s-%u", hair ? "hair" : "cards", mean);
    ways_time(name, HEADS, hair, mean, 0.05F, 0.0, times);
    rows_report(name, times);
}

/* Compares lists of 40 fragments that end where less than 0.001 is left with complete lists. */
static void truncation_race(float alpha)
{
    struct bench_samples whole[WAYS] = {0}, cut[WAYS] = {0};
    const char *name = bench_text("alpha-%.2f", (double)alpha);
    ways_time(bench_text("%s whole", name), ARRAYS, 1, 40, alpha, 0.0, whole);
    ways_time(bench_text("%s cut", name), ARRAYS, 1, 40, alpha, 0.001, cut);
    for (int way = ARRAYS; way < WAYS; way++) {
        struct bench_samples ratios = {0};
        for (int run = 0; run < whole[way].count; run++) {
            bench_add(&ratios, whole[way].values[run] / cut[way].values[run]);
        }
        bench_row(BENCH, name, bench_text("%s_cut_vs_whole", way_names[way]), "higher", &ratios);
    }
}

static void usage_print(FILE *to)
{
    fputs("usage: bench_deep_ways [--lists cards|hair|cut]\n"
          "  --lists  these lists alone: smooth sheets, hair, or hair of 40 nodes cut at epsilon\n",
          to);
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--lists", NULL};
    static const char *const kinds[] = {"cards", "hair", "cut", NULL};
    static const float alphas[] = {0.2F, 0.35F, 0.5F};
    static const uint32_t means[] = {3, 4, 6, 8, 12, 16, 20, 24, 28, 32, 36, 40};
    bench_arguments(argc, argv, options, usage_print);
    const char *only = bench_choice(argc, argv, "--lists", kinds, NULL);
    (void)bench_pin(0);
    for (int hair = 0; hair < 2; hair++) {
        for (size_t i = 0; i < sizeof means / sizeof means[0]; i++) {
            if (only == NULL || strcmp(only, kinds[hair]) == 0) {
                race(hair, means[i]);
            }
        }
    }
    for (size_t i = 0; i < sizeof alphas / sizeof alphas[0]; i++) {
        if (only == NULL || strcmp(only, kinds[2]) == 0) {
            truncation_race(alphas[i]);
        }
    }
    return 0;
}
