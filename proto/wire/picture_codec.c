/* SPDX-License-Identifier: Apache-2.0 */
/* See picture_codec.h. */
#include "wire/picture_codec.h"

#include <math.h>
#include <string.h>
#include "base/try.h"
#include "wire/codec.h"

enum {
    PICTURE_BYTES_MAX = 512 /* Largest message: four times the bytes of its fields */
};

/* Checks of both directions. */
static enum umb_status check(const struct umbw_query_request *request, struct umb_error *error)
{
    const struct umb_picture *picture = &request->picture;
    const uint64_t pixels = (uint64_t)picture->width * picture->height;
    const double *origin = request->points.origin;
    UMB__TRY(umb_picture_check(picture, error));
    if (pixels != request->points.count) {
        return umb_fail(error, UMB_E_ARGUMENT, "depth: %zu numbers for %u x %u pixels",
                        request->points.count, picture->width, picture->height);
    }
    if (origin[0] != 0 || origin[1] != 0 || origin[2] != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "origin: beside a picture, which has an eye");
    }
    return UMB_OK;
}

/* Footprints that the request does not set are those of the picture's pixels. */
static void look_through(const struct umb_picture *picture, struct umb_query_settings *settings)
{
    if (umb_filter_get_info(settings->filter)->has_footprints && settings->footprint_m == 0 &&
        settings->pixel_rad == 0) {
        memcpy(settings->eye, picture->camera.eye, sizeof settings->eye);
        settings->pixel_rad = fmin(2 * tan(picture->camera.fov_y / 2) / picture->height, 1);
    }
}

enum umb_status umbw_take_picture(const struct umbw_field_found *field,
                                  const struct umbw_field_found *depth,
                                  struct umbw_query_request *request, struct umb_error *error)
{
    ProtobufCMessage *message;
    struct umb_picture *picture = &request->picture;
    request->has_picture = field->count > 0;
    picture->depth = depth->bytes;
    if (!request->has_picture) {
        return depth->size == 0 ? UMB_OK
                                : umb_fail(error, UMB_E_ARGUMENT,
                                           "depth: %zu bytes without a picture", depth->size);
    }
    if (field->size > PICTURE_BYTES_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "picture: %zu bytes, at most %d", field->size,
                        PICTURE_BYTES_MAX);
    }
    UMB__TRY(umbw_message_unpack(&umbrage__v1__picture__descriptor, field->bytes, field->size,
                                 &message, error));
    const Umbrage__V1__Picture *p = (const Umbrage__V1__Picture *)message;
    enum umb_status status =
        umbw_vector_copy("picture.eye", p->eye, p->n_eye, picture->camera.eye, error);
    if (status == UMB_OK) {
        status = umbw_vector_copy("picture.forward", p->forward, p->n_forward,
                                  picture->camera.forward, error);
    }
    if (status == UMB_OK) {
        status = umbw_vector_copy("picture.up", p->up, p->n_up, picture->camera.up, error);
    }
    picture->camera.fov_y = p->fov_y;
    picture->width = p->width;
    picture->height = p->height;
    umbw_message_free(message);
    if (status == UMB_OK) {
        status = check(request, error);
    }
    if (status == UMB_OK) {
        look_through(picture, &request->settings);
    }
    return status;
}

enum umb_status umbw_put_picture(const struct umbw_query_request *request,
                                 struct umbw_picture_message *out, struct umb_error *error)
{
    static const Umbrage__V1__Picture empty = UMBRAGE__V1__PICTURE__INIT;
    const struct umb_picture *picture = &request->picture;
    out->message = empty;
    memcpy(out->vectors[0], picture->camera.eye, sizeof out->vectors[0]);
    memcpy(out->vectors[1], picture->camera.forward, sizeof out->vectors[1]);
    memcpy(out->vectors[2], picture->camera.up, sizeof out->vectors[2]);
    out->message.eye = out->vectors[0];
    out->message.forward = out->vectors[1];
    out->message.up = out->vectors[2];
    out->message.n_eye = out->message.n_forward = out->message.n_up = 3;
    out->message.fov_y = picture->camera.fov_y;
    out->message.width = picture->width;
    out->message.height = picture->height;
    return check(request, error);
}
