/* SPDX-License-Identifier: Apache-2.0 */
/* The way from a scene to casters, light and plan; and the texts made from them. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/analysis.h"
#include "bake/analysis/plan.h"
#include "bake/analysis/voxel_casters.h"
#include "bake/memory_plan.h"
#include "bake/base/print_text.h"
#include "bake/base/bake_progress.h"

/* A cube of edge 2 around (100.4, 0, 0), an open triangle and one without an area. */
struct small_scene {
    double positions[14][3];
    uint32_t triangles[14][3];
    struct umbs_mesh meshes[2];
    struct umbs_instance instances[2];
    struct umbs_material materials[2];
    struct umbs_light lights[3];
    struct umbs_scene_view view;
};

static void small_scene_init(struct small_scene *s)
{
    static const uint32_t cube[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                         {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                         {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    memset(s, 0, sizeof *s);
    for (uint32_t i = 0; i < 8; i++) {
        s->positions[i][0] = 99.4 + 2.0 * (i & 1);
        s->positions[i][1] = -1.0 + 2.0 * (i >> 1 & 1);
        s->positions[i][2] = -1.0 + 2.0 * (i >> 2 & 1);
    }
    memcpy(s->triangles, cube, sizeof cube);
    const double open[6][3] = {{90, 0, -3}, {92, 0, -3}, {90, 2, -3},
                               {1, 1, 1},   {1, 1, 1},   {2, 2, 2}};
    memcpy(s->positions + 8, open, sizeof open);
    const uint32_t two[2][3] = {{0, 1, 2}, {3, 4, 5}};
    memcpy(s->triangles + 12, two, sizeof two);
    s->meshes[0] =
        (struct umbs_mesh){.vertex_count = 8, .triangle_count = 12, .material = UMBS_NO_INDEX};
    s->meshes[1] = (struct umbs_mesh){.first_vertex = 8,
                                      .vertex_count = 6,
                                      .first_triangle = 12,
                                      .triangle_count = 2,
                                      .material = 1};
    for (uint32_t i = 0; i < 2; i++) {
        s->instances[i].mesh = i;
        for (int k = 0; k < 3; k++) {
            s->instances[i].mesh_to_world[k][k] = 1.0;
        }
    }
    memcpy(s->materials[1].name, "leaf \"x\"\n", 10);
    s->materials[1].alpha_mode = UMBS_ALPHA_MASK;
    s->materials[1].alpha_cutoff = 0.5F;
    s->materials[1].base_alpha = 1.0F;
    s->materials[1].texture = UMBS_NO_INDEX;
    memcpy(s->lights[0].name, "lamp", 5);
    s->lights[0].kind = UMB_LIGHT_SPOT;
    s->lights[0].direction[2] = -2.0;
    s->lights[0].position[0] = 100.0;
    s->lights[0].position[2] = 20.0;
    s->lights[0].outer_cone = 0.5;
    memcpy(s->lights[1].name, "key", 4);
    s->lights[1].direction[1] = 3.0;
    s->lights[1].direction[2] = -4.0;
    memcpy(s->lights[2].name, "fill", 5);
    s->lights[2].direction[0] = 1.0;
    s->view = (struct umbs_scene_view){
        .format = UMBS_FORMAT_OBJ,
        .z_up = 1,
        .mesh_count = 2,
        .instance_count = 2,
        .material_count = 2,
        .light_count = 3,
        .vertex_count = 14,
        .triangle_count = 14,
        .meshes = s->meshes,
        .instances = s->instances,
        .materials = s->materials,
        .lights = s->lights,
        .positions = (const double(*)[3])s->positions,
        .triangles = (const uint32_t(*)[3])s->triangles,
        .world_triangle_count = 14,
        .warnings = "",
    };
}

static struct umbb_options options_of(enum umbb_closed_mode closed)
{
    return (struct umbb_options){
        .resolution_log2 = 10, .closed = closed, .threads = 1, .memory_bytes = 1 << 30};
}

static void analysis_drops_degenerates_and_finds_closed_parts(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.count, 13);
    assert_int_equal(a.degenerate_count, 1);
    assert_int_equal(a.part_count, 2);
    assert_int_equal(a.closed_part_count, 1);
    assert_int_equal(a.closed_triangles, 12);
    assert_true(a.closed_rule && a.frusta[0].closed);
    for (int i = 0; i < 12; i++) {
        assert_int_equal(a.kinds[i], UMBB_CASTER_CLOSED);
    }
    assert_int_equal(a.kinds[12], UMBB_CASTER_OPEN);
    assert_true(a.bounds.min[0] == 90.0 && a.bounds.max[0] == 101.4);
    assert_true(a.bounds.min[2] == -3.0 && a.bounds.max[2] == 1.0);
    assert_true(a.origin[0] == 96.0 && a.origin[1] == 0.0 && a.origin[2] == -1.0);
    assert_int_equal(a.cuts.figures.mask_triangles, 2);
    /* Checks that all lights have unit directions and a frustum each. */
    assert_int_equal(a.choice.count, 3);
    assert_int_equal(a.frustum_count, 3);
    assert_string_equal(a.choice.lights[0].name, "lamp");
    assert_true(a.choice.lights[0].direction[2] == -1.0 && a.choice.cones[0] == 0.5);
    assert_true(a.frusta[0].world_to_voxel[3][2] == -1.0);
    assert_string_equal(a.choice.lights[1].name, "key");
    assert_true(a.choice.lights[1].direction[1] == 0.6 && a.choice.lights[1].direction[2] == -0.8);
    assert_string_equal(a.choice.lights[2].name, "fill");
    assert_int_equal(a.choice.lights[2].first_frustum, 2);
    assert_int_equal(a.frusta[2].light, 2);

    double before[13][3][3], copy[13][3][3];
    memcpy(before, a.corners, sizeof before);
    assert_true(a.keeps_corners); /* there is memory enough */
    for (uint32_t i = 1; i < 5; i++) {
        struct umbb_voxel_casters voxels;
        const uint32_t frustum = i < 3 ? i : i - 2; /* the same frusta once more, without copies */
        a.keeps_corners = i < 3;
        assert_int_equal(umbb_voxel_casters_make(&a, &s.view, frustum, SIZE_MAX, &voxels, &error),
                         UMB_OK);
        assert_int_equal(voxels.casters.count, 13);
        assert_memory_not_equal(before, voxels.casters.corners, sizeof before);
        if (i < 3) {
            assert_memory_equal(before, a.corners, sizeof before);
        } else {
            assert_null(a.corners); /* moved out */
        }
        if (frustum == 1 && i < 3) {
            memcpy(copy, voxels.casters.corners, sizeof copy);
        } else if (frustum == 1) {
            assert_memory_equal(copy, voxels.casters.corners, sizeof copy);
        }
        umbb_voxel_casters_finish(&voxels);
        assert_int_equal(umbb_analysis_need_corners(&a, &s.view, &error), UMB_OK);
        assert_memory_equal(before, a.corners, sizeof before);
    }
    umbb_analysis_finish(&a);
    umbb_analysis_finish(&a); /* harmless */
}

/* The self-check tells inside from outside by the winding, so the turned solid must be stored
 * outward. */
static void inside_out_solid_winds_outward_for_the_self_check(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    for (int i = 0; i < 12; i++) {
        const uint32_t kept = s.triangles[i][1];
        s.triangles[i][1] = s.triangles[i][2];
        s.triangles[i][2] = kept;
    }
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.flipped_part_count, 1);
    for (int i = 0; i < 12; i++) {
        assert_int_equal(a.kinds[i], UMBB_CASTER_CLOSED_FLIPPED);
    }
    double(*turned)[3][3] = umbb_analysis_take_turned(&a);
    assert_null(a.corners);
    double volume = 0; /* six times, relative to the first corner: positive if outward */
    const double *o = turned[0][0];
    for (int i = 0; i < 12; i++) {
        double p[3][3];
        for (int k = 0; k < 9; k++) {
            p[k / 3][k % 3] = turned[i][k / 3][k % 3] - o[k % 3];
        }
        volume += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) -
                  p[0][1] * (p[1][0] * p[2][2] - p[1][2] * p[2][0]) +
                  p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    assert_true(volume > 0);
    free(turned);
    assert_int_equal(umbb_analysis_need_corners(&a, &s.view, &error), UMB_OK); /* as in the file */
    assert_int_equal(a.kinds[0], UMBB_CASTER_CLOSED_FLIPPED);
    umbb_analysis_finish(&a);
}

/* The plan must state the price of the rule, and the option that changes the choice. */
static void plan_states_what_the_closed_rule_saves(void **state)
{
    (void)state;
    static const struct {
        double saved, closed, open;
        int on, exact;
        const char *reason, *cost;
    } cases[] = {
        {0.02, 980e3, 1000e3, 0, 1,
         "closed saves about 2 % of the nodes: voxels take 980 kB closed, 1.0 MB open",
         "none: penumbras, columns and derived maps stay (--closed parts"},
        {0.39, 53717, 88375, 1, 0,
         "closed saves about 39 % of the nodes: voxels take about 54 kB closed, 88 kB open (within "
         "a factor of 1.6), going by 2048 voxels a side",
         "no penumbras, columns and derived maps (--effect front=on keeps the first two"},
        {-0.08, 0, 0, 0, 0, "closed takes about 8 % more nodes; largest", "none"},
    };
    struct small_scene s;
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbb_analysis a;
        struct umb_error error;
        char *plan;
        small_scene_init(&s);
        assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
        assert_true(a.closed_rule); /* possible */
        umbb_analysis_rule(&a, cases[i].on);
        assert_true(a.closed_rule == cases[i].on && a.frusta[0].closed == cases[i].on);
        a.closed_price = (struct umbb_closed_price){.known = 1,
                                                    .exact = cases[i].exact,
                                                    .sample_log2 = 11,
                                                    .saved = cases[i].saved,
                                                    .factor = 1.6,
                                                    .open_bytes = cases[i].open,
                                                    .closed_bytes = cases[i].closed};
        assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
        if (strstr(plan, cases[i].reason) == NULL || strstr(plan, cases[i].cost) == NULL) {
            print_error("%s", plan);
        }
        assert_non_null(strstr(plan, cases[i].reason));
        assert_non_null(strstr(plan, cases[i].cost));
        assert_non_null(
            strstr(plan, cases[i].on ? "effect=closed state=on" : "effect=closed state=off"));
        free(plan);
        umbb_analysis_finish(&a);
    }
    /* If the caller says so, the rule is used for all parts, or for the closed ones. */
    static const enum umbb_closed_mode modes[] = {UMBB_CLOSED_ON, UMBB_CLOSED_PARTS};
    for (int i = 0; i < 2; i++) {
        struct umbb_analysis a;
        struct umb_error error;
        const struct umbb_options chosen = options_of(modes[i]);
        assert_int_equal(umbb_analysis_run(&s.view, &chosen, &a, &error), UMB_OK);
        assert_true(a.closed_rule && a.frusta[0].closed && a.kinds[0] == UMBB_CASTER_CLOSED);
        assert_int_equal(a.kinds[12], i == 0 ? UMBB_CASTER_CLOSED : UMBB_CASTER_OPEN);
        umbb_analysis_finish(&a);
    }
}

