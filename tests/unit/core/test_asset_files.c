/* SPDX-License-Identifier: Apache-2.0 */
/* Packed and mapped files: content survives round trips, and every kind of damage is refused. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "base/open_status.h"
#include "make_asset.h"
#include "umbrage/query.h"
#include "tool/exit_code.h"

static const double far_origin[3] = {84616.5, 447423.25, -3};

/* Bumpy columns: lit above a height that is computed from hashes of coarse and fine cells. */
static int bumpy(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    uint64_t coarse = (x / 16 * 73856093U) ^ (y / 16 * 19349663U) ^ (frustum * 83492791U);
    uint64_t fine = (x * 2654435761U) ^ (y * 40503U);
    uint32_t size = 1U << *(const uint32_t *)user;
    uint32_t height = (uint32_t)(coarse % (size - 8)) + (uint32_t)(fine >> 7) % 5;
    return z < height;
}

static struct bytes bumpy_file(uint32_t log2_size, uint32_t lights)
{
    struct voxels voxels = {bumpy, &log2_size, log2_size, lights};
    return make_packed(&voxels, 0.5, far_origin);
}

static enum umb_status try_open(const uint8_t *bytes, size_t size)
{
    struct umb_asset *asset;
    struct umb_error error = {0};
    struct umb_open_options options = {.max_memory_bytes = (uint64_t)1 << 28};
    enum umb_status status = umb_asset_open_bytes(bytes, size, &options, &asset, &error);
    assert_true((status == UMB_OK) == (asset != NULL));
    if (status != UMB_OK) {
        assert_int_equal(error.status, status);
        assert_true(strlen(error.message) > 10);
    }
    umb_asset_close(asset);
    return status;
}

/* A block of exactly `size` bytes, so that a sanitizer sees every read beyond it. */
static uint8_t *exact_copy(const uint8_t *bytes, size_t size)
{
    uint8_t *end = malloc(size ? size : 1);
    assert_non_null(end);
    memcpy(end, bytes, size);
    return end;
}

static void every_voxel_survives_packing_and_mapping(void **state)
{
    (void)state;
    for (uint32_t log2_size = 6; log2_size <= 8; log2_size++) {
        struct bytes packed = bumpy_file(log2_size, 3);
        struct bytes mapped = make_mapped(&packed);
        const struct bytes *files[2] = {&packed, &mapped};
        uint32_t size = 1U << log2_size;
        for (size_t f = 0; f < 2; f++) {
            struct umb_asset *asset;
            assert_int_equal(
                umb_asset_open_bytes(files[f]->data, files[f]->size, NULL, &asset, NULL), UMB_OK);
            for (uint32_t light = 0; light < 3; light++) {
                struct umb_query_settings settings = {
                    .light = light, .bias_mode = UMB_BIAS_NONE, .format = UMB_ANSWER_U8};
                struct umb_query query;
                assert_int_equal(umb_query_prepare(asset, &settings, &query, NULL), UMB_OK);
                for (uint32_t i = 0; i < size * size; i++) {
                    uint32_t x = i % size, y = i / size;
                    double points[256][3];
                    uint8_t values[256];
                    for (uint32_t z = 0; z < size; z++) {
                        points[z][0] = (x + 0.5) * 0.5;
                        points[z][1] = (y + 0.5) * 0.5;
                        points[z][2] = (z + 0.5) * 0.5;
                    }
                    struct umb_points batch = {.positions = points,
                                               .format = UMB_POINT_F64,
                                               .origin = {84616.5, 447423.25, -3},
                                               .count = size};
                    struct umb_answers answers = {.values = values};
                    umb_query_run(&query, &batch, 0, size, &answers);
                    for (uint32_t z = 0; z < size; z++) {
                        assert_int_equal(values[z], bumpy(&log2_size, light, x, y, z) ? 255 : 0);
                    }
                }
            }
            umb_asset_close(asset);
        }
        bytes_finish(&packed);
        bytes_finish(&mapped);
    }
}

