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

/* A version in memory, and what was read of it. */
struct version {
    struct bytes file;
    uint64_t most; /* Bytes that may be read before reads fail; 0: no limit */
    uint64_t read;
};

static enum umb_status read_version(void *user, const struct umb_range *ranges, size_t count,
                                    umb_range_fn got, void *got_user, struct umb_error *error)
{
    struct version *version = user;
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < count && status == UMB_OK; i++) {
        const size_t at = (size_t)ranges[i].offset;
        const size_t left = at < version->file.size ? version->file.size - at : 0;
        const size_t size = ranges[i].length < left ? (size_t)ranges[i].length : left;
        version->read += size;
        if (version->most > 0 && version->read > version->most) {
            return umb_fail(error, UMB_E_UNAVAILABLE, "the version is withdrawn");
        }
        status = got(got_user, i, version->file.data + (left > 0 ? at : 0), size);
    }
    return status;
}

static int edited_noise(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    return x < 24 && y < 24 && z < 60 ? z < 30 : noise(user, frustum, x, y, z);
}

/* Packs a version in small pages. */
static struct version make_version(voxel_fn voxel)
{
    const struct voxels voxels = {voxel, NULL, 7, 1};
    struct version version = {0};
    struct umb_sink sink = bytes_sink(&version.file);
    struct umb__octree octree;
    struct umb__content content;
    uint8_t id[UMB_ID_BYTES];
    make_octree(&voxels, &octree);
    make_content(&voxels, 0.5, origin, &content);
    const struct umb__pack_job job = {.content = &content,
                                      .octree = &octree,
                                      .sha256 = umb_sha256_openssl(),
                                      .sink = &sink,
                                      .page_bytes = 1024};
    assert_int_equal(umb__pack_run(&job, id, NULL), UMB_OK);
    umb__octree_finish(&octree);
    return version;
}

static struct umb_region_source source_of(struct version *version)
{
    return (struct umb_region_source){.read = read_version, .user = version};
}

static struct umb_region *open_whole(struct version *version)
{
    const struct umb_region_source source = source_of(version);
    struct umb_region *region;
    assert_int_equal(umb_region_open(&source, NULL, &region, NULL), UMB_OK);
    assert_int_equal(umb_region_update(region, NULL, NULL), UMB_OK);
    return region;
}

/* Asks at the points of `ask`. Out: exact: number of exact points. */
static void ask_region(struct umb_region *region, struct asker *asker)
{
    asker->region = region;
    (void)ask(asker);
    assert_int_equal(asker->status, UMB_OK);
}

static void a_region_reads_of_a_new_version_only_what_changed(void **state)
{
    static struct asker moved, fresh;
    struct version old = make_version(noise), next = make_version(edited_noise);
    struct umb_region *region = open_whole(&old), *other;
    struct umb_region_stats before, after;
    (void)state;
    umb_region_get_stats(region, &before);
    const struct umb_region_source source = source_of(&next);
    assert_int_equal(umb_region_retarget(region, &source, NULL, NULL), UMB_OK);
    assert_int_equal(umb_region_update(region, NULL, NULL), UMB_OK);
    umb_region_get_stats(region, &after);
    assert_int_equal(after.partial.pages_held, after.partial.page_count);
    assert_true(after.partial.pages_inherited > after.partial.page_count / 2);
    assert_int_equal(after.received_bytes - before.received_bytes, next.read);
    assert_true(next.read < next.file.size / 2);
    /* No page came twice: each is inherited, or received, or was in the first read. */
    assert_true(after.pages_received - before.pages_received + after.partial.pages_inherited ==
                after.partial.page_count);
    other = open_whole(&next);
    ask_region(region, &moved);
    ask_region(other, &fresh);
    assert_memory_equal(moved.values, fresh.values, sizeof moved.values);
    assert_int_equal(moved.answers.exact, POINTS);
    umb_region_close(other);
    umb_region_close(region);
    bytes_finish(&old.file);
    bytes_finish(&next.file);
}

