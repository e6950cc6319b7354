/* SPDX-License-Identifier: Apache-2.0 */
/* The up axis of OBJ, PLY and STL scenes: taken from words of the file, from the scene's shape, or
 * stated with a warning. */
#include "import_try.h"

#include <math.h>

#include "bake/import/up_axis.h"

static struct umbb_cursor cursor_of(const char *text)
{
    return (struct umbb_cursor){text, text + strlen(text)};
}

static void comments_that_name_an_axis_are_read(void **state)
{
    (void)state;
    static const struct {
        const char *comment;
        enum umbb_up up;
    } cases[] = {
        {"# converted from X 2.0; x=east y=north z=up, metres", UMBB_UP_IS_Z},
        {"comment DEM, metres, x east y north z up", UMBB_UP_IS_Z},
        {"# z up", UMBB_UP_IS_Z},
        {"# Z-up coordinates", UMBB_UP_IS_Z},
        {"# YUP", UMBB_UP_IS_Y},
        {"# up axis: Y", UMBB_UP_IS_Y},
        {"# up=z", UMBB_UP_IS_Z},
        {"# up_axis = Z_UP", UMBB_UP_IS_Z},
        {"# axis_forward='-Z', axis_up='Y'", UMBB_UP_IS_Y},
        {"# forward -Z, up Y", UMBB_UP_IS_Y},
        {"# Y up, Z forward", UMBB_UP_IS_Y},
        {"# x east z up y north", UMBB_UP_IS_Z},
        {"# coordinate system: +X is east, +Y is up, -Z is north", UMBB_UP_IS_Y},
        {"# y axis points up", UMBB_UP_IS_Y},
        {"# the y-axis is vertical", UMBB_UP_IS_Y},
        {"#zup", UMBB_UP_IS_Z},
        /* says nothing, or nothing that can be used */
        {"# -y up", UMBB_UP_UNKNOWN},
        {"# up: -Z", UMBB_UP_UNKNOWN},
        {"# x up", UMBB_UP_UNKNOWN},
        {"# y up, z up", UMBB_UP_UNKNOWN},
        {"# 1024 x 768, cleaned up by y", UMBB_UP_UNKNOWN},
        {"# set up the z buffer", UMBB_UP_UNKNOWN},
        {"# backup of y.obj", UMBB_UP_UNKNOWN},
        {"", UMBB_UP_UNKNOWN},
        {"# up", UMBB_UP_UNKNOWN},
        {"# z", UMBB_UP_UNKNOWN},
        {"\xff\xfe z up\x80", UMBB_UP_IS_Z},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        if (umbb_up_of_comment(cursor_of(cases[i].comment)) != cases[i].up) {
            print_error("'%s' is not %d\n", cases[i].comment, cases[i].up);
        }
        assert_int_equal(umbb_up_of_comment(cursor_of(cases[i].comment)), cases[i].up);
    }
}

static void comments_of_any_length_and_bytes_are_survived(void **state)
{
    (void)state;
    uint64_t random = 7;
    for (size_t length = 0; length < 4096; length += 1 + length / 8) {
        char *text = malloc(length + 1); /* exactly as long, for ASan */
        for (size_t i = 0; i < length; i++) {
            random = random * 6364136223846793005ULL + 1442695040888963407ULL;
            text[i] = "xyzup -=.\n\xc3Z"[(random >> 33) % 12];
        }
        (void)umbb_up_of_comment((struct umbb_cursor){text, text + length});
        (void)umbb_up_of_program((struct umbb_cursor){text, text + length});
        free(text);
    }
}

static void programs_with_one_axis_are_known(void **state)
{
    (void)state;
    assert_int_equal(umbb_up_of_program(cursor_of("# a mesh file for MakeHuman")), UMBB_UP_IS_Y);
    assert_int_equal(umbb_up_of_program(cursor_of("solid OpenSCAD_Model")), UMBB_UP_IS_Z);
    assert_int_equal(umbb_up_of_program(cursor_of("# EPSG:7415")), UMBB_UP_IS_Z);
    /* Their users choose the axis. */
    assert_int_equal(umbb_up_of_program(cursor_of("# Blender v2.82")), UMBB_UP_UNKNOWN);
    assert_int_equal(umbb_up_of_program(cursor_of("# 3ds Max Wavefront OBJ")), UMBB_UP_UNKNOWN);
}

/* Checks which up axis a file gives. Out: the scene is destroyed. */
static void expect_up(const char *name, const char *text, int z_up, enum umbs_up_evidence evidence)
{
    struct umbs_scene *scene = import_text(name, text);
    if (scene->view.z_up != z_up || scene->view.up_evidence != evidence) {
        print_error("%s: %d by %s\n", text, scene->view.z_up, umbs_scene_up_reason(&scene->view));
    }
    assert_int_equal(scene->view.up_evidence, evidence);
    assert_int_equal(scene->view.z_up, z_up);
    assert_true((umbs_scene_up_warning(&scene->view) != NULL) == (evidence == UMBS_UP_NONE));
    assert_non_null(umbs_scene_up_reason(&scene->view));
    umbs_scene_destroy(scene);
}

/* Appends a box from low to high as OBJ. */
static void add_box(char *text, size_t size, int first, const double low[3], const double high[3])
{
    static const int faces[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5},
                                    {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
    for (int i = 0; i < 8; i++) {
        const size_t at = strlen(text);
        (void)snprintf(text + at, size - at, "v %.17g %.17g %.17g\n", i & 1 ? high[0] : low[0],
                       i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]);
    }
    for (int i = 0; i < 6; i++) {
        const size_t at = strlen(text);
        (void)snprintf(text + at, size - at, "f %d %d %d %d\n", first + faces[i][0],
                       first + faces[i][1], first + faces[i][2], first + faces[i][3]);
    }
}

