/* SPDX-License-Identifier: Apache-2.0 */
/* Alpha textures through the importer's process: glTF's in files and buffers, OBJ's map_d. */
#include "import_try.h"

#include <math.h>

#include "bake/import/texture_table.h"
#include "make_png.h"

enum {
    SIDE = 4,
};

/* Three corners, two sets of texture coordinates. */
static const float buffer[21] = {0,    0,    0,      1,     0,     0,     0,
                                 1,    0,    0.125F, 0.25F, 0.75F, 0.25F, 0.125F,
                                 1.0F, 0.5F, 0.5F,   0.25F, 0.5F,  0.5F,  0.0F};

/* Alpha counts up along the rows from the highest. */
static struct made_png counted_png(void)
{
    uint8_t alpha[SIDE * SIDE];
    for (uint8_t i = 0; i < SIDE * SIDE; i++) {
        alpha[i] = (uint8_t)(10 * i);
    }
    return make_rgba_png(SIDE, SIDE, alpha);
}

static void expect_counted(const struct umbs_scene_view *view, uint32_t texture)
{
    assert_in_range(texture, 0, view->texture_count - 1);
    const struct umbs_texture *t = &view->textures[texture];
    assert_int_equal(t->width, SIDE);
    assert_int_equal(t->height, SIDE);
    for (int i = 0; i < SIDE * SIDE; i++) { /* the lowest row first */
        assert_int_equal(view->alpha[t->offset + (size_t)i],
                         10 * (SIDE * (SIDE - 1 - i / SIDE) + i % SIDE));
    }
}

/* A MASK material that shows texture 0; `info` is more of its textureInfo, `more` of the file. */
static const char *gltf(const char *info, const char *more)
{
    static char text[4096];
    const int length = snprintf(
        text, sizeof(text),
        "{\"asset\":{\"version\":\"2.0\"},%s"
        "\"buffers\":[{\"uri\":\"tri.bin\",\"byteLength\":84}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},"
        "{\"buffer\":0,\"byteOffset\":36,\"byteLength\":24},"
        "{\"buffer\":0,\"byteOffset\":60,\"byteLength\":24}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"},"
        "{\"bufferView\":2,\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"}],"
        "\"materials\":[{\"name\":\"leaf\",\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{"
        "\"baseColorTexture\":{\"index\":0%s}}}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1,"
        "\"TEXCOORD_1\":2},\"material\":0}]}],"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]}",
        more, info);
    assert_in_range(length, 1, sizeof(text) - 1);
    return text;
}

#define IMAGE(uri) "\"images\":[{\"uri\":\"" uri "\"}],"
#define PLAIN      IMAGE("leaf.png") "\"textures\":[{\"source\":0}],"

/* Imports with leaf.png and "a leaf.png" beside the scene. */
static struct umbs_scene *import_with_png(const char *name, const char *text)
{
    struct made_png made = counted_png();
    put_file("tri.bin", buffer, sizeof buffer);
    put_file("leaf.png", made.bytes, made.size);
    put_file("a leaf.png", made.bytes, made.size);
    struct umbs_scene *scene = import_text(name, text);
    drop_file("tri.bin");
    drop_file("leaf.png");
    drop_file("a leaf.png");
    free(made.bytes);
    return scene;
}

static void expect_uvs(const struct umbs_scene_view *view, const double wanted[3][2])
{
    assert_non_null(view->uvs);
    for (int i = 0; i < 6; i++) {
        const double got = (double)view->uvs[i / 2][i % 2];
        if (!(fabs(got - wanted[i / 2][i % 2]) <= 1.2e-7)) { /* half a unit of a float below 4 */
            fail_msg("corner %d: %.9g, not %.9g", i / 2, got, wanted[i / 2][i % 2]);
        }
    }
}

static void a_mask_material_keeps_the_alpha_of_its_texture(void **state)
{
    (void)state;
    static const char *const texts[] = {PLAIN,
                                        IMAGE("a%20leaf.png") "\"textures\":[{\"source\":0}],"};
    static const double up[3][2] = {{0.125, 0.75}, {0.75, 0.75}, {0.125, 0.0}};
    for (int i = 0; i < 2; i++) {
        struct umbs_scene *scene = import_with_png("leaf.gltf", gltf("", texts[i]));
        expect_counted(&scene->view, scene->view.materials[0].texture);
        expect_uvs(&scene->view, up);
        assert_string_equal(scene->view.warnings, "");
        umbs_scene_destroy(scene);
    }
}

