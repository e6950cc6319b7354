/* SPDX-License-Identifier: Apache-2.0 */
/* Scene buffers: builder, validator, flatten, hash. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_buffer.h"
#include "scene/scene_builder.h"
#include "common/clean_text.h"

struct bytes {
    unsigned char *data;
    size_t size;
};

static enum umb_status append_bytes(void *user, const void *data, size_t count)
{
    struct bytes *bytes = user;
    unsigned char *grown = realloc(bytes->data, bytes->size + count);
    assert_non_null(grown);
    memcpy(grown + bytes->size, data, count);
    bytes->data = grown;
    bytes->size += count;
    return UMB_OK;
}

/* Two meshes (a quad with uvs, a triangle), three instances, a material of each mode, two lights, a
 * texture. It is small, but no section is empty. */
static void build(struct umbs_scene_builder *builder)
{
    struct umb_error error;
    static const double quad[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    static const double apex[3][3] = {{0, 0, 5}, {0.1, 0, 5}, {0, 0.25, 5}};
    static const uint32_t corners[3][3] = {{0, 1, 2}, {0, 2, 3}, {0, 1, 2}};
    umbs_scene_builder_init(builder, UMBS_FORMAT_GLTF, 0, 0);
    for (int i = 0; i < 4; i++) {
        float uv[2] = {(float)quad[i][0], (float)quad[i][1]};
        assert_int_equal(umbs_scene_add_vertex(builder, quad[i], i > 0 ? uv : NULL, &error), 0);
    }
    static const double up[3] = {0, 0, 4}; /* of any length */
    assert_int_equal(umbs_scene_set_normal(builder, up, &error), 0);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(umbs_scene_add_vertex(builder, apex[i], NULL, &error), 0);
        assert_int_equal(umbs_scene_add_triangle(builder, corners[i], &error), 0);
    }
    static const uint8_t pixels[6] = {0, 50, 100, 150, 200, 250};
    struct umbs_texture texture = {.name = "leaf", .width = 3, .height = 2, .wrap_t = 1};
    assert_int_equal(umbs_scene_add_texture(builder, &texture, pixels, &error), 0);
    for (uint32_t mode = 0; mode < 3; mode++) {
        struct umbs_material material = umbs_material_opaque();
        material.name[0] = (char)('a' + mode);
        material.alpha_mode = mode;
        material.texture = mode == UMBS_ALPHA_MASK ? 0 : UMBS_NO_INDEX;
        assert_int_equal(umbs_scene_add_material(builder, &material, &error), 0);
    }
    struct umbs_light light = {.name = "sun", .direction = {0, 0.6, -0.8}, .intensity = 1};
    assert_int_equal(umbs_scene_add_light(builder, &light, NULL, &error), 0);
    light.kind = UMB_LIGHT_SPOT;
    light.inner_cone = 0.25;
    light.outer_cone = 0.5;
    assert_int_equal(umbs_scene_add_light(builder, &light, NULL, &error), 0);
    assert_int_equal(umbs_scene_end_mesh(builder, 0, 4, 2, 1, &error), 0);
    assert_int_equal(umbs_scene_end_mesh(builder, 4, 3, 1, UMBS_NO_INDEX, &error), 0);
    static const double mirror[3][4] = {{-2, 0, 0, 10}, {0, 1, 0, 20}, {0, 0, 1, 30}};
    assert_int_equal(umbs_scene_add_instance(builder, 0, NULL, &error), 0);
    assert_int_equal(umbs_scene_add_instance(builder, 1, NULL, &error), 0);
    assert_int_equal(umbs_scene_add_instance(builder, 1, mirror, &error), 0);
    umbs_scene_warn(builder, "a %s warning", "small");
}

static struct bytes make_buffer(void)
{
    struct umbs_scene_builder builder;
    struct bytes bytes = {0};
    const struct umb_sink sink = {append_bytes, &bytes};
    struct umb_error error;
    build(&builder);
    assert_int_equal(umbs_scene_builder_write(&builder, &sink, &error), UMB_OK);
    umbs_scene_builder_finish(&builder);
    return bytes;
}

