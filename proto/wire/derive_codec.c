/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage.v1.DeriveMapRequest between its bytes and the settings of umbrage/derive.h. */
#include "wire/regions.h"

#include <string.h>

#include "umbrage/v1/regions.pb-c.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"

/* By their numbers on the wire. */
static const enum umb_map_technique TECHNIQUES[] = {UMB_MAP_PCF, UMB_MAP_VSM, UMB_MAP_ESM,
                                                    UMB_MAP_EVSM, UMB_MAP_MSM};
static const enum umb_map_format FORMATS[] = {UMB_MAP_F32, UMB_MAP_F16, UMB_MAP_U16};

#define COUNT_OF(array) (sizeof(array) / sizeof(array)[0])

static enum umb_status check_enum(const char *name, int value, size_t count,
                                  struct umb_error *error)
{
    return value >= 0 && (size_t)value < count
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "%s: %d, must be 0 to %zu", name, value,
                          count - 1);
}

static enum umb_status take_view(const Umbrage__V1__CascadeView *view,
                                 struct umbw_derive_request *request, struct umb_error *error)
{
    struct umb__map_view *camera = &request->view;
    const struct {
        const char *name;
        const double *values;
        size_t count;
        double *out;
    } vectors[] = {
        {"view.eye", view->eye, view->n_eye, camera->eye},
        {"view.right", view->right, view->n_right, camera->right},
        {"view.up", view->up, view->n_up, camera->up},
        {"view.forward", view->forward, view->n_forward, camera->forward},
    };
    enum umb_status status = check_enum("view.fit", (int)view->fit, 3, error);
    for (size_t i = 0; status == UMB_OK && i < COUNT_OF(vectors); i++) {
        status = umbw_vector_copy(vectors[i].name, vectors[i].values, vectors[i].count,
                                  vectors[i].out, error);
    }
    if (status == UMB_OK && (view->count < 1 || view->count > UMB_CASCADES_MAX)) {
        status = umb_fail(error, UMB_E_ARGUMENT, "view.count: %u, must be 1 to %d", view->count,
                          UMB_CASCADES_MAX);
    }
    camera->tan_x = view->tan_x;
    camera->tan_y = view->tan_y;
    camera->near_m = view->near_m;
    camera->far_m = view->far_m;
    request->settings.cascades = (struct umb_cascade_settings){
        .count = view->count, .weight = view->weight, .fit = (enum umb_cascade_fit)view->fit};
    return status;
}

static enum umb_status take_settings(const Umbrage__V1__DeriveMapRequest *message,
                                     struct umbw_derive_request *request, struct umb_error *error)
{
    struct umb_derive_settings *settings = &request->settings;
    enum umb_status status =
        check_enum("technique", (int)message->technique, COUNT_OF(TECHNIQUES), error);
    if (status == UMB_OK) {
        status = check_enum("format", (int)message->format, COUNT_OF(FORMATS), error);
    }
    if (status == UMB_OK && message->n_rect != 0 && message->n_rect != 4) {
        status = umb_fail(error, UMB_E_ARGUMENT, "rect: %zu numbers, must be none or 4",
                          message->n_rect);
    }
    if (status != UMB_OK) {
        return status;
    }
    settings->light = message->light;
    settings->width = message->width;
    settings->height = message->height;
    settings->map = (struct umb_map_settings){
        .technique = TECHNIQUES[message->technique],
        .format = FORMATS[message->format],
        .access = message->mips ? UMB_MAP_MIPS : UMB_MAP_BASE,
        .blur = message->blur,
        .exponent = message->exponent,
        .negative_exponent = message->negative_exponent,
        .depth_plane = message->depth_plane,
        .moment_bias = message->moment_bias,
    };
    for (size_t i = 0; i < message->n_rect; i++) {
        settings->rect[i] = message->rect[i];
    }
    return message->view != NULL ? take_view(message->view, request, error) : UMB_OK;
}

