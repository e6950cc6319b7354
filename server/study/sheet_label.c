/* SPDX-License-Identifier: Apache-2.0 */
/* Names in the drawings of a sheet (techniques.h). */
#include "study/picture_text.h"
#include "study/techniques.h"

void umbt_sheet_label(struct umbt_sheet *sheet, size_t tile, const struct umbt_technique_view *view,
                      const char *name)
{
    const uint32_t width = view->size[0], height = view->size[1];
    if (sheet->path == NULL) {
        return;
    }
    /* The gaps between drawings are narrower than one drawing. */
    const uint32_t columns = sheet->picture.width / width;
    const uint32_t gap = columns > 1 ? (sheet->picture.width - columns * width) / (columns - 1) : 0;
    umbt_label_draw(&sheet->picture, (uint32_t)(tile % columns) * (width + gap),
                    (uint32_t)(tile / columns) * (height + gap), 1, name);
}
