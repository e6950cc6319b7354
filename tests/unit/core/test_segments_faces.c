/* SPDX-License-Identifier: Apache-2.0 */
/* Segments and columns before a point light, compared with a march through every voxel of its
 * faces. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "volume_fixture.h"

enum {
    LOG2 = 6,
    SIZE = 1 << LOG2,
    FACES = 6,
    EVENTS = 3 * (SIZE + 1) + 2,
    INTERVALS = 2000,
    FEW = 10000
};

static const double tangent = (double)SIZE / (SIZE - 20.0);
static const double near_m = 0.5, far_m = 16.0;
static const double eye[3] = {1000001.5, -4.25, 13.5};

struct lamp {
    struct umb_asset *asset;
    struct umb_volume volume;
    struct umb_frustum_info faces[FACES];
    struct bytes file;
};

static int face_noise(const void *user, uint32_t face, uint32_t x, uint32_t y, uint32_t z)
{
    return fixture_noise(user, 0, x + 64 * face, y, z);
}

static void face_axes(uint32_t face, double axes[3][3])
{
    const uint32_t k = face / 2;
    memset(axes, 0, 9 * sizeof(double));
    axes[2][k] = face % 2 == 0 ? 1 : -1;
    axes[0][(k + 1) % 3] = 1;
    axes[1][(k + 2) % 3] = face % 2 == 0 ? 1 : -1;
}

/* One face's matrix: x and y over the tangents, z over W. */
static void set_face(struct umb_frustum_info *frustum, uint32_t face)
{
    double(*m)[4] = frustum->world_to_voxel, axes[3][3];
    const double scale[3] = {0.5 * SIZE / tangent, 0.5 * SIZE / tangent, SIZE / (far_m - near_m)};
    frustum->light = 0;
    face_axes(face, axes);
    for (int i = 0; i < 4; i++) {
        const double shift = i < 2 ? 0.5 * SIZE : 0;
        m[i][3] = i == 2 ? -near_m * scale[2] : 0;
        for (int k = 0; k < 3; k++) {
            m[i][k] = i == 3 ? axes[2][k] : axes[i][k] * scale[i] + axes[2][k] * shift;
            m[i][3] -= m[i][k] * (eye[k] - fixture_origin[k]);
        }
    }
}

static void lamp_open(struct lamp *lamp)
{
    const struct voxels voxels = {face_noise, NULL, LOG2, FACES};
    struct umb__octree octree;
    struct umb__content content;
    struct umb_error error = {0};
    uint8_t id[UMB_ID_BYTES];
    memset(lamp, 0, sizeof *lamp);
    make_octree(&voxels, &octree);
    make_content(&voxels, 1, fixture_origin, &content);
    content.light_count = 1;
    content.lights[0].kind = UMB_LIGHT_POINT;
    content.lights[0].frustum_count = FACES;
    memset(content.lights[0].direction, 0, sizeof content.lights[0].direction);
    memcpy(content.lights[0].position, eye, sizeof eye);
    for (uint32_t face = 0; face < FACES; face++) {
        set_face(&content.frusta[face], face);
    }
    struct umb_sink sink = bytes_sink(&lamp->file);
    if (umb__pack_write(&content, &octree, &test_digest, &sink, id, &error) != UMB_OK ||
        umb_asset_open_bytes(lamp->file.data, lamp->file.size, NULL, &lamp->asset, &error) !=
            UMB_OK ||
        umb_volume_prepare(lamp->asset, 0, &lamp->volume, &error) != UMB_OK) {
        fail_msg("%s", error.message);
    }
    for (uint32_t face = 0; face < FACES; face++) {
        assert_int_equal(umb_asset_get_frustum(lamp->asset, face, &lamp->faces[face]), UMB_OK);
    }
    umb__octree_finish(&octree);
}

static void lamp_close(struct lamp *lamp)
{
    umb_asset_close(lamp->asset);
    bytes_finish(&lamp->file);
}

