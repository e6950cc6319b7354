/* SPDX-License-Identifier: Apache-2.0 */
/* OBJ and MTL: exact doubles, indices, materials, what is dropped, what is refused. */
#include "base/compat.h"
#include "import_try.h"

#include <time.h>

static void obj_keeps_doubles_exactly(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("exact.obj", "v 84616.468000001 447423.0123456789 0.1\n"
                                 "v 1e-300 -2.5E+3 .5\r\n"
                                 "v 900719925474099.3125 123456789.123456789 "
                                 "0x1p-3 0.25 1 1 1\n"
                                 "f 1 2 3\n");
    assert_int_equal(scene->view.triangle_count, 1);
    assert_int_equal(scene->view.z_up, 1);
    assert_int_equal(scene->view.format, UMBS_FORMAT_OBJ);
    assert_null(scene->view.uvs);
    expect_corner(scene, 0, 0, 84616.468000001, 447423.0123456789, 0.1);
    expect_corner(scene, 0, 1, 1e-300, -2500.0, 0.5);
    expect_corner(scene, 0, 2, 900719925474099.3125, 123456789.123456789, 0.125);
    umbs_scene_destroy(scene);
}

static void obj_negative_indices_count_from_the_end(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_text("negative.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
                                                           "f -3 -2 -1\nv 5 5 5\n"
                                                           "f -1//-1 -3/-1 2//1\n");
    assert_int_equal(scene->view.triangle_count, 2);
    expect_corner(scene, 0, 0, 0, 0, 0);
    expect_corner(scene, 0, 2, 0, 1, 0);
    expect_corner(scene, 1, 0, 5, 5, 5);
    expect_corner(scene, 1, 1, 1, 0, 0);
    expect_corner(scene, 1, 2, 1, 0, 0);
    umbs_scene_destroy(scene);
}

static void obj_unusable_faces_are_dropped_and_counted(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("drop.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nv 0 inf 0\nv broken\n"
                                "v 1e300 0 0\n"
                                "f 1 2 3\n"
                                "f 1 2 4\nf 1 2 5\nf 1 2 6\nf 1 2 7\n" /* not finite or too large */
                                "f 1 2 8\nf 0 1 2\nf 1 2 -9\nf 1 2 x\nf 1 2 3x\n" /* bad index */
                                "f 1 2\nf\n" /* too few; a bare f is no face */
                                "f 1 2 99999999999999999999\n"
                                "l 1 2\np 1\n"
                                "f 1 1 2\n"); /* degenerate: stays */
    assert_int_equal(scene->view.triangle_count, 2);
    assert_int_equal(scene->view.dropped_faces, 11);
    assert_non_null(strstr(scene->view.warnings,
                           "11 of 13 faces dropped (6 with an index of no vertex, 4 with a "
                           "coordinate that is not finite, 1 with fewer than 3 corners); the first "
                           "is face 2 in line 9"));
    umbs_scene_destroy(scene);
}

static void obj_concave_polygon_is_clipped_inside_it(void **state)
{
    (void)state;
    /* An L in a slanted plane, of area 3 in the plane's own units. A fan from corner 1 would cover
     * the notch, which the sum of the triangles' areas would show. */
    struct umbs_scene *scene = import_text("concave.obj", "v 0 2 2\nv 0 0 0\nv 2 0 0\nv 2 1 1\n"
                                                          "v 1 1 1\nv 1 2 2\nf 1 2 3 4 5 6\n");
    assert_int_equal(scene->view.triangle_count, 4);
    double(*corners)[3][3];
    size_t count;
    double area = 0.0;
    assert_int_equal(umbs_scene_flatten(&scene->view, &corners, NULL, &count, NULL), UMB_OK);
    for (size_t i = 0; i < count; i++) {
        double twice =
            (corners[i][1][0] - corners[i][0][0]) * (corners[i][2][1] - corners[i][0][1]) -
            (corners[i][1][1] - corners[i][0][1]) * (corners[i][2][0] - corners[i][0][0]);
        assert_true(twice > 0.0); /* every triangle keeps the polygon's winding */
        area += twice / 2.0;
    }
    assert_true(area == 3.0); /* small integers: exact */
    free(corners);
    umbs_scene_destroy(scene);
}

