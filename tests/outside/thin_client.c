/* SPDX-License-Identifier: Apache-2.0 */
/* Outside the tree: queries an asset, and completes a partial one from pieces of its file. */
#include <stdio.h>
#include <string.h>
#include <umbrage/region.h>

#define POINTS 1000
#define PIECE  4096 /* Byte b of the file is in FOLDER/(b / PIECE) */

static enum umb_status read_at(void *folder, uint64_t offset, void *bytes, size_t size, size_t *got,
                               struct umb_error *error)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%d", (const char *)folder, (int)(offset / PIECE));
    FILE *piece = fopen(path, "rb");
    if (piece == NULL || fseek(piece, (long)(offset % PIECE), SEEK_SET) != 0)
        return umb_fail(error, UMB_E_IO, "%s: no such piece", path);
    *got = fread(bytes, 1, size, piece);
    return fclose(piece) == 0 ? UMB_OK : UMB_E_IO;
}

int main(int argc, char **argv)
{
    static float positions[3 * POINTS], whole[POINTS], paged[POINTS];
    struct umb_error error;
    struct umb_asset *asset;
    struct umb_region *region;
    struct umb_query query;
    struct umb_query_settings settings = {0, 9};
    struct umb_points points = {positions, UMB_POINT_F32, {0, 0, 0}, NULL, POINTS};
    struct umb_answers answers = {whole};
    struct umb_partial_answers partial = {paged};
    struct umb_region_source source = {NULL, argv[argc - 1], read_at};
    if (argc != 3 || fread(positions, 12, POINTS, stdin) != POINTS)
        return 2;
    if (umb_asset_open_file(argv[1], NULL, &asset, &error) || umb_points_check(&points, &error) ||
        umb_query_prepare(asset, &settings, &query, &error) ||
        umb_region_open(&source, NULL, &region, &error) ||
        umb_region_update(region, NULL, &error) ||
        umb_region_query(region, &settings, &points, 0, &partial, &error))
        return fprintf(stderr, "%s\n", error.message), 1;
    umb_query_run(&query, &points, 0, POINTS, &answers);
    fwrite(whole, sizeof whole, 1, stdout);
    return memcmp(whole, paged, sizeof whole) != 0 || partial.exact != POINTS;
}