static double row(const struct umb_frustum_info *face, unsigned i, const double p[3])
{
    const double *m = face->world_to_voxel[i];
    return m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* What the march has found so far: intervals and the open one. */
struct found {
    struct umb_interval intervals[INTERVALS];
    size_t count;
    double lit, since;
    int is_lit;
};

static void found_put(struct found *found, int lit, double t)
{
    if (lit && !found->is_lit) {
        found->since = t;
    } else if (!lit && found->is_lit && t > found->since) {
        found->intervals[found->count++] = (struct umb_interval){found->since, t};
        found->lit += t - found->since;
    }
    found->is_lit = lit;
}

/* The planes of one axis in the order of k, and how many of them the line has passed. */
struct planes {
    double s[SIZE + 1];
    double at; /* coordinate, if the line does not move on this axis */
    int step;
};

static int64_t index_at(const struct planes *planes, double s)
{
    int64_t below = 0;
    if (planes->step == 0) {
        return planes->at < 0 ? -1 : planes->at > SIZE ? SIZE : (int64_t)floor(planes->at);
    }
    for (int k = 0; k <= SIZE; k++) {
        below += planes->step > 0 ? planes->s[k] <= s : planes->s[k] > s;
    }
    return below - 1;
}

static int voxel_state(uint32_t face, const struct planes planes[3], double s)
{
    const int64_t x = index_at(&planes[0], s), y = index_at(&planes[1], s);
    const int64_t z = index_at(&planes[2], s);
    if (x < 0 || x >= SIZE || y < 0 || y >= SIZE || z < 0) {
        return 1;
    }
    return face_noise(NULL, face, (uint32_t)x, (uint32_t)y, (uint32_t)(z < SIZE ? z : SIZE - 1)) !=
           0;
}

/* The header's formulas for the piece from a to b, all of which lies behind the frustum's near
 * plane. */
static void march_line(const struct lamp *lamp, uint32_t face, const double h0[3],
                       const double gain[3], const double part[2], const double w[2],
                       struct found *found)
{
    static double events[EVENTS];
    const double *zr = lamp->faces[face].world_to_voxel[2];
    const double *wr = lamp->faces[face].world_to_voxel[3];
    const double scale = (wr[0] * wr[0] + wr[1] * wr[1] + wr[2] * wr[2]) /
                         (wr[0] * zr[0] + wr[1] * zr[1] + wr[2] * zr[2]);
    const double offset = wr[3] - scale * zr[3];
    struct planes planes[3];
    size_t count = 1;
    events[0] = 0;
    for (unsigned i = 0; i < 3; i++) {
        const double start = i < 2 ? (h0[i] + part[0] * gain[i]) / w[0] : -1 / w[0];
        const double slope =
            i < 2 ? (h0[i] + part[1] * gain[i]) / w[1] - start : 1 / w[0] - 1 / w[1];
        const double slower = slope != 0 ? 1 / slope : INFINITY;
        planes[i].step = isfinite(slower) ? (slope > 0 ? 1 : -1) : 0;
        planes[i].at = i < 2 ? start : (w[0] - offset) / scale;
        for (int k = 0; k <= SIZE; k++) {
            const double place = i < 2 ? k : -1 / (scale * k + offset);
            planes[i].s[k] = (place - start) * slower;
            if (planes[i].step != 0 && planes[i].s[k] > 0 && planes[i].s[k] < 1) {
                events[count++] = planes[i].s[k];
            }
        }
    }
    qsort(events, count, sizeof events[0], by_value);
    for (size_t e = 0; e < count; e++) {
        if (e + 1 < count && events[e] == events[e + 1]) {
            continue;
        }
        const double s = events[e];
        const double u = w[0] == w[1] ? s : s * w[0] / (w[1] - s * (w[1] - w[0]));
        const double t = s <= 0 ? part[0] : fmin(part[0] + u * (part[1] - part[0]), part[1]);
        found_put(found, voxel_state(face, planes, s), t);
    }
}

static void march_piece(const struct lamp *lamp, uint32_t face, const double p[2][3], double a,
                        double b, struct found *found)
{
    static const unsigned rows[3] = {0, 1, 3};
    const double *zr = lamp->faces[face].world_to_voxel[2];
    const double *wr = lamp->faces[face].world_to_voxel[3];
    const double scale = (wr[0] * wr[0] + wr[1] * wr[1] + wr[2] * wr[2]) /
                         (wr[0] * zr[0] + wr[1] * zr[1] + wr[2] * zr[2]);
    const double first = wr[3] - scale * zr[3];
    double h0[3], gain[3], part[2] = {a, b}, w[2];
    for (unsigned i = 0; i < 3; i++) {
        h0[i] = row(&lamp->faces[face], rows[i], p[0]);
        gain[i] = row(&lamp->faces[face], rows[i], p[1]) - h0[i];
    }
    for (unsigned e = 0; e < 2; e++) {
        w[e] = h0[2] + part[e] * gain[2];
    }
    const int begins = w[0] >= first, ends = w[1] >= first;
    const double cut = begins != ends ? fmin(fmax((first - h0[2]) / gain[2], a), b) : a;
    if (!begins) {
        found_put(found, 1, a);
        part[0] = cut;
        w[0] = first;
    }
    if (begins && !ends) {
        part[1] = cut;
        w[1] = first;
    }
    if ((begins || ends) && part[1] > part[0]) {
        march_line(lamp, face, h0, gain, part, w, found);
    }
    if (begins && !ends) {
        found_put(found, 1, part[1]);
    }
}

/* Returns the face that answers for p; the first of equals. */
static uint32_t looking(const double w0[FACES], const double gain[FACES], double t)
{
    uint32_t best = 0;
    for (uint32_t f = 1; f < FACES; f++) {
        best = w0[f] + t * gain[f] > w0[best] + t * gain[best] ? f : best;
    }
    return best;
}

/* Cuts the segment where any two faces are equally far, and finds for the middle of each part the
 * face that answers. */
static void march(const struct lamp *lamp, const double p[2][3], struct found *found)
{
    double w0[FACES], gain[FACES], cuts[2 + FACES * FACES];
    size_t count = 0;
    memset(found, 0, sizeof *found);
    for (uint32_t f = 0; f < FACES; f++) {
        w0[f] = row(&lamp->faces[f], 3, p[0]);
        gain[f] = row(&lamp->faces[f], 3, p[1]) - w0[f];
    }
    cuts[count++] = 0;
    for (uint32_t f = 0; f < FACES; f++) {
        for (uint32_t g = 0; g < FACES; g++) {
            const double t = gain[g] > gain[f] ? (w0[f] - w0[g]) / (gain[g] - gain[f]) : 0;
            if (t > 0 && t < 1) {
                cuts[count++] = t;
            }
        }
    }
    cuts[count++] = 1;
    qsort(cuts, count, sizeof cuts[0], by_value);
    uint32_t face = looking(w0, gain, 0.5 * (cuts[0] + cuts[1]));
    double from = 0;
    for (size_t i = 1; i + 1 < count; i++) {
        const uint32_t next = looking(w0, gain, 0.5 * (cuts[i] + cuts[i + 1]));
        if (next != face) {
            const double t = gain[next] != gain[face]
                                 ? (w0[face] - w0[next]) / (gain[next] - gain[face])
                                 : INFINITY;
            march_piece(lamp, face, p, from, t, found);
            from = t;
            face = next;
        }
    }
    march_piece(lamp, face, p, from, 1, found);
    found_put(found, 0, 1);
}

/* Ends in and around the faces: anywhere, towards the light, tiny, far away. */
static void random_ends(uint64_t *seed, double p[2][3])
{
    const uint64_t kind = next_random(seed) % 6;
    for (unsigned k = 0; k < 3; k++) {
        const double middle = eye[k] - fixture_origin[k];
        for (unsigned e = 0; e < 2; e++) {
            p[e][k] = middle + (random_unit(seed) * 2 - 1) * 18;
        }
        if (kind == 1) {
            p[1][k] = p[0][k] + (random_unit(seed) - 0.5) * 0.1;
        } else if (kind == 2) { /* along a ray of the light, past it */
            p[1][k] = middle - (p[0][k] - middle) * 0.37;
        } else if (kind == 3) {
            p[1][k] = middle + (p[1][k] - middle) * 1e5;
        } else if (kind == 4 && k > 0) { /* along an axis of the faces */
            p[1][k] = p[0][k];
        }
    }
}

static void intervals_before_a_lamp_equal_a_march_through_every_voxel(void **state)
{
    (void)state;
    static struct umb_interval intervals[INTERVALS];
    static struct found marched;
    struct lamp lamp;
    uint64_t seed = 31;
    size_t faces_met = 0;
    lamp_open(&lamp);
    print_message("seed %llu\n", (unsigned long long)seed);
    for (size_t i = 0; i < (size_t)case_count(FEW); i++) {
        double p[2][3], ends[2][3];
        struct umb_segment_answer answer;
        struct umb_segment_answers answers = {
            .segments = &answer, .intervals = intervals, .interval_max = INTERVALS};
        struct umb_segments segments = {.ends = ends, .format = UMB_POINT_F64, .count = 1};
        random_ends(&seed, p);
        memcpy(segments.origin, fixture_origin, sizeof fixture_origin);
        memcpy(ends, p, sizeof ends);
        umb_volume_segments(&lamp.volume, &segments, 0, 1, &answers);
        march(&lamp, (const double(*)[3])p, &marched);
        int same = marched.count == answer.interval_count && marched.lit == answer.lit;
        for (size_t k = 0; same && k < marched.count; k++) {
            same = marched.intervals[k].begin == intervals[k].begin &&
                   marched.intervals[k].end == intervals[k].end;
        }
        faces_met += answer.interval_count > 1;
        if (!same) {
            fail_msg("case %zu: %.17g %.17g %.17g to %.17g %.17g %.17g: %zu stretches, %.17g lit; "
                     "the march has %zu, %.17g",
                     i, p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2],
                     (size_t)answer.interval_count, answer.lit, marched.count, marched.lit);
        }
    }
    assert_true(faces_met > FEW / 4);
    lamp_close(&lamp);
}

