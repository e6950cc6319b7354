/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The `reserved` words of public structs, which later versions may use (umbrage/version.h): every
 * function must refuse a word that is not 0, and every function that fills in a struct must write 0
 * to them.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <string.h>

#include "make_asset.h"
#include "umbrage/aliasing.h"
#include "umbrage/derive.h"
#include "umbrage/jobs.h"
#include "umbrage/volume_queries.h"
#include "umbrage/region.h"
#include "umbrage/sample.h"

enum {
    SIDE = 8
};

static struct umb_asset *asset;
static struct bytes file;
static struct umb_error error;
static float depth[SIDE * SIDE];
static const double origin[3] = {0, 0, 0}, to_light[3] = {0, 0, -1};
static const struct umb_box box = {{0, 0, 0}, {64, 64, 64}};
static const struct umb_camera camera = {.eye = {1, 2, 3},
                                         .forward = {0, 0, 1},
                                         .up = {0, 1, 0},
                                         .fov_y = 1,
                                         .aspect = 1,
                                         .near_m = 1,
                                         .far_m = 100};

static int half_lit(const void *user, uint32_t frustum, uint32_t x, uint32_t y, uint32_t z)
{
    (void)user;
    (void)frustum;
    (void)y;
    return x < 32 || z < 10;
}

static int open_asset(void **state)
{
    (void)state;
    const struct voxels voxels = {half_lit, NULL, 6, 1};
    file = make_packed(&voxels, 1, origin);
    for (int i = 0; i < SIDE * SIDE; i++) {
        depth[i] = 0.5F;
    }
    return (int)umb_asset_open_bytes(file.data, file.size, NULL, &asset, &error);
}

static int close_asset(void **state)
{
    (void)state;
    umb_asset_close(asset);
    bytes_finish(&file);
    return 0;
}

/* Sets each word of object->reserved in turn; `call` must fail and name the struct. */
#define REFUSED(object, name, call)                                                                \
    do {                                                                                           \
        for (size_t i = 0; i < sizeof(object)->reserved / 8; i++) {                                \
            (object)->reserved[i] = 1;                                                             \
            assert_int_equal(call, UMB_E_ARGUMENT);                                                \
            assert_non_null(strstr(error.message, name ".reserved["));                             \
            (object)->reserved[i] = 0;                                                             \
        }                                                                                          \
    } while (0)

/* Checks the `reserved` words of a struct that a function filled in. */
#define ZEROED(object)                                                                             \
    do {                                                                                           \
        for (size_t i = 0; i < sizeof(object)->reserved / 8; i++) {                                \
            assert_true((object)->reserved[i] == 0);                                               \
        }                                                                                          \
    } while (0)

static void core_refuses_unknown_words(void **state)
{
    (void)state;
    static const float zeros[6];
    struct umb_open_options open = {0};
    struct umb_query_settings settings = {0};
    struct umb_points points = {.positions = zeros, .count = 1};
    struct umb_segments segments = {.ends = zeros, .count = 1};
    struct umb_picture picture = {.camera = camera, .width = 1, .height = 1, .depth = zeros};
    struct umb_dial dial = {.max_error_m = 1};
    struct umb_partial_options options = {.sha256 = &test_digest};
    struct umb_partial_view view = {0};
    struct umb_asset *other;
    struct umb_query query;
    struct umb_partial *partial;
    REFUSED(&open, "options", umb_asset_open_bytes(file.data, file.size, &open, &other, &error));
    REFUSED(&open, "options", umb_asset_open_file("/nowhere", &open, &other, &error));
    assert_null(other);
    REFUSED(&settings, "settings", umb_query_prepare(asset, &settings, &query, &error));
    REFUSED(&points, "points", umb_points_check(&points, &error));
    REFUSED(&segments, "segments", umb_segments_check(&segments, &error));
    REFUSED(&picture, "picture", umb_picture_check(&picture, &error));
    REFUSED(&dial, "dial", umb_dial_choose(asset, &dial, NULL, &settings, NULL, &error));
    REFUSED(&options, "options",
            umb_partial_open(file.data, file.size, &options, &partial, &error));
    assert_int_equal(umb_partial_open(file.data, file.size, &options, &partial, &error), UMB_OK);
    assert_int_equal(umb_partial_build(partial, &error), UMB_OK);
    REFUSED(&view, "view", umb_partial_want(partial, &view, 0, &error));
    assert_int_equal(umb_partial_want(partial, &view, 0, &error), UMB_OK);
    umb_partial_close(partial);
    /* Without nonzero words the same structs must be accepted. */
    assert_int_equal(umb_query_prepare(asset, &settings, &query, &error), UMB_OK);
    assert_int_equal(umb_points_check(&points, &error), UMB_OK);
    assert_int_equal(umb_segments_check(&segments, &error), UMB_OK);
    assert_int_equal(umb_picture_check(&picture, &error), UMB_OK);
}

