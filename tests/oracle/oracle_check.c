/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_check: compares every voxel of a baked file with lit and end of its scene.
 *
 * The program links nothing of umbrage: the oracle's own code reads the file and the scene and
 * computes the depths. `oracle_check --help` explains the options. Exit 0: equal; 1: not, or a file
 * cannot be read as its format says; 2: usage.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "oracle_depth.h"
#include "oracle_reader.h"
#include "oracle_scene.h"

enum {
    EXIT_USAGE = 2,
    SHOWN_MAX = 10, /* wrong voxels told with coordinates */
};

static const char usage[] =
    "usage: oracle_check FILE.umb [FILE.umbm] --scene SCENE.ply|obj [--closed-parts] [--step N]\n"
    "                    [--json]\n"
    "Compares every voxel with lit and end, computed by brute force from the scene's triangles.\n"
    "  FILE.umbm       the mapped form of FILE.umb: must have its id and the same voxels\n"
    "  --closed-parts  every part is a closed outward solid; else found by its edges\n"
    "  --step N        every Nth texel in x and y only; default 1\n"
    "  --json          print one object\n";

struct options {
    const char *files[2];
    int file_count;
    const char *scene;
    int closed_parts, json;
    uint32_t step;
};

struct counts {
    uint64_t fronts; /* texels whose first occluder was compared with the front */
    uint64_t texels, compared, undefined, ties, wrong, mapped_differs, closed_triangles;
};

struct input {
    uint8_t *bytes;
    struct oracle oracle;
};

static int parse_step(const char *text, uint32_t *step)
{
    char *end;
    if (text[0] < '1' || text[0] > '9') {
        return 0;
    }
    unsigned long value = strtoul(text, &end, 10);
    *step = (uint32_t)value;
    return *end == '\0' && value <= 1 << 20;
}

static int parse(int argc, char **argv, struct options *options)
{
    *options = (struct options){.step = 1};
    for (int i = 1; i < argc; i++) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (strcmp(argv[i], "--scene") == 0 && value != NULL) {
            options->scene = argv[++i];
        } else if (strcmp(argv[i], "--step") == 0 && value != NULL) {
            if (!parse_step(argv[++i], &options->step)) {
                return 0;
            }
        } else if (strcmp(argv[i], "--closed-parts") == 0) {
            options->closed_parts = 1;
        } else if (strcmp(argv[i], "--json") == 0) {
            options->json = 1;
        } else if (argv[i][0] != '-' && options->file_count < 2) {
            options->files[options->file_count++] = argv[i];
        } else {
            return 0;
        }
    }
    return options->file_count > 0 && options->scene != NULL;
}

static int load(struct input *input, const char *path)
{
    char error[ORACLE_ERROR_SIZE];
    size_t size;
    input->bytes = oracle_file_read(path, &size, error);
    if (input->bytes == NULL) {
        (void)fprintf(stderr, "oracle_check: %s\n", error);
        return 0;
    }
    if (!oracle_open(&input->oracle, input->bytes, size, error)) {
        (void)fprintf(stderr, "oracle_check: %s: %s\n", path, error);
        return 0;
    }
    return 1;
}

/* The packed and the mapped file must have the same id and the same canonical block. */
static int same_content(const struct oracle *a, const struct oracle *b)
{
    return a->form == ORACLE_PACKED && b->form == ORACLE_MAPPED &&
           memcmp(a->id, b->id, sizeof a->id) == 0 && a->block_size == b->block_size &&
           memcmp(a->bytes + 128, b->bytes + 128, (size_t)a->block_size) == 0;
}

/*
 * The ray through a texel must be one of the light: parallel to its direction, or through its
 * position, where X, Y and W vanish. Doubles leave about 1e-15 of the terms; 1e-9 is far above.
 */