static void points_within_intervals_before_a_lamp_are_lit_and_others_shadowed(void **state)
{
    (void)state;
    static struct umb_interval intervals[INTERVALS];
    struct lamp lamp;
    struct umb_query query;
    const struct umb_query_settings settings = {.taps = 1, .bias_mode = UMB_BIAS_NONE};
    uint64_t seed = 32;
    lamp_open(&lamp);
    assert_int_equal(umb_query_prepare(lamp.asset, &settings, &query, NULL), UMB_OK);
    for (size_t i = 0; i < FEW; i++) {
        double p[2][3], at[3];
        const double t = random_unit(&seed);
        struct umb_segment_answer answer;
        struct umb_segment_answers answers = {
            .segments = &answer, .intervals = intervals, .interval_max = INTERVALS};
        struct umb_segments segments = {.ends = p, .format = UMB_POINT_F64, .count = 1};
        float value = 0;
        struct umb_points points = {.positions = at, .format = UMB_POINT_F64, .count = 1};
        struct umb_answers point = {.values = &value};
        int inside = 0, near = 0;
        random_ends(&seed, p);
        memcpy(segments.origin, fixture_origin, sizeof fixture_origin);
        memcpy(points.origin, fixture_origin, sizeof fixture_origin);
        umb_volume_segments(&lamp.volume, &segments, 0, 1, &answers);
        for (size_t k = 0; k < answer.interval_count; k++) {
            inside |= t >= intervals[k].begin && t < intervals[k].end;
            near |= fabs(t - intervals[k].begin) < 1e-8 || fabs(t - intervals[k].end) < 1e-8;
        }
        for (unsigned k = 0; k < 3; k++) {
            at[k] = p[0][k] + t * (p[1][k] - p[0][k]);
        }
        umb_query_run(&query, &points, 0, 1, &point);
        if (!near) { /* rounding decides there */
            assert_int_equal(inside, value == 1.0F);
        }
    }
    lamp_close(&lamp);
}

