/* SPDX-License-Identifier: Apache-2.0 */
/* The result of a bake is accepted as an asset only if it is one, complete, and not too large. */
#undef _FORTIFY_SOURCE /* read is defined here, not taken from its inline form */
#define _GNU_SOURCE    /* syscall */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "common/sha256.h"
#include "jobs/folder.h"
#include "jobs/staging.h"
#include "make_asset.h"

static int stepped(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    return z < 20 + (x ^ y) % 16;
}

static int fail_sync, change_write, interrupt_reads; /* what goes wrong */

#define CAUGHT __attribute__((visibility("default")))

CAUGHT int fsync(int fd)
{
    (void)fd;
    errno = EIO;
    return fail_sync ? -1 : 0;
}

CAUGHT ssize_t write(int fd, const void *bytes, size_t count)
{
    uint8_t other = 0;
    if (change_write && count > 0) { /* a disk that keeps something else */
        memcpy(&other, bytes, 1);
        other ^= 1;
        bytes = &other;
        count = 1;
        change_write = 0;
    }
    return (ssize_t)syscall(SYS_write, fd, bytes, count);
}

CAUGHT ssize_t read(int fd, void *bytes, size_t count)
{
    if (interrupt_reads > 0 && interrupt_reads-- > 0) {
        errno = EINTR;
        return -1;
    }
    return (ssize_t)syscall(SYS_read, fd, bytes, count);
}

struct fixture {
    char folder[64], path[96];
    struct bytes packed;
};

static void put_file(const struct fixture *f, size_t size)
{
    FILE *file = fopen(f->path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(f->packed.data, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static int setup(void **state)
{
    static const double origin[3] = {0, 0, 0};
    struct voxels voxels = {.lit = stepped, .log2_size = 6, .frustum_count = 1};
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    snprintf(f->folder, sizeof f->folder, "/tmp/umbrage-staging-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->path, sizeof f->path, "%s/out.umb", f->folder);
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    struct umb_sink sink = bytes_sink(&f->packed);
    make_octree(&voxels, &octree);
    make_content(&voxels, 1.0, origin, &content);
    assert_int_equal(umb__pack_write(&content, &octree, &umbs_sha256, &sink, id, NULL), UMB_OK);
    umb__octree_finish(&octree);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    bytes_finish(&f->packed);
    umbj_folder_remove(AT_FDCWD, f->folder);
    free(f);
    return 0;
}

static enum umb_status stage(const struct fixture *f, uint64_t most, struct umb_error *error)
{
    struct umbu_output staged;
    uint8_t asset[UMBJ_HASH_BYTES];
    const enum umb_status status = umbj_stage(f->path, most, f->folder, &staged, asset, error);
    assert_int_equal(staged.temporary != NULL, status == UMB_OK);
    if (status == UMB_OK) {
        assert_memory_equal(asset, f->packed.data + 48, sizeof asset); /* umb-format.md: head */
    }
    umbu_output_abandon(&staged);
    return status;
}

static void a_file_beyond_the_limit_is_refused_before_it_is_read(void **state)
{
    const struct fixture *f = *state;
    struct umb_error error = {0};
    put_file(f, f->packed.size);
    assert_int_equal(stage(f, f->packed.size, &error), UMB_OK);
    assert_int_equal(stage(f, f->packed.size - 1, &error), UMB_E_TOO_LARGE);
    assert_non_null(strstr(error.message, "--max-asset"));
    assert_int_equal(truncate(f->path, (off_t)1 << 40), 0); /* no memory has that */
    assert_int_equal(stage(f, (uint64_t)16 << 30, &error), UMB_E_TOO_LARGE);
}

static void a_file_that_is_cut_is_no_asset(void **state)
{
    const struct fixture *f = *state;
    struct umb_error error = {0};
    for (size_t size = 0; size < f->packed.size; size += 1 + size / 3) {
        put_file(f, size);
        assert_int_not_equal(stage(f, f->packed.size, &error), UMB_OK);
    }
}

static void a_file_that_was_damaged_after_its_bake_is_not_staged(void **state)
{
    const struct fixture *f = *state;
    struct umb_error error = {0};
    put_file(f, f->packed.size);
    assert_int_equal(stage(f, f->packed.size, &error), UMB_OK);
    for (size_t at = 0; at < f->packed.size; at++) {
        f->packed.data[at] ^= 1;
        put_file(f, f->packed.size);
        if (stage(f, f->packed.size, &error) == UMB_OK) {
            fail_msg("byte %zu of %zu was flipped, and the file was staged", at, f->packed.size);
        }
        f->packed.data[at] ^= 1;
    }
}

static void a_disk_that_fails_or_keeps_something_else_is_found(void **state)
{
    const struct fixture *f = *state;
    struct umb_error error = {0};
    put_file(f, f->packed.size);
    fail_sync = 1;
    assert_int_equal(stage(f, f->packed.size, &error), UMB_E_IO);
    assert_non_null(strstr(error.message, "sync"));
    fail_sync = 0;
    change_write = 1;
    assert_int_equal(stage(f, f->packed.size, &error), UMB_E_IO);
    assert_non_null(strstr(error.message, "does not read the same"));
    interrupt_reads = 3;
    assert_int_equal(stage(f, f->packed.size, &error), UMB_OK);
}

static void what_is_no_file_is_no_asset(void **state)
{
    const struct fixture *f = *state;
    struct umb_error error = {0};
    assert_int_equal(stage(f, 1000, &error), UMB_E_IO);
    assert_int_equal(mkdir(f->path, 0700), 0);
    assert_int_equal(stage(f, 1000, &error), UMB_E_IO);
}

int main(void)
{
#define STAGING_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        STAGING_TEST(a_file_beyond_the_limit_is_refused_before_it_is_read),
        STAGING_TEST(a_file_that_is_cut_is_no_asset),
        STAGING_TEST(a_file_that_was_damaged_after_its_bake_is_not_staged),
        STAGING_TEST(a_disk_that_fails_or_keeps_something_else_is_found),
        STAGING_TEST(what_is_no_file_is_no_asset),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