static void closed_option_overrules_the_parts(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    struct umbb_analysis a;
    struct umb_error error;
    struct umbb_options options = options_of(UMBB_CLOSED_OFF);
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_false(a.closed_rule || a.frusta[0].closed);
    assert_int_equal(a.kinds[0], UMBB_CASTER_OPEN);
    umbb_analysis_finish(&a);
    options = options_of(UMBB_CLOSED_ON);
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.kinds[12], UMBB_CASTER_CLOSED);
    umbb_analysis_finish(&a);
}

static void lights_are_chosen_by_option(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    struct umbb_analysis a;
    struct umb_error error;
    struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_light_requests *wanted = &options.lights;
    wanted->count = 1;
    wanted->items[0] = (struct umbb_light_request){.kind = UMBB_REQUEST_NAME, .name = "fill"};
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.choice.count, 1);
    assert_true(a.choice.lights[0].direction[0] == 1.0);
    umbb_analysis_finish(&a);
    wanted->items[0].name = "lamp";
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.choice.lights[0].kind, UMB_LIGHT_SPOT);
    umbb_analysis_finish(&a);
    wanted->items[0].name = "moon";
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "moon"));
    wanted->items[0] = (struct umbb_light_request){.kind = UMBB_REQUEST_SUN, .elevation_deg = 90.0};
    options.up = UMBB_UP_Y;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_true(a.choice.lights[0].direction[1] == -1.0);
    assert_string_equal(a.choice.notices, "");
    umbb_analysis_finish(&a);
    wanted->count = 0;
    s.view.light_count = 0;
    options.up = UMBB_UP_OF_SCENE;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_non_null(strstr(a.choice.notices, "azimuth 135, elevation 45"));
    assert_true(a.choice.lights[0].direction[2] < 0.0); /* z up: the sun stands above */
    umbb_analysis_finish(&a);
}