static void builder_and_view_agree_on_every_section(void **state)
{
    (void)state;
    struct bytes bytes = make_buffer();
    struct umbs_scene_view view;
    struct umb_error error = {0};
    enum umb_status status = umbs_scene_view(bytes.data, bytes.size, &view, &error);
    assert_string_equal(error.message, "");
    assert_int_equal(status, UMB_OK);
    assert_int_equal(view.mesh_count, 2);
    assert_int_equal(view.instance_count, 3);
    assert_int_equal(view.material_count, 3);
    assert_int_equal(view.light_count, 2);
    assert_int_equal(view.texture_count, 1);
    assert_int_equal(view.vertex_count, 7);
    assert_int_equal(view.triangle_count, 3);
    assert_int_equal(view.world_triangle_count, 4);
    assert_int_equal(view.alpha_bytes, 6);
    assert_int_equal(view.alpha[5], 250);
    assert_string_equal(view.warnings, "a small warning\n");
    assert_string_equal(view.materials[2].name, "c");
    assert_non_null(view.uvs);
    assert_true(view.uvs[2][0] == 1.0F && view.uvs[0][0] == 0.0F && view.uvs[6][1] == 0.0F);
    assert_true(view.positions[5][0] == 0.1);
    free(bytes.data);
}

static void flatten_multiplies_instances_and_turns_mirrored_ones(void **state)
{
    (void)state;
    struct bytes bytes = make_buffer();
    struct umbs_scene_view view;
    assert_int_equal(umbs_scene_view(bytes.data, bytes.size, &view, NULL), UMB_OK);
    double(*corners)[3][3];
    uint32_t *materials;
    size_t count;
    assert_int_equal(umbs_scene_flatten(&view, &corners, &materials, &count, NULL), UMB_OK);
    assert_int_equal(count, 4);
    static const double first[3][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}};
    /* The last instance is mirrored in x, so its corners 1 and 2 are exchanged. All sums are exact
     * except 0.1 * -2 + 10, which doubles round to the nearest of 9.8. */
    static const double last[3][3] = {{10, 20, 35}, {10, 20.25, 35}, {9.8, 20, 35}};
    assert_memory_equal(corners[0], first, sizeof(first));
    assert_memory_equal(corners[3], last, sizeof(last));
    assert_int_equal(materials[0], 1);
    assert_int_equal(materials[3], UMBS_NO_INDEX);
    free(corners);
    free(materials);
    assert_int_equal(umbs_scene_flatten(&view, &corners, NULL, &count, NULL), UMB_OK);
    assert_int_equal(count, 4);
    free(corners);
    free(bytes.data);
}

static void view_rejects_every_prefix(void **state)
{
    (void)state;
    struct bytes bytes = make_buffer();
    for (size_t size = 0; size < bytes.size; size++) {
        void *block = malloc(size > 0 ? size : 1); /* exact, so that ASan sees one byte too many */
        assert_non_null(block);
        memcpy(block, bytes.data, size);
        struct umbs_scene_view view;
        struct umb_error error = {0};
        assert_int_equal(umbs_scene_view(block, size, &view, &error), UMB_E_BAD_SCENE);
        assert_true(error.message[0] != '\0');
        free(block);
    }
    free(bytes.data);
}

/* Whatever passes validation must be safe to use: flatten and hash read all of it under ASan. */
static void use(const void *data, size_t size)
{
    struct umbs_scene_view view;
    struct umb_error error = {0};
    double(*corners)[3][3];
    uint32_t *materials;
    size_t count;
    uint8_t hash[UMB_ID_BYTES];
    if (umbs_scene_view(data, size, &view, &error) != UMB_OK) {
        assert_true(error.message[0] != '\0');
        assert_null(view.positions);
        return;
    }
    assert_int_equal(umbs_scene_flatten(&view, &corners, &materials, &count, &error), UMB_OK);
    const double *number = &corners[0][0][0];
    for (size_t i = 0; i < count * 9; i++) {
        assert_true(isfinite(number[i]));
    }
    for (size_t i = 0; i < count; i++) {
        assert_true(materials[i] == UMBS_NO_INDEX || materials[i] < view.material_count);
    }
    umbs_scene_hash(&view, hash);
    free(corners);
    free(materials);
}

