/* SPDX-License-Identifier: Apache-2.0 */
/* See gltf_column.h. Sizes and offsets are held below SIZE_LIMIT, so that their sums fit. */
#include "bake/import/gltf_column.h"

#include <stdlib.h>
#include <string.h>

#include "bake/import/json_scan.h"
#include "base/try.h"

#define SIZE_LIMIT ((int64_t)1 << 40)
#define NO_NUMBER  (-1)

enum component {
    COMPONENT_BYTE = 5120,
    COMPONENT_SHORT = 5122,
    COMPONENT_FLOAT = 5126
};

struct accessor {
    int64_t view, offset, component, count;
    uint32_t width; /* numbers an element; 0: a matrix, or not stated */
    int is_sparse;
};

struct view {
    int64_t buffer, offset, length, stride; /* stride 0: elements follow one another */
};

struct buffer {
    struct umbb_json_text uri; /* length 0: the GLB's own chunk */
    const char *bytes;         /* NULL: not opened */
    size_t size;
    struct umbb_file file;
    char *decoded; /* content of a data URI */
};

static uint32_t width_of(struct umbb_json_text type)
{
    static const char *const names[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    for (uint32_t i = 0; i < 4; i++) {
        if (umbb_json_is(type, names[i])) {
            return i + 1;
        }
    }
    return 0;
}

static void read_accessor(struct umbb_cursor *json, void *item)
{
    struct accessor *accessor = item;
    struct umbb_json_text key;
    *accessor = (struct accessor){.view = NO_NUMBER, .component = NO_NUMBER, .count = NO_NUMBER};
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "bufferView")) {
            accessor->view = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "byteOffset")) {
            accessor->offset = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "componentType")) {
            accessor->component = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "count")) {
            accessor->count = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "type") && umbb_skip_blanks(json) && *json->at == '"') {
            accessor->width = width_of(umbb_json_string(json));
        } else {
            accessor->is_sparse |= umbb_json_is(key, "sparse");
            umbb_json_skip(json);
        }
    }
}

static void read_view(struct umbb_cursor *json, void *item)
{
    struct view *view = item;
    struct umbb_json_text key;
    *view = (struct view){.buffer = NO_NUMBER, .length = NO_NUMBER};
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "buffer")) {
            view->buffer = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "byteOffset")) {
            view->offset = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "byteLength")) {
            view->length = umbb_json_number(json, NO_NUMBER);
        } else if (umbb_json_is(key, "byteStride")) {
            view->stride = umbb_json_number(json, NO_NUMBER);
        } else {
            umbb_json_skip(json);
        }
    }
}

static void read_buffer(struct umbb_cursor *json, void *item)
{
    struct buffer *buffer = item;
    struct umbb_json_text key;
    memset(buffer, 0, sizeof *buffer);
    while (umbb_json_member(json, &key)) {
        if (umbb_json_is(key, "uri") && umbb_skip_blanks(json) && *json->at == '"') {
            buffer->uri = umbb_json_string(json);
        } else {
            umbb_json_skip(json);
        }
    }
}

/* Target of reading an array of objects. */
struct list {
    const char *name;
    struct umbs_array *items;
    size_t item_bytes;
    /* Reads an object after its opening bracket. */
    void (*read)(struct umbb_cursor *json, void *item);
};

static enum umb_status read_list(struct umbb_cursor *json, const struct list *list,
                                 struct umb_error *error)
{
    if (!umbb_json_enter(json, '[')) {
        return UMB_OK;
    }
    while (umbb_json_item(json)) {
        void *item = umbs_array_reserve(list->items, 1, list->item_bytes);
        struct umbb_cursor none = {json->end, json->end};
        if (item == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %s", list->name);
        }
        list->items->count++;
        list->read(umbb_json_enter(json, '{') ? json : &none, item);
    }
    return UMB_OK;
}