/* At an equinox at the equator the sun is up from six to six, and goes from east to west. */
static void sun_paths_and_sizes_become_lights(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    struct umbb_analysis a;
    struct umb_error error;
    struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_light_requests *wanted = &options.lights;
    wanted->count = 2;
    wanted->items[0] = (struct umbb_light_request){.kind = UMBB_REQUEST_PATH,
                                                   .path = {0.0, 30.0, 2024, 3, 20, 60.0}};
    wanted->items[1] = (struct umbb_light_request){.kind = UMBB_REQUEST_NAME, .name = "key"};
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(a.choice.count, 13); /* 7:00 .. 18:00, the sun is 7.5 minutes late; and key */
    assert_string_equal(a.choice.lights[0].name, "sun 2024-03-20 07:00:00");
    assert_true(a.choice.lights[5].direction[2] < -0.999); /* noon: from above */
    assert_true(a.choice.lights[0].direction[0] < -0.9);   /* morning: towards the west */
    assert_true(fabs(a.choice.lights[0].extent - 0.00925) < 1e-5);
    /* A sun of the scene file must have the sun's size, too. */
    assert_true(a.choice.lights[12].extent == a.choice.lights[0].extent);
    umbb_analysis_finish(&a);
    wanted->has_size_deg = 1;
    wanted->size_deg = 2.0;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_true(fabs(a.choice.lights[12].extent - 0.0349066) < 1e-6);
    assert_true(a.choice.lights[0].extent == a.choice.lights[12].extent);
    umbb_analysis_finish(&a);
    wanted->items[0].path = (struct umbb_sun_path){80.0, 0.0, 2024, 12, 21, 10.0};
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_ARGUMENT);
    assert_non_null(strstr(error.message, "--sun-path: at latitude 80 on 2024-12-21"));
}

