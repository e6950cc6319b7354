/* SPDX-License-Identifier: Apache-2.0 */
/* glTF, GLB and STL: instances, lights, materials, what is refused and why. */
#include "import_try.h"

#include <math.h>
#include <time.h>

#include "bake/import/gltf.h"

/* One triangle: 0 0 0, 1 0 0, 0 1 0. */
static const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

/* A member of the template, unless `more` has one of that name. */
static const char *unless(const char *more, const char *name, const char *member)
{
    return strstr(more, name) == NULL ? member : "";
}

/* Makes a glTF of that triangle, whose bytes are in "tri.bin". The caller gives the rest; members
 * in `more` replace those of the template. */
static const char *gltf(const char *nodes, const char *roots, const char *more)
{
    static char text[1 << 18];
    int length = snprintf(
        text, sizeof(text),
        "{\"asset\":{\"version\":\"2.0\"},%s%s%s%s%s"
        "\"scene\":0,\"scenes\":[{\"nodes\":[%s]}],\"nodes\":[%s]}",
        more, unless(more, "\"buffers\"", "\"buffers\":[{\"uri\":\"tri.bin\",\"byteLength\":36}],"),
        unless(more, "\"bufferViews\"", "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"),
        unless(more, "\"accessors\"",
               "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,"
               "\"type\":\"VEC3\"}],"),
        unless(more, "\"meshes\"",
               "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0}]}],"),
        roots, nodes);
    assert_in_range(length, 1, sizeof(text) - 1);
    return text;
}

#define PLAIN "\"materials\":[{\"name\":\"m\"}],"

static void gltf_nodes_become_instances_of_one_mesh(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("nodes.gltf",
                    gltf("{\"translation\":[10,0,0],\"scale\":[2,2,2],\"children\":[1]},"
                         "{\"translation\":[0,3,0],\"mesh\":0,\"name\":\"same\"},"
                         "{\"mesh\":0,\"name\":\"same\",\"scale\":[-1,1,1]},"
                         "{\"mesh\":0,\"rotation\":[0,0,0.70710678118654752,0.70710678118654752]}",
                         "0,2,3", PLAIN));
    assert_int_equal(scene->view.mesh_count, 1);
    assert_int_equal(scene->view.triangle_count, 1);
    assert_int_equal(scene->view.instance_count, 3);
    assert_int_equal(scene->view.z_up, 0);
    assert_int_equal(scene->view.format, UMBS_FORMAT_GLTF);
    expect_corner(scene, 0, 0, 10, 6, 0);
    expect_corner(scene, 0, 1, 12, 6, 0);
    expect_corner(scene, 0, 2, 10, 8, 0);
    expect_corner(scene, 1, 1, 0, 1, 0); /* mirrored: the corners changed places */
    expect_corner(scene, 1, 2, -1, 0, 0);
    umbs_scene_destroy(scene);
}

#define LIGHTS(list)                                                                               \
    PLAIN "\"extensionsUsed\":[\"KHR_lights_punctual\"],"                                          \
          "\"extensionsRequired\":[\"KHR_lights_punctual\"],"                                      \
          "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[" list "]}},"
#define LIGHT_NODE(number, more)                                                                   \
    "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":" number "}}," more "}"

static void expect_vector(const double got[3], double x, double y, double z)
{
    const double wanted[3] = {x, y, z};
    for (int k = 0; k < 3; k++) {
        if (!(fabs(got[k] - wanted[k]) <= 1e-14)) {
            print_error("%.9g %.9g %.9g, expected %g %g %g\n", got[0], got[1], got[2], x, y, z);
            fail();
        }
    }
}

