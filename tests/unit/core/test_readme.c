/* SPDX-License-Identifier: Apache-2.0 */
/* The README's C snippet, compiled and run; a test compares the texts. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "make_asset.h"
#include "umbrage/query.h"

static int report(const char *message)
{
    print_error("%s\n", message);
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

static int half_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    (void)y;
    return x < 32 || z < 10;
}

static void readme_snippet_answers(void **state)
{
    (void)state;
    static const double origin[3] = {0, 0, 0};
    static const float positions[9] = {10, 30, 40, 50, 30, 40, 32, 30, 40};
    static const float normals[9] = {0, 0, -1, 0, 0, -1, 0, 0, -1};
    float visibility[3];
    struct voxels voxels = {half_lit, NULL, 6, 1};
    struct bytes file = make_packed(&voxels, 1, origin);
    char path[] = "/tmp/umbrage-readme-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, file.data, file.size), file.size);
    (void)close(fd);
    assert_int_equal(ask(path, positions, normals, 3, visibility), 0);
    (void)unlink(path);
    assert_true(visibility[0] == 1.0F && visibility[1] == 0.0F);
    assert_true(visibility[2] == 36.0F / 81.0F); /* texels 28 to 31 of 28 to 36 */
    assert_int_equal(ask("/nonexistent.umb", positions, normals, 3, visibility), 1);
    bytes_finish(&file);
}

static void readme_shows_this_snippet(void **state)
{
    (void)state;
    static char readme[65536], source[16384];
    FILE *file = fopen("README.md", "r");
    if (!file) {
        skip(); /* not run from the top folder */
    }
    readme[fread(readme, 1, sizeof readme - 1, file)] = '\0';
    (void)fclose(file);
    file = fopen("tests/unit/core/test_readme.c", "r");
    assert_non_null(file);
    source[fread(source, 1, sizeof source - 1, file)] = '\0';
    (void)fclose(file);
    char *line = strstr(source, "/* snippet begins */\n");
    char *end = strstr(source, "    /* snippet ends */");
    assert_non_null(line);
    assert_non_null(end);
    line = strchr(line, '\n') + 1;
    while (line < end) {
        char *stop = strchr(line, '\n');
        *stop = '\0';
        assert_non_null(strstr(readme, line + 4)); /* four spaces less */
        line = stop + 1;
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(readme_snippet_answers),
        cmocka_unit_test(readme_shows_this_snippet),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
