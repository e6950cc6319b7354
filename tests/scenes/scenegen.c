/* SPDX-License-Identifier: Apache-2.0 */
/* scenegen: writes one generated scene to a file. `scenegen --help` tells the rest. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gen.h"

enum {
    EXIT_USAGE = 2,
    EXIT_CANNOT_CREATE = 73,
    EXIT_IO = 74,
    EXIT_NO_MEMORY = 75,
};

static const char usage[] =
    "usage: scenegen KIND [--size N] [--seed N] [--format glb|obj|ply] [--light] -o FILE\n"
    "  terrain  closed fractal land, 8 km across; N x N cells (1024: 2.1 million triangles)\n"
    "  city     closed city, 1 km across; N x N lots (50: 530, 59: 730 thousand triangles)\n"
    "  arch     open architecture with walls of no thickness; N x N bays of 6 m\n"
    "  bridge   closed parts, wires of 10 mm; N hangers a side\n"
    "  hall     a closed hall with windows and columns; N bays of 6 m\n"
    "  forest   N x N closed trees of 92 triangles (GLB: one, and instances)\n"
    "  houses   N x N closed houses with eaves and recessed doors and windows, lots of 20 m\n"
    "  box      a closed cube of N m\n"
    "  sphere   a closed ball of radius 5 m, 8 N^2 triangles\n"
    "FILE - is stdout. Without --format the file's ending tells it.\n"
    "GLB is y up, OBJ and PLY are z up.\n"
    "--light adds a sun from south-east, 45 degrees high; only GLB holds it.\n";

static void make_box(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    (void)seed;
    const int32_t low[3] = {-size * 500, -size * 500, -size * 500};
    const int32_t high[3] = {size * 500, size * 500, size * 500};
    gen_box(mesh, low, high);
}

static void make_sphere(struct gen_mesh *mesh, int32_t size, uint64_t seed)
{
    struct gen_rng rng = {seed};
    const int32_t centre[3] = {0, 0, 0};
    gen_ball(mesh, centre, 5000, size, &rng, 0);
}

static const struct kind {
    const char *name;
    void (*make)(struct gen_mesh *mesh, int32_t size, uint64_t seed);
    int32_t size_default, size_max;
} kinds[] = {
    {"terrain", gen_terrain, 256, 4096}, {"city", gen_city, 50, 150},
    {"arch", gen_arch, 8, 200},          {"bridge", gen_bridge, 60, 5000},
    {"hall", gen_hall, 7, 1000},         {"forest", gen_forest, 32, 2048},
    {"houses", gen_houses, 6, 100},      {"box", make_box, 10, 100000},
    {"sphere", make_sphere, 8, 32},
};

struct request {
    const struct kind *kind;
    long long size;
    unsigned long long seed;
    int format; /* enum gen_format, or -1 */
    int light;
    const char *path;
};

static int format_of(const char *name)
{
    static const char *const names[] = {"glb", "obj", "ply"};
    for (int i = 0; i < 3; i++) {
        if (strcmp(name, names[i]) == 0) {
            return i;
        }
    }
    return -1;
}

static int number_of(const char *text, unsigned long long *value)
{
    char *end;
    if (text[0] < '0' || text[0] > '9') {
        return 0;
    }
    errno = 0;
    *value = strtoull(text, &end, 10);
    return errno == 0 && *end == '\0';
}

static int complain(const char *what, const char *value)
{
    (void)fprintf(stderr, "scenegen: %s%s%s\n%s", what, value != NULL ? ": " : "",
                  value != NULL ? value : "", usage);
    return 0;
}

static const struct kind *kind_of(const char *name)
{
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strcmp(kinds[i].name, name) == 0) {
            return &kinds[i];
        }
    }
    return NULL;
}

/* Takes one option and its value; returns how many arguments it used, 0 if it is wrong. */
static int take_option(struct request *request, const char *option, const char *value)
{
    unsigned long long number = 0;
    if (strcmp(option, "--light") == 0) {
        request->light = 1;
        return 1;
    }
    if (value == NULL) {
        return complain("no value, or not an option", option);
    }
    if (strcmp(option, "--size") == 0) {
        if (!number_of(value, &number) || number == 0 || number > 1000000) {
            return complain("--size is not a number from 1 to the kind's limit", value);
        }
        request->size = (long long)number;
    } else if (strcmp(option, "--seed") == 0) {
        if (!number_of(value, &request->seed)) {
            return complain("--seed is not a number", value);
        }
    } else if (strcmp(option, "--format") == 0) {
        request->format = format_of(value);
        if (request->format < 0) {
            return complain("--format is not glb, obj or ply", value);
        }
    } else if (strcmp(option, "-o") == 0) {
        request->path = value;
    } else {
        return complain("unknown option", option);
    }
    return 2;
}

static int read_arguments(int argc, char **argv, struct request *request)
{
    *request = (struct request){.seed = 1, .format = -1};
    if (argc < 2) {
        return complain("no kind", NULL);
    }
    request->kind = kind_of(argv[1]);
    if (request->kind == NULL) {
        return complain("unknown kind", argv[1]);
    }
    request->size = request->kind->size_default;
    for (int i = 2; i < argc;) {
        int used = take_option(request, argv[i], i + 1 < argc ? argv[i + 1] : NULL);
        if (used == 0) {
            return 0;
        }
        i += used;
    }
    if (request->size > request->kind->size_max) {
        (void)fprintf(stderr, "scenegen: --size %lld is above the limit of %s, %d\n", request->size,
                      request->kind->name, (int)request->kind->size_max);
        return 0;
    }
    if (request->path == NULL) {
        return complain("no output: -o FILE", NULL);
    }
    const char *ending = strrchr(request->path, '.');
    if (request->format < 0 && ending != NULL) {
        request->format = format_of(ending + 1);
    }
    if (request->format < 0) {
        return complain("no --format, and the file's ending tells none", request->path);
    }
    return !request->light || request->format == GEN_FORMAT_GLB ||
           complain("--light: only GLB holds lights", NULL);
}

int main(int argc, char **argv)
{
    struct request request;
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        (void)fputs(usage, stdout);
        return EXIT_SUCCESS;
    }
    if (!read_arguments(argc, argv, &request)) {
        return EXIT_USAGE;
    }
    struct gen_mesh mesh = {0};
    request.kind->make(&mesh, (int32_t)request.size, request.seed);
    int code = EXIT_SUCCESS;
    const int to_stdout = strcmp(request.path, "-") == 0;
    FILE *file = NULL;
    if (mesh.failed) {
        (void)fprintf(stderr, "scenegen: no memory for size %lld\n", request.size);
        code = EXIT_NO_MEMORY;
    } else if ((file = to_stdout ? stdout : fopen(request.path, "wb")) == NULL) {
        (void)fprintf(stderr, "scenegen: cannot create %s: %s\n", request.path, strerror(errno));
        code = EXIT_CANNOT_CREATE;
    } else {
        int good = gen_write(file, &mesh, (enum gen_format)request.format, request.light);
        if (fclose(file) != 0 || !good) {
            (void)fprintf(stderr, "scenegen: cannot write %s\n", request.path);
            if (!to_stdout) {
                (void)remove(request.path);
            }
            code = EXIT_IO;
        } else {
            const size_t places = mesh.place_count > 0 ? mesh.place_count : 1;
            (void)fprintf(stderr, "%s: %zu vertices, %zu triangles\n", request.path,
                          places * mesh.vertex_count, places * mesh.triangle_count);
        }
    }
    gen_mesh_finish(&mesh);
    return code;
}
