/* SPDX-License-Identifier: Apache-2.0 */
/* PLY: three encodings, all types, exact doubles, hostile counts, truncation. */
#include "import_try.h"

#include <math.h>
#include <time.h>

static void ply_text_keeps_doubles_exactly(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_text("text.ply", "ply\nformat ascii 1.0\ncomment by hand\nobj_info x\n"
                                "element vertex 4\nproperty double x\nproperty uchar red\n"
                                "property double y\nproperty double z\nproperty float s\n"
                                "property float t\nelement face 2\nproperty uchar flags\n"
                                "property list uchar int vertex_indices\n"
                                "property list uchar float other\nend_header\n"
                                "84616.468000001 255 447423.0123456789 0.1 0.5 0.25\n"
                                "1 0 2 3 0 0\n4 0 5 6 0 0\n7 0 8 9 1 1\n"
                                "0 3 0 1 2 2 9 9\n1 4 0 1 2 3 0\n");
    assert_int_equal(scene->view.triangle_count, 3);
    assert_int_equal(scene->view.z_up, 1);
    assert_non_null(scene->view.uvs);
    assert_true(scene->view.uvs[0][0] == 0.5F && scene->view.uvs[0][1] == 0.25F);
    expect_corner(scene, 0, 0, 84616.468000001, 447423.0123456789, 0.1);
    expect_corner(scene, 0, 2, 4, 5, 6);
    umbs_scene_destroy(scene);
}

/* Writes numbers of any type in either order. */
struct writer {
    unsigned char bytes[1024];
    size_t size;
    int big;
};

static void ply_pictures_get_normals(void **state)
{
    (void)state;
    struct umbs_scene *scene =
        import_look("look.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\n"
                                "property double y\nproperty double z\nproperty float nx\n"
                                "property float ny\nproperty float nz\nelement face 1\n"
                                "property list uchar int vertex_indices\nend_header\n"
                                "0 0 0 0 0 0\n1 0 0 0 3 4\n0 1 0 0 0 -2\n3 0 1 2\n");
    expect_normal(scene, 0, 0, 0, 0, 0);
    expect_normal(scene, 0, 1, 0, 0.6, 0.8);
    expect_normal(scene, 0, 2, 0, 0, -1);
    umbs_scene_destroy(scene);
}

static void put_bits(struct writer *writer, uint64_t bits, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        size_t place = writer->big ? count - 1 - i : i;
        writer->bytes[writer->size++] = (unsigned char)(bits >> (8 * place));
    }
}

static void put_double(struct writer *writer, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof(bits));
    put_bits(writer, bits, 8);
}

static void put_float(struct writer *writer, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof(bits));
    put_bits(writer, bits, 4);
}

static void put_text(struct writer *writer, const char *text)
{
    memcpy(writer->bytes + writer->size, text, strlen(text));
    writer->size += strlen(text);
}

/* x double, y float, z int16; a list among the vertex's properties; faces before vertices; an
 * unknown element. Offsets of the items are the reader's business. */
static void write_binary(struct writer *writer, int big)
{
    memset(writer, 0, sizeof(*writer));
    writer->big = big;
    put_text(writer, "ply\r\nformat binary_");
    put_text(writer, big ? "big" : "little");
    put_text(writer, "_endian 1.0\nelement face 2\nproperty list uint16 uint8 vertex_index\n"
                     "property int8 id\nelement odd 1\nproperty list int32 float64 values\n"
                     "element vertex 3\nproperty float64 x\nproperty list uint8 uint16 skip\n"
                     "property float32 y\nproperty short z\nproperty uint n\nend_header\n");
    for (uint64_t face = 0; face < 2; face++) {
        put_bits(writer, 3, 2);
        for (uint64_t k = 0; k < 3; k++) {
            put_bits(writer, face == 0 ? k : 7 * k, 1); /* the second has bad indices */
        }
        put_bits(writer, 0xff, 1);
    }
    put_bits(writer, 2, 4);
    put_double(writer, 1.0);
    put_double(writer, 2.0);
    for (int i = 0; i < 3; i++) {
        put_double(writer, 0.1 * i + 1e6);
        put_bits(writer, (uint64_t)i, 1);
        put_bits(writer, 0xabcdabcd, (size_t)i * 2);
        put_float(writer, 0.5F * (float)i);
        put_bits(writer, (uint64_t)(int64_t)(-5 * i), 2);
        put_bits(writer, 0xffffffff, 4);
    }
}

