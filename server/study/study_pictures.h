/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PICTURES_H
#define UMBRAGE_SERVER_STUDY_STUDY_PICTURES_H
/* The pictures of a study: one view with the shadows of each resolution, and its differences from
 * rays. */
#include "study/study.h"

#define UMBT_STUDY_PICTURE_WIDTH  640
#define UMBT_STUDY_PICTURE_HEIGHT 360

/* 1 if a result gets pictures: 1 and 9 taps. */
int umbt_study_has_picture(const struct umbt_study_result *result);

/* File name beneath FOLDER: "pictures/4096-closed-9.png", or "...-difference.png". */
void umbt_study_picture_name(const struct umbt_study *study, const struct umbt_study_result *result,
                             int difference, char *name, size_t size);

/* Draws all pictures, and pictures/traced.png. Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbt_study_pictures(const struct umbt_study *study,
                                                struct umb_error *error);

/* The view that `umbrage render` chooses for a picture of that size. Fails: as umbt_camera_make. */
UMB_CHECKED enum umb_status umbt_study_camera(const struct umbt_study *study, uint32_t width,
                                              uint32_t height, struct umbt_camera *camera,
                                              int *z_up, struct umb_error *error);

#endif
