/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Work of pages that come and go.
 *
 *     page_count write FILE              writes an asset of about 1200 pages
 *     page_count run FILE HELD           holds the first HELD pages; then adds the last 16, one a
 *                                        build (page_come), and drops them again (page_go)
 *     page_count race FILE POINTS        CPU time of queries on half of the pages, beside a layout
 *                                        that is made anew (harness/partial_oracle.h); POINTS: six
 *                                        float32 a point, position and normal
 *
 * tests/system/test_page_costs.sh counts the instructions of page_come and page_go.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "make_asset.h"
#include "partial_oracle.h"
#include "umbrage/region.h"

enum {
    LOG2_SIZE = 12,
    MEASURED = 16,
    POINTS_MOST = 1 << 16,
    ROUNDS = 15,
};

static void stop(const char *what, const struct umb_error *error)
{
    (void)fprintf(stderr, "page_count: %s: %s\n", what, error->message);
    exit(1);
}

/* A tree of which no two nodes are equal: four of eight children are mixed, near bricks five. */
static void make_tree(struct umb__octree *octree)
{
    uint64_t seed = 3;
    uint32_t count = 1;
    memset(octree, 0, sizeof *octree);
    octree->root_count = 1;
    octree->roots = calloc(1, sizeof *octree->roots);
    octree->roots[0] = (struct umb__octree_root){UMB__NODE_MIXED, LOG2_SIZE, 0};
    for (uint32_t l = LOG2_SIZE; l > UMB_LEVEL_BRICK; l--) {
        struct umb__octree_level *level = &octree->level[l];
        const uint32_t mixed = l <= UMB_LEVEL_BRICK + 2 ? 5 : 4;
        level->count = count;
        level->masks = calloc(count, sizeof *level->masks);
        level->first = calloc((size_t)count + 1, sizeof *level->first);
        level->children = calloc((size_t)count * mixed, sizeof *level->children);
        for (uint32_t i = 0; i < count; i++) {
            const unsigned turn = (unsigned)(next_random(&seed) % 8);
            for (unsigned c = 0; c < 8; c++) {
                const bool is_mixed = (c + turn) % 8 < mixed;
                level->masks[i] |= (uint16_t)((is_mixed ? 2U : (c ^ turn) & 1U) << (2 * c));
            }
            for (uint32_t c = 0; c < mixed; c++) {
                level->children[i * mixed + c] = i * mixed + c;
            }
            level->first[i + 1] = (i + 1) * mixed;
        }
        count *= mixed;
    }
    octree->brick_count = count;
    octree->bricks = calloc(count, sizeof *octree->bricks);
    for (uint32_t i = 0; i < 8 * count; i++) {
        octree->bricks[i / 8][i % 8] = next_random(&seed);
    }
}

static void write_asset(const char *path)
{
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {.log2_size = LOG2_SIZE, .frustum_count = 1};
    struct umb__octree octree;
    struct umb__content content;
    struct bytes file = {0};
    struct umb_sink sink = bytes_sink(&file);
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    make_tree(&octree);
    make_content(&voxels, 0.1, origin, &content);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK) {
        stop("write", &error);
    }
    FILE *out = fopen(path, "wb");
    if (!out || fwrite(file.data, 1, file.size, out) != file.size || fclose(out) != 0) {
        stop(path, &error);
    }
    umb__octree_finish(&octree);
    bytes_finish(&file);
}

static uint8_t *read_file(const char *path, size_t *size)
{
    FILE *in = fopen(path, "rb");
    if (!in || fseek(in, 0, SEEK_END) != 0) {
        (void)fprintf(stderr, "page_count: cannot read %s\n", path);
        exit(1);
    }
    *size = (size_t)ftell(in);
    rewind(in);
    uint8_t *bytes = malloc(*size + 1);
    if (fread(bytes, 1, *size, in) != *size || fclose(in) != 0) {
        exit(1);
    }
    return bytes;
}

/* In: digest: the hash that the asset was made with. */
static struct umb_partial *open_all_blocks(const uint8_t *file, size_t size,
                                           const struct umb_sha256 *digest)
{
    const struct umb_partial_options options = {.sha256 = digest, .max_memory_bytes = 1ULL << 32};
    struct umb_error error = {0};
    struct umb_partial *partial;
    struct umb_partial_stats stats;
    if (umb_partial_open(file, size, &options, &partial, &error) != UMB_OK) {
        stop("open", &error);
    }
    umb_partial_get_stats(partial, &stats);
    for (uint32_t block = stats.blocks_held; block < stats.block_count; block++) {
        uint64_t offset;
        uint32_t length;
        umb_partial_locate_block(partial, block, &offset, &length);
        if (umb_partial_add_block(partial, block, file + offset, length, &error) != UMB_OK) {
            stop("block", &error);
        }
    }
    return partial;
}

static void add(struct umb_partial *partial, const uint8_t *file, uint32_t page)
{
    struct umb_error error = {0};
    uint64_t offset;
    uint32_t length;
    (void)umb_partial_locate(partial, page, &offset, &length);
    if (umb_partial_add(partial, page, file + offset, length, &error) != UMB_OK) {
        stop("add", &error);
    }
}