static void gltf_lights_shine_along_minus_z_of_their_nodes(void **state)
{
    (void)state;
    /* No node uses light 0, and two nodes with the same name use light 2. The first of these is
     * turned by -90 degrees about x, so that -z becomes -y, and its parent scales. */
    /* clang-format cannot lay out strings that macros and literals make together. */
    /* clang-format off */
    static const char nodes[] =
        "{\"mesh\":0},{\"scale\":[3,3,3],\"translation\":[0,1,0],\"children\":[2]},"
        LIGHT_NODE("1", "\"name\":\"sun\",\"rotation\":[-0.70710678118654752,0,0,"
                        "0.70710678118654752]") ","
        LIGHT_NODE("2", "\"name\":\"lamp\",\"translation\":[1,2,3]") ","
        LIGHT_NODE("2", "\"name\":\"lamp\",\"translation\":[4,5,6]") ","
        LIGHT_NODE("3", "\"name\":\"bulb\"");
    /* clang-format on */
    static const char more[] =
        LIGHTS("{\"type\":\"point\",\"intensity\":77},"
               "{\"type\":\"directional\",\"intensity\":8,\"color\":[1,0.5,0.25]},"
               "{\"type\":\"spot\",\"intensity\":10,\"range\":7,"
               "\"spot\":{\"innerConeAngle\":0.25,\"outerConeAngle\":0.5}},"
               "{\"type\":\"point\",\"intensity\":3}");
    struct umbs_scene *scene = import_text("lights.gltf", gltf(nodes, "0,1,3,4,5", more));
    const struct umbs_light *lights = scene->view.lights;
    assert_int_equal(scene->view.light_count, 4);
    assert_int_equal(lights[0].kind, UMB_LIGHT_DIRECTIONAL);
    assert_string_equal(lights[0].name, "sun");
    expect_vector(lights[0].direction, 0, -1, 0);
    assert_true(lights[0].intensity == 8.0);
    expect_vector(lights[0].color, 1, 0.5, 0.25);
    for (int i = 1; i < 3; i++) {
        assert_int_equal(lights[i].kind, UMB_LIGHT_SPOT);
        assert_string_equal(lights[i].name, "lamp");
        expect_vector(lights[i].direction, 0, 0, -1);
        expect_vector(lights[i].position, 3 * i - 2, 3 * i - 1, 3 * i);
        assert_true(lights[i].inner_cone == 0.25 && lights[i].outer_cone == 0.5);
    }
    assert_int_equal(lights[3].kind, UMB_LIGHT_POINT);
    assert_true(lights[3].intensity == 3.0);
    umbs_scene_destroy(scene);
}

static void gltf_materials_keep_what_matters_to_shadows(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_text(
        "materials.gltf",
        gltf("{\"mesh\":0}", "0",
             "\"extensionsUsed\":[\"KHR_materials_transmission\"],"
             "\"materials\":[{\"name\":\"leaves\",\"alphaMode\":\"MASK\",\"alphaCutoff\":0.25,"
             "\"doubleSided\":true,\"pbrMetallicRoughness\":{\"baseColorFactor\":[1,1,1,0.5]}},"
             "{\"alphaMode\":\"BLEND\",\"extensions\":{\"KHR_materials_transmission\":"
             "{\"transmissionFactor\":0.75}}},{\"alphaMode\":\"MASK\",\"alphaCutoff\":2}],"
             "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0},"
             "{\"attributes\":{\"POSITION\":0},\"material\":1},"
             "{\"attributes\":{\"POSITION\":0},\"material\":2}]}],"));
    const struct umbs_material *materials = scene->view.materials;
    assert_int_equal(scene->view.material_count, 3);
    assert_int_equal(scene->view.mesh_count, 3);
    assert_int_equal(scene->view.meshes[2].material, 2);
    assert_string_equal(materials[0].name, "leaves");
    assert_int_equal(materials[0].alpha_mode, UMBS_ALPHA_MASK);
    assert_true(materials[0].alpha_cutoff == 0.25F && materials[0].base_alpha == 0.5F);
    assert_int_equal(materials[0].double_sided, 1);
    assert_int_equal(materials[1].alpha_mode, UMBS_ALPHA_BLEND);
    assert_true(materials[1].base_alpha == 1.0F);
    assert_true(materials[0].transmission == 0.0F && materials[1].transmission == 0.75F);
    assert_int_equal(materials[1].double_sided, 0);
    assert_non_null(strstr(scene->view.warnings, "alphaCutoff 2"));
    assert_int_equal(scene->view.meshes[0].material, 0);
    umbs_scene_destroy(scene);
}

static void expect_gltf_refusal(const char *nodes, const char *more, const char *words)
{
    expect_refusal("refused.gltf", gltf(nodes, "0", more), words);
}

