/* SPDX-License-Identifier: Apache-2.0 */
/* SubmitRequest, with its manifest, and SubmitReply. Data is never copied by the decoder. */
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"
#include "umbrage/v1/bakes.pb-c.h"
#include "wire/bakes.h"
#include "wire/codec.h"
#include "wire/proto_scan.h"
#include "wire/wire_buffer.h"

void umbw_manifest_finish(struct umbw_manifest *manifest)
{
    free(manifest->files);
    free(manifest->settings);
    umbw_message_free(manifest->owned);
    memset(manifest, 0, sizeof *manifest);
}

/* Checks UTF-8 and NULs, which protobuf-c does not; a NUL would cut a text short. */
static enum umb_status check_text(const char *name, const char *text, struct umb_error *error)
{
    if (!umb__utf8_valid((const uint8_t *)text, strlen(text))) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: is not UTF-8", name);
    }
    return UMB_OK;
}

static enum umb_status take_files(const Umbrage__V1__Manifest *message,
                                  struct umbw_manifest *manifest, struct umb_error *error)
{
    manifest->files = calloc(message->n_files + 1, sizeof *manifest->files);
    if (manifest->files == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu files", message->n_files);
    }
    manifest->file_count = message->n_files;
    for (size_t i = 0; i < message->n_files; i++) {
        const Umbrage__V1__BundleFile *from = message->files[i];
        struct umbw_bundle_file *to = &manifest->files[i];
        to->path = from->path;
        to->size = from->size;
        enum umb_status status = check_text("files.path", from->path, error);
        if (status == UMB_OK) {
            status = umbw_id_copy("files.sha256", from->sha256.data, from->sha256.len, to->sha256,
                                  error);
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    return UMB_OK;
}

static enum umb_status take_settings(const Umbrage__V1__Manifest *message,
                                     struct umbw_manifest *manifest, struct umb_error *error)
{
    manifest->settings = calloc(message->n_settings + 1, sizeof *manifest->settings);
    if (manifest->settings == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu settings",
                        message->n_settings);
    }
    manifest->setting_count = message->n_settings;
    for (size_t i = 0; i < message->n_settings; i++) {
        manifest->settings[i].name = message->settings[i]->name;
        manifest->settings[i].value = message->settings[i]->value;
        enum umb_status status = check_text("settings.name", message->settings[i]->name, error);
        if (status == UMB_OK) {
            status = check_text("settings.value", message->settings[i]->value, error);
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    return UMB_OK;
}

/* Counts the parts before memory is allocated for them. */
static enum umb_status decode_manifest(const uint8_t *bytes, size_t size,
                                       struct umbw_manifest *manifest, struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {2, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "files"},
        {3, UMBW_FIELD_MESSAGE, UMBW_WIRE_BYTES, "settings"},
    };
    struct umbw_field_found found[2];
    ProtobufCMessage *base = NULL;
    enum umb_status status = umbw_proto_scan(bytes, size, fields, 2, found, NULL, error);
    if (status == UMB_OK && found[0].count + found[1].count > UMBW_MANIFEST_MAX) {
        status = umb_fail(error, UMB_E_ARGUMENT,
                          "manifest: %zu files and settings are over the limit of %d",
                          found[0].count + found[1].count, UMBW_MANIFEST_MAX);
    }
    if (status == UMB_OK) {
        status = umbw_message_unpack(&umbrage__v1__manifest__descriptor, bytes, size, &base, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    const Umbrage__V1__Manifest *message = (const Umbrage__V1__Manifest *)base;
    manifest->owned = base;
    manifest->scene = message->scene;
    manifest->priority = message->priority;
    status = check_text("scene", message->scene, error);
    if (status == UMB_OK) {
        status = take_files(message, manifest, error);
    }
    if (status == UMB_OK) {
        status = take_settings(message, manifest, error);
    }
    if (status != UMB_OK) {
        umbw_manifest_finish(manifest);
    }
    return status;
}

enum umb_status umbw_decode_submit_request(const uint8_t *message, size_t size,
                                           struct umbw_submit_request *request,
                                           struct umb_error *error)
{
    static const struct umbw_field fields[] = {
        {1, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "manifest"},
        {2, UMBW_FIELD_IN_PLACE, UMBW_WIRE_BYTES, "data"},
    };
    struct umbw_field_found found[2];
    memset(request, 0, sizeof *request);
    enum umb_status status = umbw_proto_scan(message, size, fields, 2, found, NULL, error);
    if (status == UMB_OK && found[0].count > 0 && found[1].count > 0) {
        status = umb_fail(error, UMB_E_ARGUMENT, "data: must not be beside a manifest");
    }
    if (status != UMB_OK) {
        return status;
    }
    request->data = found[1].bytes;
    request->data_size = found[1].size;
    request->has_manifest = found[0].count > 0;
    return request->has_manifest
               ? decode_manifest(found[0].bytes, found[0].size, &request->manifest, error)
               : UMB_OK;
}

/* The arrays of pointers that protobuf-c needs; one allocation each. */
struct manifest_parts {
    Umbrage__V1__BundleFile *files;
    Umbrage__V1__BundleFile **file_pointers;
    Umbrage__V1__BakeSetting *settings;
    Umbrage__V1__BakeSetting **setting_pointers;
};

static int make_parts(const struct umbw_manifest *manifest, struct manifest_parts *parts)
{
    parts->files = calloc(manifest->file_count + 1, sizeof *parts->files);
    parts->file_pointers = calloc(manifest->file_count + 1, sizeof *parts->file_pointers);
    parts->settings = calloc(manifest->setting_count + 1, sizeof *parts->settings);
    parts->setting_pointers = calloc(manifest->setting_count + 1, sizeof *parts->setting_pointers);
    return parts->files != NULL && parts->file_pointers != NULL && parts->settings != NULL &&
           parts->setting_pointers != NULL;
}

static void put_parts(const struct umbw_manifest *manifest, struct manifest_parts *parts)
{
    for (size_t i = 0; i < manifest->file_count; i++) {
        Umbrage__V1__BundleFile *to = &parts->files[i];
        umbrage__v1__bundle_file__init(to);
        to->path = (char *)(uintptr_t)manifest->files[i].path; /* read only by the encoder */
        to->size = manifest->files[i].size;
        to->sha256.data = manifest->files[i].sha256;
        to->sha256.len = UMB_ID_BYTES;
        parts->file_pointers[i] = to;
    }
    for (size_t i = 0; i < manifest->setting_count; i++) {
        Umbrage__V1__BakeSetting *to = &parts->settings[i];
        umbrage__v1__bake_setting__init(to);
        to->name = (char *)(uintptr_t)manifest->settings[i].name;
        to->value = (char *)(uintptr_t)manifest->settings[i].value;
        parts->setting_pointers[i] = to;
    }
}

enum umb_status umbw_encode_manifest(const struct umbw_manifest *manifest,
                                     struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__SubmitRequest request = UMBRAGE__V1__SUBMIT_REQUEST__INIT;
    Umbrage__V1__Manifest message = UMBRAGE__V1__MANIFEST__INIT;
    struct manifest_parts parts = {0};
    enum umb_status status = UMB_OK;
    if (make_parts(manifest, &parts)) {
        put_parts(manifest, &parts);
        message.scene = (char *)(uintptr_t)manifest->scene;
        message.files = parts.file_pointers;
        message.n_files = manifest->file_count;
        message.settings = parts.setting_pointers;
        message.n_settings = manifest->setting_count;
        message.priority = manifest->priority;
        request.manifest = &message;
        status = umbw_message_append(&request.base, buffer, error);
    } else {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a manifest of %zu files",
                          manifest->file_count);
    }
    free(parts.files);
    free(parts.file_pointers);
    free(parts.settings);
    free(parts.setting_pointers);
    return status;
}

enum umb_status umbw_encode_submit_data(const uint8_t *data, size_t size,
                                        struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__SubmitRequest request = UMBRAGE__V1__SUBMIT_REQUEST__INIT;
    request.data.data = (uint8_t *)(uintptr_t)data; /* read only by the encoder */
    request.data.len = size;
    return umbw_message_append(&request.base, buffer, error);
}

enum umb_status umbw_encode_submit_reply(const struct umbw_submit_reply *reply,
                                         struct umbw_buffer *buffer, struct umb_error *error)
{
    Umbrage__V1__SubmitReply message = UMBRAGE__V1__SUBMIT_REPLY__INIT;
    message.job = (char *)(uintptr_t)reply->job;
    message.existing = reply->existing;
    return umbw_message_append(&message.base, buffer, error);
}

enum umb_status umbw_decode_submit_reply(const uint8_t *message, size_t size,
                                         struct umbw_submit_reply *reply, struct umb_error *error)
{
    ProtobufCMessage *base = NULL;
    memset(reply, 0, sizeof *reply);
    enum umb_status status =
        umbw_message_unpack(&umbrage__v1__submit_reply__descriptor, message, size, &base, error);
    if (status == UMB_OK) {
        const Umbrage__V1__SubmitReply *found = (const Umbrage__V1__SubmitReply *)base;
        reply->existing = found->existing;
        status = umbw_text_copy("job", (const uint8_t *)found->job, strlen(found->job),
                                UMBW_JOB_MAX, reply->job, error);
        umbw_message_free(base);
    }
    return status;
}