static void view_survives_every_field_replaced(void **state)
{
    (void)state;
    static const uint32_t values[] = {0,          1,          2,          7,          0x7fffffff,
                                      0x80000000, 0xfffffffe, 0xffffffff, 0x7ff00000, 0x7f800000,
                                      0x7fc00000, 0x41414141, 0x00080000};
    struct bytes bytes = make_buffer();
    unsigned char *copy = malloc(bytes.size);
    assert_non_null(copy);
    for (size_t at = 0; at + 4 <= bytes.size; at += 4) {
        for (size_t i = 0; i < sizeof(values) / sizeof(values[0]); i++) {
            memcpy(copy, bytes.data, bytes.size);
            memcpy(copy + at, &values[i], 4);
            use(copy, bytes.size);
        }
        for (int bit = 0; bit < 32; bit++) {
            memcpy(copy, bytes.data, bytes.size);
            copy[at + (size_t)bit / 8] ^= (unsigned char)(1U << (bit % 8));
            use(copy, bytes.size);
        }
    }
    free(copy);
    free(bytes.data);
}

/* Changes one thing of a good buffer and expects a message with the given words. */
static void expect_refusal(void (*change)(unsigned char *bytes, struct umbs_scene_header *header),
                           const char *words)
{
    struct bytes bytes = make_buffer();
    struct umbs_scene_view view;
    struct umb_error error = {0};
    change(bytes.data, (struct umbs_scene_header *)(void *)bytes.data);
    assert_int_equal(umbs_scene_view(bytes.data, bytes.size, &view, &error), UMB_E_BAD_SCENE);
    if (strstr(error.message, words) == NULL) {
        print_error("message '%s' lacks '%s'\n", error.message, words);
        fail();
    }
    free(bytes.data);
}

static void *section(unsigned char *bytes, const struct umbs_scene_header *header, int which)
{
    return bytes + header->offsets[which];
}

static void break_magic(unsigned char *bytes, struct umbs_scene_header *header)
{
    (void)bytes;
    header->magic[7] ^= 1;
}

static void break_count(unsigned char *bytes, struct umbs_scene_header *header)
{
    (void)bytes;
    header->counts[UMBS_SECTION_POSITIONS] = 1ULL << 61; /* times 24 overflows 64 bits */
}

static void break_offset(unsigned char *bytes, struct umbs_scene_header *header)
{
    (void)bytes;
    header->offsets[UMBS_SECTION_TRIANGLES] -= 8;
}

static void break_corner(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((uint32_t *)section(bytes, header, UMBS_SECTION_TRIANGLES))[8] = 3; /* mesh 1 has 3 vertices */
}

static void break_instance(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_instance *)section(bytes, header, UMBS_SECTION_INSTANCES))[1].mesh = 2;
}

static void break_transform(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_instance *)section(bytes, header, UMBS_SECTION_INSTANCES))[2]
        .mesh_to_world[1][2] = (double)INFINITY;
}

static void break_position(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((double *)section(bytes, header, UMBS_SECTION_POSITIONS))[4] = (double)NAN;
}

static void break_direction(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_light *)section(bytes, header, UMBS_SECTION_LIGHTS))[0].direction[2] = 1.8;
}

static void break_name(unsigned char *bytes, struct umbs_scene_header *header)
{
    memset(((struct umbs_light *)section(bytes, header, UMBS_SECTION_LIGHTS))[0].name, 'x',
           UMB_NAME_SIZE);
}

static void break_world_count(unsigned char *bytes, struct umbs_scene_header *header)
{
    (void)bytes;
    header->world_triangle_count = 5;
}

static void break_texture(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_texture *)section(bytes, header, UMBS_SECTION_TEXTURES))[0].offset = UINT64_MAX;
}

