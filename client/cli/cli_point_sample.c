/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_point_sample.h. */
#include "cli_point_sample.h"

#include <stdlib.h>
#include <string.h>

#define RANGE 4096 /* points */

/* Goes to a place in the file where a point begins: the first one not before `offset`. */
static bool seek_point(struct umbc_points *source, uint64_t offset)
{
    const uint64_t record =
        (source->with_normals ? 6U : 3U) * (source->format == UMBC_POINTS_F64 ? 8U : 4U);
    const bool is_text = source->format == UMBC_POINTS_TEXT;
    if (!is_text) {
        offset = (offset + record - 1) / record * record;
    }
    if (offset > INT64_MAX || fseeko(source->file, (off_t)offset, SEEK_SET) != 0) {
        return false;
    }
    for (int c = is_text && offset > 0 ? getc(source->file) : '\n'; c != '\n';) {
        if (c == EOF) {
            return false;
        }
        c = getc(source->file);
    }
    return true;
}

/* Adds a range's points to the sample. */
static void append(struct umbc_batch *sample, const struct umbc_batch *range)
{
    const size_t room = sample->capacity - sample->count;
    const size_t count = range->count < room ? range->count : room;
    const size_t at = 3 * sample->count;
    if (sample->wide != NULL) {
        memcpy(sample->wide + at, range->wide, 3 * count * sizeof *sample->wide);
    } else {
        memcpy(sample->narrow + at, range->narrow, 3 * count * sizeof *sample->narrow);
    }
    if (range->has_normals) {
        memcpy(sample->normals + at, range->normals, 3 * count * sizeof *sample->normals);
        sample->has_normals = true;
    }
    sample->count += count;
}

/* Reads one range; what cannot be read is left out. */
static void read_range(struct umbc_points *source, uint64_t offset, struct umbc_batch *range,
                       struct umbc_batch *sample)
{
    struct umb_error ignored;
    if (seek_point(source, offset) && umbc_points_read(source, range, &ignored) == UMB_OK) {
        append(sample, range);
    }
}

enum umb_status umbc_points_sample(const char *path, enum umbc_points_format format,
                                   bool with_normals, size_t most, struct umbc_batch *batch,
                                   struct umb_error *error)
{
    struct umb_error ignored;
    struct umbc_batch range = {0};
    enum umb_status status = umbc_batch_init(batch, most, format, error);
    struct umbc_points *source = malloc(sizeof *source);
    if (status == UMB_OK && source == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a sample of points");
    }
    uint64_t size = 0;
    if (status == UMB_OK && strcmp(path, "-") != 0 &&
        umbc_points_open(path, format, with_normals, source, &ignored) == UMB_OK) {
        size = source->size;
        umbc_points_close(source);
    }
    /* A file that may have no more points than that is read as a whole. */
    const uint64_t count = size > most * 12 && most > RANGE ? most / RANGE : size > 0;
    if (status == UMB_OK && count > 0) {
        status = umbc_batch_init(&range, count > 1 ? RANGE : batch->capacity, format, error);
    }
    for (uint64_t i = 0; status == UMB_OK && i < count; i++) {
        if (umbc_points_open(path, format, with_normals, source, &ignored) == UMB_OK) {
            read_range(source, size / count * i, &range, batch);
            umbc_points_close(source);
        }
    }
    umbc_batch_finish(&range);
    free(source);
    return status;
}
