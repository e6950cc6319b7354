/* SPDX-License-Identifier: Apache-2.0 */
/* Point files; see point_file.h. */
#include "study/point_file.h"

#include <stdio.h>
#include <string.h>
#include "base/bytes.h"
#include "base/try.h"
#include "tool/output.h"

#define POINT_BYTES_MAX 192U /* longest text of one point: six numbers of at most 25 characters */
#define BUFFER_BYTES    65536U

static size_t f32_put(float value, uint8_t *at)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    umb__store32(at, bits);
    return sizeof bits;
}

static size_t number_put(enum umbt_point_file_format format, double value, uint8_t *at)
{
    if (format == UMBT_POINT_FILE_F32) {
        return f32_put((float)value, at);
    }
    umb__store_f64(at, value);
    return sizeof value;
}

/* Writes one point at `at`; returns its bytes, at most POINT_BYTES_MAX. */
static size_t point_put(const struct umbt_point_file *file, const double position[3],
                        const float normal[3], uint8_t *at)
{
    size_t bytes = 0;
    if (file->format == UMBT_POINT_FILE_TEXT) {
        char line[POINT_BYTES_MAX];
        int length =
            snprintf(line, sizeof line, "%.17g %.17g %.17g", position[0], position[1], position[2]);
        if (file->normals && length > 0) {
            length += snprintf(line + length, sizeof line - (size_t)length, " %.9g %.9g %.9g",
                               (double)normal[0], (double)normal[1], (double)normal[2]);
        }
        line[length] = '\n';
        memcpy(at, line, (size_t)length + 1);
        return (size_t)length + 1;
    }
    for (int k = 0; k < 3; k++) {
        bytes += number_put(file->format, position[k], at + bytes);
    }
    for (int k = 0; k < 3 && file->normals; k++) {
        bytes += number_put(file->format, (double)normal[k], at + bytes);
    }
    return bytes;
}

enum umb_status umbt_point_file_write(const struct umbt_point_file *file,
                                      const struct umbt_point_set *set, uint64_t *bytes,
                                      struct umb_error *error)
{
    struct umbu_output out;
    uint8_t buffer[BUFFER_BYTES];
    size_t used = 0;
    *bytes = 0;
    enum umb_status status = UMB_OK;
    UMB__TRY(umbu_output_begin(file->path, UMBU_OUTPUT_COMMAND, &out, error));
    for (size_t i = 0; i < set->count && status == UMB_OK; i++) {
        double position[3];
        for (int k = 0; k < 3; k++) {
            position[k] = set->positions[i][k] - file->origin[k];
        }
        used += point_put(file, position, set->normals[i], buffer + used);
        if (used > sizeof buffer - POINT_BYTES_MAX || i + 1 == set->count) {
            status = umbu_output_write(&out, buffer, used, error);
            *bytes += used;
            used = 0;
        }
    }
    if (status == UMB_OK) {
        return umbu_output_commit(&out, error);
    }
    umbu_output_abandon(&out);
    return status;
}