/* Positions are used as normals; the first one is 0. A bad normal changes only the look. */
static void gltf_pictures_get_normals_and_colours(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_look(
        "look.gltf",
        gltf("{\"mesh\":0}", "0",
             "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.25,7,-1,1]}}],"
             "\"meshes\":[{\"primitives\":["
             "{\"attributes\":{\"POSITION\":0,\"NORMAL\":0},\"material\":0},"
             "{\"attributes\":{\"POSITION\":0,\"NORMAL\":9},\"material\":0},"
             "{\"attributes\":{\"POSITION\":0,\"NORMAL\":\"x\"},\"material\":0}]}],"));
    expect_normal(scene, 0, 0, 0, 0, 0);
    expect_normal(scene, 0, 1, 1, 0, 0);
    expect_normal(scene, 0, 2, 0, 1, 0);
    expect_normal(scene, 1, 1, 0, 0, 0);
    expect_normal(scene, 2, 1, 0, 0, 0);
    const float *color = scene->view.materials[0].base_color;
    assert_true(fabsf(color[0] - 0.25F) < 1e-6F && color[1] >= 1.0F && color[2] <= 0.0F);
    umbs_scene_destroy(scene);
}

static void gltf_that_would_be_read_wrongly_is_refused(void **state)
{
    (void)state;
    static const char node[] = "{\"mesh\":0}";
    expect_gltf_refusal(node, PLAIN "\"extensionsRequired\":[\"KHR_mesh_quantization\"],",
                        "'KHR_mesh_quantization', which is not supported");
    expect_gltf_refusal(node,
                        PLAIN "\"extensionsRequired\" : [ \"KHR_materials_unlit\" , "
                              "\"EXT_meshopt_compression\"],",
                        "'EXT_meshopt_compression'");
    expect_gltf_refusal(node,
                        PLAIN "\"accessors\":[{\"bufferView\":0,\"componentType\":5123,\"count\":3,"
                              "\"type\":\"VEC3\"}],",
                        "accessors[0] of POSITION must be VEC3 of floats");
    expect_gltf_refusal(node,
                        PLAIN "\"accessors\":[{\"componentType\":5126,\"count\":3,"
                              "\"type\":\"VEC3\"}],",
                        "accessors[0] of POSITION has no bufferView");
    expect_gltf_refusal("{\"mesh\":0,\"translation\":[1e30,0,0]}", PLAIN,
                        "transform of node 'nodes[0]'");
    expect_gltf_refusal("{\"mesh\":0,\"matrix\":[1,0,0,5,0,1,0,0,0,0,1,0,0,0,0,1]}", PLAIN,
                        "not affine");
    expect_gltf_refusal("{\"children\":[1]},{\"children\":[0],\"mesh\":0}", PLAIN, "recursive");
    expect_gltf_refusal("{\"children\":[1,1]},{\"mesh\":0}", PLAIN, "nodes[1] has two parents");
    expect_gltf_refusal("{\"children\":[7],\"mesh\":0}", PLAIN, "nodes[7] does not exist");
    expect_gltf_refusal("{\"mesh\":0,\"rotation\":[0,0,0,0]}", PLAIN, "transform of node");
    expect_gltf_refusal(node, PLAIN "\"extras\":{\"a\":1,\"a\":2},", "JSON, line 1: duplicate");
    expect_gltf_refusal(node, PLAIN "\"extras\":[1e999],", "JSON, line 1: real number overflow");
    expect_refusal("one.gltf", "{\"asset\":{\"version\":\"1.0\"}}",
                   "glTF version '1.0' is not supported");
    expect_refusal("noversion.gltf", "{\"scene\":0}", "no asset.version");
    expect_refusal("text.gltf", "solid", "JSON, line 1: '[' or '{' expected");
    expect_refusal("cut.gltf", "{\"asset\":{\"version\":\"2.0\"", "cut.gltf: ");
}