static void exporting_and_packing_again_gives_the_same_bytes(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(8, 2), mapped = make_mapped(&packed);
    const struct bytes *files[2] = {&packed, &mapped};
    for (size_t f = 0; f < 2; f++) {
        struct umb_asset *asset;
        struct umb__octree octree;
        struct umb__content content;
        struct bytes again = {0};
        struct umb_sink sink = bytes_sink(&again);
        uint8_t id[UMB_ID_BYTES];
        assert_int_equal(umb_asset_open_bytes(files[f]->data, files[f]->size, NULL, &asset, NULL),
                         UMB_OK);
        assert_int_equal(umb__asset_export(asset, &octree, &content, NULL), UMB_OK);
        assert_int_equal(umb__pack_write(&content, &octree, &test_digest, &sink, id, NULL), UMB_OK);
        assert_int_equal(again.size, packed.size);
        assert_memory_equal(again.data, packed.data, packed.size);
        umb__octree_finish(&octree);
        umb_asset_close(asset);
        bytes_finish(&again);
    }
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void every_prefix_of_a_packed_file_is_refused(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(6, 1);
    for (size_t size = 0; size < packed.size; size++) {
        uint8_t *prefix = exact_copy(packed.data, size);
        assert_int_not_equal(try_open(prefix, size), UMB_OK);
        free(prefix);
    }
    assert_int_equal(try_open(packed.data, packed.size), UMB_OK);
    bytes_finish(&packed);
}

static size_t head_length(const struct bytes *file)
{
    uint64_t length;
    memcpy(&length, file->data + 24, sizeof length);
    return (size_t)length;
}

static void every_flipped_bit_of_a_packed_file_is_refused(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(6, 1);
    uint8_t *copy = exact_copy(packed.data, packed.size);
    for (size_t bit = 0; bit < packed.size * 8; bit++) {
        copy[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        assert_int_not_equal(try_open(copy, packed.size), UMB_OK);
        copy[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    }
    free(copy);
    bytes_finish(&packed);
}

static void flipped_bits_of_a_mapped_file_are_refused(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(6, 1), mapped = make_mapped(&packed);
    size_t head = head_length(&mapped);
    uint64_t seed = 42;
    for (size_t k = 0; k < head * 8 + 4000; k++) {
        /* Flips every bit of the head, then a sample of the others. Padding between sections is not
         * tested here. */
        size_t bit = k < head * 8 ? k : head * 8 + next_random(&seed) % ((mapped.size - head) * 8);
        mapped.data[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        enum umb_status status = try_open(mapped.data, mapped.size);
        if (k < head * 8) {
            assert_int_not_equal(status, UMB_OK);
        }
        mapped.data[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    }
    assert_int_equal(try_open(mapped.data, mapped.size), UMB_OK);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void prefixes_of_a_mapped_file_are_refused(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(6, 1), mapped = make_mapped(&packed);
    for (size_t size = 0; size < mapped.size; size += size < 2048 ? 1 : 509) {
        assert_int_not_equal(try_open(mapped.data, size), UMB_OK);
    }
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

static void proof_finds_a_page_that_is_not_what_its_hash_says(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(7, 1);
    assert_int_equal(umb_packed_prove(packed.data, packed.size, NULL, &test_digest, NULL), UMB_OK);
    packed.data[packed.size - 1] ^= 0x10;
    assert_int_equal(umb_packed_prove(packed.data, packed.size, NULL, &test_digest, NULL),
                     UMB_E_CORRUPT);
    bytes_finish(&packed);
}

static void memory_limit_is_respected(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(8, 1);
    struct umb_asset *asset;
    struct umb_error error;
    struct umb_open_options options = {.max_memory_bytes = 4096};
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, &options, &asset, &error),
                     UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "4096"));
    bytes_finish(&packed);
}

/* Fails the n-th allocation, once or from then on. */
struct failing {
    size_t calls, fail_at;
    int for_ever;
    size_t live;
};

static void *failing_resize(void *user, void *block, size_t bytes)
{
    struct failing *f = user;
    if (bytes == 0) {
        f->live -= block != NULL;
        free(block);
        return NULL;
    }
    f->calls++;
    if (f->calls == f->fail_at || (f->for_ever && f->calls > f->fail_at && f->fail_at)) {
        return NULL;
    }
    void *result = realloc(block, bytes);
    f->live += result != NULL && block == NULL;
    return result;
}

static void every_failing_allocation_is_reported_and_nothing_leaks(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(6, 1);
    struct failing f = {0};
    struct umb_alloc alloc = {failing_resize, &f};
    struct umb_open_options options = {.alloc = &alloc};
    struct umb_asset *asset;
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, &options, &asset, NULL),
                     UMB_OK);
    umb_asset_close(asset);
    size_t total = f.calls;
    assert_int_equal(f.live, 0);
    assert_true(total > 10);
    for (size_t n = 1; n <= 2 * total; n++) {
        f = (struct failing){.fail_at = (n + 1) / 2, .for_ever = (int)(n % 2)};
        assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, &options, &asset, NULL),
                         UMB_E_NO_MEMORY);
        assert_int_equal(f.live, 0);
    }
    bytes_finish(&packed);
}