static void scenes_without_area_or_over_memory_are_refused(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    struct umbb_analysis a;
    struct umb_error error;
    struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    options.memory_bytes = 1000;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "--memory"));
    options.memory_bytes = (uint64_t)563 << 20;
    s.view.world_triangle_count = 2109440; /* at 280 bytes each: 563.3 MiB */
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "2109440 triangles (instances multiplied out) "
                                          "need about 564 MiB, 563 MiB"));
    s.view.world_triangle_count = 14;
    options.memory_bytes = 1 << 30;
    memset(s.positions, 0, sizeof s.positions);
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_BAD_SCENE);
    assert_null(a.corners);
}

static void plan_and_settings_say_what_and_why(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    char *plan, *settings;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
    assert_non_null(strstr(plan, "effect=closed state=on reason=\"1 of 2 parts closed"));
    assert_non_null(strstr(plan, "effect=origin state=off reason="));
    assert_non_null(
        strstr(plan, "effect=cut-out state=off reason=\"2 triangles of MASK materials"));
    assert_non_null(strstr(plan, "leaf \\x22x\\x22\\x0a"));
    assert_null(strstr(plan, "transmittance"));
    assert_int_equal(umbb_settings_text(&a, &options, &settings, &error), UMB_OK);
    assert_string_equal(settings, "bake=2\nclosed=auto\n"
                                  "light.0.direction=0,0,-1\n"
                                  "light.0.position=100,0,20\n"
                                  "light.0.cone=0.5\n"
                                  "light.1.direction=0,0.59999999999999998,-0.80000000000000004\n"
                                  "light.2.direction=1,0,0\n"
                                  "resolution=1024\nup=z\n");
    free(plan);
    free(settings);
    umbb_analysis_finish(&a);
}