static void gltf_references_and_transforms_of_wrong_types_are_named(void **state)
{
    (void)state;
    static const char node[] = "{\"mesh\":0}";
    static const char *const references[] = {"0.5",   "-1",    "null",
                                             "\"0\"", "1e308", "1099511627776"};
    static const char *const transforms[] = {
        "\"translation\":[1,2]", "\"translation\":[1,2,\"3\"]",
        "\"rotation\":[0,0,1]",  "\"scale\":2",
        "\"matrix\":null",       "\"rotation\":[1e200,0,0,1]",
    };
    char text[128];
    for (size_t i = 0; i < sizeof(references) / sizeof(references[0]); i++) {
        (void)snprintf(text, sizeof(text), "{\"mesh\":%s}", references[i]);
        expect_gltf_refusal(text, PLAIN, "a reference into meshes is not a whole number from 0");
    }
    for (size_t i = 0; i < sizeof(transforms) / sizeof(transforms[0]); i++) {
        (void)snprintf(text, sizeof(text), "{\"mesh\":0,%s}", transforms[i]);
        expect_gltf_refusal(text, PLAIN, "transform of node 'nodes[0]' is not of finite numbers");
    }
    expect_gltf_refusal(node, PLAIN "\"bufferViews\":[{\"byteLength\":36}],",
                        "a reference into buffers is missing");
    expect_gltf_refusal(
        node, PLAIN "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36,\"byteStride\":0}],",
        "byteStride is not in 1 to 65536");
    expect_gltf_refusal(
        node,
        PLAIN "\"meshes\":[{\"primitives\":[{\"mode\":-1,\"attributes\":{\"POSITION\":0}}]}],",
        "the mode of a primitive is not a whole number");
    expect_gltf_refusal(LIGHT_NODE("-1", "\"mesh\":0"), PLAIN,
                        "the light of node 'nodes[0]' is not a whole number");
}

/* The triangles 0 1 2 and 1 3 2 of a square as a strip, and 0 1 2 and 0 2 3 as a fan. */
static void gltf_strips_and_fans_are_read(void **state)
{
    (void)state;
    static const float square[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
    static const int corners[2][6] = {{0, 1, 2, 2, 1, 3}, {0, 1, 2, 0, 2, 3}};
    static const char *const text =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"sq.bin\",\"byteLength\":48}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}],"
        "\"meshes\":[{\"primitives\":[{\"mode\":%d,\"attributes\":{\"POSITION\":0}}]}],"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]}";
    char file[1024];
    put_file("sq.bin", square, sizeof(square));
    for (int mode = 5; mode <= 6; mode++) { /* strip, fan */
        (void)snprintf(file, sizeof(file), text, mode);
        struct umbs_scene *scene = import_text("strip.gltf", file);
        assert_int_equal(scene->view.triangle_count, 2);
        for (int i = 0; i < 6; i++) {
            const float *at = square + 3 * corners[mode - 5][i];
            expect_corner(scene, (size_t)i / 3, i % 3, (double)at[0], (double)at[1], (double)at[2]);
        }
        umbs_scene_destroy(scene);
    }
    (void)snprintf(file, sizeof(file), text, 3); /* lines cast nothing */
    expect_refusal("lines.gltf", file, "no node shows a triangle");
    (void)snprintf(file, sizeof(file), text, 7);
    expect_refusal("mode.gltf", file, "mode 7 of a primitive");
    drop_file("sq.bin");
}

/* Single precision would move the triangle by up to 4 millimetres. */
static void gltf_transforms_keep_the_doubles_of_the_file(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("far.gltf", gltf("{\"mesh\":0,\"translation\":[84000.123456789,447000.1,-0.3]}",
                                     "0", PLAIN));
    expect_corner(scene, 0, 0, 84000.123456789, 447000.1, -0.3);
    umbs_scene_destroy(scene);
}

/* An index without a vertex must drop its own face and no other. */
static void gltf_indices_beyond_the_vertices_drop_their_faces(void **state)
{
    (void)state;
    static const unsigned char data[42] = {[26] = 0x80, [27] = 0x3f, [36] = 0, 1, 2, 0, 1, 3};
    struct umbs_scene *scene;
    put_file("index.bin", data, sizeof(data));
    scene = import_text(
        "index.gltf",
        gltf("{\"mesh\":0}", "0",
             PLAIN "\"buffers\":[{\"uri\":\"index.bin\",\"byteLength\":42}],"
                   "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},"
                   "{\"buffer\":0,\"byteOffset\":36,\"byteLength\":6}],"
                   "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,"
                   "\"type\":\"VEC3\"},{\"bufferView\":1,\"componentType\":5121,\"count\":6,"
                   "\"type\":\"SCALAR\",\"normalized\":true}]," /* has no meaning here */
                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                   "\"indices\":1}]}],"));
    assert_int_equal(scene->view.triangle_count, 1);
    assert_int_equal(scene->view.dropped_faces, 1);
    expect_corner(scene, 0, 2, 1, 0, 0);
    umbs_scene_destroy(scene);
    drop_file("index.bin");
}