static void maps_refuse_unknown_words(void **state)
{
    (void)state;
    static const uint64_t first[SIDE * SIDE + 1];
    static const struct umb_map_fragment none[1];
    struct umb_map_spot spot = {.forward = {0, 0, 1},
                                .up = {0, 1, 0},
                                .tangent = 1,
                                .far_m = 9,
                                .projection = UMB_MAP_PERSPECTIVE};
    struct umb_map_frustum frustum;
    struct umb_map_layer layer = {.depth = depth};
    struct umb_map_settings settings = {0};
    struct umb_map_deep_settings deep = {0};
    struct umb_map_filter filter = {0};
    struct umb_cascade_settings cascades = {.count = 1, .resolution = {SIDE}};
    struct umb_derive_settings derive = {.width = SIDE, .height = SIDE};
    const struct umb_map_fragments fragments = {first, none};
    struct umb_map *map;
    struct umb_map_query query;
    struct umb_cascade_plan plan;
    struct umb_derived *derived;
    REFUSED(&spot, "spot", umb_map_frustum_spot(&spot, SIDE, SIDE, &frustum, &error));
    assert_int_equal(umb_map_frustum_spot(&spot, SIDE, SIDE, &frustum, &error), UMB_OK);
    REFUSED(&frustum, "frustum", umb_map_build(&frustum, &layer, &settings, NULL, &map, &error));
    REFUSED(&layer, "layer", umb_map_build(&frustum, &layer, &settings, NULL, &map, &error));
    REFUSED(&settings, "settings", umb_map_build(&frustum, &layer, &settings, NULL, &map, &error));
    REFUSED(&deep, "settings", umb_map_build_deep(&frustum, &fragments, &deep, NULL, &map, &error));
    settings.technique = UMB_MAP_MOMENTS;
    settings.terms = 4;
    REFUSED(&settings, "settings",
            umb_map_build_translucent(&frustum, &fragments, &settings, NULL, &map, &error));
    REFUSED(&cascades, "settings",
            umb_cascades_plan(&camera, to_light, &box, &cascades, &plan, &error));
    REFUSED(&derive, "settings", umb_derive(asset, &derive, NULL, &derived, &error));
    REFUSED(&derive.map, "settings", umb_derive(asset, &derive, NULL, &derived, &error));
    derive.cascades = cascades;
    derive.camera = &camera;
    REFUSED(&derive.cascades, "settings", umb_derive(asset, &derive, NULL, &derived, &error));
    settings = (struct umb_map_settings){0};
    assert_int_equal(umb_map_build(&frustum, &layer, &settings, NULL, &map, &error), UMB_OK);
    REFUSED(&filter, "filter", umb_map_prepare(map, &filter, &query, &error));
    assert_int_equal(umb_map_prepare(map, &filter, &query, &error), UMB_OK);
    umb_map_destroy(map);
}

static enum umb_status read_nothing(void *user, const struct umb_range *ranges, size_t count,
                                    umb_range_fn got, void *got_user, struct umb_error *fault)
{
    (void)user;
    (void)ranges;
    (void)count;
    (void)got;
    (void)got_user;
    return umb_fail(fault, UMB_E_IO, "nothing is read");
}

static void on_done(void *user, enum umb_status status, const struct umb_error *fault)
{
    (void)user;
    (void)status;
    (void)fault;
}

static void on_query(void *user, enum umb_status status, const struct umb_client_query_reply *reply,
                     const struct umb_error *fault)
{
    (void)reply;
    on_done(user, status, fault);
}

static void the_client_refuses_unknown_words(void **state)
{
    (void)state;
    static const float zeros[6];
    struct umb_client_options open = {0};
    struct umb_client *client;
    REFUSED(&open, "options", umb_client_open("tcp:127.0.0.1:1", &open, &client, &error));
    assert_null(client);
    assert_int_equal(umb_client_open("tcp:127.0.0.1:1", &open, &client, &error), UMB_OK);

    struct umb_picture picture = {.camera = camera, .width = 1, .height = 1, .depth = zeros};
    struct umb_client_query_request request = {
        .asset = "a", .points = {.positions = zeros, .count = 1}, .picture = &picture};
#define START umb_client_query_start(client, &request, on_query, NULL, NULL, &error)
    REFUSED(&request, "request", START);
    REFUSED(&request.settings, "settings", START);
    REFUSED(&request.dial, "dial", START);
    REFUSED(&request.points, "points", START);
    REFUSED(&picture, "picture", START);

    struct umb_volume_query volume_query = {.asset = "a"};
    struct umb_segments segments = {.ends = zeros, .count = 1};
    struct umb_segment_answer share;
    struct umb_segment_answers shares = {.segments = &share};
    struct umb_column_answer column;
    struct umb_column_answers columns = {.columns = &column};
    REFUSED(&volume_query, "volume_query",
            umb_client_segments(client, &volume_query, &segments, &shares, NULL, NULL, &error));
    REFUSED(&segments, "segments",
            umb_client_segments(client, &volume_query, &segments, &shares, NULL, NULL, &error));
    const struct umb_points *points = &request.points;
    REFUSED(&request.points, "points",
            umb_client_columns(client, &volume_query, points, &columns, NULL, NULL, &error));

    struct umb_client_async async = {.done = on_done};
    struct umb_client_description *description;
    REFUSED(&async, "async", umb_client_describe(client, "a", &description, &async, &error));

    struct umb_derive_settings derive = {.width = SIDE, .height = SIDE};
    uint8_t *bytes, id[UMB_ID_BYTES];
    size_t size;
#define DERIVE umb_client_derive(client, "a", &derive, &bytes, &size, id, NULL, &error)
    REFUSED(&derive, "settings", DERIVE);
    REFUSED(&derive.map, "settings.map", DERIVE);
    REFUSED(&derive.cascades, "settings.cascades", DERIVE);

    struct umb_sample_settings sampling = {.count = 1};
    struct umb_sample sample;
    double drawn[3];
#define SAMPLE umb_client_sample(client, "a", &sampling, drawn, &sample, NULL, &error)
    REFUSED(&sampling, "settings", SAMPLE);

    struct umb_job_submission submission = {.scene = "a.ply"};
    struct umb_job_submitted submitted;
    REFUSED(&submission, "submission",
            umb_client_submit(client, &submission, &submitted, NULL, &error));
    umb_client_close(client);

    struct umb_region_source source = {.read = read_nothing};
    struct umb_region_options options = {0};
    struct umb_region *region;
    REFUSED(&source, "source", umb_region_open(&source, &options, &region, &error));
    REFUSED(&options, "options", umb_region_open(&source, &options, &region, &error));
    REFUSED(&options, "options",
            umb_region_resume(file.data, file.size, &source, &options, &region, &error));
    assert_int_equal(umb_region_open(&source, &options, &region, &error), UMB_E_IO);
}