/* The open triangle and the one without an area cast nothing, by their material. */
static void triangles_below_their_cut_off_are_dropped_unless_they_are_to_be_opaque(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    s.materials[1].base_alpha = 0.25F;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
        struct umbb_analysis a;
        struct umb_error error;
        char *plan, *settings;
        options.opaque_cut_outs = opaque;
        assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
        assert_int_equal(a.count, opaque ? 13 : 12);
        assert_int_equal(a.gone_count, opaque ? 0 : 1);
        assert_int_equal(a.degenerate_count, 1);
        assert_true(a.bounds.min[0] == (opaque ? 90.0 : 99.4));
        assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
        assert_non_null(strstr(plan, opaque ? "effect=cut-out state=off reason=\"switched off: "
                                            : "effect=cut-out state=on reason=\"material "));
        assert_non_null(strstr(plan, "2 triangles with alpha below 0.5 on 100 % of their texels"));
        assert_int_equal(umbb_settings_text(&a, &options, &settings, &error), UMB_OK);
        assert_int_equal(strstr(settings, "cut-out=on\n") != NULL, !opaque);
        free(plan);
        free(settings);
        umbb_analysis_finish(&a);
    }
    s.view.mesh_count = s.view.instance_count = 2;
    s.meshes[0].material = 1;
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "the alpha of all is below"));
}

/* Materials that are opaque all over are kept, those that are clear all over are dropped, and the
 * others are kept apart as translucent. */
static void translucent_triangles_leave_the_casters_unless_they_are_to_be_opaque(void **state)
{
    (void)state;
    static const float alphas[] = {1.0F, 0.5F, 0.0F};
    for (int i = 0; i < 6; i++) {
        struct small_scene s;
        struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
        struct umbb_analysis a;
        struct umb_error error;
        char *plan, *settings;
        small_scene_init(&s);
        s.materials[1].alpha_mode = UMBS_ALPHA_BLEND;
        s.materials[1].base_alpha = alphas[i % 3];
        options.opaque_translucents = i / 3;
        assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
        const int called_for = i % 3 != 0, on = called_for && i < 3;
        assert_int_equal(a.count, on ? 12 : 13);
        assert_int_equal(a.translucent_count, on && i % 3 == 1);
        assert_int_equal(a.gone_count, on && i % 3 == 2);
        assert_true(a.bounds.min[0] == (on && i % 3 == 2 ? 99.4 : 90.0));
        assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
        assert_int_equal(umbb_settings_text(&a, &options, &settings, &error), UMB_OK);
        assert_int_equal(strstr(plan, "effect=transmittance state=") != NULL, called_for);
        assert_int_equal(strstr(plan, "effect=transmittance state=on") != NULL, on);
        assert_int_equal(strstr(settings, "transmittance=on\n") != NULL, on);
        if (a.translucent_count == 1) { /* they follow the casters, also when taken anew */
            assert_memory_equal(a.corners[a.count], a.translucent[0], sizeof a.translucent[0]);
            struct umbb_voxel_casters voxels;
            assert_int_equal(umbb_voxel_casters_make(&a, &s.view, 1, SIZE_MAX, &voxels, &error),
                             UMB_OK);
            umbb_voxel_casters_finish(&voxels);
            assert_int_equal(umbb_analysis_need_corners(&a, &s.view, &error), UMB_OK);
            assert_memory_equal(a.corners[a.count], a.translucent[0], sizeof a.translucent[0]);
            assert_non_null(strstr(plan, "2 triangles take 50 to 50 % of the light"));
        }
        free(plan);
        free(settings);
        umbb_analysis_finish(&a);
    }
}