/* One accessor of a million indices may be used by any number of primitives. None of its faces can
 * be used here, so the limit of triangles alone would not end the reading. */
static void gltf_faces_that_cannot_be_used_have_a_limit(void **state)
{
    (void)state;
    static const char text[] =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"data:;base64,AACAfwAAgH8AAIB/"
        "\"}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":12}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"},"
        "{\"componentType\":5121,\"count\":1048576,\"type\":\"SCALAR\",\"sparse\":{\"count\":1,"
        "\"indices\":{\"bufferView\":0,\"componentType\":5121},\"values\":{\"bufferView\":0}}}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],"
        "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]}";
    assert_int_equal(read_here(umbb_gltf_read, text, sizeof(text) - 1), UMB_E_LIMIT);
}

/* `sparse` replaces elements of a bufferView, or of zeros where there is none. */
static void gltf_sparse_positions_are_read_or_refused(void **state)
{
    (void)state;
    struct {
        float square[12];
        uint16_t changed, unused;
        float value[3];
    } data = {{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, 2, 0, {0, 7, 0}};
    static const char *const text =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"sp.bin\",\"byteLength\":64}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,"
        "\"byteLength\":2},{\"buffer\":0,\"byteOffset\":52,\"byteLength\":12}],"
        "\"accessors\":[{%s\"componentType\":5126,\"count\":%d,\"type\":\"%s\",\"sparse\":{"
        "\"count\":1,"
        "\"indices\":{\"bufferView\":1,\"componentType\":5123},\"values\":{\"bufferView\":2}}}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]}";
    char file[1024];
    put_file("sp.bin", &data, sizeof(data));
    for (int i = 0; i < 2; i++) {
        (void)snprintf(file, sizeof(file), text, i == 0 ? "\"bufferView\":0," : "", 3, "VEC3");
        struct umbs_scene *scene = import_text("sparse.gltf", file);
        expect_corner(scene, 0, 1, i == 0 ? 1 : 0, 0, 0);
        expect_corner(scene, 0, 2, 0, 7, 0);
        umbs_scene_destroy(scene);
    }
    (void)snprintf(file, sizeof(file), text, "\"bufferView\":0,", 3, "VEC2");
    expect_refusal("flat.gltf", file, "accessors[0] of POSITION must be VEC3");
    (void)snprintf(file, sizeof(file), text, "\"bufferView\":0,", 2, "VEC3");
    expect_refusal("beyond.gltf", file, "has sparse indices that do not ascend below its count");
    drop_file("sp.bin");
}

/* The order of sparse indices is checked once for each accessor, so thousands of nodes with one
 * accessor take no quadratic time. A change after the first use shows that. */
static void gltf_sparse_order_is_checked_once_for_each_accessor(void **state)
{
    (void)state;
    static const char text[] =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"data:;base64,AAEAAAAAAAA=\"}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":8}],"
        "\"accessors\":[{\"componentType\":5126,\"count\":2,\"type\":\"SCALAR\",\"sparse\":{"
        "\"count\":2,\"indices\":{\"bufferView\":0,\"componentType\":5121},"
        "\"values\":{\"bufferView\":0}}}]}";
    static const struct umbb_gltf_use use = {"TEST", "SCALAR of floats", 1, UMBB_GLTF_FLOAT};
    struct umbb_import job = {.file = {.bytes = text, .size = sizeof(text) - 1}};
    struct umbb_gltf file;
    struct umbb_gltf_accessor accessor;
    struct umb_error error = {0};
    double number;
    assert_int_equal(umbb_gltf_open(&file, &job, &error), UMB_OK);
    assert_int_equal(umbb_gltf_accessor(&file, 0, &use, &accessor, &error), UMB_OK);
    file.buffers[0].decoded[0] = 7;
    assert_int_equal(umbb_gltf_accessor(&file, 0, &use, &accessor, &error), UMB_OK);
    umbb_gltf_get(&accessor, 1, &number);
    umbb_gltf_close(&file);
    assert_int_equal(umbb_gltf_open(&file, &job, &error), UMB_OK);
    assert_int_equal(umbb_gltf_view(&file, 0, &(struct umbb_gltf_view){0}, &error), UMB_OK);
    file.buffers[0].decoded[0] = 7;
    assert_int_equal(umbb_gltf_accessor(&file, 0, &use, &accessor, &error), UMB_E_BAD_SCENE);
    umbb_gltf_close(&file);
}