static int follows_light(const struct oracle *oracle, const struct oracle_frustum *frustum)
{
    const struct oracle_light *light = &oracle->lights[frustum->light];
    double v[4], size[4];
    for (int r = 0; r < 4; r++) {
        const double *m = frustum->m + 4 * r;
        v[r] = light->kind == 0 ? 0.0 : m[3];
        size[r] = fabs(v[r]);
        for (int k = 0; k < 3; k++) {
            double term = m[k] * (light->kind == 0 ? light->direction[k]
                                                   : light->position[k] - oracle->origin[k]);
            v[r] += term;
            size[r] += fabs(term);
        }
    }
    if (light->kind == 0) {
        return v[2] > 0.0 && fabs(v[0]) <= 1e-9 * v[2] && fabs(v[1]) <= 1e-9 * v[2];
    }
    return fabs(v[0]) <= 1e-9 * size[0] && fabs(v[1]) <= 1e-9 * size[1] &&
           fabs(v[3]) <= 1e-9 * size[3];
}

static void tell_wrong(const struct counts *counts, const uint32_t at[4], int value,
                       const struct oracle_texel *texel)
{
    if (counts->wrong + counts->mapped_differs <= SHOWN_MAX) {
        (void)fprintf(stderr,
                      "oracle_check: frustum %" PRIu32 " voxel %" PRIu32 ",%" PRIu32 ",%" PRIu32
                      ": %d; lit %" PRIu32 ", end %" PRIu32 "\n",
                      at[3], at[0], at[1], at[2], value, texel->lit, texel->end);
    }
}

static void compare_column(const struct input *inputs, int input_count, const uint32_t column[3],
                           const struct oracle_texel *texel, struct counts *counts)
{
    uint32_t frustum = column[2];
    uint32_t side = (uint32_t)1 << inputs[0].oracle.frusta[frustum].n;
    for (uint32_t z = 0; z < side; z++) {
        const uint32_t at[4] = {column[0], column[1], z, frustum};
        int value = oracle_voxel(&inputs[0].oracle, frustum, at[0], at[1], z);
        if (input_count > 1 && oracle_voxel(&inputs[1].oracle, frustum, at[0], at[1], z) != value) {
            counts->mapped_differs++;
            tell_wrong(counts, at, value, texel);
        }
        if (texel->tie) {
            continue;
        }
        if (z >= texel->lit && z < texel->end) {
            counts->undefined++;
            continue;
        }
        counts->compared++;
        if (value != (z < texel->lit)) {
            counts->wrong++;
            tell_wrong(counts, at, value, texel);
        }
    }
}

/* Finds the first occluder: from the occluder depth map, or else the tree's first shadowed
 * voxel. */
static void compare_occluder_depth(const struct oracle *oracle, const uint32_t column[3],
                                   const struct oracle_texel *texel, struct counts *counts)
{
    const uint32_t frustum = column[2];
    if (oracle->frnt.data == NULL || texel->tie) {
        return;
    }
    int64_t lit = oracle_occluder_depth(oracle, frustum, column[0], column[1]);
    if (lit == -1) {
        const int64_t side = (int64_t)1 << oracle->frusta[frustum].n;
        for (lit = 0; lit < side &&
                      oracle_voxel(oracle, frustum, column[0], column[1], (uint32_t)lit) == 1;) {
            lit++;
        }
    }
    counts->fronts++;
    if (lit != texel->lit) {
        const uint32_t at[4] = {column[0], column[1], texel->lit, frustum};
        counts->wrong++;
        tell_wrong(counts, at, (int)lit, texel);
    }
}

static int compare_frustum(const struct options *options, const struct oracle_scene *scene,
                           const struct input *inputs, uint32_t number, struct counts *counts)
{
    const struct oracle *oracle = &inputs[0].oracle;
    const struct oracle_frustum *frustum = &oracle->frusta[number];
    uint32_t side = (uint32_t)1 << frustum->n;
    const struct oracle_view view = {frustum->m, oracle->origin, side, (frustum->flags & 1) != 0};
    struct oracle_depth depth = {0};
    struct oracle_texel *row = calloc(side, sizeof *row);
    int good = row != NULL && oracle_depth_init(&depth, scene, &view);
    if (!good) {
        (void)fprintf(stderr, "oracle_check: frustum %" PRIu32 ": no memory, or M is singular\n",
                      number);
    } else if (!follows_light(oracle, frustum)) {
        (void)fprintf(stderr, "oracle_check: frustum %" PRIu32 ": M's rays are not the light's\n",
                      number);
        good = 0;
    }
    for (uint32_t y = 0; good && y < side; y += options->step) {
        oracle_depth_row(&depth, y, options->step, row);
        for (uint32_t x = 0; x < side; x += options->step) {
            const uint32_t column[3] = {x, y, number};
            counts->texels++;
            counts->ties += row[x].tie != 0;
            if (oracle->receiver_mask.data != NULL) {
                row[x].end = side; /* Triangles and windows decide which voxels are defined here */
            }
            compare_column(inputs, options->file_count, column, &row[x], counts);
            compare_occluder_depth(oracle, column, &row[x], counts);
        }
    }
    oracle_depth_finish(&depth);
    free(row);
    return good;
}

