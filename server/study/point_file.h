/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_POINT_FILE_H
#define UMBRAGE_SERVER_STUDY_POINT_FILE_H
/*
 * Point files for `umbrage query --points`: raw little-endian floats or doubles, three for a point
 * or six with the normal, or text with a point a line.
 */
#include "study/point_sampler.h"

enum umbt_point_file_format {
    UMBT_POINT_FILE_F32 = 0,
    UMBT_POINT_FILE_F64,
    UMBT_POINT_FILE_TEXT, /* %.17g, normals %.9g: reading gives the same bits */
};

struct umbt_point_file {
    const char *path; /* "-" is stdout */
    enum umbt_point_file_format format;
    int normals;      /* 1: write normals too */
    double origin[3]; /* subtracted from every position */
};

/*
 * Writes a set; the file is replaced as a whole or stays as it was.
 *
 * Out:   bytes: size of the file.
 * Fails: E_CANNOT_CREATE, E_IO, E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbt_point_file_write(const struct umbt_point_file *file,
                                                  const struct umbt_point_set *set, uint64_t *bytes,
                                                  struct umb_error *error);

#endif