static void samplers_and_sets_of_coordinates_are_obeyed(void **state)
{
    (void)state;
    static const double up[3][2] = {{0.5, 0.5}, {0.25, 0.5}, {0.5, 1.0}};
    struct umbs_scene *scene = import_with_png(
        "leaf.gltf",
        gltf(",\"texCoord\":1", IMAGE("leaf.png") "\"textures\":[{\"source\":0,\"sampler\":0}],"
                                                  "\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648,"
                                                  "\"magFilter\":9728}],"));
    const struct umbs_texture *texture = &scene->view.textures[0];
    assert_int_equal(texture->wrap_s, UMBS_WRAP_CLAMP);
    assert_int_equal(texture->wrap_t, UMBS_WRAP_MIRROR);
    assert_int_equal(texture->nearest, 1);
    expect_uvs(&scene->view, up);
    umbs_scene_destroy(scene);
}

#define MOVED                                                                                      \
    ",\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.25,0.5],\"scale\":[2,3],"           \
    "\"rotation\":%s}}"

static void texture_transforms_scale_then_turn_then_move(void **state)
{
    (void)state;
    static const char *const angles[] = {"0", "1.5707963267948966", "0.3"};
    static const double radians[] = {0.0, 1.5707963267948966, 0.3};
    for (int i = 0; i < 3; i++) {
        char info[256];
        double wanted[3][2];
        (void)snprintf(info, sizeof info, MOVED, angles[i]);
        struct umbs_scene *scene = import_with_png(
            "leaf.gltf", gltf(info, PLAIN "\"extensionsUsed\":[\"KHR_texture_transform\"],"));
        for (int k = 0; k < 3; k++) { /* as the extension says it, v downward */
            const double u = 2.0 * (double)buffer[9 + 2 * k], v = 3.0 * (double)buffer[10 + 2 * k];
            const double c = cos(radians[i]), s = sin(radians[i]);
            wanted[k][0] = c * u + s * v + 0.25;
            wanted[k][1] = 1.0 - (-s * u + c * v + 0.5);
        }
        expect_uvs(&scene->view, (const double(*)[2])wanted);
        umbs_scene_destroy(scene);
    }
}

/* The extension's choice of the second texture coordinates goes before the texture's own; an
 * invalid choice is ignored. */
static void a_texture_transform_may_name_the_set_of_coordinates(void **state)
{
    (void)state;
    static const double first[3][2] = {{0.125, 0.75}, {0.75, 0.75}, {0.125, 0.0}};
    static const double second[3][2] = {{0.5, 0.5}, {0.25, 0.5}, {0.5, 1.0}};
    static const struct {
        const char *info;
        int is_second;
    } cases[] = {
        {",\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":1}}", 1},
        {",\"texCoord\":1,\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":0}}", 0},
        {",\"extensions\":{\"EXT_other\":{\"texCoord\":1},\"KHR_texture_transform\":{}}", 0},
        {",\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":-1}}", 0},
        {",\"texCoord\":1,\"extensions\":{\"KHR_texture_transform\":{\"extras\":{\"texCoord\":0}}}",
         1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbs_scene *scene =
            import_with_png("leaf.gltf", gltf(cases[i].info, PLAIN
                                              "\"extensionsUsed\":[\"KHR_texture_transform\"],"));
        expect_uvs(&scene->view, cases[i].is_second ? second : first);
        umbs_scene_destroy(scene);
    }
}

#define MOVED_MATERIAL                                                                             \
    "{\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,"         \
    "\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":1}}}}},"
#define MOVED_MESH                                                                                 \
    "{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1,\"TEXCOORD_1\":2},\"material\":1},"

/* A triangle whose material is the file's second, has no name, and takes the second set of
 * coordinates by the extension. Behind it stands a triangle of the file's third material, called
 * `name`, which chooses nothing. */