static void plan_says_what_this_version_leaves_out(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    char *plan;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
    assert_non_null(strstr(plan, "effect=suns state=on reason=\"2 directional lights"));
    assert_non_null(strstr(plan, "effect=faces state=on reason=\"1 spot or point lights see "
                                 "casters in 1 frusta"));
    assert_non_null(strstr(plan, "effect=penumbra")); /* the file's suns have the sun's size */
    free(plan);
    umbb_analysis_finish(&a);
    options.lights.count = 1;
    options.lights.items[0].elevation_deg = 45.0;
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
    assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
    assert_null(strstr(plan, "effect=suns")); /* --sun replaces the file's lights */
    assert_non_null(strstr(plan,
                           "effect=penumbra state=off reason=\"the closed rule leaves out the "
                           "first occluders that it needs (--effect penumbra=on keeps them): "
                           "a light 0.53 degrees across"));
    char *json;
    size_t size;
    FILE *to = open_memstream(&json, &size);
    assert_non_null(to);
    umbb_plan_print_json(to, &a, &s.view, plan, 16);
    assert_int_equal(fclose(to), 0);
    assert_non_null(strstr(json, "\"plan\":[\"effect=closed state=on reason=\\\"1 of 2"));
    assert_non_null(strstr(json, "cost=\\\"none\\\"\"]}\n"));
    free(json);
    free(plan);
    umbb_analysis_finish(&a);
}

static void the_penumbra_effect_is_on_where_first_occluders_are_kept(void **state)
{
    static const struct {
        enum umbb_closed_mode closed;
        int occluder_depth;
        enum umbb_penumbra_mode mode;
        const char *line;
    } cases[] = {
        {UMBB_CLOSED_OFF, 0, UMBB_PENUMBRA_AUTO,
         "effect=penumbra state=on reason=\"a light 0.53 degrees across over "},
        {UMBB_CLOSED_AUTO, 1, UMBB_PENUMBRA_ON, "effect=penumbra state=on reason=\"a light 0.53 "},
        {UMBB_CLOSED_OFF, 0, UMBB_PENUMBRA_OFF,
         "effect=penumbra state=off reason=\"switched off: lights are kept without an extent\""},
    };
    struct small_scene s;
    (void)state;
    small_scene_init(&s);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct umbb_options options = options_of(cases[i].closed);
        struct umbb_analysis a;
        struct umb_error error;
        char *plan;
        options.occluder_depth = cases[i].occluder_depth;
        options.penumbra = cases[i].mode;
        options.lights.count = 1;
        options.lights.items[0].elevation_deg = 45.0;
        assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_OK);
        assert_int_equal(umbb_plan_text(&a, &s.view, &options, &plan, &error), UMB_OK);
        assert_non_null(strstr(plan, cases[i].line));
        assert_true((a.choice.lights[0].extent > 0) == (cases[i].mode != UMBB_PENUMBRA_OFF));
        free(plan);
        umbb_analysis_finish(&a);
    }
}

static void corners_out_of_reach_are_refused_and_not_dropped(void **state)
{
    (void)state;
    struct small_scene s;
    small_scene_init(&s);
    const struct umbb_options options = options_of(UMBB_CLOSED_AUTO);
    struct umbb_analysis a;
    struct umb_error error;
    for (int k = 0; k < 3; k++) { /* a triangle whose area overflows to no number */
        s.positions[8 + k][0] = 1e200 * (k + 1);
        s.positions[8 + k][1] = 1e200 * (k * k);
    }
    assert_int_equal(umbb_analysis_run(&s.view, &options, &a, &error), UMB_E_BAD_SCENE);
    assert_non_null(strstr(error.message, "beyond 1e+12 metres"));
}