enum umb_status umbb_gltf_columns_find(struct umbb_gltf_columns *columns,
                                       const struct umbb_import *job, enum umbb_kind kind,
                                       struct umb_error *error)
{
    const struct list lists[] = {
        {"accessors", &columns->accessors, sizeof(struct accessor), read_accessor},
        {"bufferViews", &columns->views, sizeof(struct view), read_view},
        {"buffers", &columns->buffers, sizeof(struct buffer), read_buffer},
    };
    struct umbb_cursor json = umbb_gltf_json(job, kind);
    struct umbb_json_text key;
    enum umb_status status = UMB_OK;
    columns->job = job;
    if (!umbb_json_enter(&json, '{')) {
        return UMB_OK;
    }
    while (status == UMB_OK && umbb_json_member(&json, &key)) {
        const struct list *list = NULL;
        for (size_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
            if (umbb_json_is(key, lists[i].name)) {
                list = &lists[i];
            }
        }
        if (list != NULL) {
            status = read_list(&json, list, error);
        } else {
            umbb_json_skip(&json);
        }
    }
    return status;
}

void umbb_gltf_columns_finish(struct umbb_gltf_columns *columns)
{
    struct buffer *buffers = columns->buffers.data;
    for (size_t i = 0; i < columns->buffers.count; i++) {
        umbb_file_unmap(&buffers[i].file);
        free(buffers[i].decoded);
    }
    free(columns->accessors.data);
    free(columns->views.data);
    free(columns->buffers.data);
    memset(columns, 0, sizeof *columns);
}

/* Opens the binary chunk of a GLB, if there is one. */
static void open_chunk(const struct umbb_file *file, struct buffer *buffer)
{
    buffer->bytes = "";
    if (file->size < 20 || memcmp(file->bytes, "glTF", 4) != 0) {
        return;
    }
    const uint64_t header = 20 + (uint64_t)umbb_load_u32(file->bytes + 12);
    if (header + 8 <= file->size && memcmp(file->bytes + header + 4, "BIN", 4) == 0) {
        const uint64_t length = umbb_load_u32(file->bytes + header);
        const uint64_t left = file->size - header - 8;
        buffer->bytes = file->bytes + header + 8;
        buffer->size = (size_t)(length < left ? length : left);
    }
}

/* Value of a base64 letter (RFC 4648); 64 for other characters. */
static uint32_t base64_digit(char c)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *at = c != '\0' ? strchr(digits, c) : NULL;
    return at != NULL ? (uint32_t)(at - digits) : 64;
}

/* Decodes a data URI, up to the first character that is not base64. */
static enum umb_status open_data(struct umbb_json_text text, struct buffer *buffer,
                                 struct umb_error *error)
{
    uint32_t bits = 0, held = 0;
    buffer->decoded = malloc(text.length + 1);
    if (buffer->decoded == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a data URI");
    }
    for (size_t i = 0; i < text.length && base64_digit(text.at[i]) < 64; i++) {
        bits = bits << 6 | base64_digit(text.at[i]);
        held += 6;
        if (held >= 8) {
            held -= 8;
            buffer->decoded[buffer->size++] = (char)(bits >> held & 0xff);
        }
    }
    buffer->bytes = buffer->decoded;
    return UMB_OK;
}

static enum umb_status open_buffer(const struct umbb_gltf_columns *columns, struct buffer *buffer,
                                   struct umb_error *error)
{
    static const char base64[] = ";base64,";
    const struct umbb_json_text uri = buffer->uri;
    const struct umbb_import *job = columns->job;
    if (uri.length == 0) {
        open_chunk(&job->file, buffer);
        return UMB_OK;
    }
    if (umbb_json_starts(uri, "data:")) {
        const char *comma = memchr(uri.at, ',', uri.length < 200 ? uri.length : 200);
        const size_t head = comma != NULL ? (size_t)(comma - uri.at) + 1 : 0;
        if (head < sizeof base64 - 1 ||
            memcmp(uri.at + head - (sizeof base64 - 1), base64, sizeof base64 - 1) != 0) {
            return umb_fail(error, UMB_E_BAD_SCENE, "a data URI of a buffer is not base64");
        }
        const struct umbb_json_text text = {uri.at + head, uri.length - head};
        return open_data(text, buffer, error);
    }
    struct umb_error cause = {0};
    const enum umb_status status = umbb_file_map_uri(&job->folder, uri.at, uri.length,
                                                     job->max_input_bytes, &buffer->file, &cause);
    if (status != UMB_OK) {
        return umb_fail(error, status == UMB_E_NO_MEMORY ? status : UMB_E_BAD_SCENE,
                        "buffer of instances: %s", cause.message);
    }
    buffer->bytes = buffer->file.bytes;
    buffer->size = buffer->file.size;
    return UMB_OK;
}