static void columns_before_a_lamp_end_at_their_first_shadowed_voxel(void **state)
{
    (void)state;
    struct lamp lamp;
    uint64_t seed = 33;
    size_t met = 0;
    lamp_open(&lamp);
    for (size_t i = 0; i < (size_t)case_count(FEW); i++) {
        double p[3], from_light = 0;
        struct umb_column_answer got;
        struct umb_column_answers answers = {.columns = &got};
        struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
        uint32_t face = 0, want = 0;
        memcpy(points.origin, fixture_origin, sizeof fixture_origin);
        for (unsigned k = 0; k < 3; k++) {
            const double offset = (random_unit(&seed) * 2 - 1) * 18;
            p[k] = eye[k] - fixture_origin[k] + offset;
            from_light += offset * offset;
        }
        for (uint32_t f = 1; f < FACES; f++) {
            face = row(&lamp.faces[f], 3, p) > row(&lamp.faces[face], 3, p) ? f : face;
        }
        const double w = row(&lamp.faces[face], 3, p);
        const double x = row(&lamp.faces[face], 0, p) / w, y = row(&lamp.faces[face], 1, p) / w;
        while (want < SIZE && face_noise(NULL, face, (uint32_t)x, (uint32_t)y, want)) {
            want++;
        }
        umb_volume_columns(&lamp.volume, &points, 0, 1, &answers);
        assert_int_equal(got.outside, 0); /* a guard band lies around every face */
        assert_int_equal(got.lit, want);
        if (want < SIZE) {
            const double occluder_w = near_m + want * (far_m - near_m) / SIZE;
            assert_true(fabs(got.distance_m - (occluder_w / w - 1) * sqrt(from_light)) < 1e-6);
            met++;
        } else {
            assert_true(isinf(got.distance_m));
        }
    }
    assert_true(met > FEW / 4);
    lamp_close(&lamp);
}

