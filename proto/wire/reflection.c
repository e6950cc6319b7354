/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Server reflection on the descriptors that the build embeds. None of the .proto files imports
 * another, so a client needs only the file that holds a symbol.
 *
 * Source: descriptor.proto of Protocol Buffers for the field numbers; the gRPC server reflection
 * protocol for the answers.
 */
#include "wire/reflection.h"

#include <string.h>
#include "base/try.h"
#include "grpc/reflection/v1/reflection.pb-c.h"
#include "wire/codec.h"
#include "wire/descriptor_set.h"
#include "wire/grpc.h"
#include "wire/proto_scan.h"

#define SERVICES_MAX     16
#define SERVICE_NAME_MAX 128 /* Longest name of a service, with its package */

#define FILE_NAME    1
#define FILE_PACKAGE 2
#define FILE_SERVICE 6

typedef Grpc__Reflection__V1__ServerReflectionRequest request_message;
typedef Grpc__Reflection__V1__ServerReflectionResponse response_message;
#define RESPONSE_IS(kind) GRPC__REFLECTION__V1__SERVER_REFLECTION_RESPONSE__MESSAGE_RESPONSE_##kind

struct span {
    const uint8_t *bytes;
    size_t size;
};

/* Kinds of named things in a descriptor, by field number; 0 ends the list. */
struct children {
    uint32_t number;
    const struct children *of; /* Kinds that such a child may hold */
};

static const struct children method_children[] = {{2, NULL}, {0, NULL}};
static const struct children nested_children[] = {{3, NULL}, {4, NULL}, {0, NULL}};
static const struct children message_children[] = {{3, nested_children}, {4, NULL}, {0, NULL}};
static const struct children file_children[] = {
    {4, message_children}, {5, NULL}, {FILE_SERVICE, method_children}, {0, NULL}};

/* Moves to the next field of a descriptor; returns 0 at its end. The bytes are our own and never
 * malformed. */
static int next_item(struct span *rest, struct umbw_item *item)
{
    const uint8_t *at = rest->bytes;
    const uint8_t *end = at + rest->size;
    if (rest->size == 0 || umbw_item_read(at, &at, end, item, NULL) != UMB_OK) {
        return 0;
    }
    *rest = (struct span){at, (size_t)(end - at)};
    return 1;
}

/* Returns the first field of that number; empty if there is none. */
static struct span field_of(struct span descriptor, uint32_t number)
{
    struct umbw_item item;
    while (next_item(&descriptor, &item)) {
        if (item.number == number) {
            return (struct span){item.payload, item.payload_size};
        }
    }
    return (struct span){NULL, 0};
}

/* Returns what follows the dot if name starts with `part` as a whole word ("" at the end). */
static const char *after(const char *name, struct span part)
{
    if (part.size == 0 || strncmp(name, (const char *)part.bytes, part.size) != 0) {
        return NULL;
    }
    name += part.size;
    return name[0] == '.' ? name + 1 : name[0] == '\0' ? name : NULL;
}

/* Returns 1 if the descriptor holds the thing that `name` names, at any depth. */
static int holds(struct span descriptor, const struct children *kinds, const char *name)
{
    struct umbw_item item;
    while (kinds != NULL && next_item(&descriptor, &item)) {
        for (const struct children *kind = kinds; kind->number != 0; kind++) {
            struct span child = {item.payload, item.payload_size};
            const char *rest =
                item.number == kind->number ? after(name, field_of(child, FILE_NAME)) : NULL;
            if (rest != NULL && (rest[0] == '\0' || holds(child, kind->of, rest))) {
                return 1;
            }
        }
    }
    return 0;
}

static int has_symbol(struct span file, const char *symbol)
{
    const char *rest = after(symbol, field_of(file, FILE_PACKAGE));
    return rest != NULL && rest[0] != '\0' && holds(file, file_children, rest);
}

static int has_name(struct span file, const char *name)
{
    struct span own = field_of(file, FILE_NAME);
    return own.size == strlen(name) && memcmp(own.bytes, name, own.size) == 0;
}

/* Returns the file for which `matches` is true; empty if there is none. */
static struct span find_file(int (*matches)(struct span file, const char *name), const char *name)
{
    struct span set = {umbw__descriptor_set, umbw__descriptor_set_bytes};
    struct umbw_item item;
    while (next_item(&set, &item)) {
        struct span file = {item.payload, item.payload_size};
        if (matches(file, name)) {
            return file;
        }
    }
    return (struct span){NULL, 0};
}

static enum umb_status send_error(response_message *response, int code, const char *text,
                                  struct umbw_buffer *buffer, struct umb_error *error)
{
    Grpc__Reflection__V1__ErrorResponse answer = GRPC__REFLECTION__V1__ERROR_RESPONSE__INIT;
    char copy[64];
    size_t length = strlen(text);
    length = length < sizeof copy ? length : sizeof copy - 1;
    memcpy(copy, text, length);
    copy[length] = '\0';
    answer.error_code = code;
    answer.error_message = copy;
    response->message_response_case = RESPONSE_IS(ERROR_RESPONSE);
    response->error_response = &answer;
    return umbw_message_append(&response->base, buffer, error);
}