static void a_version_that_cannot_be_opened_leaves_the_region_as_it_was(void **state)
{
    static struct asker before, after;
    struct version old = make_version(noise), next = make_version(edited_noise);
    struct umb_region *region = open_whole(&old);
    const size_t whole = next.file.size;
    const uint8_t id[UMB_ID_BYTES] = {1};
    const struct umb_region_options another = {.id = id}, tiny = {.max_memory_bytes = 1000};
    const struct umb_region_source source = source_of(&next);
    (void)state;
    ask_region(region, &before);
    assert_int_equal(umb_region_retarget(region, &source, &another, NULL), UMB_E_CORRUPT);
    assert_int_not_equal(umb_region_retarget(region, &source, &tiny, NULL), UMB_OK);
    for (size_t cut = 0; cut < UMB_FILE_HEAD_BYTES + 300; cut += 7) { /* inside of the head */
        next.file.size = cut;
        assert_int_not_equal(umb_region_retarget(region, &source, NULL, NULL), UMB_OK);
    }
    next.file.size = whole;
    next.most = 1;
    next.read = 0;
    assert_int_equal(umb_region_retarget(region, &source, NULL, NULL), UMB_E_UNAVAILABLE);
    next.most = 0;
    ask_region(region, &after);
    assert_memory_equal(before.values, after.values, sizeof before.values);
    assert_int_equal(after.answers.exact, POINTS);
    umb_region_close(region);
    bytes_finish(&old.file);
    bytes_finish(&next.file);
}

static void a_version_withdrawn_while_it_is_read_loses_no_page(void **state)
{
    struct version old = make_version(noise), next = make_version(edited_noise);
    struct umb_region *region = open_whole(&old);
    struct umb_region_stats before, after;
    (void)state;
    next.most = 6000; /* the head, the first block and some of the others */
    struct umb_region_source source = source_of(&next);
    assert_int_equal(umb_region_retarget(region, &source, NULL, NULL), UMB_OK);
    assert_int_equal(umb_region_update(region, NULL, NULL), UMB_E_UNAVAILABLE);
    umb_region_get_stats(region, &before);
    assert_true(before.partial.pages_held < before.partial.page_count);
    source = source_of(&old);
    assert_int_equal(umb_region_retarget(region, &source, NULL, NULL), UMB_OK);
    assert_int_equal(umb_region_update(region, NULL, NULL), UMB_OK);
    umb_region_get_stats(region, &after);
    assert_int_equal(after.partial.pages_inherited, after.partial.page_count);
    assert_int_equal(after.pages_received, before.pages_received);
    /* The same version again: nothing changes but the source. */
    assert_int_equal(umb_region_retarget(region, NULL, NULL, NULL), UMB_OK);
    umb_region_get_stats(region, &before);
    assert_int_equal(before.partial.pages_held, after.partial.page_count);
    umb_region_close(region);
    bytes_finish(&old.file);
    bytes_finish(&next.file);
}

static void the_id_of_a_source_is_that_of_its_file(void **state)
{
    struct pieces pieces = {packed_noise(), .piece = 50};
    const struct umb_region_source by_pieces = {.read_at = read_piece, .user = &pieces};
    const struct umb_region_source by_ranges = {.read = read_memory, .user = &pieces.file};
    uint8_t one[UMB_ID_BYTES], other[UMB_ID_BYTES];
    struct umb_file_head head;
    (void)state;
    assert_int_equal(umb_file_read_head(pieces.file.data, pieces.file.size, &head, NULL), UMB_OK);
    assert_int_equal(umb_region_source_id(&by_pieces, one, NULL), UMB_OK);
    assert_int_equal(umb_region_source_id(&by_ranges, other, NULL), UMB_OK);
    assert_memory_equal(one, head.id, sizeof one);
    assert_memory_equal(other, head.id, sizeof other);
    pieces.file.size = 100;
    assert_int_equal(umb_region_source_id(&by_pieces, one, NULL), UMB_E_TRUNCATED);
    pieces.status = UMB_E_IO;
    assert_int_equal(umb_region_source_id(&by_pieces, one, NULL), UMB_E_IO);
    bytes_finish(&pieces.file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_source_of_pieces_completes_an_asset),
        cmocka_unit_test(bad_sources_are_refused),
        cmocka_unit_test(a_region_reads_of_a_new_version_only_what_changed),
        cmocka_unit_test(a_version_that_cannot_be_opened_leaves_the_region_as_it_was),
        cmocka_unit_test(a_version_withdrawn_while_it_is_read_loses_no_page),
        cmocka_unit_test(the_id_of_a_source_is_that_of_its_file),
        cmocka_unit_test(threads_query_a_region_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