enum umb_status umbw_decode_derive_request(const uint8_t *message, size_t size,
                                           struct umbw_derive_request *request,
                                           struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "asset"},
        {2, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "light"},
        {3, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "technique"},
        {4, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "format"},
        {5, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "width"},
        {6, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "height"},
        {7, UMBW_FIELD_PACKED, UMBW_WIRE_FIXED64, "rect"},
        {8, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "view"},
        {9, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "mips"},
        {10, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "blur"},
        {11, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "exponent"},
        {12, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "negative_exponent"},
        {13, UMBW_FIELD_SCALAR, UMBW_WIRE_VARINT, "depth_plane"},
        {14, UMBW_FIELD_SCALAR, UMBW_WIRE_FIXED64, "moment_bias"},
    };
    struct umbw_field_found found[COUNT_OF(fields)];
    struct umbw_scratch scratch;
    ProtobufCMessage *unpacked = NULL;
    memset(request, 0, sizeof *request);
    enum umb_status status =
        umbw_proto_scan(message, size, fields, COUNT_OF(fields), found, &scratch, error);
    if (status == UMB_OK) {
        status = umbw_asset_copy(found[0].bytes, found[0].size, request->asset, error);
    }
    if (status == UMB_OK) {
        status = umbw_message_unpack(&umbrage__v1__derive_map_request__descriptor, scratch.bytes,
                                     scratch.size, &unpacked, error);
    }
    if (status == UMB_OK) {
        status = take_settings((const Umbrage__V1__DeriveMapRequest *)unpacked, request, error);
        umbw_message_free(unpacked);
    }
    return status;
}

/* The number on the wire of a value; past the end if it has none. */
static size_t wire_technique(enum umb_map_technique technique)
{
    size_t i = 0;
    while (i < COUNT_OF(TECHNIQUES) && TECHNIQUES[i] != technique) {
        i++;
    }
    return i;
}

static size_t wire_format(enum umb_map_format format)
{
    size_t i = 0;
    while (i < COUNT_OF(FORMATS) && FORMATS[i] != format) {
        i++;
    }
    return i;
}

/* Borrows from the request, which the encoder only reads. */
static void put_view(const struct umbw_derive_request *request, Umbrage__V1__CascadeView *view)
{
    struct umb__map_view *camera = (struct umb__map_view *)(uintptr_t)&request->view;
    view->n_eye = view->n_right = view->n_up = view->n_forward = 3;
    view->eye = camera->eye;
    view->right = camera->right;
    view->up = camera->up;
    view->forward = camera->forward;
    view->tan_x = camera->tan_x;
    view->tan_y = camera->tan_y;
    view->near_m = camera->near_m;
    view->far_m = camera->far_m;
    view->count = request->settings.cascades.count;
    view->weight = request->settings.cascades.weight;
    view->fit = (Umbrage__V1__CascadeFit)request->settings.cascades.fit;
}

enum umb_status umbw_encode_derive_request(const struct umbw_derive_request *request,
                                           struct umbw_buffer *buffer, struct umb_error *error)
{
    const struct umb_derive_settings *settings = &request->settings;
    const struct umb_map_settings *map = &settings->map;
    Umbrage__V1__DeriveMapRequest message = UMBRAGE__V1__DERIVE_MAP_REQUEST__INIT;
    Umbrage__V1__CascadeView view = UMBRAGE__V1__CASCADE_VIEW__INIT;
    const size_t technique = wire_technique(map->technique), format = wire_format(map->format);
    if (technique == COUNT_OF(TECHNIQUES) || format == COUNT_OF(FORMATS)) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "map: technique %d in format %d is not derived; depth, vsm, esm, evsm and "
                        "msm are, in f32, f16 and u16",
                        (int)map->technique, (int)map->format);
    }
    message.asset = (char *)(uintptr_t)request->asset; /* read only by the encoder */
    message.light = settings->light;
    message.technique = (Umbrage__V1__MapTechnique)technique;
    message.format = (Umbrage__V1__MapFormat)format;
    message.width = settings->width;
    message.height = settings->height;
    for (size_t i = 0; i < 4; i++) {
        message.n_rect = settings->rect[i] != 0 ? 4 : message.n_rect;
    }
    message.rect = (double *)(uintptr_t)settings->rect;
    message.mips = map->access == UMB_MAP_MIPS;
    message.blur = map->blur;
    message.exponent = map->exponent;
    message.negative_exponent = map->negative_exponent;
    message.depth_plane = map->depth_plane;
    message.moment_bias = map->moment_bias;
    if (settings->cascades.count > 0) {
        put_view(request, &view);
        message.view = &view;
    }
    return umbw_message_append(&message.base, buffer, error);
}