static void break_normal(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((float *)section(bytes, header, UMBS_SECTION_NORMALS))[11] = 1.5F;
}

static void break_color(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_material *)section(bytes, header, UMBS_SECTION_MATERIALS))[1].base_color[2] =
        (float)NAN;
}

static void view_names_the_field_it_refuses(void **state)
{
    (void)state;
    expect_refusal(break_magic, "magic");
    expect_refusal(break_count, "vertex_count");
    expect_refusal(break_offset, "offset of section 7");
    expect_refusal(break_corner, "triangle 2");
    expect_refusal(break_instance, "instance 1: mesh");
    expect_refusal(break_transform, "instance 2: mesh_to_world");
    expect_refusal(break_position, "position 1");
    expect_refusal(break_direction, "light 0: direction");
    expect_refusal(break_name, "light 0: name");
    expect_refusal(break_world_count, "world_triangle_count is 5");
    expect_refusal(break_texture, "texture 0: pixels");
    expect_refusal(break_normal, "normal 3: is not in -1..1");
    expect_refusal(break_color, "material 1: base_color");
}

static void hash_after(void (*change)(unsigned char *, struct umbs_scene_header *),
                       uint8_t hash[UMB_ID_BYTES])
{
    struct bytes bytes = make_buffer();
    struct umbs_scene_view view;
    if (change != NULL) {
        change(bytes.data, (struct umbs_scene_header *)(void *)bytes.data);
    }
    assert_int_equal(umbs_scene_view(bytes.data, bytes.size, &view, NULL), UMB_OK);
    umbs_scene_hash(&view, hash);
    free(bytes.data);
}

static void rename_material(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_material *)section(bytes, header, UMBS_SECTION_MATERIALS))[0].name[0] = 'z';
}

static void move_vertex(unsigned char *bytes, struct umbs_scene_header *header)
{
    double *position = section(bytes, header, UMBS_SECTION_POSITIONS);
    position[0] = nextafter(position[0], 1.0);
}

static void change_cutoff(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_material *)section(bytes, header, UMBS_SECTION_MATERIALS))[1].alpha_cutoff = 0.4F;
}

static void change_light(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((struct umbs_light *)section(bytes, header, UMBS_SECTION_LIGHTS))[1].outer_cone = 0.51;
}

static void change_uv(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((float *)section(bytes, header, UMBS_SECTION_UVS))[3] = 0.125F;
}

static void change_look(unsigned char *bytes, struct umbs_scene_header *header)
{
    ((float *)section(bytes, header, UMBS_SECTION_NORMALS))[11] = -1.0F;
    ((struct umbs_material *)section(bytes, header, UMBS_SECTION_MATERIALS))[1].base_color[2] =
        0.25F;
}

static void what_only_pictures_need_is_not_hashed(void **state)
{
    (void)state;
    uint8_t before[UMB_ID_BYTES], after[UMB_ID_BYTES];
    hash_after(NULL, before);
    hash_after(change_look, after);
    assert_memory_equal(before, after, sizeof before);
    struct bytes bytes = make_buffer();
    struct umbs_scene_view view;
    assert_int_equal(umbs_scene_view(bytes.data, bytes.size, &view, NULL), UMB_OK);
    assert_non_null(view.normals);
    assert_true(view.normals[3][2] >= 1.0F && view.normals[2][2] <= 0.0F);
    free(bytes.data);
}

static void hash_follows_content_and_not_names(void **state)
{
    (void)state;
    uint8_t base[UMB_ID_BYTES], other[UMB_ID_BYTES];
    hash_after(NULL, base);
    hash_after(NULL, other);
    assert_memory_equal(base, other, sizeof(base));
    hash_after(rename_material, other);
    assert_memory_equal(base, other, sizeof(base));
    hash_after(move_vertex, other);
    assert_memory_not_equal(base, other, sizeof(base));
    hash_after(change_cutoff, other);
    assert_memory_not_equal(base, other, sizeof(base));
    hash_after(change_light, other);
    assert_memory_not_equal(base, other, sizeof(base));
    hash_after(change_uv, other);
    assert_memory_not_equal(base, other, sizeof(base));
}

