/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/picture.h"

enum {
    PIXELS = SIDE * SIDE
};

static float depth[PIXELS], points[3 * PIXELS];
static uint8_t base[PIXELS], values_u8[PIXELS], scratch[PIXELS], unpacked[PIXELS];

static int example(void)
{
    const struct umb_picture picture = {
        .camera = {.forward = {0, 0, -1}, .up = {0, 1, 0}, .fov_y = 1},
        .width = SIDE,
        .height = SIDE,
        .depth = depth};
    const size_t count = PIXELS;
    void *packed = malloc(umb_picture_room(count));
    size_t packed_size = 0;
    uint8_t *values = values_u8;
    memset(values, 7, count);
#include "picture.1"
    EXPECT(points[2] == -10.0F && points[3 * (PIXELS - 1)] == 0.0F);
    EXPECT(values[0] == 7 && values[PIXELS - 1] == 255);
    EXPECT(packed_size < count && memcmp(values, unpacked, count) == 0);
    free(packed);
    return UMB_OK;
}

int main(void)
{
    for (int i = 0; i < PIXELS / 2; i++) {
        depth[i] = 10.0F;
    }
    return example_end((enum umb_status)example());
}