static void obj_groups_triangles_by_material_of_its_library(void **state)
{
    (void)state;
    static const char mtl[] = "newmtl glass pane\r\nd 0.25\r\nTr 0.9\r\n"
                              "newmtl leaf\nmap_d leaf.png\n"
                              "newmtl old\nTr 0.5\nnewmtl solid\nd -halo 1\nd 7\nKd 1 1 1\n"
                              "newmtl under\nd -1\nTr ?\n";
    put_file("my lib.mtl", mtl, sizeof(mtl) - 1);
    struct umbs_scene *scene =
        import_text("materials.obj", "mtllib my lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 7 7 7\n"
                                     "f 1 2 4\nusemtl leaf\nf 1 2 3\nusemtl glass pane\nf 2 3 1\n"
                                     "usemtl leaf\nf 3 1 2\nusemtl unknown\nusemtl old\nf 1 2 3\n");
    drop_file("my lib.mtl");
    const struct umbs_scene_view *view = &scene->view;
    assert_int_equal(view->material_count, 6);
    assert_string_equal(view->materials[0].name, "glass pane");
    assert_int_equal(view->materials[0].alpha_mode, UMBS_ALPHA_BLEND);
    assert_true(view->materials[0].base_alpha == 0.25F);
    assert_int_equal(view->materials[1].alpha_mode, UMBS_ALPHA_MASK);
    assert_true(view->materials[2].base_alpha == 0.5F);
    assert_int_equal(view->materials[3].alpha_mode, UMBS_ALPHA_OPAQUE);
    assert_non_null(strstr(view->warnings, "material 'solid': d of 7 is not in 0 to 1"));
    assert_int_equal(view->materials[4].alpha_mode, UMBS_ALPHA_OPAQUE);
    assert_non_null(strstr(view->warnings, "material 'under': d of -1 is not in 0 to 1"));
    assert_null(strstr(view->warnings, "Tr"));
    assert_string_equal(view->materials[5].name, "unknown");
    assert_int_equal(view->mesh_count, 4);
    assert_int_equal(view->meshes[0].material, UMBS_NO_INDEX);
    assert_int_equal(view->meshes[1].material, 0);
    assert_int_equal(view->meshes[2].material, 1);
    assert_int_equal(view->meshes[2].triangle_count, 2);
    assert_int_equal(view->meshes[3].material, 2);
    expect_corner(scene, 0, 2, 7, 7, 7);
    expect_corner(scene, 1, 0, 1, 0, 0); /* the glass one */
    expect_corner(scene, 3, 0, 0, 1, 0); /* the second leaf */
    umbs_scene_destroy(scene);
}

static void obj_pictures_get_normals_and_colours(void **state)
{
    (void)state;
    static const char mtl[] =
        "newmtl red\nKd 1 0.5 0\nnewmtl odd\nKd 2 x\nnewmtl over\nKd 7 -1 1\n";
    put_file("look.mtl", mtl, sizeof(mtl) - 1);
    /* The corner at 1 has two normals; a bad, a missing or an unreadable normal counts as none. */
    struct umbs_scene *scene = import_look(
        "look.obj", "mtllib look.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 3 0 4\nvn x\n"
                    "usemtl red\nf 1//1 2//-2 3//9\nf 1//2 2 3//3\nf 1//1 2//2 3/\n");
    drop_file("look.mtl");
    const struct umbs_scene_view *view = &scene->view;
    expect_normal(scene, 0, 0, 0, 0, 1);
    expect_normal(scene, 0, 1, 0.6, 0, 0.8);
    expect_normal(scene, 0, 2, 0, 0, 0);
    expect_normal(scene, 1, 0, 0.6, 0, 0.8);
    expect_normal(scene, 1, 1, 0, 0, 0);
    expect_normal(scene, 1, 2, 0, 0, 0);
    assert_int_equal(view->triangles[0][0], view->triangles[2][0]);
    assert_true(fabs((double)view->materials[0].base_color[1] - pow(0.5, 2.2)) < 1e-6);
    assert_true(view->materials[0].base_color[0] >= 1.0F);
    assert_true(view->materials[1].base_color[0] >= 1.0F); /* as without the line */
    assert_true(view->materials[2].base_color[1] <= 0.0F);
    umbs_scene_destroy(scene);
}