/* How one file writes the two triangles of a square. */
struct writing {
    int shared;    /* corners that are the same are one vertex */
    int unused;    /* with a vertex that no triangle has */
    int meshes;    /* 1, or 2 with a triangle each */
    int moved;     /* placed by a transform */
    int materials; /* 1: opaque, with a texture that is not read */
    int turned;    /* the second triangle starts at another corner */
};

static void hash_of_square(const struct writing *how, uint8_t hash[UMB_ID_BYTES])
{
    static const double square[4][3] = {{0, 0, 1}, {8, 0, 1}, {8, 8, 1}, {0, 8, 1}};
    static const uint32_t corners[2][3] = {{0, 1, 2}, {0, 2, 3}};
    static const double identity[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    struct umbs_scene_builder builder;
    struct bytes bytes = {0};
    const struct umb_sink sink = {append_bytes, &bytes};
    struct umbs_scene_view view;
    umbs_scene_builder_init(&builder, UMBS_FORMAT_OBJ, 1, 0);
    uint32_t vertices = 0, first = 0;
    for (; how->shared && vertices < 4; vertices++) {
        assert_int_equal(umbs_scene_add_vertex(&builder, square[vertices], NULL, NULL), 0);
    }
    if (how->unused) {
        assert_int_equal(umbs_scene_add_vertex(&builder, square[2], NULL, NULL), 0);
        first = how->shared ? 0 : 1;
        vertices++;
    }
    if (how->materials) {
        struct umbs_material material = umbs_material_opaque();
        material.double_sided = 1;
        material.base_alpha = 0.5F;
        assert_int_equal(umbs_scene_add_material(&builder, &material, NULL), 0);
    }
    for (uint32_t t = 0; t < 2; t++) {
        uint32_t own[3];
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t corner = corners[t][t == 1 && how->turned ? (k + 1) % 3 : k];
            double at[3];
            memcpy(at, square[corner], sizeof at);
            at[0] -= how->moved ? 5 : 0;
            own[k] = how->shared ? corner : vertices - first;
            if (!how->shared) {
                assert_int_equal(umbs_scene_add_vertex(&builder, at, NULL, NULL), 0);
                vertices++;
            }
        }
        assert_int_equal(umbs_scene_add_triangle(&builder, own, NULL), 0);
        if (t == 1 || how->meshes == 2) {
            assert_int_equal(umbs_scene_end_mesh(&builder, first, vertices - first,
                                                 how->meshes == 2 ? 1 : 2,
                                                 how->materials ? 0 : UMBS_NO_INDEX, NULL),
                             0);
            first = how->shared ? 0 : vertices;
        }
    }
    for (int mesh = 0; mesh < how->meshes; mesh++) {
        double place[3][4];
        memcpy(place, identity, sizeof place);
        place[0][3] = how->moved ? 5 : 0;
        assert_int_equal(
            umbs_scene_add_instance(&builder, (uint32_t)mesh, (const double(*)[4])place, NULL), 0);
    }
    assert_int_equal(umbs_scene_builder_write(&builder, &sink, NULL), UMB_OK);
    assert_int_equal(umbs_scene_view(bytes.data, bytes.size, &view, NULL), UMB_OK);
    umbs_scene_hash(&view, hash);
    umbs_scene_builder_finish(&builder);
    free(bytes.data);
}