static void ply_binary_of_both_orders_reads_all_types(void **state)
{
    (void)state;
    for (int big = 0; big < 2; big++) {
        struct writer writer;
        struct umbs_scene *scene;
        struct umb_error error;
        write_binary(&writer, big);
        enum umb_status status = try_bytes("binary.ply", writer.bytes, writer.size, &scene, &error);
        assert_string_equal(error.message, "");
        assert_int_equal(status, UMB_OK);
        assert_int_equal(scene->view.triangle_count, 1);
        assert_int_equal(scene->view.dropped_faces, 1);
        expect_corner(scene, 0, 0, 1e6, 0, 0);
        expect_corner(scene, 0, 1, 0.1 + 1e6, 0.5, -5);
        expect_corner(scene, 0, 2, 0.2 + 1e6, 1.0, -10);
        umbs_scene_destroy(scene);
    }
}

static void ply_that_is_cut_off_is_refused(void **state)
{
    (void)state;
    struct writer writer;
    write_binary(&writer, 0);
    for (size_t size = 0; size < writer.size; size++) {
        assert_int_equal(read_here(umbb_ply_read, writer.bytes, size), UMB_E_BAD_SCENE);
    }
    assert_int_equal(read_here(umbb_ply_read, writer.bytes, writer.size), UMB_OK);
}

static void ply_reader_survives_random_changes(void **state)
{
    (void)state;
    uint64_t seed = (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (int round = 0; round < 4000; round++) {
        struct writer writer;
        write_binary(&writer, round % 2);
        for (int i = 0; i < 2; i++) {
            seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
            writer.bytes[(seed >> 33) % writer.size] = (unsigned char)(seed >> 56);
        }
        (void)read_here(umbb_ply_read, writer.bytes, writer.size);
    }
}

static void ply_counts_meet_the_bytes_left_before_any_memory(void **state)
{
    (void)state;
    static const char head[] = "ply\nformat binary_little_endian 1.0\n";
    char text[512];
    (void)snprintf(text, sizeof(text),
                   "%selement vertex 4000000000\nproperty float x\nproperty float y\n"
                   "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                   "end_header\n",
                   head);
    expect_refusal("vertices.ply", text, "element 'vertex' has count 4000000000, but only 0 bytes");
    (void)snprintf(text, sizeof(text),
                   "%selement nothing 99999999999999\nelement vertex 1\nproperty uchar x\n"
                   "property uchar y\nproperty uchar z\nelement face 1000000\n"
                   "property list uchar int vertex_indices\nend_header\nabc",
                   head);
    expect_refusal("faces.ply", text, "element 'face' has count 1000000");
    expect_refusal("list.ply",
                   "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\n"
                   "property uchar y\nproperty uchar z\nelement face 1\n"
                   "property list uint uint vertex_indices\nend_header\nabc\xff\xff\xff\xff",
                   "element 'face', item 1 of 1");
}

static void ply_headers_that_are_wrong_name_the_line(void **state)
{
    (void)state;
    expect_refusal("a.ply", "ply\nformat ascii 2.0\n", "header line 2: unknown format");
    expect_refusal("b.ply", "ply\nformat ascii 1.0\nproperty int x\n", "line 3: property before");
    expect_refusal("c.ply", "ply\nformat ascii 1.0\nelement vertex -1\n", "line 3: element");
    expect_refusal("d.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n",
                   "line 4: property of an unknown type");
    expect_refusal("e.ply", "ply\nformat ascii 1.0\nelement vertex 1\n", "no end_header");
    expect_refusal("f.ply", "ply\nelement vertex 1\nend_header\n", "no format line");
    expect_refusal("g.ply", "ply\nformat ascii 1.0\nnonsense\n", "line 3: unknown keyword");
    expect_refusal("h.ply", "PLY\n", "'ply' is missing");
    expect_refusal("i.ply",
                   "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 1\n"
                   "property list uchar int vertex_indices\nend_header\n0\n3 0 0 0\n",
                   "element 'vertex' has no x, y and z");
}

static void ply_without_triangles_says_why(void **state)
{
    (void)state;
    expect_refusal("none.ply", "ply\nformat ascii 1.0\nend_header\n", "no vertices and no faces");
    expect_refusal("cloud.ply",
                   "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                   "property float z\nend_header\n0 0 0\n1 1 1\n",
                   "2 vertices and no faces");
    expect_refusal("nan.ply",
                   "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                   "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                   "end_header\n0 nan 0\n3 0 0 0\n",
                   "none of 1 faces can be used");
}

int main(int argc, char **argv)
{
    if (is_import_child(argc, argv)) {
        return umbb_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_text_keeps_doubles_exactly),
        cmocka_unit_test(ply_pictures_get_normals),
        cmocka_unit_test(ply_binary_of_both_orders_reads_all_types),
        cmocka_unit_test(ply_that_is_cut_off_is_refused),
        cmocka_unit_test(ply_reader_survives_random_changes),
        cmocka_unit_test(ply_counts_meet_the_bytes_left_before_any_memory),
        cmocka_unit_test(ply_headers_that_are_wrong_name_the_line),
        cmocka_unit_test(ply_without_triangles_says_why),
    };
    return cmocka_run_group_tests(tests, make_try_folder, remove_try_folder);
}
