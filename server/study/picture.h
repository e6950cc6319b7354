/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_PICTURE_H
#define UMBRAGE_SERVER_STUDY_PICTURE_H
/* 8-bit sRGB pictures and their PNG files, which appear whole or not at all. */
#include <stdint.h>
#include "umbrage/status.h"

struct umbt_picture {
    uint32_t width, height; /* 1..16384 each */
    uint8_t *pixels;        /* uint8[height][width][3], sRGB, top row first */
};

/* Makes a black picture. Fails: E_NO_MEMORY. Owns: umbt_picture_finish. */
UMB_CHECKED enum umb_status umbt_picture_init(struct umbt_picture *picture, uint32_t width,
                                              uint32_t height, struct umb_error *error);
void umbt_picture_finish(struct umbt_picture *picture); /* a zeroed struct is allowed */

/* Writes a PNG, replacing path atomically. Fails: E_NO_MEMORY, E_INTERNAL (libpng),
 * E_CANNOT_CREATE, E_IO. */
UMB_CHECKED enum umb_status umbt_picture_write(const struct umbt_picture *picture, const char *path,
                                               struct umb_error *error);

#endif
