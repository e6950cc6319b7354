/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of umbrage/file.h: converting assets, proving ids, mapping a file, reading its first
 * bytes. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "make_asset.h"
#include "umbrage/file.h"

static struct bytes packed, mapped;

static int setup(void **state)
{
    static const uint32_t log2_size = 6;
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {random_voxel, &log2_size, 6, 1};
    (void)state;
    packed = make_packed(&voxels, 0.5, origin);
    mapped = make_mapped(&packed);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    bytes_finish(&packed);
    bytes_finish(&mapped);
    return 0;
}

static struct umb_asset *open_one(const struct bytes *file)
{
    struct umb_asset *asset;
    assert_int_equal(umb_asset_open_bytes(file->data, file->size, NULL, &asset, NULL), UMB_OK);
    return asset;
}

static void either_encoding_is_written_from_either(void **state)
{
    const struct bytes *files[] = {&packed, &mapped};
    (void)state;
    for (unsigned from = 0; from < 2; from++) {
        struct umb_asset *asset = open_one(files[from]);
        for (unsigned to = 0; to < 2; to++) {
            const enum umb_encoding encoding = to ? UMB_ENCODING_MAPPED : UMB_ENCODING_PACKED;
            struct bytes out = {0};
            const struct umb_sink sink = bytes_sink(&out);
            assert_int_equal(umb_asset_write(asset, encoding, &test_digest, &sink, NULL), UMB_OK);
            assert_int_equal(out.size, files[to]->size);
            assert_memory_equal(out.data, files[to]->data, out.size);
            bytes_finish(&out);
        }
        assert_int_equal(umb_asset_prove(asset, &test_digest, NULL), UMB_OK);
        umb_asset_close(asset);
    }
}

/* A hash that is neither SHA-256 nor the harness's, so that every id differs. */
static void another_digest(void *user, const void *const *parts, const size_t *sizes,
                           size_t part_count, uint8_t out[UMB_ID_BYTES])
{
    test_digest.digest(user, parts, sizes, part_count, out);
    out[0] ^= 1;
}

static void another_id_is_damage_or_a_file_of_another_version(void **state)
{
    const struct umb_sha256 another = {.digest = another_digest};
    struct umb_asset *asset = open_one(&mapped);
    struct umb_error error;
    (void)state;
    assert_int_equal(umb_asset_prove(asset, &another, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "id: the content has "));
    assert_non_null(strstr(error.message, "damaged or of another version"));
    assert_in_range(strlen(error.message), 0, 200); /* a file's name goes before it */
    umb_asset_close(asset);
}

static void what_cannot_be_written_or_proven_is_named(void **state)
{
    struct umb_asset *asset = open_one(&packed);
    struct bytes out = {0};
    const struct umb_sink sink = bytes_sink(&out);
    struct umb_error error;
    (void)state;
    assert_int_equal(umb_asset_write(asset, (enum umb_encoding)7, &test_digest, &sink, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "encoding: 7"));
    assert_int_equal(umb_asset_write(asset, UMB_ENCODING_PACKED, NULL, &sink, &error),
                     UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "sha256"));
    assert_int_equal(umb_asset_prove(asset, NULL, &error), UMB_E_ARGUMENT);
    assert_int_equal(umb_packed_prove(packed.data, packed.size, NULL, NULL, &error),
                     UMB_E_ARGUMENT);
    assert_int_equal(out.size, 0);
    assert_int_equal(umb_asset_write(asset, UMB_ENCODING_MAPPED, NULL, &sink, &error), UMB_OK);
    bytes_finish(&out);
    umb_asset_close(asset);
}

static void proof_of_packed_bytes_asks_for_an_id(void **state)
{
    uint8_t id[UMB_ID_BYTES];
    struct umb_asset_info info;
    struct umb_asset *asset = open_one(&packed);
    struct umb_error error;
    (void)state;
    umb_asset_get_info(asset, &info);
    memcpy(id, info.id, sizeof id);
    umb_asset_close(asset);
    assert_int_equal(umb_packed_prove(packed.data, packed.size, id, &test_digest, NULL), UMB_OK);
    assert_int_equal(umb_packed_prove(packed.data, packed.size, NULL, &test_digest, NULL), UMB_OK);
    id[31] ^= 1;
    assert_int_equal(umb_packed_prove(packed.data, packed.size, id, &test_digest, &error),
                     UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "asked for was "));
    assert_int_equal(umb_packed_prove(mapped.data, mapped.size, NULL, &test_digest, NULL),
                     UMB_E_UNSUPPORTED);
}

static void the_first_bytes_say_what_the_file_is(void **state)
{
    struct umb_file_head head;
    struct umb_asset_info info;
    struct umb_asset *asset = open_one(&mapped);
    uint8_t *exact = malloc(UMB_FILE_HEAD_BYTES); /* ASan sees the first byte too many */
    (void)state;
    umb_asset_get_info(asset, &info);
    assert_non_null(exact);
    const struct bytes *files[] = {&packed, &mapped};
    for (unsigned i = 0; i < 2; i++) {
        memcpy(exact, files[i]->data, UMB_FILE_HEAD_BYTES);
        assert_int_equal(umb_file_read_head(exact, UMB_FILE_HEAD_BYTES, &head, NULL), UMB_OK);
        assert_int_equal(head.encoding, i ? UMB_ENCODING_MAPPED : UMB_ENCODING_PACKED);
        assert_memory_equal(head.id, info.id, UMB_ID_BYTES);
        assert_int_equal(head.file_bytes, files[i]->size);
        assert_in_range(head.open_bytes, UMB_FILE_HEAD_BYTES, files[i]->size);
        assert_int_equal(umb_file_read_head(exact, UMB_FILE_HEAD_BYTES - 1, &head, NULL),
                         UMB_E_TRUNCATED);
    }
    memset(exact, 0, UMB_FILE_HEAD_BYTES);
    assert_int_equal(umb_file_read_head(exact, UMB_FILE_HEAD_BYTES, &head, NULL), UMB_E_FORMAT);
    free(exact);
    umb_asset_close(asset);
}

static void a_file_is_mapped_and_a_folder_is_not(void **state)
{
    char path[] = "/tmp/umbrage-file-XXXXXX";
    struct umb_file file;
    (void)state;
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_int_equal(umb_file_open(path, &file, NULL), UMB_E_TRUNCATED);
    assert_null(file.bytes);
    assert_int_equal(write(fd, packed.data, packed.size), packed.size);
    assert_int_equal(umb_file_open(path, &file, NULL), UMB_OK);
    assert_int_equal(file.size, packed.size);
    assert_memory_equal(file.bytes, packed.data, packed.size);
    umb_file_close(&file);
    assert_null(file.bytes);
    umb_file_close(&file);
    (void)close(fd);
    (void)unlink(path);
    assert_int_equal(umb_file_open(path, &file, NULL), UMB_E_NO_INPUT);
    assert_int_equal(umb_file_open("/tmp", &file, NULL), UMB_E_NO_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(either_encoding_is_written_from_either),
        cmocka_unit_test(another_id_is_damage_or_a_file_of_another_version),
        cmocka_unit_test(what_cannot_be_written_or_proven_is_named),
        cmocka_unit_test(proof_of_packed_bytes_asks_for_an_id),
        cmocka_unit_test(the_first_bytes_say_what_the_file_is),
        cmocka_unit_test(a_file_is_mapped_and_a_folder_is_not),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
