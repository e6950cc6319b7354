/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Draws the failures of shadow maps that the literature describes, and their remedies:
 *
 *     failure_pictures OUT.png
 *
 * Each row is a constructed scene seen along the light. Each pixel is a receiver above its texel,
 * and its grey is the light that reaches the receiver. From left to right stand the truth (PCF of
 * the same window), the failure, and the remedies. The program also prints the mean light where the
 * truth has none: the figures of docs/explained/techniques.md.
 */
#include <stdio.h>

#include "../unit/maps/maps_fixture.h"
#include "study/picture_text.h"
#include "umbrage/cascades.h"

enum {
    WIDTH = 192,
    HEIGHT = 96,
    GAP = 6,
    TITLE = 12, /* height of a panel's name */
    PANELS = 5,
    ROWS = 4,
    TAPS = 9
};

static float occluder[HEIGHT][WIDTH];
static float receiver[HEIGHT][WIDTH];
static struct umbt_picture sheet;

/* One panel: settings and a filter; `name` NULL ends a row. */
struct panel {
    const char *name;
    struct umb_map_settings settings;
    struct umb_map_filter filter;
};

static void place(int x, int y, double at[3])
{
    at[0] = x + 0.5;
    at[1] = y + 0.5;
    at[2] = (double)receiver[y][x];
}

/* Paints a panel below its name. */
static void paint(int row, int column, const char *name, const float *values)
{
    const size_t top = (size_t)(row * (HEIGHT + TITLE + GAP));
    umbt_label_draw(&sheet, (uint32_t)(column * (WIDTH + GAP)), (uint32_t)top, 1, name);
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            const float value = values[y * WIDTH + x];
            const size_t to =
                (top + TITLE + (size_t)y) * sheet.width + (size_t)(column * (WIDTH + GAP) + x);
            memset(&sheet.pixels[3 * to], (int)(40.0F + 215.0F * value), 3);
        }
    }
}

/* Returns the mean light where the truth has none, away from the map's border. */
static void tell(const char *row, const char *name, const float *truth, const float *values)
{
    double sum = 0.0, most = 0.0;
    int count = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const int x = i % WIDTH, y = i / WIDTH;
        if (truth[i] == 0.0F && x >= TAPS && y >= TAPS && x < WIDTH - TAPS && y < HEIGHT - TAPS) {
            sum += (double)values[i];
            most = fmax(most, (double)values[i]);
            count++;
        }
    }
    printf("%-16s %-26s light mean %.4f most %.3f\n", row, name, sum / count, most);
}

static void answer(const struct panel *panel, float *values)
{
    static double at[WIDTH * HEIGHT][3];
    const struct umb_map_frustum frustum = plain_frustum(WIDTH, HEIGHT);
    struct umb_map *map = map_of(&frustum, &occluder[0][0], &panel->settings);
    const struct umb_map_query query = query_of(map, &panel->filter);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        place(i % WIDTH, i / WIDTH, at[i]);
    }
    ask(&query, (const double(*)[3])at, (size_t)WIDTH * HEIGHT, values);
    umb_map_destroy(map);
}

static void draw_row(int row, const char *name, const struct panel *panels)
{
    static float truth[WIDTH * HEIGHT], values[WIDTH * HEIGHT];
    const struct panel pcf = {"truth", {.technique = UMB_MAP_PCF}, {.width = TAPS}};
    answer(&pcf, truth);
    paint(row, 0, name, truth);
    for (int i = 0; i < PANELS - 1 && panels[i].name != NULL; i++) {
        answer(&panels[i], values);
        paint(row, i + 1, panels[i].name, values);
        tell(name, panels[i].name, truth, values);
    }
}

static void fill(float layer[HEIGHT][WIDTH], float value)
{
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        layer[i / WIDTH][i % WIDTH] = value;
    }
}

/* A plate, and a disc high above it. A receiver below both is dark. Where the disc's outline lies
 * over the plate, its window holds two depths. */
static void two_occluders(void)
{
    static const struct panel panels[PANELS] = {
        {"vsm", {.technique = UMB_MAP_VSM, .blur = TAPS}, {.width = 1}},
        {"vsm, reduction 0.7",
         {.technique = UMB_MAP_VSM, .blur = TAPS},
         {.width = 1, .reduction = 0.7}},
        {"evsm 40", {.technique = UMB_MAP_EVSM, .exponent = 40, .blur = TAPS}, {.width = 1}},
        {"msm", {.technique = UMB_MAP_MSM, .blur = TAPS}, {.width = 1}},
    };
    fill(occluder, 1.0F);
    fill(receiver, 0.55F);
    for (int y = 16; y < HEIGHT - 16; y++) {
        for (int x = 16; x < WIDTH - 16; x++) {
            const int dx = x - WIDTH / 2, dy = y - HEIGHT / 2;
            occluder[y][x] = dx * dx + dy * dy < 24 * 24 ? 0.2F : 0.5F;
        }
    }
    draw_row(0, "bleeding: truth", panels);
}

