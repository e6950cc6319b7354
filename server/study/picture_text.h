/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_PICTURE_TEXT_H
#define UMBRAGE_SERVER_STUDY_PICTURE_TEXT_H
/*
 * Labels in pictures: one line of white text on a dark strip, in a font of 5 x 7 pixels. Characters
 * other than those of ASCII that print are drawn as question marks.
 */
#include "study/picture.h"

#define UMBT_LABEL_HEIGHT 11 /* pixels of a strip at scale 1 */

/* Returns the width of a label's strip in pixels. */
uint32_t umbt_label_width(const char *text, uint32_t scale);

/* Draws a label whose upper left corner is at x, y. What lies outside of the picture is left out.
 * scale: pixels of the picture a side of a font pixel, 1 to 8. */
void umbt_label_draw(struct umbt_picture *picture, uint32_t x, uint32_t y, uint32_t scale,
                     const char *text);

#endif
