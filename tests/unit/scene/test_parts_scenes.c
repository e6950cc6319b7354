/* SPDX-License-Identifier: Apache-2.0 */
/* The generated scenes must keep their promises: closed where they say so, and equal in every
 * format. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/parts.h"
#include "gen.h"

typedef void (*maker)(struct gen_mesh *mesh, int32_t size, uint64_t seed);

/* Flattens a mesh to world triangles in metres; the caller frees. */
static double (*flatten(const struct gen_mesh *mesh))[3][3]
{
    double(*corners)[3][3] = calloc(mesh->triangle_count, sizeof *corners);
    assert_non_null(corners);
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        for (int k = 0; k < 9; k++) {
            corners[t][k / 3][k % 3] = mesh->vertices[mesh->triangles[t][k / 3]][k % 3] / 1000.0;
        }
    }
    return corners;
}

/* Finds the parts of a made scene and checks that all are closed and outward; returns how many. */
static size_t check_closed(maker make, int32_t size, uint64_t seed, size_t *triangles)
{
    struct gen_mesh mesh = {0};
    struct umbs_parts parts;
    struct umb_error error = {0};
    make(&mesh, size, seed);
    assert_false(mesh.failed);
    double(*corners)[3][3] = flatten(&mesh);
    enum umb_status status =
        umbs_parts_find((const double(*)[3][3])corners, mesh.triangle_count, &parts, &error);
    assert_int_equal(status, UMB_OK);
    assert_int_equal(parts.degenerate_count, 0);
    assert_int_equal(parts.duplicate_triangles, 0);
    for (size_t i = 0; i < parts.part_count; i++) {
        char reason[256];
        umbs_part_reason(&parts.parts[i], reason, sizeof reason);
        if (!parts.parts[i].closed) {
            fail_msg("size %d seed %llu: part %zu has %s", (int)size, (unsigned long long)seed, i,
                     reason);
        }
        if (!(parts.parts[i].volume > 0)) {
            fail_msg("size %d seed %llu: part %zu has volume %g", (int)size,
                     (unsigned long long)seed, i, parts.parts[i].volume);
        }
    }
    size_t count = parts.part_count;
    *triangles = mesh.triangle_count;
    assert_int_equal(parts.closed_triangles, mesh.triangle_count);
    umbs_parts_finish(&parts);
    free(corners);
    gen_mesh_finish(&mesh);
    return count;
}

static void terrain_is_one_closed_solid(void **state)
{
    (void)state;
    static const int32_t sizes[] = {1, 2, 7, 64, 200};
    size_t triangles;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        assert_int_equal(check_closed(gen_terrain, sizes[i], i, &triangles), 1);
        assert_int_equal(triangles, 2 * sizes[i] * sizes[i] + 12 * sizes[i]);
    }
}

static void city_parts_are_closed_and_number_about_three_a_lot(void **state)
{
    (void)state;
    size_t triangles;
    for (uint64_t seed = 1; seed <= 3; seed++) {
        size_t parts = check_closed(gen_city, 20, seed, &triangles);
        assert_true(parts > 2 * 20 * 20);
    }
    size_t parts = check_closed(gen_city, 50, 1, &triangles);
    print_message("city 50: %zu parts, %zu triangles\n", parts, triangles);
    assert_in_range(parts, 9000, 13000);
    assert_in_range(triangles, 400000, 750000);
    (void)check_closed(gen_city, 1, 5, &triangles);
    (void)check_closed(gen_city, 90, 4, &triangles);
}

static void bridge_parts_are_closed_and_hold_wires(void **state)
{
    (void)state;
    size_t triangles;
    (void)check_closed(gen_bridge, 1, 9, &triangles);
    size_t parts = check_closed(gen_bridge, 60, 1, &triangles);
    assert_true(parts > 2 * 60 + 2 * 60 * 4); /* hangers, rails and their posts */
}

