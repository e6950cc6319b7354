/* SPDX-License-Identifier: Apache-2.0 */
/* Reading points, see cli_points.h. */
#include "cli/shared/cli_points.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "tool/base.h"
#include "cli/shared/cli_common.h"
#include "tool/tool_try.h"

#define SHOWN 60    /* bytes of a bad line in a message */
#define RANGE 4096  /* points of a range of a sample */
#define WHOLE 65536 /* points of a batch while a whole file is read */

enum umb_status umbc_points_open(const char *path, enum umbc_points_format format,
                                 bool with_normals, struct umbc_points *points,
                                 struct umb_error *error)
{
    struct stat info;
    memset(points, 0, sizeof *points);
    points->format = format;
    points->with_normals = with_normals;
    if (strcmp(path, "-") == 0) {
        points->file = stdin;
        points->name = "stdin";
        return UMB_OK;
    }
    points->name = path;
    enum umb_status status = umbc_open_input(path, &points->file, error);
    if (status == UMB_OK && fstat(fileno(points->file), &info) == 0) {
        points->size = S_ISREG(info.st_mode) ? (uint64_t)info.st_size : 0;
    }
    return status;
}

void umbc_points_close(struct umbc_points *points)
{
    if (points->file != NULL && points->file != stdin) {
        (void)fclose(points->file);
    }
    points->file = NULL;
}

static enum umb_status read_failed(const struct umbc_points *points, struct umb_error *error)
{
    return umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", points->name);
}

/* Moves the unread bytes to the front of the buffer and reads more after them. */
static enum umb_status fill_buffer(struct umbc_points *points, struct umb_error *error)
{
    memmove(points->buffer, points->buffer + points->begin, points->end - points->begin);
    points->end -= points->begin;
    points->begin = 0;
    size_t count =
        fread(points->buffer + points->end, 1, UMBC_LINE_MAX - points->end, points->file);
    if (count == 0) {
        if (ferror(points->file)) {
            return read_failed(points, error);
        }
        points->ended = true;
    }
    points->end += count;
    points->offset += count;
    return UMB_OK;
}

/*
 * Finds the next line. Out: text: NUL-terminated, in the buffer; NULL at the end of the input.
 * length: bytes of the line, by which a caller detects a NUL inside the line.
 */
static enum umb_status next_line(struct umbc_points *points, char **text, size_t *length,
                                 struct umb_error *error)
{
    *text = NULL;
    for (;;) {
        char *start = points->buffer + points->begin;
        size_t unread = points->end - points->begin;
        char *newline = memchr(start, '\n', unread);
        if (newline != NULL || (points->ended && unread > 0)) {
            *length = newline != NULL ? (size_t)(newline - start) : unread;
            points->begin += *length + (newline != NULL);
            if (*length > 0 && start[*length - 1] == '\r') {
                --*length;
            }
            start[*length] = '\0'; /* the buffer has one byte more than is ever filled */
            points->line++;
            *text = start;
            return UMB_OK;
        }
        if (points->ended) {
            return UMB_OK;
        }
        if (unread == UMBC_LINE_MAX) {
            return umb_fail(error, UMB_E_FORMAT, "%.120s:%llu: line is over the limit of %d bytes",
                            points->name, (unsigned long long)(points->line + 1), UMBC_LINE_MAX);
        }
        UMB__TRY(fill_buffer(points, error));
    }
}

/* Copies a line for a message: printable ASCII, cut. */
static void show_text(const char *text, size_t length, char shown[SHOWN + 4])
{
    size_t count = length < SHOWN ? length : SHOWN;
    for (size_t i = 0; i < count; i++) {
        shown[i] = (char)(text[i] >= ' ' && text[i] <= '~' ? text[i] : '?');
    }
    (void)snprintf(shown + count, 4, "%s", length > SHOWN ? "..." : "");
}

static enum umb_status bad_line(const struct umbc_points *points, const char *line, size_t length,
                                size_t column, const char *what, struct umb_error *error)
{
    char shown[SHOWN + 4];
    show_text(line, length, shown);
    return umb_fail(error, UMB_E_FORMAT, "%.100s:%llu:%zu: %s in '%s'", points->name,
                    (unsigned long long)points->line, column + 1, what, shown);
}

