/* SPDX-License-Identifier: Apache-2.0 */
/* A program outside the tree: queries a partial asset, then completes it from pieces of its
 * file. */
#include <stdio.h>
#include <string.h>
#include <umbrage/region.h>

#define POINTS 1000
#define PIECE  4096 /* Byte b of the file is in FOLDER/(b / PIECE) */

static enum umb_status read_ranges(void *folder, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *user, struct umb_error *error)
{
    static char bytes[16 << 20], path[256];
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        size_t at = ranges[i].offset, end = at + ranges[i].length, size = 0, n = 1;
        for (FILE *file; at < end && n > 0 && size + PIECE <= sizeof bytes; at += n, size += n) {
            snprintf(path, sizeof path, "%s/%zu", (const char *)folder, at / PIECE);
            if ((file = fopen(path, "rb")) == NULL)
                break; /* behind the end of the file, or a fault */
            n = end - at < PIECE ? end - at : PIECE;
            n = fseek(file, (long)(at % PIECE), SEEK_SET) ? 0 : fread(bytes + size, 1, n, file);
            fclose(file);
        }
        status = size > 0 ? got(user, i, bytes, size)
                          : umb_fail(error, UMB_E_IO, "%s: no such piece", path);
    }
    return status;
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
    struct umb_answers answers = {whole};
    struct umb_partial_answers partial = {paged};
    struct umb_partial_view everything = {0};
    struct umb_region_request request = {&everything, 1};
    struct umb_region_source source = {read_ranges, argv[2]};
    settings.taps = 9, points.positions = positions, points.count = POINTS;
    if (argc != 3 || fread(positions, 12, POINTS, stdin) != POINTS)
        return 2;
    if (umb_asset_open_file(argv[1], NULL, &asset, &error) || umb_points_check(&points, &error) ||
        umb_query_prepare(asset, &settings, &query, &error) ||
        umb_region_open(&source, NULL, &region, &error) ||
        umb_region_update(region, &request, &error) ||
        umb_region_query(region, &settings, &points, 0, &partial, &error))
        return fprintf(stderr, "%s\n", error.message), 1;
    umb_query_run(&query, &points, 0, POINTS, &answers);
    for (int i = 0; i < POINTS; i++)
        printf("%.9g\n", (double)whole[i]);
    return memcmp(whole, paged, sizeof whole) != 0 || partial.exact != POINTS;
}