static void ball_is_closed_at_every_detail(void **state)
{
    (void)state;
    for (int32_t detail = 1; detail <= 32; detail += 3) {
        struct gen_mesh mesh = {0};
        struct umbs_parts parts;
        struct gen_rng rng = {7};
        gen_ball(&mesh, (const int32_t[3]){0, 0, 0}, 5000, detail, &rng, 0);
        double(*corners)[3][3] = flatten(&mesh);
        assert_int_equal(mesh.triangle_count, 8 * detail * detail);
        assert_int_equal(
            umbs_parts_find((const double(*)[3][3])corners, mesh.triangle_count, &parts, NULL),
            UMB_OK);
        assert_int_equal(parts.part_count, 1);
        assert_true(parts.parts[0].closed && parts.parts[0].volume > 0);
        /* The volume must be below the ball's own and above the octahedron's. */
        assert_true(parts.parts[0].volume < 523.6 && parts.parts[0].volume > 166.6);
        umbs_parts_finish(&parts);
        free(corners);
        gen_mesh_finish(&mesh);
    }
}

static void arch_is_open_and_has_no_degenerate_triangles(void **state)
{
    (void)state;
    struct gen_mesh mesh = {0};
    struct umbs_parts parts;
    gen_arch(&mesh, 8, 1);
    double(*corners)[3][3] = flatten(&mesh);
    assert_int_equal(
        umbs_parts_find((const double(*)[3][3])corners, mesh.triangle_count, &parts, NULL), UMB_OK);
    assert_int_equal(parts.closed_triangles, 0);
    assert_int_equal(parts.degenerate_count, 0);
    assert_true(parts.part_count > 100);
    umbs_parts_finish(&parts);
    free(corners);
    gen_mesh_finish(&mesh);
}

/* A whole written file in memory; the caller frees. */
static unsigned char *written(const struct gen_mesh *mesh, enum gen_format format, int light,
                              size_t *size)
{
    FILE *file = tmpfile();
    assert_non_null(file);
    assert_true(gen_write(file, mesh, format, light));
    long end = ftell(file);
    assert_true(end > 0);
    unsigned char *bytes = calloc((size_t)end + 1, 1);
    assert_non_null(bytes);
    rewind(file);
    assert_int_equal(fread(bytes, 1, (size_t)end, file), end);
    fclose(file);
    *size = (size_t)end;
    return bytes;
}

static uint32_t u32_at(const unsigned char *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static double f64_at(const unsigned char *p)
{
    uint64_t bits = (uint64_t)u32_at(p) | (uint64_t)u32_at(p + 4) << 32;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static double f32_at(const unsigned char *p)
{
    uint32_t bits = u32_at(p);
    float value;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
}

static void check_ply(const struct gen_mesh *mesh)
{
    size_t size;
    unsigned char *bytes = written(mesh, GEN_FORMAT_PLY, 0, &size);
    const char *mark = strstr((const char *)bytes, "end_header\n");
    assert_non_null(mark);
    size_t at = (size_t)(mark - (const char *)bytes) + strlen("end_header\n");
    assert_int_equal(size, at + 24 * mesh->vertex_count + 13 * mesh->triangle_count);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (size_t k = 0; k < 3; k++) {
            assert_true(f64_at(bytes + at) == mesh->vertices[i][k] / 1000.0);
            at += 8;
        }
    }
    for (size_t i = 0; i < mesh->triangle_count; i++, at += 13) {
        assert_int_equal(bytes[at], 3);
        for (size_t k = 0; k < 3; k++) {
            assert_int_equal(u32_at(bytes + at + 1 + 4 * k), mesh->triangles[i][k]);
        }
    }
    free(bytes);
}

static void check_obj(const struct gen_mesh *mesh)
{
    size_t size, vertex = 0, triangle = 0;
    unsigned char *bytes = written(mesh, GEN_FORMAT_OBJ, 0, &size);
    char *save = NULL;
    for (char *line = strtok_r((char *)bytes, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save)) {
        char *p = line + 1;
        for (size_t k = 0; k < 3 && (line[0] == 'v' || line[0] == 'f'); k++) {
            double value = strtod(p, &p);
            if (line[0] == 'v') {
                assert_true(value == mesh->vertices[vertex][k] / 1000.0);
            } else {
                assert_true(value == mesh->triangles[triangle][k] + 1.0);
            }
        }
        vertex += line[0] == 'v';
        triangle += line[0] == 'f';
    }
    assert_int_equal(vertex, mesh->vertex_count);
    assert_int_equal(triangle, mesh->triangle_count);
    free(bytes);
}

static void check_glb(const struct gen_mesh *mesh, int light)
{
    size_t size;
    unsigned char *bytes = written(mesh, GEN_FORMAT_GLB, light, &size);
    assert_memory_equal(bytes, "glTF\x02\0\0\0", 8);
    assert_int_equal(u32_at(bytes + 8), size);
    uint32_t json_bytes = u32_at(bytes + 12);
    const unsigned char *bin = bytes + 20 + json_bytes;
    assert_memory_equal(bytes + 16, "JSON", 4);
    assert_memory_equal(bin + 4, "BIN\0", 4);
    assert_int_equal(u32_at(bin), 12 * (mesh->vertex_count + mesh->triangle_count));
    assert_int_equal(u32_at(bin) % 4, 0);
    assert_int_equal(28 + json_bytes + u32_at(bin), size);
    assert_int_equal(strstr((char *)bytes + 20, "KHR_lights_punctual") != NULL, light);
    const char *mark = strstr((char *)bytes + 20, "\"translation\":[");
    assert_non_null(mark);
    double move[3];
    char *p = (char *)bytes + 20 + (mark - ((char *)bytes + 20)) + strlen("\"translation\":[");
    for (int k = 0; k < 3; k++) {
        move[k] = strtod(p, &p);
        p++;
    }
    bin += 8;
    for (size_t i = 0; i < mesh->vertex_count; i++, bin += 12) {
        const int32_t *v = mesh->vertices[i];
        const double expected[3] = {v[0] / 1000.0, v[2] / 1000.0, -v[1] / 1000.0};
        for (int k = 0; k < 3; k++) {
            /* Half a float step of a value below 8192 m is 0.25 mm. */
            assert_true(fabs(f32_at(bin + 4 * k) + move[k] - expected[k]) < 0.000251);
        }
    }
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++, bin += 4) {
        assert_int_equal(u32_at(bin), mesh->triangles[i / 3][i % 3]);
    }
    free(bytes);
}