static size_t component_bytes(int64_t component)
{
    return component == COMPONENT_FLOAT   ? 4
           : component == COMPONENT_SHORT ? 2
           : component == COMPONENT_BYTE  ? 1
                                          : 0;
}

static int in_size(int64_t value)
{
    return value >= 0 && value < SIZE_LIMIT;
}

static enum umb_status bad_accessor(int64_t number, const char *what, struct umb_error *error)
{
    return umb_fail(error, UMB_E_BAD_SCENE, "accessors[%lld] of instances %s", (long long)number,
                    what);
}

enum umb_status umbb_gltf_column_open(struct umbb_gltf_columns *columns, int64_t number,
                                      uint32_t width, struct umbb_gltf_column *column,
                                      struct umb_error *error)
{
    if (number < 0 || (uint64_t)number >= columns->accessors.count) {
        return bad_accessor(number, "does not exist", error);
    }
    const struct accessor *accessor = (const struct accessor *)columns->accessors.data + number;
    const size_t bytes = component_bytes(accessor->component) * width;
    if (accessor->width != width || bytes == 0 ||
        (width == 3 && accessor->component != COMPONENT_FLOAT)) {
        return bad_accessor(number, "is of a type that is not read", error);
    }
    if (accessor->is_sparse || accessor->view < 0 ||
        (uint64_t)accessor->view >= columns->views.count) {
        return bad_accessor(number, "has no bufferView, or is sparse, which is not supported",
                            error);
    }
    const struct view *view = (const struct view *)columns->views.data + accessor->view;
    if (view->buffer < 0 || (uint64_t)view->buffer >= columns->buffers.count) {
        return bad_accessor(number, "has no buffer", error);
    }
    struct buffer *buffer = (struct buffer *)columns->buffers.data + view->buffer;
    UMB__TRY(buffer->bytes == NULL ? open_buffer(columns, buffer, error) : UMB_OK);
    const int64_t stride = view->stride != 0 ? view->stride : (int64_t)bytes;
    if (!in_size(accessor->offset) || !in_size(view->offset) || !in_size(view->length) ||
        stride < 1 || stride > 65536 || accessor->count < 1 || accessor->count > UINT32_MAX ||
        accessor->offset + stride * (accessor->count - 1) + (int64_t)bytes > view->length ||
        (uint64_t)(view->offset + view->length) > buffer->size) {
        return bad_accessor(number, "lies outside of its buffer", error);
    }
    *column = (struct umbb_gltf_column){.bytes = buffer->bytes + view->offset + accessor->offset,
                                        .stride = (size_t)stride,
                                        .count = (uint32_t)accessor->count,
                                        .width = width,
                                        .component = (int32_t)accessor->component};
    return UMB_OK;
}

void umbb_gltf_column_get(const struct umbb_gltf_column *column, size_t index, double *numbers)
{
    const char *at = column->bytes + index * column->stride;
    for (uint32_t i = 0; i < column->width; i++) {
        if (column->component == COMPONENT_FLOAT) {
            const uint32_t bits = umbb_load_u32(at + 4 * (size_t)i);
            float value;
            memcpy(&value, &bits, sizeof value);
            numbers[i] = (double)value;
        } else {
            const int is_short = column->component == COMPONENT_SHORT;
            const uint8_t low = (uint8_t)at[is_short ? 2 * (size_t)i : i];
            const uint8_t high = is_short ? (uint8_t)at[2 * (size_t)i + 1] : 0;
            const double value =
                is_short ? (double)(int16_t)(uint16_t)(low | high << 8) : (double)(int8_t)low;
            const double fraction = value / (is_short ? 32767.0 : 127.0);
            numbers[i] = fraction > -1.0 ? fraction : -1.0;
        }
    }
}