static enum umb_status send_file(response_message *response, struct span file,
                                 struct umbw_buffer *buffer, struct umb_error *error)
{
    Grpc__Reflection__V1__FileDescriptorResponse answer =
        GRPC__REFLECTION__V1__FILE_DESCRIPTOR_RESPONSE__INIT;
    if (file.size == 0) {
        return send_error(response, UMBW_GRPC_NOT_FOUND, "not found", buffer, error);
    }
    ProtobufCBinaryData data = {.len = file.size, .data = (uint8_t *)(uintptr_t)file.bytes};
    answer.n_file_descriptor_proto = 1;
    answer.file_descriptor_proto = &data;
    response->message_response_case = RESPONSE_IS(FILE_DESCRIPTOR_RESPONSE);
    response->file_descriptor_response = &answer;
    return umbw_message_append(&response->base, buffer, error);
}

/* The messages have no extensions, which proto3 does not allow. */
static enum umb_status send_no_extensions(response_message *response, char *type,
                                          struct umbw_buffer *buffer, struct umb_error *error)
{
    Grpc__Reflection__V1__ExtensionNumberResponse answer =
        GRPC__REFLECTION__V1__EXTENSION_NUMBER_RESPONSE__INIT;
    if (find_file(has_symbol, type).size == 0) {
        return send_error(response, UMBW_GRPC_NOT_FOUND, "not found", buffer, error);
    }
    answer.base_type_name = type;
    response->message_response_case = RESPONSE_IS(ALL_EXTENSION_NUMBERS_RESPONSE);
    response->all_extension_numbers_response = &answer;
    return umbw_message_append(&response->base, buffer, error);
}

struct service_list {
    size_t count;
    char names[SERVICES_MAX][SERVICE_NAME_MAX];
};

static void list_services(struct service_list *list)
{
    struct span set = {umbw__descriptor_set, umbw__descriptor_set_bytes};
    struct umbw_item item;
    while (next_item(&set, &item)) {
        struct span file = {item.payload, item.payload_size};
        struct span package = field_of(file, FILE_PACKAGE);
        while (next_item(&file, &item)) {
            struct span name = field_of((struct span){item.payload, item.payload_size}, FILE_NAME);
            if (item.number == FILE_SERVICE && list->count < SERVICES_MAX &&
                package.size + 1 + name.size < SERVICE_NAME_MAX) {
                char *at = list->names[list->count++];
                memcpy(at, package.bytes, package.size);
                at[package.size] = '.';
                memcpy(at + package.size + 1, name.bytes, name.size);
                at[package.size + 1 + name.size] = '\0';
            }
        }
    }
}

static enum umb_status send_services(response_message *response, struct umbw_buffer *buffer,
                                     struct umb_error *error)
{
    struct service_list list = {0};
    Grpc__Reflection__V1__ServiceResponse services[SERVICES_MAX];
    Grpc__Reflection__V1__ServiceResponse *pointers[SERVICES_MAX];
    Grpc__Reflection__V1__ListServiceResponse answer =
        GRPC__REFLECTION__V1__LIST_SERVICE_RESPONSE__INIT;
    list_services(&list);
    for (size_t i = 0; i < list.count; i++) {
        grpc__reflection__v1__service_response__init(&services[i]);
        services[i].name = list.names[i];
        pointers[i] = &services[i];
    }
    answer.n_service = list.count;
    answer.service = pointers;
    response->message_response_case = RESPONSE_IS(LIST_SERVICES_RESPONSE);
    response->list_services_response = &answer;
    return umbw_message_append(&response->base, buffer, error);
}

static enum umb_status answer_request(request_message *request, struct umbw_buffer *buffer,
                                      struct umb_error *error)
{
    response_message response = GRPC__REFLECTION__V1__SERVER_REFLECTION_RESPONSE__INIT;
    response.valid_host = request->host;
    response.original_request = request;
    switch ((int)request->message_request_case) {
    case 3:
        return send_file(&response, find_file(has_name, request->file_by_filename), buffer, error);
    case 4:
        return send_file(&response, find_file(has_symbol, request->file_containing_symbol), buffer,
                         error);
    case 5:
        return send_error(&response, UMBW_GRPC_NOT_FOUND, "there are no extensions", buffer, error);
    case 6:
        return send_no_extensions(&response, request->all_extension_numbers_of_type, buffer, error);
    case 7:
        return send_services(&response, buffer, error);
    default:
        return send_error(&response, UMBW_GRPC_INVALID_ARGUMENT, "nothing is asked for", buffer,
                          error);
    }
}

enum umb_status umbw_reflection_answer(const uint8_t *message, size_t size,
                                       struct umbw_buffer *buffer, struct umb_error *error)
{
    ProtobufCMessage *base;
    UMB__TRY(umbw_message_unpack(&grpc__reflection__v1__server_reflection_request__descriptor,
                                 message, size, &base, error));
    enum umb_status status = answer_request((request_message *)base, buffer, error);
    umbw_message_free(base);
    return status;
}