static void every_format_holds_the_same_geometry(void **state)
{
    (void)state;
    static const maker makers[4] = {gen_terrain, gen_city, gen_arch, gen_bridge};
    static const int32_t sizes[4] = {24, 4, 3, 10};
    for (int i = 0; i < 4; i++) {
        struct gen_mesh mesh = {0};
        makers[i](&mesh, sizes[i], 3);
        assert_false(mesh.failed);
        check_ply(&mesh);
        check_obj(&mesh);
        check_glb(&mesh, i % 2);
        gen_mesh_finish(&mesh);
    }
}

/* FNV-1a over vertices and triangles: the same on every machine and compiler. */
static uint64_t mesh_hash(const struct gen_mesh *mesh)
{
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++) {
        hash = (hash ^ (uint32_t)mesh->vertices[i / 3][i % 3]) * UINT64_C(0x100000001b3);
    }
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++) {
        hash = (hash ^ mesh->triangles[i / 3][i % 3]) * UINT64_C(0x100000001b3);
    }
    return hash;
}

static void scenes_are_pinned_and_follow_their_seed(void **state)
{
    (void)state;
    static const struct {
        maker make;
        int32_t size;
        uint64_t hash;
    } pinned[4] = {
        {gen_terrain, 32, UINT64_C(0x4cf8830c9d55c37e)},
        {gen_city, 8, UINT64_C(0x20cdf27a706f0154)},
        {gen_arch, 4, UINT64_C(0xa9fd564e3ba9f84b)},
        {gen_bridge, 20, UINT64_C(0x80b78e8de132258d)},
    };
    for (int i = 0; i < 4; i++) {
        uint64_t hashes[3];
        for (uint64_t run = 0; run < 3; run++) {
            struct gen_mesh mesh = {0};
            pinned[i].make(&mesh, pinned[i].size, run < 2 ? 1 : 2);
            hashes[run] = mesh_hash(&mesh);
            gen_mesh_finish(&mesh);
        }
        print_message("scene %d: %016llx\n", i, (unsigned long long)hashes[0]);
        assert_true(hashes[0] == pinned[i].hash);
        assert_true(hashes[0] == hashes[1]);
        assert_true(hashes[0] != hashes[2]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(terrain_is_one_closed_solid),
        cmocka_unit_test(city_parts_are_closed_and_number_about_three_a_lot),
        cmocka_unit_test(bridge_parts_are_closed_and_hold_wires),
        cmocka_unit_test(ball_is_closed_at_every_detail),
        cmocka_unit_test(arch_is_open_and_has_no_degenerate_triangles),
        cmocka_unit_test(every_format_holds_the_same_geometry),
        cmocka_unit_test(scenes_are_pinned_and_follow_their_seed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