static void obj_splits_vertices_at_texture_seams_only(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("seam.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
                                "vt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0.5\n"
                                "f 1/1 2/2 3/3\nf 2/2 4/4 3/1\nf 1/9 2/2 3/3\n");
    assert_int_equal(scene->view.vertex_count, 6); /* 3 has two uvs, 1 one and none */
    assert_int_equal(scene->view.triangle_count, 3);
    assert_non_null(scene->view.uvs);
    uint32_t at = scene->view.triangles[1][1];
    assert_true(scene->view.uvs[at][0] == 0.5F && scene->view.uvs[at][1] == 0.5F);
    umbs_scene_destroy(scene);
}

static void obj_joins_lines_and_passes_over_the_rest(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_text("lines.obj", "\xef\xbb\xbf# comment\n\n  \t\no thing\n"
                                                        "g a b\ns off\nvn 0 0 1\nvp 1 2\n"
                                                        "v 0 0 \\\n 0\nv 1 0 0\r\n\tv 0 1 0\n"
                                                        "f 1 \\\r\n 2 \\\n 3 # a face\n"
                                                        "vertex 1 2 3\nface 1 2 3\n"
                                                        "f 1 2 3");
    assert_int_equal(scene->view.triangle_count, 2);
    assert_int_equal(scene->view.vertex_count, 3);
    assert_int_equal(scene->view.dropped_faces, 0);
    umbs_scene_destroy(scene);
}

static void obj_without_triangles_says_why(void **state)
{
    (void)state;
    expect_refusal("empty.obj", "# nothing\n", "empty.obj: no faces");
    expect_refusal("points.obj", "v 0 0 0\nv 1 1 1\np 1 2\n", "2 vertices and no faces");
    expect_refusal("bad.obj", "v 0 0 nan\nf 1 1 1\n", "none of 1 faces can be used");
    expect_refusal("zero.obj", "", "the file is empty");
    expect_refusal("binary.obj", "ply\nformat ascii 1.0\n", "is not OBJ text");
    expect_refusal("scene.fbx", "v 0 0 0\n", "'.fbx' is not supported");
    expect_refusal("noextension", "v 0 0 0\n", "is not supported");
}

static void obj_libraries_beneath_the_folder_only(void **state)
{
    (void)state;
    static const char mtl[] = "newmtl m\nd 0.5\n";
    static const char faces[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    static const struct {
        const char *line;
        int found;
        const char *words;
    } cases[] = {
        {"mtllib inner/lib.mtl\n", 1, ""},
        {"mtllib inner\\lib.mtl\n", 1, ""},
        {"mtllib ./inner/link.mtl\n", 1, ""},
        {"mtllib absent.mtl inner/lib.mtl\n", 1, "absent.mtl"},
        {"mtllib inner/../inner/lib.mtl\n", 0, "'..' is refused"},
        {"mtllib ../inner/lib.mtl\n", 0, "'..' is refused"},
        {"mtllib /etc/hostname\n", 0, "absolute file name"},
        {"mtllib inner/out.mtl\n", 0, "out.mtl"},
        {"mtllib inner\n", 0, "not a regular file"},
    };
    assert_int_equal(mkdir(try_path("inner"), 0700), 0);
    put_file("inner/lib.mtl", mtl, sizeof(mtl) - 1);
    assert_int_equal(symlink("lib.mtl", try_path("inner/link.mtl")), 0);
    assert_int_equal(symlink("/etc/hostname", try_path("inner/out.mtl")), 0);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        char text[256];
        (void)snprintf(text, sizeof(text), "%s%s", cases[i].line, faces);
        struct umbs_scene *scene = import_text("beneath.obj", text);
        print_message("%s", cases[i].line);
        assert_int_equal(scene->view.materials[0].alpha_mode,
                         cases[i].found ? UMBS_ALPHA_BLEND : UMBS_ALPHA_OPAQUE);
        assert_non_null(strstr(scene->view.warnings, cases[i].words));
        umbs_scene_destroy(scene);
    }
    drop_file("inner/out.mtl");
    drop_file("inner/link.mtl");
    drop_file("inner/lib.mtl");
    assert_int_equal(rmdir(try_path("inner")), 0);
}

static const char sample[] = "mtllib x.mtl\nv 0 0 0\nv 1.5e2 -0 0\nv 0 1 0\nv 1 1 0.125\nvt 0 1\n"
                             "usemtl a\nf 1/1/1 2//2 3 4/1\nf -1 -2 -3\nusemtl b\nf 1 2 \\\n 3\n";