/* Computes the centre of a voxel as umb_volume_boxes documents it, and W there. */
static double centre_of(const struct umb_frustum_info *face, const uint32_t v[3], double p[3])
{
    const double *m = face->world_to_voxel[0], *w = face->world_to_voxel[3];
    const double *z = face->world_to_voxel[2];
    const double square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    const double c = square / (w[0] * z[0] + w[1] * z[1] + w[2] * z[2]);
    const double depth = c * (v[2] + 0.5) + (w[3] - c * z[3]);
    double x = 0, y = 0;
    for (int k = 0; k < 3; k++) {
        x += m[k] * w[k] / square;
        y += face->world_to_voxel[1][k] * w[k] / square;
    }
    for (int k = 0; k < 3; k++) {
        const double d = w[k] / square - x * face->voxel_step[0][k] - y * face->voxel_step[1][k];
        p[k] = (depth * ((d + (v[0] + 0.5) * face->voxel_step[0][k]) +
                         (v[1] + 0.5) * face->voxel_step[1][k]) +
                (eye[k] - fixture_origin[k])) +
               fixture_origin[k];
    }
    return depth;
}

/* Tests for every voxel of every face whether its centre lies in the box and its own face answers
 * there. Sides of boxes are drawn away from voxel centres, so rounding decides nothing. */