/* Exchanges the axes y and z of a box, so that each shape is tried both ways. */
static void box_as(char *text, size_t size, int z_up, const double low[3], const double high[3])
{
    double a[3], b[3];
    for (int k = 0; k < 3; k++) {
        const int from = z_up || k == 0 ? k : 3 - k;
        a[k] = low[from];
        b[k] = high[from];
    }
    add_box(text, size, 0, a, b);
}

static void shapes_tell_their_axis_both_ways(void **state)
{
    (void)state;
    static const struct {
        double low[3], high[3];
        enum umbs_up_evidence evidence;
    } boxes[] = {
        {{84616, 447423, -0.4}, {85140, 447750, 16.8}, UMBS_UP_MAP},
        {{-9, -7, 3}, {8, 9, 5}, UMBS_UP_FLATS}, /* a slab */
    };
    for (size_t i = 0; i < sizeof boxes / sizeof boxes[0]; i++) {
        for (int z_up = 0; z_up < 2; z_up++) {
            char text[2048] = "# by hand\n";
            box_as(text, sizeof text, z_up, boxes[i].low, boxes[i].high);
            expect_up("box.obj", text, z_up, boxes[i].evidence);
        }
    }
    static const double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    char cube[2048] = "";
    add_box(cube, sizeof cube, 0, low, high);
    expect_up("cube.obj", cube, 1, UMBS_UP_NONE);
    static const double base[3] = {-1, -1, 0}, top[3] = {1, 1, 2};
    for (int z_up = 0; z_up < 2; z_up++) {
        char text[2048] = "";
        box_as(text, sizeof text, z_up, base, top);
        expect_up("standing.obj", text, z_up, UMBS_UP_BASE);
    }
}

/* A door: flat along one axis, standing on the other. Contradictory evidence counts as none. */
static void contradictions_are_said_aloud(void **state)
{
    (void)state;
    static const double low[3] = {-0.5, 0, -0.02}, high[3] = {0.5, 2, 0.02};
    char text[2048] = "";
    add_box(text, sizeof text, 0, low, high);
    expect_up("door.obj", text, 1, UMBS_UP_NONE);
    expect_up("words.obj", "# y up\n# z up\nv 0 0 0\nv 1 0 0.2\nv 0 1 0.3\nf 1 2 3\n", 1,
              UMBS_UP_GROUND); /* the shape decides */
}

/* Terrain: all faces show one side upwards. */
static void grounds_tell_their_axis_both_ways(void **state)
{
    (void)state;
    for (int z_up = 0; z_up < 2; z_up++) {
        char text[16384] = "";
        for (int i = 0; i < 64; i++) {
            const size_t at = strlen(text);
            const double x = 10 * (i % 8), y = 10 * (double)(i / 8), h = 9 * sin(i * 1.7);
            (void)snprintf(text + at, sizeof text - at, "v %g %g %g\n", x, z_up ? y : h,
                           z_up ? h : y);
        }
        for (int i = 0; i < 49; i++) {
            const int a = 1 + i % 7 + 8 * (i / 7);
            const size_t at = strlen(text);
            (void)snprintf(text + at, sizeof text - at, "f %d %d %d\nf %d %d %d\n", a, a + 1, a + 9,
                           a, a + 9, a + 8);
        }
        expect_up("land.obj", text, z_up, UMBS_UP_GROUND);
    }
}

static void words_of_each_format_are_read(void **state)
{
    (void)state;
    static const char body[] = "v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n";
    char text[512];
    (void)snprintf(text, sizeof text, "# y up\n%s", body);
    expect_up("a.obj", text, 0, UMBS_UP_COMMENT);
    (void)snprintf(text, sizeof text, "  # file for MakeHuman\n%s", body);
    expect_up("b.obj", text, 0, UMBS_UP_PROGRAM);
    (void)snprintf(text, sizeof text, "# MakeHuman, z up\n%s", body);
    expect_up("c.obj", text, 1, UMBS_UP_COMMENT); /* the axis itself beats the program */
    expect_up("d.ply",
              "ply\nformat ascii 1.0\nobj_info up axis y\nelement vertex 3\nproperty float x\n"
              "property float y\nproperty float z\nelement face 1\n"
              "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 1\n3 0 1 2\n",
              0, UMBS_UP_COMMENT);
    expect_up("e.stl",
              "solid y_up\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
              "vertex 0 1 1\nendloop\nendfacet\nendsolid\n",
              0, UMBS_UP_COMMENT);
    char binary[84 + 50] = "exported, up axis: Y";
    binary[80] = 1;
    const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 1};
    memcpy(binary + 84 + 12, corners, sizeof corners);
    struct umbs_scene *scene;
    struct umb_error error;
    assert_int_equal(try_bytes("f.stl", binary, sizeof binary, &scene, &error), UMB_OK);
    assert_int_equal(scene->view.z_up, 0);
    assert_int_equal(scene->view.up_evidence, UMBS_UP_COMMENT);
    umbs_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(comments_that_name_an_axis_are_read),
        cmocka_unit_test(comments_of_any_length_and_bytes_are_survived),
        cmocka_unit_test(programs_with_one_axis_are_known),
        cmocka_unit_test(shapes_tell_their_axis_both_ways),
        cmocka_unit_test(contradictions_are_said_aloud),
        cmocka_unit_test(grounds_tell_their_axis_both_ways),
        cmocka_unit_test(words_of_each_format_are_read),
    };
    return cmocka_run_group_tests(tests, make_try_folder, remove_try_folder);
}