/* Each library could be as large as the scene: a file full of mtllib lines must not take quadratic
 * time. */
static void obj_of_many_libraries_reads_the_first(void **state)
{
    (void)state;
    char text[8192] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    put_file("lib.mtl", "newmtl glass\nd 0.25\n", 20);
    for (int i = 0; i < 300; i++) {
        (void)snprintf(text + strlen(text), sizeof(text) - strlen(text), "mtllib lib.mtl\n");
    }
    struct umbs_scene *scene = import_text("many.obj", text);
    assert_int_equal(scene->view.material_count, 1);
    assert_non_null(strstr(scene->view.warnings, "mtllib: more than 64 names"));
    assert_null(strstr(strstr(scene->view.warnings, "mtllib") + 1, "mtllib"));
    umbs_scene_destroy(scene);
    drop_file("lib.mtl");
}

static void obj_reader_survives_every_prefix(void **state)
{
    (void)state;
    for (size_t size = 0; size < sizeof(sample); size++) {
        (void)read_here(umbb_obj_read, sample, size);
    }
    assert_int_equal(read_here(umbb_obj_read, sample, sizeof(sample) - 1), UMB_OK);
}

static void obj_reader_survives_random_changes(void **state)
{
    (void)state;
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 3000; round++) {
        char copy[sizeof(sample)];
        memcpy(copy, sample, sizeof(sample));
        for (int i = 0; i < 3; i++) {
            static const char swap[] = "0123456789-+./ \\\n\tefvu#\xff";
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            copy[(seed >> 33) % (sizeof(sample) - 1)] = swap[(seed >> 50) % (sizeof(swap) - 1)];
        }
        (void)read_here(umbb_obj_read, copy, sizeof(sample) - 1);
    }
}

static void obj_triangle_limit_is_a_limit(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error = {0};
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\n";
    const struct umbs_import_options options = {.importer_path = "/proc/self/exe",
                                                .max_triangles = 1};
    put_file("many.obj", text, sizeof(text) - 1);
    assert_int_equal(umbs_scene_import(try_path("many.obj"), &options, &scene, &error),
                     UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "more than 1 triangles"));
    drop_file("many.obj");
}

/* A file whose vertices alone need more memory than the limit. Not run under sanitizers, which need
 * an address space without limit. */
static void obj_over_memory_is_a_limit(void **state)
{
    (void)state;
#if UMB__SANITIZED
    skip();
#else
    const size_t lines = 2000000;
    char *text = malloc(lines * 6);
    assert_non_null(text);
    for (size_t i = 0; i < lines; i++) {
        memcpy(text + 6 * i, "v 0 0\n", 6);
    }
    struct umbs_scene *scene;
    struct umb_error error = {0};
    const struct umbs_import_options options = {.importer_path = "/proc/self/exe",
                                                .max_memory_bytes = 48 << 20};
    put_file("fat.obj", text, lines * 6);
    free(text);
    assert_int_equal(umbs_scene_import(try_path("fat.obj"), &options, &scene, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "limit of 48 MiB"));
    drop_file("fat.obj");
#endif
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(obj_keeps_doubles_exactly),
        cmocka_unit_test(obj_negative_indices_count_from_the_end),
        cmocka_unit_test(obj_unusable_faces_are_dropped_and_counted),
        cmocka_unit_test(obj_concave_polygon_is_clipped_inside_it),
        cmocka_unit_test(obj_groups_triangles_by_material_of_its_library),
        cmocka_unit_test(obj_pictures_get_normals_and_colours),
        cmocka_unit_test(obj_splits_vertices_at_texture_seams_only),
        cmocka_unit_test(obj_joins_lines_and_passes_over_the_rest),
        cmocka_unit_test(obj_without_triangles_says_why),
        cmocka_unit_test(obj_libraries_beneath_the_folder_only),
        cmocka_unit_test(obj_of_many_libraries_reads_the_first),
        cmocka_unit_test(obj_reader_survives_every_prefix),
        cmocka_unit_test(obj_reader_survives_random_changes),
        cmocka_unit_test(obj_triangle_limit_is_a_limit),
        cmocka_unit_test(obj_over_memory_is_a_limit),
    };
    return cmocka_run_group_tests(tests, make_try_folder, remove_try_folder);
}
