/* SPDX-License-Identifier: Apache-2.0 */
/* One view drawn by many techniques, side by side; see techniques.h. */
#include "study/techniques.h"

#include "base/try.h"

#define COLUMNS 5U /* drawings in a row of a sheet */
#define GAP     4U /* pixels between drawings */

static struct umbt_rgb pixel_color(const struct umbt_technique_view *view, size_t pixel,
                                   const float *values)
{
    const uint32_t slot = view->buffer.slots[pixel];
    const int up = view->setup.z_up ? 2 : 1;
    if (slot == UMBT_SKY) {
        double direction[3];
        umbt_camera_ray(&view->setup.camera,
                        ((double)(pixel % view->size[0]) + 0.5) / view->size[0],
                        ((double)(pixel / view->size[0]) + 0.5) / view->size[1], direction);
        return umbt_sky(direction[up]);
    }
    double normal[3];
    umbt_widen(view->buffer.normals[slot], normal);
    const uint32_t key = umbt_scene_surface_key(view->setup.scene, view->buffer.triangles[slot]);
    return umbt_shade(umbt_surface_color(key), (double)values[slot],
                      umb__dot(normal, view->setup.to_light), normal[up]);
}

enum umb_status umbt_sheet_begin(struct umbt_sheet *sheet, const char *path,
                                 const struct umbt_technique_view *view, size_t tiles,
                                 struct umb_error *error)
{
    const uint32_t rows = (uint32_t)((tiles + COLUMNS - 1) / COLUMNS);
    sheet->path = path;
    return path != NULL ? umbt_picture_init(&sheet->picture, COLUMNS * (view->size[0] + GAP) - GAP,
                                            rows * (view->size[1] + GAP) - GAP, error)
                        : UMB_OK;
}

void umbt_sheet_draw(struct umbt_sheet *sheet, size_t tile, const struct umbt_technique_view *view,
                     const float *values)
{
    const size_t width = view->size[0], height = view->size[1];
    const size_t x0 = tile % COLUMNS * (width + GAP), y0 = tile / COLUMNS * (height + GAP);
    for (size_t pixel = 0; sheet->path != NULL && pixel < width * height; pixel++) {
        const struct umbt_rgb color = pixel_color(view, pixel, values);
        const size_t x = x0 + pixel % width, y = y0 + pixel / width;
        for (size_t c = 0; c < 3; c++) {
            sheet->picture.pixels[3 * (y * sheet->picture.width + x) + c] =
                umbt_srgb8(umbt_shoulder(color.c[c]));
        }
    }
}

enum umb_status umbt_sheet_write(const struct umbt_sheet *sheet, struct umb_error *error)
{
    return sheet->path != NULL ? umbt_picture_write(&sheet->picture, sheet->path, error) : UMB_OK;
}