static void boxes_count_the_voxels_of_all_faces(void **state)
{
    struct lamp lamp;
    uint64_t seed = 35, all = 0;
    (void)state;
    lamp_open(&lamp);
    for (int n = 0; n < 12; n++) {
        struct umb_box box;
        struct umb_box_answer got;
        struct umb_box_answers answers = {.boxes = &got};
        uint64_t voxels = 0, lit = 0;
        for (int k = 0; k < 3; k++) {
            const double a = eye[k] + (random_unit(&seed) * 2 - 1) * 4;
            const double b = eye[k] + (random_unit(&seed) * 2 - 1) * 4;
            box.min[k] = n == 0 ? -1e9 : fmin(a, b);
            box.max[k] = n == 0 ? 1e9 : fmax(a, b);
        }
        assert_int_equal(umb_volume_boxes(&lamp.volume, &box, 0, 1, NULL, &answers, NULL), UMB_OK);
        for (uint32_t face = 0; face < FACES; face++) {
            for (uint32_t i = 0; i < SIZE * SIZE * SIZE; i++) {
                const uint32_t v[3] = {i % SIZE, i / SIZE % SIZE, i / (SIZE * SIZE)};
                double p[3], local[3];
                const double w = centre_of(&lamp.faces[face], v, p);
                int inside = w > 0;
                for (int k = 0; k < 3; k++) {
                    inside &= p[k] >= box.min[k] && p[k] < box.max[k];
                    local[k] = p[k] - fixture_origin[k];
                }
                for (uint32_t other = 0; inside && other < FACES; other++) {
                    inside &= other == face || row(&lamp.faces[other], 3, local) < w;
                }
                voxels += (uint64_t)inside;
                lit += (uint64_t)(inside && face_noise(NULL, face, v[0], v[1], v[2]));
            }
        }
        if (got.voxels != voxels || got.lit != lit) {
            fail_msg("box %d: %llu of %llu, must be %llu of %llu", n, (unsigned long long)got.lit,
                     (unsigned long long)got.voxels, (unsigned long long)lit,
                     (unsigned long long)voxels);
        }
        all += voxels;
    }
    assert_true(all > 1000);
    lamp_close(&lamp);
}

static void numbers_that_overflow_do_no_harm(void **state)
{
    (void)state;
    struct lamp lamp;
    struct umb_error error;
    static const double far[] = {1e15,   -1e17,   3e18, 1e300,    -1e306,
                                 1e-310, -1e-300, 5,    INFINITY, NAN};
    uint64_t seed = 34;
    lamp_open(&lamp);
    assert_int_equal(umb_volume_check_parallel(&lamp.volume, &error), UMB_E_UNSUPPORTED);
    assert_non_null(strstr(error.message, "light: 0 is not directional"));
    for (size_t i = 0; i < 20000; i++) {
        double p[2][3];
        struct umb_segment_answer answer;
        struct umb_segment_answers answers = {.segments = &answer};
        struct umb_column_answer column;
        struct umb_column_answers columns = {.columns = &column};
        const struct umb_segments segments = {.ends = p, .format = UMB_POINT_F64, .count = 1};
        const struct umb_points points = {.positions = p, .format = UMB_POINT_F64, .count = 1};
        for (unsigned k = 0; k < 6; k++) {
            p[k / 3][k % 3] = far[next_random(&seed) % 10] * random_unit(&seed);
        }
        umb_volume_segments(&lamp.volume, &segments, 0, 1, &answers);
        umb_volume_columns(&lamp.volume, &points, 0, 1, &columns);
        struct umb_box box;
        struct umb_box_answer count;
        struct umb_box_answers boxes = {.boxes = &count};
        for (unsigned k = 0; k < 3; k++) {
            box.min[k] = fmin(p[0][k], p[1][k]);
            box.max[k] = fmax(p[0][k], p[1][k]);
        }
        if (i < 200) {
            assert_int_equal(umb_volume_boxes(&lamp.volume, &box, 0, 1, NULL, &boxes, NULL),
                             UMB_OK);
            assert_true(count.lit <= count.voxels);
        }
        assert_true(!(answer.lit < 0) && !(answer.lit > 1 + 1e-12));
    }
    lamp_close(&lamp);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intervals_before_a_lamp_equal_a_march_through_every_voxel),
        cmocka_unit_test(points_within_intervals_before_a_lamp_are_lit_and_others_shadowed),
        cmocka_unit_test(columns_before_a_lamp_end_at_their_first_shadowed_voxel),
        cmocka_unit_test(boxes_count_the_voxels_of_all_faces),
        cmocka_unit_test(numbers_that_overflow_do_no_harm),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
