/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Asks an asset file for the light at points: the program of README.md's lines of C.
 *
 *     cc ask_file.c $(pkg-config --cflags --libs umbrage-core) -o ask_file
 *     ./ask_file city.umb <points.txt
 *
 * Reads "x y z nx ny nz" lines, place and normal, and writes a share of light a line: 0 shadowed to
 * 1 lit.
 */
#include <stdio.h>
#include <stdlib.h>
#include <umbrage/query.h>

#define POINTS_MAX 65536

static int report(const char *message)
{
    fprintf(stderr, "ask_file: %s\n", message);
    return 1;
}

static int ask(const char *path, const float *positions, const float *normals, size_t count,
               float *visibility)
{
    /* snippet begins */
    struct umb_asset *asset;
    struct umb_error error;
    if (umb_asset_open_file(path, NULL, &asset, &error) != UMB_OK) {
        return report(error.message);
    }
    struct umb_query_settings settings = {.light = 0, .taps = 9};
    struct umb_query query;
    if (umb_query_prepare(asset, &settings, &query, &error) != UMB_OK) {
        return report(error.message);
    }
    struct umb_points points = {.positions = positions, .normals = normals, .count = count};
    struct umb_answers answers = {.values = visibility};
    umb_query_run(&query, &points, 0, count, &answers);
    umb_asset_close(asset);
    /* snippet ends */
    return 0;
}

int main(int argc, char **argv)
{
    static float positions[POINTS_MAX][3], normals[POINTS_MAX][3], visibility[POINTS_MAX];
    size_t count = 0;
    int read = 6;
    if (argc != 2) {
        return report("give one asset file");
    }
    while (count < POINTS_MAX) {
        float *p = positions[count], *n = normals[count];
        read = scanf("%f %f %f %f %f %f", &p[0], &p[1], &p[2], &n[0], &n[1], &n[2]);
        if (read != 6) {
            break;
        }
        count++;
    }
    if (read != EOF && (read != 6 || scanf(" %*c") != EOF)) {
        return report(count < POINTS_MAX ? "a line has other than six numbers"
                                         : "more than 65536 points; give fewer");
    }
    if (ask(argv[1], positions[0], normals[0], count, visibility) != 0) {
        return 1;
    }
    for (size_t i = 0; i < count; i++) {
        printf("%.9g\n", visibility[i]);
    }
    return 0;
}
