/* SPDX-License-Identifier: Apache-2.0 */
/* A program outside the tree: asks an asset, then completes it from pieces of its file. */
#include <stdio.h>
#include <string.h>
#include <umbrage/region.h>

enum {
    POINTS = 1000,
    PIECE = 4096
}; /* bytes: piece i of the file is the file FOLDER/i */

static enum umb_status read_ranges(void *folder, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *user, struct umb_error *error)
{
    static char bytes[16 << 20], path[256];
    for (size_t i = 0; i < count; i++) {
        size_t size = 0, skip = ranges[i].offset % PIECE, wanted = skip + ranges[i].length;
        unsigned piece = (unsigned)(ranges[i].offset / PIECE);
        while (size < wanted && size + PIECE <= sizeof bytes) {
            snprintf(path, sizeof path, "%s/%u", (const char *)folder, piece++);
            FILE *file = fopen(path, "rb");
            if (file == NULL)
                break; /* the file's end */
            size += fread(bytes + size, 1, PIECE, file);
            fclose(file);
        }
        if (size <= skip)
            return umb_fail(error, UMB_E_IO, "%s: no such piece", path);
        enum umb_status status = got(user, i, bytes + skip, (size < wanted ? size : wanted) - skip);
        if (status != UMB_OK)
            return status;
    }
    return UMB_OK;
}

int main(int argc, char **argv)
{
    static float positions[3 * POINTS], whole[POINTS], paged[POINTS];
    struct umb_error error;
    struct umb_asset *asset = NULL;
    struct umb_region *region = NULL;
    struct umb_query query;
    struct umb_query_settings settings = {0};
    struct umb_points points = {0};
    struct umb_answers answers = {0};
    struct umb_partial_answers partial = {0};
    struct umb_partial_view view = {0};
    struct umb_region_request request = {0};
    struct umb_region_source source = {0};
    if (argc != 3 || fread(positions, 12, POINTS, stdin) != POINTS)
        return 2;
    source.read = read_ranges, source.user = argv[2];
    settings.taps = 9;
    points.positions = positions, points.count = POINTS;
    answers.values = whole, partial.values = paged;
    request.views = &view, request.view_count = 1;
    if (umb_asset_open_file(argv[1], NULL, &asset, &error) || umb_points_check(&points, &error) ||
        umb_query_prepare(asset, &settings, &query, &error) ||
        umb_region_open(&source, NULL, &region, &error) ||
        umb_region_update(region, &request, &error) ||
        umb_region_query(region, &settings, &points, 0, &partial, &error)) {
        return fprintf(stderr, "%s\n", error.message), 1;
    }
    umb_query_run(&query, &points, 0, POINTS, &answers);
    for (int i = 0; i < POINTS; i++)
        printf("%.9g\n", (double)whole[i]);
    umb_region_close(region), umb_asset_close(asset);
    return memcmp(whole, paged, sizeof whole) != 0 || partial.exact != POINTS;
}