static void gltf_nodes_too_deep_are_refused(void **state)
{
    (void)state;
    char *nodes = malloc(1 << 17);
    size_t used = 0;
    assert_non_null(nodes);
    for (int i = 0; i < 2000; i++) {
        used += (size_t)snprintf(nodes + used, (1 << 17) - used, "{\"children\":[%d]},", i + 1);
    }
    (void)snprintf(nodes + used, (1 << 17) - used, "{\"mesh\":0}");
    expect_gltf_refusal(nodes, PLAIN, "deeper than 1024");
    free(nodes);
}

static void gltf_without_triangles_says_why(void **state)
{
    (void)state;
    expect_refusal("none.gltf",
                   "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
                   "\"nodes\":[{\"name\":\"empty\"}]}",
                   "no meshes, so no triangles");
    float broken[9];
    memcpy(broken, triangle, sizeof(broken));
    broken[4] = (float)NAN;
    put_file("tri.bin", broken, sizeof(broken));
    expect_gltf_refusal("{\"mesh\":0}", PLAIN, "1 faces dropped");
    put_file("tri.bin", triangle, sizeof(triangle));
}

static void gltf_buffers_come_from_beneath_the_folder_only(void **state)
{
    (void)state;
    static const struct {
        const char *uri, *words;
    } cases[] = {
        {"../../../absent.bin", "'..' is refused"},
        {"/etc/hostname", "absolute file name"},
        {"absent.bin", "absent.bin"},
        {"link.bin", "link.bin"},
    };
    assert_int_equal(symlink("/etc/hostname", try_path("link.bin")), 0);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        char more[256];
        (void)snprintf(more, sizeof(more),
                       PLAIN "\"buffers\":[{\"uri\":\"%s\",\"byteLength\":36}],", cases[i].uri);
        expect_refusal("buffers.gltf", gltf("{\"mesh\":0}", "0", more), cases[i].words);
    }
    drop_file("link.bin");
    /* A name with a blank, percent-encoded as RFC 3986 asks. */
    put_file("my tri.bin", triangle, sizeof(triangle));
    struct umbs_scene *scene = import_text(
        "blank.gltf", gltf("{\"mesh\":0}", "0",
                           PLAIN "\"buffers\":[{\"uri\":\"my%20tri.bin\",\"byteLength\":36}],"));
    assert_int_equal(scene->view.triangle_count, 1);
    umbs_scene_destroy(scene);
    drop_file("my tri.bin");
}

/* The same as one GLB. Returns its size. */
static size_t make_glb(unsigned char *out, size_t room)
{
    char *json = strdup(gltf("{\"mesh\":0}", "0", PLAIN));
    assert_non_null(json);
    char *uri = strstr(json, "\"uri\":\"tri.bin\",");
    assert_non_null(uri);
    memset(uri, ' ', 16); /* the buffer is the file's own chunk */
    size_t length = (strlen(json) + 3) & ~(size_t)3;
    uint32_t head[5] = {0x46546c67, 2, (uint32_t)(20 + length + 8 + 36), (uint32_t)length,
                        0x4e4f534a};
    uint32_t chunk[2] = {36, 0x004e4942};
    assert_in_range(head[2], 1, room);
    memset(out, ' ', room);
    memcpy(out, head, 20);
    memcpy(out + 20, json, strlen(json));
    memcpy(out + 20 + length, chunk, 8);
    memcpy(out + 28 + length, triangle, 36);
    free(json);
    return head[2];
}