/* Fills a struct with bytes other than zero, as a caller's stack may hold. */
static void *soiled(void *memory, size_t size)
{
    return memset(memory, 0xa5, size);
}
#define SOIL(object) soiled(object, sizeof *(object))

static void filled_structs_have_zeros(void **state)
{
    (void)state;
    struct umb_asset_info info;
    struct umb_light_info light;
    struct umb_frustum_info voxels;
    struct umb_file_head head;
    struct umb_explanation explanation;
    struct umb_partial_stats partial_stats;
    struct umb_map_frustum frustum;
    struct umb_map_info map_info;
    struct umb_map_level level;
    struct umb_cascade_plan plan;
    struct umb_aliasing aliasing;
    struct umb_query query;
    static const float positions[3] = {40, 30, 20};
    const struct umb_query_settings settings = {.taps = 3};
    const struct umb_points points = {.positions = positions, .count = 1};
    const struct umb_partial_options options = {.sha256 = &test_digest};
    struct umb_partial *partial;
    umb_asset_get_info(asset, SOIL(&info));
    ZEROED(&info);
    assert_int_equal(umb_asset_get_light(asset, 0, SOIL(&light)), UMB_OK);
    ZEROED(&light);
    assert_int_equal(umb_asset_get_frustum(asset, 0, SOIL(&voxels)), UMB_OK);
    ZEROED(&voxels);
    assert_int_equal(umb_file_read_head(file.data, file.size, SOIL(&head), &error), UMB_OK);
    ZEROED(&head);
    assert_int_equal(umb_query_prepare(asset, &settings, &query, &error), UMB_OK);
    umb_query_explain(&query, &points, 0, SOIL(&explanation));
    ZEROED(&explanation);
    assert_int_equal(umb_partial_open(file.data, file.size, &options, &partial, &error), UMB_OK);
    umb_partial_get_stats(partial, SOIL(&partial_stats));
    ZEROED(&partial_stats);
    umb_partial_close(partial);
    assert_int_equal(umb_map_frustum_fit(to_light, &box, SIDE, SIDE, SOIL(&frustum), &error),
                     UMB_OK);
    ZEROED(&frustum);
    const struct umb_cascade_settings cascades = {.count = 1, .resolution = {SIDE}};
    assert_int_equal(umb_cascades_plan(&camera, to_light, &box, &cascades, SOIL(&plan), &error),
                     UMB_OK);
    ZEROED(&plan);
    ZEROED(&plan.frusta[0]);
    const double world[3] = {1, 2, 30}, normal[3] = {0, 0, -1};
    assert_int_equal(umb_aliasing_at(&frustum, &camera, 100, 100, world, normal, SOIL(&aliasing)),
                     UMB_OK);
    ZEROED(&aliasing);
    const struct umb_map_settings map_settings = {0};
    const struct umb_map_layer layer = {.depth = depth};
    struct umb_map *map;
    assert_int_equal(umb_map_build(&frustum, &layer, &map_settings, NULL, &map, &error), UMB_OK);
    umb_map_get_info(map, SOIL(&map_info));
    ZEROED(&map_info);
    assert_int_equal(umb_map_get_level(map, 0, SOIL(&level)), UMB_OK);
    ZEROED(&level);
    umb_map_destroy(map);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(core_refuses_unknown_words, open_asset, close_asset),
        cmocka_unit_test_setup_teardown(maps_refuse_unknown_words, open_asset, close_asset),
        cmocka_unit_test_setup_teardown(the_client_refuses_unknown_words, open_asset, close_asset),
        cmocka_unit_test_setup_teardown(filled_structs_have_zeros, open_asset, close_asset),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
