/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the receiver mask (NEAR) as docs/reference/umb-format.md, section 3, describes it: a bit at
 * a time. */
#include "oracle_parts.h"

enum {
    CELLS = 64
};

int oracle_receiver_mask(const struct oracle *oracle, uint32_t frustum, uint32_t x, uint32_t y,
                         uint32_t z)
{
    if (oracle->receiver_mask.data == NULL || frustum >= oracle->frustum_count) {
        return -1;
    }
    const uint64_t side = (uint64_t)1 << oracle->frusta[frustum].n, cell = side / CELLS;
    if (x >= side || y >= side || z >= side) {
        return -1;
    }
    const uint64_t row = (uint64_t)frustum * CELLS * CELLS + y / cell + CELLS * (z / cell);
    const uint64_t bit = x / cell;
    return oracle->receiver_mask.data[8 * row + bit / 8] >> bit % 8 & 1;
}

int oracle_check_receiver_mask(const struct oracle *oracle, char error[ORACLE_ERROR_SIZE])
{
    if (oracle->receiver_mask.data == NULL) {
        return 1;
    }
    if (oracle->receiver_mask.size != (uint64_t)oracle->frustum_count * CELLS * CELLS * CELLS / 8) {
        return oracle_refuse(error, "NEAR: not 32768 bytes a frustum");
    }
    for (uint32_t i = 0; i < oracle->light_count; i++) {
        if (oracle->lights[i].kind != 0) {
            return oracle_refuse(error, "NEAR: a light is not directional");
        }
    }
    return 1;
}
