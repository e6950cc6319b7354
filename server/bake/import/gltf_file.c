/* SPDX-License-Identifier: Apache-2.0 */
/* JSON and buffers of a glTF file (gltf.h). */
#include "bake/import/gltf.h"

#include <math.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "common/clean_text.h"

#define GLB_HEADER_BYTES 12
#define GLB_CHUNK_BYTES  8 /* header of a chunk */

/* Target of the jump out of Jansson's parser when memory is refused. One importer runs in a
 * process, so one is enough. */
static jmp_buf refusal;

/* Leaves Jansson's parser by a jump when memory is refused. Otherwise its lexer would drop
 * characters, such as the end of a string, and read on behind its buffer. */
static void *take_memory(size_t size)
{
    void *memory = malloc(size);
    if (memory == NULL) {
        longjmp(refusal, 1);
    }
    return memory;
}

/* Parses the text. Returns 0 if memory is refused; the memory so far stays allocated then, because
 * the importer is about to end. Out: json: NULL, with a fault, if the text is no JSON. */
static int parse(struct umbb_cursor text, json_t **json, json_error_t *fault)
{
    if (setjmp(refusal) != 0) {
        json_set_alloc_funcs(malloc, free); /* `refusal` ends with this function */
        return 0;
    }
    json_set_alloc_funcs(take_memory, free);
    *json = json_loadb(text.at, (size_t)(text.end - text.at),
                       JSON_REJECT_DUPLICATES | JSON_DECODE_INT_AS_REAL | JSON_ALLOW_NUL, fault);
    json_set_alloc_funcs(malloc, free);
    return 1;
}

/* Finds the JSON: the file without a byte order mark, or the first chunk of a GLB, which some
 * exporters fill with NULs. Also finds the binary chunk of a GLB. */
static enum umb_status find_json(const struct umbb_file *file, struct umbb_cursor *json,
                                 struct umbb_cursor *chunk, struct umb_error *error)
{
    const size_t before = GLB_HEADER_BYTES + GLB_CHUNK_BYTES;
    *json = umbb_text_of(file);
    *chunk = (struct umbb_cursor){json->end, json->end};
    if (!umbb_starts_with(*json, "glTF")) {
        json->at += umbb_starts_with(*json, "\xef\xbb\xbf") ? 3 : 0;
        return UMB_OK;
    }
    if (file->size < GLB_HEADER_BYTES || umbb_load_u32(file->bytes + 4) != 2) {
        return UMBB_REFUSE(error, "the file is GLB of another version than 2");
    }
    if (umbb_load_u32(file->bytes + 8) > file->size) {
        return UMBB_REFUSE(error, "the file ends before the length it states");
    }
    if (file->size < before || memcmp(file->bytes + GLB_HEADER_BYTES + 4, "JSON", 4) != 0) {
        return UMBB_REFUSE(error, "the first chunk of the GLB is not JSON");
    }
    const size_t length = umbb_load_u32(file->bytes + GLB_HEADER_BYTES), left = file->size - before;
    const size_t padded = (length + 3) & ~(size_t)3; /* chunks begin at multiples of 4 */
    if (length > left) {
        return UMBB_REFUSE(
            error, "the JSON chunk has %zu bytes, but the file has only %zu after its header",
            length, left);
    }
    json->at += before;
    json->end = json->at + length;
    if (padded + GLB_CHUNK_BYTES <= left && memcmp(json->at + padded + 4, "BIN", 4) == 0) {
        const size_t bytes = umbb_load_u32(json->at + padded);
        chunk->at = json->at + padded + GLB_CHUNK_BYTES;
        chunk->end = bytes < umbb_length(*chunk) ? chunk->at + bytes : chunk->end;
    }
    while (json->end > json->at && json->end[-1] == '\0') {
        json->end--;
    }
    return UMB_OK;
}

/* Checks the extensions that the file requires: each must change no shape, or be one that this
 * reader supports. */
static enum umb_status check_extensions(const json_t *required, struct umb_error *error)
{
    static const char *const harmless[] = {
        "KHR_lights_punctual", "KHR_materials_",          "KHR_texture_", "EXT_texture_", "KHR_xmp",
        "KHR_xmp_json_ld",     "EXT_mesh_gpu_instancing",
    };
    for (size_t i = 0; i < json_array_size(required); i++) {
        const char *name = json_string_value(json_array_get(required, i));
        int is_harmless = name == NULL;
        for (size_t k = 0; !is_harmless && k < sizeof harmless / sizeof harmless[0]; k++) {
            const size_t length = strlen(harmless[k]);
            const int is_prefix = harmless[k][length - 1] == '_';
            is_harmless = strncmp(name, harmless[k], length + !is_prefix) == 0;
        }
        if (!is_harmless) {
            char shown[80];
            umbs_text_clean(shown, sizeof shown, name, strlen(name));
            return UMBB_REFUSE(error, "it requires the glTF extension '%s', which is not supported",
                               shown);
        }
    }
    return UMB_OK;
}