static struct umbs_scene *import_two_materials(const char *name)
{
    static const char before[] = "\"materials\":[", mesh[] = "\"meshes\":[{\"primitives\":[";
    const char *plain = gltf("", PLAIN "\"extensionsUsed\":[\"KHR_texture_transform\"],");
    const char *materials = strstr(plain, before) + sizeof before - 1;
    const char *named = strstr(materials, "\"leaf\"") + sizeof "\"leaf\"" - 1;
    const char *primitives = strstr(named, mesh) + sizeof mesh - 1;
    const char *number = strstr(primitives, "\"material\":0") + sizeof "\"material\":" - 1;
    char text[4096];
    (void)snprintf(text, sizeof text, "%.*s{\"name\":\"none\"},%s{\"name\":\"%s\"%.*s%s%.*s2%s",
                   (int)(materials - plain), plain, MOVED_MATERIAL, name, (int)(primitives - named),
                   named, MOVED_MESH, (int)(number - primitives), primitives, number + 1);
    return import_with_png("leaf.gltf", text);
}

static void the_set_is_that_of_the_meshs_own_material(void **state)
{
    (void)state;
    static const double first[3][2] = {{0.125, 0.75}, {0.75, 0.75}, {0.125, 0.0}};
    static const double second[3][2] = {{0.5, 0.5}, {0.25, 0.5}, {0.5, 1.0}};
    struct umbs_scene *scene = import_two_materials("leaf");
    struct umbs_scene_view view = scene->view;
    assert_int_equal(view.triangle_count, 2);
    expect_uvs(&view, second);
    view.uvs += 3;
    expect_uvs(&view, first);
    assert_string_equal(view.warnings, "");
    umbs_scene_destroy(scene);
    scene = import_two_materials(""); /* names do not count */
    expect_uvs(&scene->view, second);
    umbs_scene_destroy(scene);
}