/* Reads one number. The byte after the token is a NUL during the call, and is then restored. */
static bool parse_token(char *token, size_t length, double *value)
{
    const char after = token[length], *at = token;
    token[length] = '\0';
    const bool good = umbu_read_number(&at, value) && at == token + length; /* no NUL inside */
    token[length] = after;
    return good;
}

/* Reads the numbers of a line; *count is 0 for a blank one. */
static enum umb_status parse_line(const struct umbc_points *points, char *line, size_t length,
                                  double values[6], size_t *count, struct umb_error *error)
{
    char *comment = memchr(line, '#', length);
    size_t end = comment != NULL ? (size_t)(comment - line) : length;
    size_t at = 0;
    *count = 0;
    for (;;) {
        while (at < end && (line[at] == ' ' || line[at] == '\t')) {
            at++;
        }
        if (at == end) {
            break;
        }
        size_t token = at;
        while (at < end && line[at] != ' ' && line[at] != '\t') {
            at++;
        }
        if (*count == 6) {
            return bad_line(points, line, length, token, "more than six numbers", error);
        }
        if (!parse_token(line + token, at - token, &values[*count])) {
            const bool has_comma = memchr(line + token, ',', at - token) != NULL;
            return bad_line(points, line, length, token,
                            has_comma ? "blanks separate numbers, not commas"
                                      : "not a finite decimal number",
                            error);
        }
        ++*count;
    }
    if (*count != 0 && *count != 6 && (*count != 3 || points->pairs)) {
        return bad_line(points, line, length, at,
                        points->pairs ? "must have 6 numbers" : "must have 3 or 6 numbers", error);
    }
    return UMB_OK;
}

/* Adds a point of a text file. The batch gets normals as soon as one point has a normal; points
 * without one get a zero normal, which means "none" (query.h). */
static void add_point(struct umbc_batch *batch, const double *values, bool has_normal)
{
    size_t at = 3 * batch->count++;
    for (size_t i = 0; i < 3; i++) {
        batch->wide[at + i] = values[i];
        batch->normals[at + i] = has_normal ? (float)values[3 + i] : 0.0F;
    }
    batch->has_normals = batch->has_normals || has_normal;
}

static enum umb_status read_text(struct umbc_points *points, struct umbc_batch *batch,
                                 struct umb_error *error)
{
    while (batch->count + points->pairs < batch->capacity) {
        char *line;
        size_t length;
        double values[6];
        size_t count;
        UMB__TRY(next_line(points, &line, &length, error));
        if (line == NULL) {
            return UMB_OK;
        }
        UMB__TRY(parse_line(points, line, length, values, &count, error));
        if (count > 0) {
            add_point(batch, values, count == 6 && !points->pairs);
        }
        if (count > 0 && points->pairs) {
            add_point(batch, values + 3, false);
        }
    }
    return UMB_OK;
}

/* Takes one point and its normal; false if a coordinate is not finite. */
static bool add_record(const struct umbc_points *points, const uint8_t *bytes,
                       struct umbc_batch *batch)
{
    bool wide = points->format == UMBC_POINTS_F64;
    size_t step = wide ? 8 : 4;
    size_t at = 3 * batch->count++;
    bool finite = true;
    for (size_t i = 0; i < 3; i++) {
        double value =
            wide ? umb__load_f64(bytes + i * step) : (double)umb__load_f32(bytes + i * step);
        finite = finite && isfinite(value);
        if (batch->wide != NULL) {
            batch->wide[at + i] = value;
        } else {
            batch->narrow[at + i] = (float)value;
        }
        if (points->with_normals) {
            const uint8_t *normal = bytes + (3 + i) * step;
            batch->normals[at + i] = wide ? (float)umb__load_f64(normal) : umb__load_f32(normal);
        }
    }
    batch->has_normals = points->with_normals;
    return finite;
}