static enum umb_status check_version(const json_t *json, struct umb_error *error)
{
    const char *version = umbb_gltf_text(json_object_get(json, "asset"), "version");
    if (version == NULL) {
        return UMBB_REFUSE(error, "it has no asset.version, so it is no glTF");
    }
    if (strncmp(version, "2.", 2) != 0) {
        char shown[16];
        umbs_text_clean(shown, sizeof shown, version, strlen(version));
        return UMBB_REFUSE(error, "glTF version '%s' is not supported (2.x is)", shown);
    }
    return UMB_OK;
}

/* Number of items in a list of the file. */
static size_t count_of(const struct umbb_gltf *gltf, const char *list)
{
    return json_array_size(json_object_get(gltf->json, list));
}

enum umb_status umbb_gltf_open(struct umbb_gltf *gltf, struct umbb_import *job,
                               struct umb_error *error)
{
    struct umbb_cursor text;
    json_error_t fault = {0};
    *gltf =
        (struct umbb_gltf){.job = job, .faces = {.scene = &job->scene}, .textures = {.job = job}};
    UMB__TRY(find_json(&job->file, &text, &gltf->chunk, error));
    const int is_parsed = parse(text, &gltf->json, &fault);
    gltf->buffers = calloc(count_of(gltf, "buffers") + 1, sizeof *gltf->buffers);
    gltf->accessors = calloc(count_of(gltf, "accessors") + 1, 1);
    gltf->materials = calloc(count_of(gltf, "materials") + 1, sizeof *gltf->materials);
    gltf->meshes = calloc(count_of(gltf, "meshes") + 1, sizeof *gltf->meshes);
    gltf->nodes = calloc(count_of(gltf, "nodes") + 1, 1);
    if (!is_parsed || gltf->buffers == NULL || gltf->accessors == NULL || gltf->materials == NULL ||
        gltf->meshes == NULL || gltf->nodes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the JSON");
    }
    if (gltf->json == NULL) {
        char shown[sizeof fault.text];
        umbs_text_clean(shown, sizeof shown, fault.text, strlen(fault.text));
        return UMBB_REFUSE(error, "JSON, line %d: %s", fault.line, shown);
    }
    UMB__TRY(check_version(gltf->json, error));
    return check_extensions(json_object_get(gltf->json, "extensionsRequired"), error);
}

void umbb_gltf_close(struct umbb_gltf *gltf)
{
    for (size_t i = 0; gltf->buffers != NULL && i < count_of(gltf, "buffers"); i++) {
        umbb_file_unmap(&gltf->buffers[i].file);
        free(gltf->buffers[i].decoded);
    }
    void *const arrays[] = {gltf->buffers, gltf->accessors, gltf->materials, gltf->meshes,
                            gltf->nodes};
    for (size_t i = 0; i < sizeof arrays / sizeof arrays[0]; i++) {
        free(arrays[i]);
    }
    umbb_faces_finish(&gltf->faces);
    umbb_texture_table_finish(&gltf->textures);
    json_decref(gltf->json);
    memset(gltf, 0, sizeof *gltf);
}

int64_t umbb_gltf_to_index(const json_t *value)
{
    const double number = json_number_value(value);
    const int is_index = json_is_number(value) && number >= 0.0 && number < (double)UMBB_GLTF_BAD &&
                         floor(number) >= number;
    return value == NULL ? UMBB_GLTF_NONE : is_index ? (int64_t)number : UMBB_GLTF_BAD;
}

int64_t umbb_gltf_index(const json_t *object, const char *key)
{
    return umbb_gltf_to_index(json_object_get(object, key));
}

int64_t umbb_gltf_offset(const json_t *object)
{
    const int64_t offset = umbb_gltf_index(object, "byteOffset");
    return offset != UMBB_GLTF_NONE ? offset : 0;
}

