/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_PICTURE_CODEC_H
#define UMBRAGE_WIRE_PICTURE_CODEC_H
/* umbrage.v1.Picture between its bytes and struct umb_picture, for the codec of QueryRequest. */
#include "umbrage/v1/shadows.pb-c.h"
#include "wire/messages.h"
#include "wire/proto_scan.h"

/* A message, and the storage it points to. */
struct umbw_picture_message {
    Umbrage__V1__Picture message;
    double vectors[3][3];
};

/*
 * Reads a picture, if there is one, whose depths are request->points: as many as it has pixels.
 * Out: request->picture and has_picture. Fails: E_ARGUMENT, naming the field; E_NO_MEMORY.
 */
UMB_CHECKED enum umb_status umbw_take_picture(const struct umbw_field_found *field,
                                              const struct umbw_field_found *depth,
                                              struct umbw_query_request *request,
                                              struct umb_error *error);

/* Fills the message of a picture, with the same checks. */
UMB_CHECKED enum umb_status umbw_put_picture(const struct umbw_query_request *request,
                                             struct umbw_picture_message *out,
                                             struct umb_error *error);

#endif