/* A plate; the receiver touches it on the left and falls behind it to the right. */
static void near_occluder(void)
{
    static const struct panel panels[PANELS] = {
        {"esm 80", {.technique = UMB_MAP_ESM, .exponent = 80, .blur = TAPS}, {.width = 1}},
        {"esm 800, logarithmic",
         {.technique = UMB_MAP_ESM, .exponent = 800, .blur = TAPS},
         {.width = 1}},
        {"evsm 40, both warps",
         {.technique = UMB_MAP_EVSM, .exponent = 40, .negative_exponent = 40, .blur = TAPS},
         {.width = 1}},
        {0},
    };
    fill(occluder, 0.5F);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        receiver[i / WIDTH][i % WIDTH] = (float)(0.501 + 0.05 * (i % WIDTH) / WIDTH);
    }
    draw_row(1, "contact: truth", panels);
}

/* The same plate; the receiver falls away to the far end. */
static void behind_occluder(void)
{
    static const struct panel panels[PANELS] = {
        {"convolution 4",
         {.technique = UMB_MAP_CONVOLUTION, .terms = 4, .blur = TAPS},
         {.width = 1}},
        {"convolution 16",
         {.technique = UMB_MAP_CONVOLUTION, .terms = 16, .blur = TAPS},
         {.width = 1}},
        {"convolution 16, damping 2",
         {.technique = UMB_MAP_CONVOLUTION, .terms = 16, .damping = 2, .blur = TAPS},
         {.width = 1}},
        {0},
    };
    fill(occluder, 0.3F);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        receiver[i / WIDTH][i % WIDTH] = (float)(0.35 + 0.6 * (i % WIDTH) / WIDTH);
    }
    draw_row(2, "ringing: truth", panels);
}

/* A strip across two cascades: texels of the right half are four times as large. */
static void seam(void)
{
    enum {
        COARSE = 4
    };
    static float coarse[HEIGHT / COARSE][WIDTH / COARSE], scratch[2 * WIDTH];
    static float truth[WIDTH * HEIGHT], left[WIDTH * HEIGHT], right[WIDTH * HEIGHT];
    static double at[WIDTH * HEIGHT][3], under[WIDTH][3];
    const struct umb_map_settings settings = {.technique = UMB_MAP_VSM, .blur = TAPS};
    const struct panel pcf = {"truth", {.technique = UMB_MAP_PCF}, {.width = TAPS}};
    const struct panel vsm = {"vsm", {.technique = UMB_MAP_VSM, .blur = TAPS}, {.width = 1}};
    struct umb_map_frustum frustum = plain_frustum(WIDTH, HEIGHT);
    fill(receiver, 0.6F);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const int y = i / WIDTH;
        occluder[y][i % WIDTH] = y >= 45 && y < 51 ? 0.3F : 0.6F;
        coarse[y / COARSE][i % WIDTH / COARSE] = occluder[y / COARSE * COARSE + 2][i % WIDTH];
        place(i % WIDTH, y, at[i]);
    }
    for (int i = 0; i < WIDTH; i++) {
        under[i][0] = WIDTH / 4.0 + 0.5 * i; /* away from the map's border */
        under[i][1] = 45.0 + 6.0 * i / WIDTH;
        under[i][2] = 60.0;
    }
    answer(&pcf, truth);
    answer(&vsm, left);
    char name[32];
    paint(3, 0, "seam of cascades: truth", truth);
    struct umb_map *fine = map_of(&frustum, &occluder[0][0], &settings);
    frustum = plain_frustum(WIDTH / COARSE, HEIGHT / COARSE);
    frustum.world_to_map[0][0] = frustum.world_to_map[1][1] = 1.0 / COARSE;
    struct umb_map *far = map_of(&frustum, &coarse[0][0], &settings);
    struct umb_cascade_seam match = {.fine = fine, .coarse = far};
    const struct umb_points points = {.positions = under, .format = UMB_POINT_F64, .count = WIDTH};
    if (umb_cascades_match(&match, &points, scratch, NULL) != UMB_OK) {
        abort();
    }
    for (int panel = 1; panel < 3; panel++) {
        const struct umb_map_query query =
            query_of(far, &(struct umb_map_filter){.width = 1,
                                                   .contrast = panel == 1 ? 1.0 : match.contrast});
        ask(&query, (const double(*)[3])at, (size_t)WIDTH * HEIGHT, right);
        for (int i = 0; i < WIDTH * HEIGHT; i++) {
            right[i] = i % WIDTH < WIDTH / 2 ? left[i] : right[i];
        }
        (void)snprintf(name, sizeof name, "vsm, C = %.1f", panel == 1 ? 1.0 : match.contrast);
        paint(3, panel, name, right);
    }
    printf("%-16s C = 1: %.3f, C = %.1f: %.3f, root mean square under the strip\n", "seam",
           match.difference, match.contrast, match.after);
    umb_map_destroy(fine);
    umb_map_destroy(far);
}

int main(int argc, char **argv)
{
    struct umb_error error = {0};
    if (argc != 2) {
        (void)fprintf(stderr, "usage: failure_pictures OUT.png\n");
        return 2;
    }
    if (umbt_picture_init(&sheet, PANELS * (WIDTH + GAP) - GAP, ROWS * (HEIGHT + TITLE + GAP) - GAP,
                          &error) != UMB_OK) {
        return 1;
    }
    memset(sheet.pixels, 255, (size_t)3 * sheet.width * sheet.height);
    two_occluders();
    near_occluder();
    behind_occluder();
    seam();
    const enum umb_status status = umbt_picture_write(&sheet, argv[1], &error);
    if (status != UMB_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
    }
    umbt_picture_finish(&sheet);
    return status != UMB_OK;
}