const char *umbb_gltf_text(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

double umbb_gltf_number(const json_t *object, const char *key, double otherwise)
{
    const json_t *value = json_object_get(object, key);
    return json_is_number(value) ? json_number_value(value) : otherwise;
}

int umbb_gltf_numbers(const json_t *object, const char *key, size_t count, double *numbers)
{
    const json_t *array = json_object_get(object, key);
    int good = json_array_size(array) == count;
    for (size_t i = 0; good && i < count; i++) {
        good = json_is_number(json_array_get(array, i));
    }
    for (size_t i = 0; good && i < count; i++) {
        numbers[i] = json_number_value(json_array_get(array, i));
    }
    return good;
}

struct umbb_cursor umbb_gltf_uri(const json_t *object)
{
    const json_t *uri = json_object_get(object, "uri");
    const char *text = json_string_value(uri);
    return (struct umbb_cursor){text, text != NULL ? text + json_string_length(uri) : NULL};
}

const json_t *umbb_gltf_extension(const json_t *object, const char *name)
{
    return json_object_get(json_object_get(object, "extensions"), name);
}

enum umb_status umbb_gltf_item(const struct umbb_gltf *gltf, const char *list, int64_t number,
                               const json_t **item, struct umb_error *error)
{
    *item = json_array_get(json_object_get(gltf->json, list), (size_t)number);
    if (number == UMBB_GLTF_NONE) {
        return UMBB_REFUSE(error, "a reference into %s is missing", list);
    }
    if (number == UMBB_GLTF_BAD) {
        return UMBB_REFUSE(error, "a reference into %s is not a whole number from 0 to 2^40", list);
    }
    return json_is_object(*item)
               ? UMB_OK
               : UMBB_REFUSE(error, "%s[%lld] does not exist", list, (long long)number);
}

/* Value of a base64 letter (RFC 4648); 64 for other characters. */
static uint32_t base64_digit(char c)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *at = c != '\0' ? strchr(digits, c) : NULL;
    return at != NULL ? (uint32_t)(at - digits) : 64;
}

enum umb_status umbb_gltf_data_uri(struct umbb_cursor uri, char **bytes, size_t *size,
                                   struct umb_error *error)
{
    static const char base64[] = ";base64,";
    const size_t tail = sizeof base64 - 1, length = umbb_length(uri);
    const char *comma = memchr(uri.at, ',', length < 200 ? length : 200);
    const size_t head = comma != NULL ? (size_t)(comma - uri.at) + 1 : 0;
    uint32_t bits = 0, held = 0;
    *bytes = NULL;
    *size = 0;
    if (head < sizeof "data:" - 1 + tail || !umbb_starts_with(uri, "data:") ||
        memcmp(uri.at + head - tail, base64, tail) != 0) {
        return UMB_OK;
    }
    *bytes = malloc(length);
    if (*bytes == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a data URI");
    }
    for (size_t i = head; i < length && base64_digit(uri.at[i]) < 64; i++) {
        bits = bits << 6 | base64_digit(uri.at[i]);
        held += 6;
        if (held >= 8) {
            held -= 8;
            (*bytes)[(*size)++] = (char)(bits >> held & 0xff);
        }
    }
    return UMB_OK;
}

/* Opens a buffer: a data URI, a file, or without a URI the GLB's own chunk. */
static enum umb_status open_buffer(const struct umbb_gltf *gltf, const json_t *item,
                                   struct umbb_gltf_buffer *buffer, struct umb_error *error)
{
    const struct umbb_cursor uri = umbb_gltf_uri(item);
    if (uri.at == NULL) {
        buffer->bytes = gltf->chunk.at;
        buffer->size = umbb_length(gltf->chunk);
        return UMB_OK;
    }
    UMB__TRY(umbb_gltf_data_uri(uri, &buffer->decoded, &buffer->size, error));
    if (buffer->decoded != NULL) {
        buffer->bytes = buffer->decoded;
        return UMB_OK;
    }
    if (umbb_starts_with(uri, "data:")) {
        return UMBB_REFUSE(error, "a data URI of a buffer is not base64");
    }
    struct umb_error cause = {0};
    const enum umb_status status = umbb_file_map_uri(gltf->job, uri, &buffer->file, &cause);
    if (status != UMB_OK) {
        return umb_fail(error, status == UMB_E_NO_MEMORY ? status : UMB_E_BAD_SCENE, "buffer: %s",
                        cause.message);
    }
    buffer->bytes = buffer->file.bytes;
    buffer->size = buffer->file.size;
    return UMB_OK;
}

enum umb_status umbb_gltf_view(struct umbb_gltf *gltf, int64_t number, struct umbb_gltf_view *view,
                               struct umb_error *error)
{
    const json_t *json, *item;
    UMB__TRY(umbb_gltf_item(gltf, "bufferViews", number, &json, error));
    const int64_t buffer_number = umbb_gltf_index(json, "buffer");
    UMB__TRY(umbb_gltf_item(gltf, "buffers", buffer_number, &item, error));
    struct umbb_gltf_buffer *buffer = &gltf->buffers[buffer_number];
    UMB__TRY(buffer->bytes == NULL ? open_buffer(gltf, item, buffer, error) : UMB_OK);
    const int64_t offset = umbb_gltf_offset(json);
    const int64_t length = umbb_gltf_index(json, "byteLength");
    if (length < 0 || (uint64_t)(offset + length) > buffer->size) { /* both at most 2^40 */
        return UMBB_REFUSE(error, "bufferViews[%lld] lies outside of its buffer",
                           (long long)number);
    }
    *view = (struct umbb_gltf_view){.bytes = buffer->bytes + offset,
                                    .size = (size_t)length,
                                    .stride = umbb_gltf_index(json, "byteStride")};
    return UMB_OK;
}