static void info_says_what_was_written(void **state)
{
    (void)state;
    struct bytes packed = bumpy_file(7, 2);
    struct umb_asset *asset;
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_frustum_info frustum;
    assert_int_equal(umb_asset_open_bytes(packed.data, packed.size, NULL, &asset, NULL), UMB_OK);
    umb_asset_get_info(asset, &info);
    assert_int_equal(info.light_count, 2);
    assert_int_equal(info.frustum_count, 2);
    assert_int_equal(info.file_bytes, packed.size);
    assert_memory_equal(info.origin, far_origin, sizeof far_origin);
    assert_non_null(strstr(info.plan, "effect=closed"));
    assert_string_equal(info.notes, "writer=test\n");
    assert_true(info.level_nodes[3] > 0);
    assert_int_equal(umb_asset_get_light(asset, 1, &light), UMB_OK);
    assert_string_equal(light.name, "sun1");
    assert_int_equal(umb_asset_get_light(asset, 2, &light), UMB_E_NOT_FOUND);
    assert_int_equal(umb_asset_get_frustum(asset, 1, &frustum), UMB_OK);
    assert_true(frustum.voxel_step[2][2] == 0.5);
    umb_asset_close(asset);
    bytes_finish(&packed);
}

static void opening_tells_missing_from_forbidden_from_exhausted(void **state)
{
    (void)state;
    struct umb_asset *asset;
    struct umb_error error;
    struct rlimit limit, none;
    assert_int_equal(umb_asset_open_file("/nonexistent/x.umb", NULL, &asset, &error),
                     UMB_E_NO_INPUT);
    assert_int_equal(umb_asset_open_file("/dev/null/x.umb", NULL, &asset, &error), UMB_E_NO_INPUT);
    assert_int_equal(umb_asset_open_file("/tmp", NULL, &asset, &error), UMB_E_NO_INPUT);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    none = limit;
    none.rlim_cur = 0;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    enum umb_status status = umb_asset_open_file("/tmp", NULL, &asset, &error);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    assert_int_equal(status, UMB_E_LIMIT);
    assert_int_equal(umbu_exit_code(umb__open_status(EACCES)), 77);
    assert_int_equal(umbu_exit_code(umb__open_status(EIO)), 74);
    assert_int_equal(umbu_exit_code(umb__open_status(ELOOP)), 74);
    assert_int_equal(umbu_exit_code(umb__open_status(ENOENT)), 66);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_voxel_survives_packing_and_mapping),
        cmocka_unit_test(exporting_and_packing_again_gives_the_same_bytes),
        cmocka_unit_test(every_prefix_of_a_packed_file_is_refused),
        cmocka_unit_test(every_flipped_bit_of_a_packed_file_is_refused),
        cmocka_unit_test(flipped_bits_of_a_mapped_file_are_refused),
        cmocka_unit_test(prefixes_of_a_mapped_file_are_refused),
        cmocka_unit_test(proof_finds_a_page_that_is_not_what_its_hash_says),
        cmocka_unit_test(memory_limit_is_respected),
        cmocka_unit_test(every_failing_allocation_is_reported_and_nothing_leaks),
        cmocka_unit_test(info_says_what_was_written),
        cmocka_unit_test(opening_tells_missing_from_forbidden_from_exhausted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
