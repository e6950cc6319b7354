/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_POINTS_H
#define UMBRAGE_CLI_CLI_POINTS_H
/*
 * Points from a file or stdin, a batch at a time, in bounded memory.
 *
 * Text: one point a line, `x y z` or `x y z nx ny nz`, separated by blanks or tabs; '#' starts a
 * comment, blank lines are skipped. Numbers are decimal with a point, whatever the locale, and are
 * kept as doubles. Raw: little-endian float32 or float64, three numbers a point, or six with
 * normals.
 *
 * Errors name the line, the column and the text, or the byte offset. Their status leads to exit
 * code 65, because a file's content is never a usage error.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "umbrage/query.h"

enum umbc_points_format {
    UMBC_POINTS_TEXT,
    UMBC_POINTS_F32,
    UMBC_POINTS_F64,
};

#define UMBC_LINE_MAX 65536 /* bytes of one line of text */

struct umbc_points {
    FILE *file;
    const char *name; /* borrowed; "stdin" for "-" */
    enum umbc_points_format format;
    bool with_normals; /* true: raw points have six numbers */
    /* true: six numbers are two points, such as the ends of a segment or corners of a box, and a
     * batch never ends within a pair. Set this before the first read. */
    bool pairs;
    uint64_t line;     /* number of the last line of text */
    uint64_t offset;   /* number of bytes read */
    uint64_t size;     /* size of the file in bytes, 0 = not known */
    uint64_t count;    /* number of points given out */
    size_t begin, end; /* range of unread bytes in buffer */
    bool ended;        /* true: the file has no more bytes */
    char buffer[UMBC_LINE_MAX + 1];
};

/* Points with normals and footprints; memory for `capacity` points. */
struct umbc_batch {
    size_t capacity, count;
    double *wide;   /* [3 * capacity] doubles, or NULL */
    float *narrow;  /* [3 * capacity] floats, or NULL */
    float *normals; /* [3 * capacity] */
    bool has_normals;
    float *footprints; /* [capacity], or NULL; metres, see umbc_footprints_read */
    uint64_t first;    /* number of the first point, from 0 */
};

/* Opens path ("-" is stdin). Fails: E_NO_INPUT. */
UMB_CHECKED enum umb_status umbc_points_open(const char *path, enum umbc_points_format format,
                                             bool with_normals, struct umbc_points *points,
                                             struct umb_error *error);
void umbc_points_close(struct umbc_points *points);

/*
 * Reads up to batch->capacity points.
 *
 * In:    batch: made for the points' format.
 * Out:   batch->count: 0 at the end of the input.
 * Fails: E_FORMAT (a bad line, a number that is not finite), E_TRUNCATED (raw bytes left over),
 *        E_IO. The batch's content is unspecified then.
 */
UMB_CHECKED enum umb_status umbc_points_read(struct umbc_points *points, struct umbc_batch *batch,
                                             struct umb_error *error);

/* Reads a footprint in metres, a raw f32, for each point of a batch. Fails: E_NO_MEMORY,
 * E_TRUNCATED (fewer than points), E_FORMAT (not finite, below 0), E_IO. */
UMB_CHECKED enum umb_status umbc_footprints_read(FILE *file, const char *name,
                                                 struct umbc_batch *batch, struct umb_error *error);

/* Checks that the file ends after the footprints of all points. Fails: E_FORMAT. */
UMB_CHECKED enum umb_status umbc_footprints_end(FILE *file, const char *name, uint64_t points,
                                                struct umb_error *error);

/* Makes room for points of a format. Fails: E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbc_batch_init(struct umbc_batch *batch, size_t capacity,
                                            enum umbc_points_format format,
                                            struct umb_error *error);
void umbc_batch_finish(struct umbc_batch *batch);

/* Returns the batch as points of the library, which borrow the batch's arrays. origin: metres to
 * add to every point. */
struct umb_points umbc_batch_view(const struct umbc_batch *batch, enum umbc_points_format format,
                                  const double origin[3]);

/*
 * Reads a whole file.
 *
 * In:    most: number of points after which reading stops.
 * Out:   batch: the points as doubles, whatever the format of the file.
 * Fails: as umbc_points_open and umbc_points_read; E_NO_MEMORY. The batch is then empty.
 */
UMB_CHECKED enum umb_status umbc_points_load(const char *path, enum umbc_points_format format,
                                             bool with_normals, size_t most,
                                             struct umbc_batch *batch, struct umb_error *error);

/* Number of points of a calibration sample. It is so large that the points touch more memory than
 * the caches hold. */
#define UMBC_SAMPLE_POINTS 262144

/*
 * Reads ranges of consecutive points from all over a file, or all of a small one.
 *
 * In:    path, format, with_normals: as for umbc_points_open. most: number of points wanted.
 * Out:   batch: finish with umbc_batch_finish, also after a failure. batch->count is 0 for stdin,
 *        pipes and files that cannot be read. Such files are not reported here: reading the whole
 *        file later reports the error.
 * Fails: E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbc_points_sample(const char *path, enum umbc_points_format format,
                                               bool with_normals, size_t most,
                                               struct umbc_batch *batch, struct umb_error *error);

#endif
