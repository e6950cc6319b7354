/* SPDX-License-Identifier: Apache-2.0 */
/* A region's sources, and threads that query a region between two updates; `make config=tsan` finds
 * data races. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <pthread.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/region.h"

enum {
    POINTS = 4000,
    THREADS = 3,
};

static const double origin[3] = {0, 0, 0};

static int noise(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    uint64_t seed = ((uint64_t)x << 40 | (uint64_t)y << 20 | z) * 0x9e3779b97f4a7c15U + 1;
    (void)user;
    (void)frustum;
    return z < 40 || (z < 90 && (next_random(&seed) >> 33 & 3) == 0);
}

static struct bytes packed_noise(void)
{
    const struct voxels voxels = {noise, NULL, 7, 1};
    struct bytes file = {0};
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.5, origin, &content);
    struct umb_sink sink = bytes_sink(&file);
    assert_int_equal(umb__pack_write(&content, &octree, umb_sha256_openssl(), &sink, id, NULL),
                     UMB_OK);
    umb__octree_finish(&octree);
    return file;
}

static enum umb_status read_memory(void *user, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *got_user, struct umb_error *error)
{
    const struct bytes *file = user;
    enum umb_status status = UMB_OK;
    (void)error;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        status = got(got_user, i, file->data + ranges[i].offset, (size_t)ranges[i].length);
    }
    return status;
}

struct asker {
    struct umb_region *region;
    float positions[3 * POINTS], values[POINTS];
    struct umb_partial_answers answers;
    enum umb_status status;
};

static void *ask(void *user)
{
    struct asker *a = user;
    const struct umb_query_settings settings = {.taps = 5};
    const struct umb_points points = {
        .positions = a->positions, .format = UMB_POINT_F32, .count = POINTS};
    uint64_t seed = 7;
    for (size_t i = 0; i < 3 * (size_t)POINTS; i++) {
        a->positions[i] = (float)(random_unit(&seed) * 64);
    }
    a->answers = (struct umb_partial_answers){.values = a->values};
    a->status = umb_region_query(a->region, &settings, &points, 0, &a->answers, NULL);
    return NULL;
}

static void threads_query_a_region_at_once(void **state)
{
    static struct asker askers[THREADS];
    struct bytes file = packed_noise();
    const struct umb_region_source source = {.read = read_memory, .user = &file};
    const struct umb_region_options options = {.first_bytes = 4096};
    struct umb_region *region;
    pthread_t threads[THREADS];
    uint32_t page;
    (void)state;
    assert_int_equal(umb_region_open(&source, &options, &region, NULL), UMB_OK);
    for (size_t i = 0; i < THREADS; i++) {
        askers[i].region = region;
        assert_int_equal(pthread_create(&threads[i], NULL, ask, &askers[i]), 0);
    }
    for (size_t i = 0; i < THREADS; i++) {
        assert_int_equal(pthread_join(threads[i], NULL), 0);
        assert_int_equal(askers[i].status, UMB_OK);
        assert_memory_equal(askers[i].values, askers[0].values, sizeof askers[0].values);
    }
    assert_true(askers[0].answers.exact < POINTS);
    assert_int_equal(umb_partial_missing(umb_region_partial(region), &page, 1, 0), 0);
    umb_region_close(region);
    bytes_finish(&file);
}

/* A source that reads pieces, and how it misbehaves. */
struct pieces {
    struct bytes file;
    size_t piece;  /* Length of a piece; no read goes beyond its end */
    size_t excess; /* Bytes that a read claims in addition */
    enum umb_status status;
    unsigned reads;
};

static enum umb_status read_piece(void *user, uint64_t offset, void *bytes, size_t size,
                                  size_t *got, struct umb_error *error)
{
    struct pieces *pieces = user;
    const size_t at = (size_t)offset, left = pieces->file.size > at ? pieces->file.size - at : 0;
    const size_t piece = pieces->piece - at % pieces->piece;
    *got = size < left ? size : left;
    *got = *got < piece ? *got : piece;
    memcpy(bytes, pieces->file.data + (left > 0 ? at : 0), *got);
    *got += pieces->excess;
    pieces->reads++;
    return pieces->status == UMB_OK ? UMB_OK : umb_fail(error, pieces->status, "no such piece");
}

static void a_source_of_pieces_completes_an_asset(void **state)
{
    struct pieces pieces = {packed_noise(), .piece = 1000};
    const struct umb_region_source source = {.read_at = read_piece, .user = &pieces};
    const struct umb_region_options options = {.first_bytes = 4096};
    struct umb_region *region;
    struct umb_region_stats stats;
    (void)state;
    assert_int_equal(umb_region_open(&source, &options, &region, NULL), UMB_OK);
    umb_region_get_stats(region, &stats);
    assert_true(stats.partial.pages_held < stats.partial.page_count);
    assert_int_equal(umb_region_update(region, NULL, NULL), UMB_OK);
    umb_region_get_stats(region, &stats);
    assert_int_equal(stats.partial.pages_held, stats.partial.page_count);
    assert_true(pieces.reads >= pieces.file.size / 1000);
    umb_region_close(region);
    bytes_finish(&pieces.file);
}

static void bad_sources_are_refused(void **state)
{
    struct pieces pieces = {packed_noise(), .piece = 1000};
    struct umb_region_source source = {.user = &pieces};
    struct umb_region *region;
    struct umb_error error;
    (void)state;
    assert_int_equal(umb_region_open(&source, NULL, &region, &error), UMB_E_ARGUMENT);
    assert_string_equal(error.message, "source: give read or read_at");
    source.read_at = read_piece;
    pieces.status = UMB_E_IO;
    assert_int_equal(umb_region_open(&source, NULL, &region, &error), UMB_E_IO);
    assert_string_equal(error.message, "no such piece");
    pieces.status = UMB_OK;
    pieces.piece = pieces.file.size;
    pieces.excess = 40000; /* more than the first read asks for */
    assert_int_equal(umb_region_open(&source, NULL, &region, &error), UMB_E_PROTOCOL);
    assert_non_null(strstr(error.message, "the source read"));
    assert_null(region);
    bytes_finish(&pieces.file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_source_of_pieces_completes_an_asset),
        cmocka_unit_test(bad_sources_are_refused),
        cmocka_unit_test(threads_query_a_region_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