static enum umb_status read_raw(struct umbc_points *points, struct umbc_batch *batch,
                                struct umb_error *error)
{
    size_t record = (points->with_normals || points->pairs ? 6U : 3U) *
                    (points->format == UMBC_POINTS_F64 ? 8U : 4U);
    while (batch->count + points->pairs < batch->capacity) {
        if (points->end - points->begin < record) {
            if (!points->ended) {
                UMB__TRY(fill_buffer(points, error));
                continue;
            }
            size_t left = points->end - points->begin;
            return left == 0
                       ? UMB_OK
                       : umb_fail(error, UMB_E_TRUNCATED,
                                  "%.120s: the last %zu bytes are no whole %s of %zu bytes",
                                  points->name, left, points->pairs ? "record" : "point", record);
        }
        const uint8_t *bytes = (const uint8_t *)points->buffer + points->begin;
        points->begin += record;
        bool finite = add_record(points, bytes, batch);
        if (points->pairs) {
            finite = add_record(points, bytes + record / 2, batch) && finite;
        }
        if (!finite) {
            return umb_fail(
                error, UMB_E_FORMAT, "%.120s: %s %llu has a coordinate that is not finite",
                points->name, points->pairs ? "record" : "point",
                (unsigned long long)((batch->first + batch->count - 1) >> points->pairs));
        }
    }
    return UMB_OK;
}

/* Reads points behind those of the batch, until it is full. */
static enum umb_status append(struct umbc_points *points, struct umbc_batch *batch,
                              struct umb_error *error)
{
    const size_t before = batch->count;
    enum umb_status status = points->format == UMBC_POINTS_TEXT ? read_text(points, batch, error)
                                                                : read_raw(points, batch, error);
    points->count += batch->count - before;
    return status;
}

enum umb_status umbc_points_read(struct umbc_points *points, struct umbc_batch *batch,
                                 struct umb_error *error)
{
    batch->count = 0;
    batch->has_normals = false;
    batch->first = points->count;
    return append(points, batch, error);
}

enum umb_status umbc_footprints_read(FILE *file, const char *name, struct umbc_batch *batch,
                                     struct umb_error *error)
{
    if (batch->footprints == NULL) {
        batch->footprints = calloc(batch->capacity, sizeof *batch->footprints);
    }
    if (batch->footprints == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu footprints",
                        batch->capacity);
    }
    const size_t count = fread(batch->footprints, sizeof(float), batch->count, file);
    if (count < batch->count) {
        return ferror(file) ? umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", name)
                            : umb_fail(error, UMB_E_TRUNCATED,
                                       "%.120s: ends after %llu footprints (raw f32), but "
                                       "there are more points",
                                       name, (unsigned long long)(batch->first + count));
    }
    for (size_t i = 0; i < count; i++) {
        const float length = umb__load_f32((const uint8_t *)(batch->footprints + i));
        if (!(isfinite(length) && length >= 0)) {
            return umb_fail(error, UMB_E_FORMAT,
                            "%.120s: footprint %llu is %g, not a length of 0 or more", name,
                            (unsigned long long)(batch->first + i), (double)length);
        }
        batch->footprints[i] = length;
    }
    return UMB_OK;
}

enum umb_status umbc_footprints_end(FILE *file, const char *name, uint64_t points,
                                    struct umb_error *error)
{
    return fgetc(file) == EOF ? UMB_OK
                              : umb_fail(error, UMB_E_FORMAT,
                                         "%.120s: goes on after the footprints (raw f32) of all "
                                         "%llu points",
                                         name, (unsigned long long)points);
}

enum umb_status umbc_batch_init(struct umbc_batch *batch, size_t capacity,
                                enum umbc_points_format format, struct umb_error *error)
{
    bool narrow = format == UMBC_POINTS_F32;
    memset(batch, 0, sizeof *batch);
    if (narrow) {
        batch->narrow = calloc(capacity, 3 * sizeof *batch->narrow);
    } else {
        batch->wide = calloc(capacity, 3 * sizeof *batch->wide);
    }
    batch->normals = calloc(capacity, 3 * sizeof *batch->normals);
    if ((narrow ? batch->narrow == NULL : batch->wide == NULL) || batch->normals == NULL) {
        umbc_batch_finish(batch);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a batch of %zu points",
                        capacity);
    }
    batch->capacity = capacity;
    return UMB_OK;
}

