/* SPDX-License-Identifier: Apache-2.0 */
/* Packing an asset again: what is said when the id is another. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "cli/cli_repack.h"
#include "make_asset.h"

static void another_id_is_damage_or_a_file_of_another_version(void **state)
{
    static const uint32_t log2_size = 6;
    static const double origin[3] = {0, 0, 0};
    const struct voxels voxels = {random_voxel, &log2_size, 6, 1};
    struct bytes packed = make_packed(&voxels, 0.5, origin), mapped = make_mapped(&packed);
    struct umb_asset *asset;
    struct umb_error error;
    (void)state;
    assert_int_equal(umb_asset_open_bytes(mapped.data, mapped.size, NULL, &asset, NULL), UMB_OK);
    /* The harness's digest is no SHA-256, so that the id is another. */
    assert_int_equal(umbc_repack(asset, NULL, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "id: the content has "));
    assert_non_null(strstr(error.message, "damaged or of another version"));
    assert_in_range(strlen(error.message), 0, 200); /* a file's name goes before it */
    umb_asset_close(asset);
    bytes_finish(&packed);
    bytes_finish(&mapped);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(another_id_is_damage_or_a_file_of_another_version),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