static void build(struct umb_partial *partial)
{
    struct umb_error error = {0};
    if (umb_partial_build(partial, &error) != UMB_OK) {
        stop("build", &error);
    }
}

/* Counted. */
__attribute__((noinline)) void page_come(struct umb_partial *partial, const uint8_t *file,
                                         uint32_t page);
__attribute__((noinline)) void page_go(struct umb_partial *partial, uint32_t page);

void page_come(struct umb_partial *partial, const uint8_t *file, uint32_t page)
{
    add(partial, file, page);
    build(partial);
}

void page_go(struct umb_partial *partial, uint32_t page)
{
    umb_partial_drop(partial, page);
    build(partial);
}

static void run(const char *path, uint32_t held)
{
    size_t size;
    struct umb_partial_stats stats;
    uint8_t *file = read_file(path, &size);
    struct umb_partial *partial = open_all_blocks(file, size, &test_digest);
    umb_partial_get_stats(partial, &stats);
    if (stats.page_count < held + MEASURED) {
        (void)fprintf(stderr, "page_count: the asset has only %u pages\n", stats.page_count);
        exit(1);
    }
    for (uint32_t page = 0; page < held; page++) {
        add(partial, file, page);
    }
    build(partial);
    for (uint32_t i = 1; i <= MEASURED; i++) {
        page_come(partial, file, stats.page_count - i);
    }
    for (uint32_t i = 1; i <= MEASURED; i++) {
        page_go(partial, stats.page_count - i);
    }
    (void)printf("pages=%d of %u\n", MEASURED, stats.page_count);
    umb_partial_close(partial);
    free(file);
}

/* --- queries ---------------------------------------------------------------------------------- */

static double cpu_s(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Times queries of both in turn; prints the medians. */
static void race_one(struct umb_partial *partial, struct oracle *oracle,
                     const struct umb_query_settings *settings, const struct umb_points *points)
{
    static float values[2][POINTS_MOST], low[2][POINTS_MOST], high[2][POINTS_MOST];
    double times[2][ROUNDS];
    struct umb_error error = {0};
    for (int round = 0; round < ROUNDS; round++) {
        for (int k = 0; k < 2; k++) {
            struct umb_partial_answers answers = {
                .values = values[k], .low = low[k], .high = high[k]};
            const double start = cpu_s();
            if ((k == 0 ? umb_partial_query(partial, settings, points, 0, &answers, &error)
                        : oracle_query(oracle, settings, points, 0, &answers, &error)) != UMB_OK) {
                stop("query", &error);
            }
            times[k][round] = cpu_s() - start;
        }
    }
    const bool equal = memcmp(values[0], values[1], points->count * sizeof(float)) == 0 &&
                       memcmp(low[0], low[1], points->count * sizeof(float)) == 0 &&
                       memcmp(high[0], high[1], points->count * sizeof(float)) == 0;
    for (int k = 0; k < 2; k++) {
        qsort(times[k], ROUNDS, sizeof(double), by_size);
        times[k][0] = times[k][ROUNDS / 2] * 1e9 / (double)points->count;
    }
    (void)printf("%2u taps, filter %d: %.1f ns a point, made anew %.1f ns, ratio %.2f%s\n",
                 settings->taps, (int)settings->filter, times[0][0], times[1][0],
                 times[0][0] / times[1][0], equal ? "" : ", ANSWERS DIFFER");
}

static void race(const char *path, const char *points_path, const struct umb_sha256 *digest)
{
    size_t size, bytes;
    static float positions[3 * POINTS_MOST], normals[3 * POINTS_MOST];
    struct umb_error error = {0};
    uint8_t *file = read_file(path, &size), *records = read_file(points_path, &bytes);
    struct umb_partial *partial = open_all_blocks(file, size, digest);
    struct oracle oracle = {.part = partial};
    struct umb_points points = {.positions = positions, .normals = normals};
    for (size_t i = 0; i < bytes / 24 && i < POINTS_MOST; i++) {
        memcpy(positions + 3 * i, records + 24 * i, 12);
        memcpy(normals + 3 * i, records + 24 * i + 12, 12);
        points.count = i + 1;
    }
    for (uint32_t page = 0; page < partial->head.page_count; page++) {
        if (page < partial->head.page_count / 8 || page % 2) {
            add(partial, file, page);
        }
    }
    build(partial);
    if (oracle_build(&oracle, &error) != UMB_OK) {
        stop("oracle", &error);
    }
    static const struct umb_query_settings ways[] = {
        {.taps = 1}, {.taps = 9}, {.taps = 17}, {.taps = 9, .filter = UMB_FILTER_TENT}};
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        race_one(partial, &oracle, &ways[i], &points);
    }
    oracle_finish(&oracle);
    umb_partial_close(partial);
    free(file);
    free(records);
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "write") == 0) {
        write_asset(argv[2]);
    } else if (argc == 4 && strcmp(argv[1], "run") == 0) {
        run(argv[2], (uint32_t)strtoul(argv[3], NULL, 10));
    } else if (argc == 4 && strcmp(argv[1], "race") == 0) {
        race(argv[2], argv[3], umb_sha256_openssl());
    } else {
        (void)fprintf(stderr, "page_count: write FILE | run FILE HELD | race FILE POINTS\n");
        return 2;
    }
    return 0;
}
