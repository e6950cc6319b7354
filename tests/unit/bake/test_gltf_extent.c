/* SPDX-License-Identifier: Apache-2.0 */
/* Extents of lights in the extras of glTF, and area lights. */
#include "import_try.h"

#include <math.h>
#include <stdio.h>

/* A glTF of one triangle, with a directional light 0 and a point light 1 of 0.25 m. */
static const char *gltf(const char *nodes, const char *roots)
{
    static char text[1 << 14];
    const int length =
        snprintf(text, sizeof text,
                 "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"KHR_lights_punctual\"],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"directional\"},"
                 "{\"type\":\"point\",\"extras\":{\"umbrage_diameter\":0.25}}]}},"
                 "\"buffers\":[{\"byteLength\":36,\"uri\":\"data:application/octet-stream;base64,"
                 "%s\"}],"
                 "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
                 "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,"
                 "\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,0]}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
                 "\"scene\":0,\"scenes\":[{\"nodes\":[%s]}],\"nodes\":[{\"mesh\":0},%s]}",
                 "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA", roots, nodes);
    assert_true(length > 0 && (size_t)length < sizeof text);
    return text;
}

#define LIGHT_NODE(number, more)                                                                   \
    "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":" number "}}," more "}"

/* The node's extras take precedence over the light's; a scale of the node does not change the
 * extent. */
static void gltf_extras_give_lights_their_extent(void **state)
{
    (void)state;
    /* clang-format off */
    static const char nodes[] =
        LIGHT_NODE("0", "\"extras\":{\"umbrage_angle\":0.02}") ","
        LIGHT_NODE("1", "\"name\":\"bulb\"") ","
        LIGHT_NODE("1", "\"extras\":{\"umbrage_shape\":\"rectangle\",\"umbrage_width\":2,"
                        "\"umbrage_height\":0.5},\"scale\":[3,4,5]") ","
        LIGHT_NODE("1", "\"extras\":{\"umbrage_shape\":\"disc\",\"umbrage_diameter\":3}") ","
        LIGHT_NODE("0", "\"name\":\"plain\"");
    /* clang-format on */
    struct umbs_scene *scene = import_text("extents.gltf", gltf(nodes, "0,1,2,3,4,5"));
    const struct umbs_light *lights = scene->view.lights;
    const struct umbs_light_extent *extents = scene->view.extents;
    assert_int_equal(scene->view.light_count, 5);
    assert_non_null(extents);
    assert_true(extents[0].is_given && extents[0].extent == 0.02);
    assert_true(lights[1].kind == UMB_LIGHT_POINT && extents[1].extent == 0.25);
    assert_true(lights[2].kind == UMB_LIGHT_RECTANGLE && extents[2].extent == 0.5);
    assert_true(fabs(extents[2].side[0] - 2) < 1e-14);
    assert_true(extents[2].side[1] == 0 && extents[2].side[2] == 0);
    assert_true(lights[3].kind == UMB_LIGHT_DISC && extents[3].extent == 3);
    assert_true(!extents[4].is_given && extents[4].extent == 0);
    umbs_scene_destroy(scene);
}

static void gltf_extents_out_of_range_are_refused_by_name(void **state)
{
    static const struct {
        const char *light, *extras, *words;
    } cases[] = {
        {"0", "\"umbrage_angle\":-1", "umbrage_angle: -1, must be 0 or more and at most 1.57"},
        {"0", "\"umbrage_angle\":4", "umbrage_angle: 4"},
        {"0", "\"umbrage_angle\":\"2\"", "umbrage_angle is no number"},
        {"0", "\"umbrage_shape\":\"disc\"", "umbrage_shape: it is directional"},
        {"1", "\"umbrage_diameter\":1e7", "umbrage_diameter: 1e+07, must be 0 or more"},
        {"1", "\"umbrage_shape\":\"ball\"", "umbrage_shape: unknown; give rectangle or disc"},
        {"1", "\"umbrage_shape\":7", "umbrage_shape: unknown"},
        {"1", "\"umbrage_shape\":\"disc\",\"umbrage_diameter\":0", "umbrage_diameter: 0, must"},
        {"1", "\"umbrage_shape\":\"rectangle\",\"umbrage_width\":1", "umbrage_height is missing"},
        {"1", "\"umbrage_shape\":\"rectangle\",\"umbrage_width\":-2", "umbrage_width: -2, must"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char nodes[512];
        (void)snprintf(nodes, sizeof nodes,
                       "{\"name\":\"lamp\",\"extensions\":"
                       "{\"KHR_lights_punctual\":{\"light\":%s}},\"extras\":{%s}}",
                       cases[i].light, cases[i].extras);
        expect_refusal("extent.gltf", gltf(nodes, "0,1"), cases[i].words);
    }
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gltf_extras_give_lights_their_extent),
        cmocka_unit_test(gltf_extents_out_of_range_are_refused_by_name),
    };
    return cmocka_run_group_tests(tests, make_try_folder, remove_try_folder);
}