static void memory_is_divided_within_the_limit(void **state)
{
    (void)state;
    struct umb_error error;
    struct umbb_memory_input input = {.memory_bytes = (uint64_t)4 << 30,
                                      .triangles = 2000000,
                                      .log2_size = 14,
                                      .tile_log2 = 12,
                                      .threads = 2,
                                      .closed_rule = 1};
    struct umbb_memory_plan plan;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    assert_int_equal(plan.tile_log2, 12);
    assert_true(plan.fixed_bytes + plan.octree_max_bytes <= input.memory_bytes);
    input.memory_bytes = (uint64_t)700 << 20;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    assert_true(plan.tile_log2 < 12 && plan.tile_log2 >= UMBB_TILE_LOG2_MIN);
    assert_true(plan.fixed_bytes + plan.octree_max_bytes <= input.memory_bytes);
    input.memory_bytes = (uint64_t)100 << 20;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "100 MiB"));
    /* Memory of the static rule: 6 bytes a triangle, and for each thread 64 rows of the tile. */
    input.memory_bytes = (uint64_t)4 << 30;
    input.threads = 256;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    const uint64_t free_of_rules = plan.fixed_bytes;
    input.ruled_frusta = 1;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    assert_int_equal(plan.tile_log2, 12);
    assert_true(plan.fixed_bytes >= free_of_rules + ((uint64_t)256 << 20));
    assert_true(plan.fixed_bytes + plan.octree_max_bytes <= input.memory_bytes);
    /* Memory of the receiver mask, which says which cells hold receivers: 32 KiB a frustum. */
    const uint64_t of_one = plan.fixed_bytes;
    input.ruled_frusta = 1024;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    assert_int_equal(plan.fixed_bytes, of_one + 1023 * 32768);
    input.ruled_frusta = 0;
    input.threads = 2;
    /* A merge draws no tile, so any tile size may be given. */
    input.memory_bytes = (uint64_t)700 << 20;
    input.merging = 1;
    assert_int_equal(umbb_memory_divide(&input, &plan, &error), UMB_OK);
    assert_int_equal(plan.tile_log2, 12);
}

static void foreign_text_is_escaped(void **state)
{
    (void)state;
    char out[64];
    umbb_escape("plain \xc3\xa9", out, sizeof out);
    assert_string_equal(out, "plain \xc3\xa9");
    umbb_escape("a\x1b[2J\"\\\xff\xc0\x80\xc2\x9b", out, sizeof out);
    assert_string_equal(out, "a\\x1b[2J\\x22\\x5c\\xff\\xc0\\x80\\xc2\\x9b");
    umbb_escape("\xc3\xa9\xc3\xa9", out, 4); /* cut between characters */
    assert_string_equal(out, "\xc3\xa9");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(analysis_drops_degenerates_and_finds_closed_parts),
        cmocka_unit_test(inside_out_solid_winds_outward_for_the_self_check),
        cmocka_unit_test(plan_states_what_the_closed_rule_saves),
        cmocka_unit_test(closed_option_overrules_the_parts),
        cmocka_unit_test(lights_are_chosen_by_option),
        cmocka_unit_test(sun_paths_and_sizes_become_lights),
        cmocka_unit_test(scenes_without_area_or_over_memory_are_refused),
        cmocka_unit_test(plan_and_settings_say_what_and_why),
        cmocka_unit_test(triangles_below_their_cut_off_are_dropped_unless_they_are_to_be_opaque),
        cmocka_unit_test(translucent_triangles_leave_the_casters_unless_they_are_to_be_opaque),
        cmocka_unit_test(plan_says_what_this_version_leaves_out),
        cmocka_unit_test(the_penumbra_effect_is_on_where_first_occluders_are_kept),
        cmocka_unit_test(corners_out_of_reach_are_refused_and_not_dropped),
        cmocka_unit_test(memory_is_divided_within_the_limit),
        cmocka_unit_test(foreign_text_is_escaped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