void umbc_batch_finish(struct umbc_batch *batch)
{
    free(batch->wide);
    free(batch->narrow);
    free(batch->normals);
    free(batch->footprints);
    memset(batch, 0, sizeof *batch);
}

struct umb_points umbc_batch_view(const struct umbc_batch *batch, enum umbc_points_format format,
                                  const double origin[3])
{
    struct umb_points view = {
        .positions = format == UMBC_POINTS_F32 ? (const void *)batch->narrow : batch->wide,
        .format = format == UMBC_POINTS_F32 ? UMB_POINT_F32 : UMB_POINT_F64,
        .normals = batch->has_normals ? batch->normals : NULL,
        .count = batch->count,
        .footprints = batch->footprints,
    };
    memcpy(view.origin, origin, sizeof view.origin);
    return view;
}

/* Moves to the first point at or behind byte `offset` of the file. */
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

/* Reads points at byte `offset` of a file into a sample; leaves out a range that cannot be read. */
static void read_range(const char *path, uint64_t offset, struct umbc_points *source,
                       struct umbc_batch *sample)
{
    const size_t count = sample->count;
    struct umb_error ignored;
    if (umbc_points_open(path, source->format, source->with_normals, source, &ignored) != UMB_OK) {
        return;
    }
    if (!seek_point(source, offset) || append(source, sample, &ignored) != UMB_OK) {
        sample->count = count;
    }
    umbc_points_close(source);
}

enum umb_status umbc_points_sample(const char *path, enum umbc_points_format format,
                                   bool with_normals, size_t most, struct umbc_batch *batch,
                                   struct umb_error *error)
{
    struct umb_error ignored;
    UMB__TRY(umbc_batch_init(batch, most, format, error));
    struct umbc_points *source = malloc(sizeof *source);
    if (source == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a sample of points");
    }
    uint64_t size = 0;
    if (strcmp(path, "-") != 0 &&
        umbc_points_open(path, format, with_normals, source, &ignored) == UMB_OK) {
        size = source->size;
        umbc_points_close(source);
    }
    /* A file that may have no more points than `most` is read as a whole. */
    const uint64_t count = size > most * 12 && most > RANGE ? most / RANGE : size > 0;
    for (uint64_t i = 0; i < count; i++) {
        const size_t end = batch->count + (count > 1 ? RANGE : most);
        batch->capacity = end < most ? end : most;
        read_range(path, size / count * i, source, batch);
    }
    batch->capacity = most;
    free(source);
    return UMB_OK;
}

/* Reads points to the end of the source, or until there are `most`. */
static enum umb_status read_all(struct umbc_points *source, size_t most, struct umbc_batch *batch,
                                struct umb_error *error)
{
    UMB__TRY(umbc_batch_init(batch, WHOLE < most ? WHOLE : most, UMBC_POINTS_F64, error));
    for (;;) {
        UMB__TRY(append(source, batch, error));
        if (batch->count < batch->capacity || batch->capacity == most) {
            return UMB_OK;
        }
        batch->capacity = 2 * batch->capacity < most ? 2 * batch->capacity : most;
        double *wide = realloc(batch->wide, 3 * batch->capacity * sizeof *wide);
        batch->wide = wide != NULL ? wide : batch->wide;
        float *normals = realloc(batch->normals, 3 * batch->capacity * sizeof *normals);
        batch->normals = normals != NULL ? normals : batch->normals;
        if (wide == NULL || normals == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu points", batch->count);
        }
    }
}

enum umb_status umbc_points_load(const char *path, enum umbc_points_format format,
                                 bool with_normals, size_t most, struct umbc_batch *batch,
                                 struct umb_error *error)
{
    memset(batch, 0, sizeof *batch);
    struct umbc_points *source = malloc(sizeof *source);
    if (source == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for '%.200s'", path);
    }
    enum umb_status status = umbc_points_open(path, format, with_normals, source, error);
    if (status == UMB_OK) {
        status = read_all(source, most, batch, error);
        umbc_points_close(source);
    }
    free(source);
    if (status != UMB_OK) {
        umbc_batch_finish(batch);
    }
    return status;
}
