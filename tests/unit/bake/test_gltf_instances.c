/* SPDX-License-Identifier: Apache-2.0 */
/* EXT_mesh_gpu_instancing: a node's mesh at the places that accessors hold. */
#include "import_try.h"

#include <math.h>

/* Two places: moved floats, turned bytes, scaled floats. */
#define ROTATIONS 24
#define SCALES    32
#define BYTES     56

static void make_places(unsigned char bytes[BYTES])
{
    static const float move[6] = {1, 2, 3, 0, 0, -5}, size[6] = {2, 2, 2, 1, 1, 1};
    static const signed char turn[8] = {0, 0, 0, 127, 0, 0, 90, 90}; /* none, 90 degrees about z */
    memcpy(bytes, move, sizeof move); /* of a little-endian machine */
    memcpy(bytes + ROTATIONS, turn, sizeof turn);
    memcpy(bytes + SCALES, size, sizeof size);
}

/* Makes a file with the triangle 0 0 0, 1 0 0, 0 1 0 and those places; given texts are inserted. */
struct parts {
    const char *attributes, *nodes, *roots, *places_uri, *move; /* move: of accessor 1 */
    const char *shape_uri;                                      /* NULL: tri.bin */
};

static const char *gltf(const struct parts *parts)
{
    static char text[4096];
    const int length = snprintf(
        text, sizeof text,
        "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"EXT_mesh_gpu_instancing\"],"
        "\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"],"
        "\"buffers\":[{\"uri\":\"%s\",\"byteLength\":36},{\"uri\":\"%s\",\"byteLength\":56}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":1,\"byteLength\":32},"
        "{\"buffer\":1,\"byteOffset\":32,\"byteLength\":24,\"byteStride\":12}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
        "{%s\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"byteOffset\":24,\"componentType\":5120,\"normalized\":true,"
        "\"count\":2,\"type\":\"VEC4\"},"
        "{\"bufferView\":2,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"},"
        "{\"bufferView\":2,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
        "\"scene\":0,\"scenes\":[{\"nodes\":[%s]}],\"nodes\":[%s{\"mesh\":0,"
        "\"translation\":[100,0,0],\"extensions\":{\"EXT_mesh_gpu_instancing\":{"
        "\"attributes\":{%s}}}}]}",
        parts->shape_uri != NULL ? parts->shape_uri : "tri.bin", parts->places_uri, parts->move,
        parts->roots, parts->nodes, parts->attributes);
    assert_in_range(length, 1, sizeof text - 1);
    return text;
}

#define MOVE "\"bufferView\":1,\"componentType\":5126,\"count\":2,"
#define ALL  "\"TRANSLATION\":1,\"ROTATION\":2,\"SCALE\":3"
static const struct parts whole = {ALL, "", "0", "places.bin", MOVE, NULL};

static int make_files(void **state)
{
    static const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    unsigned char places[BYTES];
    const int failed = make_try_folder(state);
    make_places(places);
    put_file("tri.bin", triangle, sizeof triangle);
    put_file("places.bin", places, sizeof places);
    return failed;
}

static int remove_files(void **state)
{
    drop_file("tri.bin");
    drop_file("places.bin");
    return remove_try_folder(state);
}

static void expect_two(const struct umbs_scene *scene)
{
    assert_int_equal(scene->view.mesh_count, 1);
    assert_int_equal(scene->view.triangle_count, 1);
    assert_int_equal(scene->view.instance_count, 2);
    expect_corner(scene, 0, 0, 101, 2, 3);
    expect_corner(scene, 0, 1, 103, 2, 3);
    expect_corner(scene, 0, 2, 101, 4, 3);
    expect_corner(scene, 1, 1, 100, 1, -5);
    expect_corner(scene, 1, 2, 99, 0, -5);
}

static void a_node_stands_at_every_place_of_its_accessors(void **state)
{
    (void)state;
    struct umbs_scene *scene = import_text("places.gltf", gltf(&whole));
    expect_two(scene);
    umbs_scene_destroy(scene);
    struct parts data = whole;
    data.places_uri =
        "data:application/octet-stream;base64,"
        "AACAPwAAAEAAAEBAAAAAAAAAAAAAAKDAAAAAfwAAWloAAABAAAAAQAAAAEAAAIA/AACAPwAAgD8=";
    scene = import_text("data.gltf", gltf(&data));
    expect_two(scene);
    umbs_scene_destroy(scene);
    struct parts moved = whole;
    moved.attributes = "\"_ID\":7,\"TRANSLATION\":1";
    scene = import_text("moved.gltf", gltf(&moved));
    expect_corner(scene, 1, 1, 101, 0, -5);
    umbs_scene_destroy(scene);
}