static void glb_imports_and_its_prefixes_are_refused(void **state)
{
    (void)state;
    unsigned char bytes[2048];
    size_t size = make_glb(bytes, sizeof(bytes));
    struct umbs_scene *scene;
    struct umb_error error;
    enum umb_status status = try_bytes("whole.glb", bytes, size, &scene, &error);
    assert_string_equal(error.message, "");
    assert_int_equal(status, UMB_OK);
    expect_corner(scene, 0, 1, 1, 0, 0);
    umbs_scene_destroy(scene);
    for (size_t cut = 0; cut < size; cut += 37) {
        status = try_bytes("cut.glb", bytes, cut, &scene, &error);
        assert_int_equal(status, UMB_E_BAD_SCENE);
    }
    static const uint32_t lengths[] = {(uint32_t)-1, (uint32_t)-8, 1U << 31, 4096};
    for (size_t i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++) {
        memcpy(bytes + 12, &lengths[i], 4);
        assert_int_equal(try_bytes("lies.glb", bytes, size, &scene, &error), UMB_E_BAD_SCENE);
        assert_non_null(strstr(error.message, "the JSON chunk has"));
    }
    bytes[16] = 'B';
    assert_int_equal(try_bytes("kind.glb", bytes, size, &scene, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "the first chunk of the GLB is not JSON"));
    bytes[4] = 1;
    assert_int_equal(try_bytes("old.glb", bytes, size, &scene, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "another version"));
}

static void glb_with_random_changes_never_harms_the_caller(void **state)
{
    (void)state;
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 30; round++) {
        unsigned char bytes[2048];
        struct umbs_scene *scene;
        struct umb_error error;
        size_t size = make_glb(bytes, sizeof(bytes));
        for (int i = 0; i < 4; i++) {
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            bytes[20 + (seed >> 33) % (size - 20)] ^= (unsigned char)(1U << (seed >> 61));
        }
        enum umb_status status = try_bytes("random.glb", bytes, size, &scene, &error);
        assert_true(status == UMB_OK || status == UMB_E_BAD_SCENE || status == UMB_E_LIMIT);
        umbs_scene_destroy(scene);
    }
}

static void gltf_reader_survives_every_prefix_and_change(void **state)
{
    (void)state;
    const char *text =
        gltf("{\"children\":[1],\"rotation\":[0,0,0,1]}," LIGHT_NODE("0", "\"mesh\":0"), "0",
             "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"spot\"}]}},"
             "\"extensionsRequired\":[\"KHR_lights_punctual\",[{}]],"
             "\"materials\":[{\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{"
             "\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0}],"
             "\"images\":[{\"bufferView\":0}],"
             "\"buffers\":[{\"uri\":\"data:;base64,"
             "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}],");
    size_t size = strlen(text);
    assert_int_equal(read_here(umbb_gltf_read, text, size), UMB_OK);
    for (size_t cut = 0; cut < size; cut++) {
        (void)read_here(umbb_gltf_read, text, cut);
    }
    char *copy = malloc(size);
    assert_non_null(copy);
    static const char swap[] = "{}[]\",:\\09 ";
    for (size_t at = 0; at < size; at++) {
        for (size_t i = 0; i < sizeof(swap) - 1; i++) {
            memcpy(copy, text, size);
            copy[at] = swap[i];
            (void)read_here(umbb_gltf_read, copy, size);
        }
    }
    free(copy);
    unsigned char bytes[2048];
    size = make_glb(bytes, sizeof(bytes));
    for (size_t cut = 0; cut < size; cut++) {
        (void)read_here(umbb_gltf_read, bytes, cut);
    }
}

/* Jansson's own limit; a parser without one would exhaust the stack. */
static void gltf_that_nests_too_deep_is_refused(void **state)
{
    (void)state;
    enum {
        DEEP = 1 << 20,
    };
    char *text = malloc(DEEP + 1);
    assert_non_null(text);
    memset(text, '[', DEEP);
    text[DEEP] = '\0';
    memcpy(text, "{\"a\":", 5);
    expect_refusal("deep.gltf", text, "maximum parsing depth reached");
    free(text);
}

static void stl_of_both_kinds_imports(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("text.STL", "solid thing\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0.5\n"
                                "vertex 1 0 0.5\nvertex 0 1 0.5\nendloop\nendfacet\n"
                                "endsolid thing\n");
    assert_int_equal(scene->view.triangle_count, 1);
    assert_int_equal(scene->view.z_up, 1);
    assert_int_equal(scene->view.material_count, 0);
    assert_int_equal(scene->view.meshes[0].material, UMBS_NO_INDEX);
    expect_corner(scene, 0, 1, 1, 0, 0.5);
    umbs_scene_destroy(scene);
    unsigned char bytes[84 + 50] = {0};
    static const float facet[12] = {0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, 0};
    struct umb_error error;
    bytes[80] = 1;
    memcpy(bytes + 84, facet, sizeof(facet));
    assert_int_equal(try_bytes("binary.stl", bytes, sizeof(bytes), &scene, &error), UMB_OK);
    expect_corner(scene, 0, 2, 0, 2, 0);
    umbs_scene_destroy(scene);
}