static void images_in_buffers_are_read_too(void **state)
{
    (void)state;
    static const char hex[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    struct made_png made = counted_png();
    char base64[1024], more[2048];
    size_t used = 0;
    for (size_t i = 0; i < made.size; i += 3) {
        unsigned long bits = 0;
        for (size_t k = 0; k < 3; k++) {
            bits = bits << 8 | (i + k < made.size ? made.bytes[i + k] : 0U);
        }
        for (size_t k = 0; k < 4; k++) {
            assert_true(used + 1 < sizeof base64);
            base64[used++] = i + k > made.size ? '=' : hex[bits >> (18 - 6 * k) & 63];
        }
    }
    base64[used] = '\0';
    (void)snprintf(more, sizeof more,
                   "\"images\":[{\"uri\":\"data:image/png;base64,%s\"}],"
                   "\"textures\":[{\"source\":0}],",
                   base64);
    struct umbs_scene *scene = import_with_png("leaf.gltf", gltf("", more));
    expect_counted(&scene->view, scene->view.materials[0].texture);
    umbs_scene_destroy(scene);
    /* In a bufferView, and coordinates as normalised integers. */
    static const uint16_t shorts[6] = {0, 0, 65535, 0, 0, 65535};
    static const double corners[3][2] = {{0, 1}, {1, 1}, {0, 0}};
    const size_t at = sizeof buffer + sizeof shorts;
    unsigned char *all = malloc(at + made.size);
    assert_non_null(all);
    memcpy(all, buffer, sizeof buffer);
    memcpy(all + sizeof buffer, shorts, sizeof shorts);
    memcpy(all + at, made.bytes, made.size);
    put_file("all.bin", all, at + made.size);
    (void)snprintf(
        more, sizeof more,
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"all.bin\"}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":%zu,"
        "\"byteLength\":12},{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu}],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
        "{\"bufferView\":1,\"componentType\":5123,\"normalized\":true,\"count\":3,"
        "\"type\":\"VEC2\"}],\"materials\":[{\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{"
        "\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0}],"
        "\"images\":[{\"bufferView\":2,\"mimeType\":\"image/png\"}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},"
        "\"material\":0}]}],\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]}",
        sizeof buffer, at, made.size);
    scene = import_text("view.gltf", more);
    expect_counted(&scene->view, scene->view.materials[0].texture);
    expect_uvs(&scene->view, corners);
    umbs_scene_destroy(scene);
    drop_file("all.bin");
    free(all);
    free(made.bytes);
}

/* Must warn, and the material must have no texture. */
static void expect_opaque(const char *text, const char *words)
{
    struct umbs_scene *scene = import_with_png("leaf.gltf", text);
    assert_int_equal(scene->view.materials[0].texture, UMBS_NO_INDEX);
    assert_int_equal(scene->view.texture_count, 0);
    if (strstr(scene->view.warnings, words) == NULL) {
        fail_msg("'%s' lacks '%s'", scene->view.warnings, words);
    }
    umbs_scene_destroy(scene);
}

static void images_that_cannot_be_read_are_warnings(void **state)
{
    (void)state;
    put_file("odd.png", "GIF89a", 6);
    put_file("cut.png", "\x89PNG\r\n\x1a\n\0\0", 10);
    put_file("photo.png", "\xff\xd8\xff\xe0", 4);
    expect_opaque(gltf("", IMAGE("none.png") "\"textures\":[{\"source\":0}],"), "'none.png'");
    expect_opaque(gltf("", IMAGE("../up.png") "\"textures\":[{\"source\":0}],"), "'..'");
    expect_opaque(gltf("", IMAGE("odd.png") "\"textures\":[{\"source\":0}],"), "neither PNG nor");
    expect_opaque(gltf("", IMAGE("cut.png") "\"textures\":[{\"source\":0}],"), "ends too early");
    expect_opaque(gltf("", IMAGE("photo.png") "\"textures\":[{\"source\":0}],"), "");
    drop_file("odd.png");
    drop_file("cut.png");
    drop_file("photo.png");
}

/* The table names an embedded image by its number. A file of that name is another image. */
static void a_file_may_be_named_as_an_embedded_image(void **state)
{
    (void)state;
    static const char more[] =
        "\"images\":[{\"bufferView\":0},{\"uri\":\"images[0]\"}],"
        "\"textures\":[{\"source\":0},{\"source\":1}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},"
        "\"material\":0},{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},\"material\":1}]}],"
        "\"materials\":[{\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{"
        "\"baseColorTexture\":{\"index\":0}}},{\"alphaMode\":\"MASK\",\"pbrMetallicRoughness\":{"
        "\"baseColorTexture\":{\"index\":1}}}],";
    char text[4096];
    const char *tail = strstr(gltf("", ""), "\"buffers\"");
    const char *materials = strstr(tail, "\"materials\""), *scene_at = strstr(tail, "\"scene\"");
    struct made_png made = counted_png();
    (void)snprintf(text, sizeof text, "{\"asset\":{\"version\":\"2.0\"},%s%.*s%s", more,
                   (int)(materials - tail), tail, scene_at);
    put_file("images[0]", made.bytes, made.size);
    struct umbs_scene *scene = import_with_png("named.gltf", text);
    assert_int_equal(scene->view.texture_count, 1); /* the embedded one is no PNG */
    assert_int_equal(scene->view.materials[0].texture, UMBS_NO_INDEX);
    expect_counted(&scene->view, scene->view.materials[1].texture);
    umbs_scene_destroy(scene);
    drop_file("images[0]");
    free(made.bytes);
}

/* A small file can use one damaged image under thousands of names. */
static void damaged_images_use_up_the_limit_of_texels(void **state)
{
    (void)state;
    struct made_png made = counted_png();
    struct umbb_import job = {.max_input_bytes = 1 << 20};
    struct umbb_texture_table table = {.job = &job, .texels = UMBB_IMAGES_TEXELS_MAX - 20};
    struct umbb_image image = {
        .name = "a", .name_length = 1, .bytes = made.bytes, .size = made.size - 20};
    struct umb_error error = {0};
    uint32_t index;
    umbs_scene_builder_init(&job.scene, UMBS_FORMAT_GLTF, 0, 1);
    assert_int_equal(umbb_texture_find(&table, &image, &index), 0);
    assert_int_equal(umbb_texture_get(&table, &image, &index, &error), UMB_OK);
    assert_int_equal(index, UMBS_NO_INDEX);
    assert_int_equal(table.texels, UMBB_IMAGES_TEXELS_MAX - 4);
    assert_int_equal(umbb_texture_find(&table, &image, &index), 1); /* known as damaged */
    assert_int_equal(umbb_texture_get(&table, &image, &index, &error), UMB_OK);
    image.name = "b";
    assert_int_equal(umbb_texture_get(&table, &image, &index, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "4 x 4 texels, limit 4"));
    umbb_texture_table_finish(&table);
    umbs_scene_builder_finish(&job.scene);
    free(made.bytes);
}

static void obj_maps_cut_by_alpha_and_say_what_is_not_read(void **state)
{
    (void)state;
    static const char mtl[] = "newmtl leaf\nmap_d -clamp on -bm 0.5 a leaf.png\n"
                              "newmtl moved\nmap_d -o 0.5 0.5 leaf.png\n"
                              "newmtl same\nmap_d -clamp on  a leaf.png\n"
                              "newmtl glass\nd 0.5\nmap_d leaf.png\n";
    put_file("leaf.mtl", mtl, sizeof(mtl) - 1);
    struct umbs_scene *scene = import_with_png(
        "leaf.obj", "mtllib leaf.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvt 1 0\nvt 0 1\n"
                    "usemtl leaf\nf 1/1 2/2 3/3\nusemtl moved\nf 1/1 2/2 3/3\n");
    drop_file("leaf.mtl");
    const struct umbs_scene_view *view = &scene->view;
    assert_int_equal(view->texture_count, 2);
    expect_counted(view, view->materials[0].texture);
    assert_int_equal(view->textures[0].wrap_s, UMBS_WRAP_CLAMP);
    assert_int_equal(view->materials[1].texture, UMBS_NO_INDEX);
    assert_int_equal(view->materials[2].texture, 0);
    assert_int_equal(view->materials[3].alpha_mode, UMBS_ALPHA_BLEND);
    assert_int_equal(view->materials[3].texture, 1);
    assert_true(view->materials[3].base_alpha == 0.5F);
    assert_non_null(strstr(view->warnings, "material 'moved': map_d"));
    assert_true(view->uvs[0][0] == 0.25F && view->uvs[0][1] == 0.75F);
    umbs_scene_destroy(scene);
}

/* Without texture coordinates every corner would show the image's corner, and would be dropped if
 * that is a hole. */
static void faces_without_texture_coordinates_are_opaque(void **state)
{
    (void)state;
    static const char mtl[] = "newmtl leaf\nmap_d leaf.png\nnewmtl plain\n";
    put_file("leaf.mtl", mtl, sizeof(mtl) - 1);
    struct umbs_scene *scene = import_with_png(
        "leaf.obj", "mtllib leaf.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvt 1 0\nvt 0 1\n"
                    "usemtl leaf\nf 1 2 3\nf 1/1 2/2 3/3\nf 1/1 2/2 3/9\nusemtl plain\nf 1 2 3\n");
    drop_file("leaf.mtl");
    const struct umbs_scene_view *view = &scene->view;
    assert_int_equal(view->mesh_count, 3); /* those two, leaf, plain */
    assert_int_equal(view->meshes[0].material, UMBS_NO_INDEX);
    assert_int_equal(view->meshes[0].triangle_count, 2);
    assert_int_equal(view->meshes[1].material, 0);
    assert_int_equal(view->meshes[1].triangle_count, 1);
    assert_int_equal(view->meshes[2].material, 1);
    assert_non_null(strstr(view->warnings, "2 triangles of materials with map_d have no texture"));
    umbs_scene_destroy(scene);

    scene = import_with_png("leaf.gltf", gltf(",\"texCoord\":2", PLAIN));
    assert_int_equal(scene->view.materials[0].texture, 0);
    assert_int_equal(scene->view.meshes[0].material, UMBS_NO_INDEX);
    assert_non_null(strstr(scene->view.warnings, "1 meshes whose alpha is a texture have no"));
    umbs_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mask_material_keeps_the_alpha_of_its_texture),
        cmocka_unit_test(samplers_and_sets_of_coordinates_are_obeyed),
        cmocka_unit_test(texture_transforms_scale_then_turn_then_move),
        cmocka_unit_test(a_texture_transform_may_name_the_set_of_coordinates),
        cmocka_unit_test(the_set_is_that_of_the_meshs_own_material),
        cmocka_unit_test(images_in_buffers_are_read_too),
        cmocka_unit_test(images_that_cannot_be_read_are_warnings),
        cmocka_unit_test(a_file_may_be_named_as_an_embedded_image),
        cmocka_unit_test(damaged_images_use_up_the_limit_of_texels),
        cmocka_unit_test(obj_maps_cut_by_alpha_and_say_what_is_not_read),
        cmocka_unit_test(faces_without_texture_coordinates_are_opaque),
    };
    return cmocka_run_group_tests(tests, make_try_folder, remove_try_folder);
}