static void print_counts(const struct options *options, const struct counts *counts, int good)
{
    const char *format = options->json
                             ? "{\"file\":\"%s\",\"texels\":%" PRIu64 ",\"compared\":%" PRIu64
                               ",\"undefined\":%" PRIu64 ",\"ties\":%" PRIu64 ",\"wrong\":%" PRIu64
                               ",\"mapped_differs\":%" PRIu64 ",\"fronts\":%" PRIu64
                               ",\"closed_triangles\":%" PRIu64 ",\"ok\":%s}\n"
                             : "%s: %" PRIu64 " texels, %" PRIu64 " voxels compared, %" PRIu64
                               " undefined skipped, %" PRIu64 " ties, %" PRIu64 " wrong, %" PRIu64
                               " differ in the mapped file, %" PRIu64 " fronts compared, %" PRIu64
                               " closed triangles, ok %s\n";
    const char *slash = strrchr(options->files[0], '/');
    (void)printf(format, slash != NULL ? slash + 1 : options->files[0], counts->texels,
                 counts->compared, counts->undefined, counts->ties, counts->wrong,
                 counts->mapped_differs, counts->fronts, counts->closed_triangles,
                 good ? "true" : "false");
}

static int read_scene(const struct options *options, struct oracle_scene *scene,
                      struct counts *counts)
{
    char error[ORACLE_SCENE_ERROR_SIZE];
    if (!oracle_scene_read(scene, options->scene, error)) {
        (void)fprintf(stderr, "oracle_check: %s\n", error);
        return 0;
    }
    if (options->closed_parts) {
        memset(scene->closed, 1, scene->triangle_count);
    } else if (!oracle_scene_find_closed(scene)) {
        (void)fprintf(stderr, "oracle_check: out of memory\n");
        return 0;
    }
    for (size_t i = 0; i < scene->triangle_count; i++) {
        counts->closed_triangles += scene->closed[i];
    }
    return 1;
}

static int check(const struct options *options)
{
    struct input inputs[2] = {{0}};
    struct oracle_scene scene = {0};
    struct counts counts = {0};
    int good = 1, compared = 0;
    for (int i = 0; good && i < options->file_count; i++) {
        good = load(&inputs[i], options->files[i]);
    }
    if (good && options->file_count > 1 && !same_content(&inputs[0].oracle, &inputs[1].oracle)) {
        (void)fprintf(stderr, "oracle_check: the files are not the packed and mapped form of one "
                              "content\n");
        good = 0;
    }
    good = good && read_scene(options, &scene, &counts);
    for (uint32_t i = 0; good && i < inputs[0].oracle.frustum_count; i++) {
        good = compare_frustum(options, &scene, inputs, i, &counts);
        compared = good;
    }
    /* Ties in more than one texel of a thousand would hide the faults that the check looks for. */
    if (good && counts.ties * 1000 > counts.texels) {
        (void)fprintf(stderr, "oracle_check: %" PRIu64 " ties in %" PRIu64 " texels\n", counts.ties,
                      counts.texels);
        good = 0;
    }
    good = good && counts.wrong == 0 && counts.mapped_differs == 0 && counts.compared > 0;
    if (compared) {
        print_counts(options, &counts, good);
    }
    oracle_scene_finish(&scene);
    for (int i = 0; i < 2; i++) {
        oracle_close(&inputs[i].oracle);
        free(inputs[i].bytes);
    }
    return good;
}

int main(int argc, char **argv)
{
    struct options options;
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        (void)fputs(usage, stdout);
        return EXIT_SUCCESS;
    }
    if (!parse(argc, argv, &options)) {
        (void)fputs(usage, stderr);
        return EXIT_USAGE;
    }
    return check(&options) ? EXIT_SUCCESS : EXIT_FAILURE;
}