static void stl_text_keeps_doubles_and_drops_broken_facets(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_text(
        "solids.stl",
        "solid a vertex 1 2 3\n facet normal 0 0 1\n outer loop\n vertex 84000.123456789 0 0\n"
        " vertex 1e5 0 0\n vertex 0 1 0\n endloop\n endfacet\nendsolid a vertex 1 2 3\n"
        "solid\nfacet\nvertex 0 0 0\nvertex x 0 0\nvertex 0 1 0\nendfacet\n"
        "facet\nvertex 0 0 0\nvertex 1 0 0\nendfacet\n"
        "facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 1\nendloop\nendfacet\n"
        "facet\nvertex 0 0 5\nvertex 1 0 5\nvertex 0 1 5\nendfacet\nendsolid\n");
    assert_int_equal(scene->view.triangle_count, 2);
    assert_int_equal(scene->view.dropped_faces, 3);
    expect_corner(scene, 0, 0, 84000.123456789, 0, 0);
    expect_corner(scene, 1, 2, 0, 1, 5);
    umbs_scene_destroy(scene);
}

static void stl_without_triangles_says_why(void **state)
{
    (void)state;
    struct umbs_scene *scene;
    struct umb_error error;
    unsigned char bytes[84] = {0};
    assert_int_equal(try_bytes("zero.stl", bytes, 84, &scene, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "zero.stl: the file has no triangles"));
    bytes[80] = 200;
    assert_int_equal(try_bytes("lies.stl", bytes, 84, &scene, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "fits its count of facets"));
    expect_refusal("empty.stl", "solid Empty\nendsolid Empty", "has no triangles");
}

static int make_files(void **state)
{
    if (make_try_folder(state) != 0) {
        return -1;
    }
    put_file("tri.bin", triangle, sizeof(triangle));
    return 0;
}

static int remove_files(void **state)
{
    drop_file("tri.bin");
    return remove_try_folder(state);
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gltf_nodes_become_instances_of_one_mesh),
        cmocka_unit_test(gltf_lights_shine_along_minus_z_of_their_nodes),
        cmocka_unit_test(gltf_materials_keep_what_matters_to_shadows),
        cmocka_unit_test(gltf_pictures_get_normals_and_colours),
        cmocka_unit_test(gltf_that_would_be_read_wrongly_is_refused),
        cmocka_unit_test(gltf_references_and_transforms_of_wrong_types_are_named),
        cmocka_unit_test(gltf_strips_and_fans_are_read),
        cmocka_unit_test(gltf_transforms_keep_the_doubles_of_the_file),
        cmocka_unit_test(gltf_indices_beyond_the_vertices_drop_their_faces),
        cmocka_unit_test(gltf_sparse_positions_are_read_or_refused),
        cmocka_unit_test(gltf_faces_that_cannot_be_used_have_a_limit),
        cmocka_unit_test(gltf_sparse_order_is_checked_once_for_each_accessor),
        cmocka_unit_test(gltf_nodes_too_deep_are_refused),
        cmocka_unit_test(gltf_without_triangles_says_why),
        cmocka_unit_test(gltf_buffers_come_from_beneath_the_folder_only),
        cmocka_unit_test(glb_imports_and_its_prefixes_are_refused),
        cmocka_unit_test(glb_with_random_changes_never_harms_the_caller),
        cmocka_unit_test(gltf_reader_survives_every_prefix_and_change),
        cmocka_unit_test(gltf_that_nests_too_deep_is_refused),
        cmocka_unit_test(stl_of_both_kinds_imports),
        cmocka_unit_test(stl_text_keeps_doubles_and_drops_broken_facets),
        cmocka_unit_test(stl_without_triangles_says_why),
    };
    return cmocka_run_group_tests(tests, make_files, remove_files);
}