static void the_nodes_of_the_file_are_found_again_in_the_tree(void **state)
{
    (void)state;
    struct parts parts = whole;
    parts.nodes = "{\"children\":[1,2],\"scale\":[2,2,2]},{\"mesh\":0},";
    struct umbs_scene *scene = import_text("child.gltf", gltf(&parts));
    assert_int_equal(scene->view.instance_count, 3);
    expect_corner(scene, 0, 1, 2, 0, 0);
    expect_corner(scene, 1, 1, 206, 4, 6);
    umbs_scene_destroy(scene);
    parts.nodes = "{\"mesh\":0},";
    parts.roots = "0,1";
    scene = import_text("roots.gltf", gltf(&parts));
    assert_int_equal(scene->view.instance_count, 3);
    expect_corner(scene, 0, 1, 1, 0, 0);
    expect_corner(scene, 1, 1, 103, 2, 3);
    umbs_scene_destroy(scene);
    parts.roots = "1"; /* of a part of the file */
    scene = import_text("one.gltf", gltf(&parts));
    expect_two(scene);
    umbs_scene_destroy(scene);
}

/* A node without a mesh costs nothing, however many places it has, and a bad place in it goes
 * unnoticed. */
static void places_of_a_node_that_shows_nothing_are_not_walked(void **state)
{
    (void)state;
    struct parts parts = whole;
    parts.places_uri = "data:;base64,AACAPwAAAEAAAEBAAAAAAAAAAAAAAKDAAAAAAAAAAAA=";
    parts.attributes = "\"TRANSLATION\":1";
    parts.nodes = "{\"children\":[1],\"extensions\":{\"EXT_mesh_gpu_instancing\":{"
                  "\"attributes\":{\"ROTATION\":2}}}},";
    struct umbs_scene *scene = import_text("empty.gltf", gltf(&parts));
    assert_int_equal(scene->view.instance_count, 2);
    expect_corner(scene, 1, 1, 101, 0, -5);
    umbs_scene_destroy(scene);
}

static void places_that_cannot_be_read_are_refused_by_name(void **state)
{
    (void)state;
    static const struct {
        const char *attributes, *uri, *move, *words;
    } cases[] = {
        {"\"TRANSLATION\":9", "places.bin", MOVE, "accessors[9] does not exist"},
        {"\"TRANSLATION\":2", "places.bin", MOVE, "accessors[2] of TRANSLATION must be VEC3"},
        {"\"ROTATION\":1", "places.bin", MOVE, "accessors[1] of ROTATION must be VEC4"},
        {"\"TRANSLATION\":1,\"SCALE\":4", "places.bin", MOVE, "of 2 and of 1 elements"},
        {ALL, "missing.bin", MOVE, "missing.bin"},
        {ALL, "tri.bin", MOVE, "bufferViews[2] lies outside of its buffer"},
        {"\"TRANSLATION\":1", "places.bin", "\"bufferView\":1,\"componentType\":5126,\"count\":3,",
         "accessors[1] of TRANSLATION lies outside"},
        {"\"TRANSLATION\":1", "places.bin", "\"bufferView\":7,\"componentType\":5126,\"count\":2,",
         "bufferViews[7] does not exist"},
        {"\"TRANSLATION\":1", "places.bin",
         "\"bufferView\":1,\"componentType\":5126,\"count\":2,\"sparse\":{},",
         "has a sparse count"},
        {"\"TRANSLATION\":1", "places.bin",
         "\"bufferView\":1,\"byteOffset\":9223372036854775807,\"componentType\":5126,\"count\":2,",
         "lies outside"},
        {"\"ROTATION\":2", "data:;base64,AACAPwAAAEAAAEBAAAAAAAAAAAAAAKDAAAAAAAAAAAA=", MOVE,
         "transform of node"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct parts parts = {cases[i].attributes, "",  "0", cases[i].uri,
                                    cases[i].move,       NULL};
        expect_refusal("refused.gltf", gltf(&parts), cases[i].words);
    }
}

static void every_prefix_and_change_is_harmless(void **state)
{
    (void)state;
    struct parts data = whole;
    data.places_uri =
        "data:;base64,"
        "AACAPwAAAEAAAEBAAAAAAAAAAAAAAKDAAAAAfwAAWloAAABAAAAAQAAAAEAAAIA/AACAPwAAgD8=";
    data.shape_uri = "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    const char *text = gltf(&data);
    const size_t size = strlen(text);
    assert_int_equal(read_here(umbb_gltf_read, text, size), UMB_OK);
    for (size_t cut = 0; cut < size; cut++) {
        (void)read_here(umbb_gltf_read, text, cut);
    }
    char *copy = malloc(size);
    assert_non_null(copy);
    static const char swap[] = "{}[]\",:\\09";
    for (size_t at = 0; at < size; at++) {
        for (size_t i = 0; i < sizeof swap - 1; i++) {
            memcpy(copy, text, size);
            copy[at] = swap[i];
            (void)read_here(umbb_gltf_read, copy, size);
        }
    }
    free(copy);
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_node_stands_at_every_place_of_its_accessors),
        cmocka_unit_test(the_nodes_of_the_file_are_found_again_in_the_tree),
        cmocka_unit_test(places_of_a_node_that_shows_nothing_are_not_walked),
        cmocka_unit_test(places_that_cannot_be_read_are_refused_by_name),
        cmocka_unit_test(every_prefix_and_change_is_harmless),
    };
    return cmocka_run_group_tests(tests, make_files, remove_files);
}