static void hash_is_of_the_triangles_and_not_of_how_they_are_written(void **state)
{
    (void)state;
    static const struct writing same[] = {
        {.shared = 0, .meshes = 1},
        {.shared = 1, .unused = 1, .meshes = 1},
        {.shared = 0, .unused = 1, .meshes = 1},
        {.shared = 1, .meshes = 2},
        {.shared = 0, .meshes = 2},
        {.shared = 0, .meshes = 2, .moved = 1},
        {.shared = 1, .meshes = 1, .materials = 1},
    };
    const struct writing plain = {.shared = 1, .meshes = 1};
    const struct writing turned = {.shared = 1, .meshes = 1, .turned = 1};
    uint8_t base[UMB_ID_BYTES], other[UMB_ID_BYTES];
    hash_of_square(&plain, base);
    for (size_t i = 0; i < sizeof same / sizeof same[0]; i++) {
        hash_of_square(&same[i], other);
        assert_memory_equal(base, other, sizeof base);
    }
    hash_of_square(&turned, other); /* The hash keeps the file's order: meshes flattened in another
                                       order have another hash. */
    assert_memory_not_equal(base, other, sizeof base);
}

static void builder_refuses_more_triangles_than_allowed(void **state)
{
    (void)state;
    struct umbs_scene_builder builder;
    struct umb_error error = {0};
    static const uint32_t corners[3] = {0, 0, 0};
    static const double origin[3] = {0, 0, 0};
    umbs_scene_builder_init(&builder, UMBS_FORMAT_OBJ, 1, 3);
    assert_int_equal(umbs_scene_add_vertex(&builder, origin, NULL, &error), UMB_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(umbs_scene_add_triangle(&builder, corners, &error), UMB_OK);
    }
    assert_int_equal(umbs_scene_end_mesh(&builder, 0, 1, 2, UMBS_NO_INDEX, &error), UMB_OK);
    assert_int_equal(umbs_scene_add_instance(&builder, 0, NULL, &error), UMB_OK);
    assert_int_equal(umbs_scene_add_instance(&builder, 0, NULL, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "limit 3"));
    assert_int_equal(umbs_scene_add_triangle(&builder, corners, &error), UMB_OK);
    assert_int_equal(umbs_scene_add_triangle(&builder, corners, &error), UMB_E_LIMIT);
    umbs_scene_builder_finish(&builder);
}

static void text_is_cleaned_to_utf8_without_controls(void **state)
{
    (void)state;
    static const struct {
        const char *in, *out;
    } cases[] = {
        {"plain", "plain"},
        {"a\tb\nc\x7f\x1b[31m", "a?b?c??[31m"},
        {"gr\xc3\xbcn \xe2\x82\xac \xf0\x9f\x8c\xb3", "gr\xc3\xbcn \xe2\x82\xac \xf0\x9f\x8c\xb3"},
        /* broken, broken, overlong, surrogate, cut off */
        {"\xff\xc3"
         "a"
         "\xc0\xaf\xed\xa0\x80\xe2\x82",
         "??a???????"},
        {"\xc2\x9b"
         "0m",
         "??0m"}, /* U+009B starts an escape sequence */
        {"12345678901234567890", "123456789012345"},
        {"12345678901234\xc3\xbc", "12345678901234"}, /* never half a character */
    };
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        char out[16];
        memset(out, 'x', sizeof(out));
        umbs_text_clean(out, sizeof(out), cases[i].in, strlen(cases[i].in));
        assert_string_equal(out, cases[i].out);
        assert_true(umbs_text_is_clean(out, strlen(out), 0));
        for (size_t k = strlen(out); k < sizeof(out); k++) {
            assert_int_equal(out[k], 0);
        }
    }
    assert_false(umbs_text_is_clean("a\nb", 3, 0));
    assert_true(umbs_text_is_clean("a\nb", 3, 1));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(builder_and_view_agree_on_every_section),
        cmocka_unit_test(flatten_multiplies_instances_and_turns_mirrored_ones),
        cmocka_unit_test(view_rejects_every_prefix),
        cmocka_unit_test(view_survives_every_field_replaced),
        cmocka_unit_test(view_names_the_field_it_refuses),
        cmocka_unit_test(hash_follows_content_and_not_names),
        cmocka_unit_test(what_only_pictures_need_is_not_hashed),
        cmocka_unit_test(hash_is_of_the_triangles_and_not_of_how_they_are_written),
        cmocka_unit_test(builder_refuses_more_triangles_than_allowed),
        cmocka_unit_test(text_is_cleaned_to_utf8_without_controls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
