/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Server reflection on the descriptors that the build embeds. None of the .proto files imports
 * another, so a client needs only the file that holds a symbol.
 *
 * Source: descriptor.proto of Protocol Buffers for the field numbers; the gRPC server reflection
 * protocol for the answers.
 */
#include "wire/messages.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/try.h"
#include "grpc/reflection/v1/reflection.pb-c.h"
#include "wire/codec.h"
#include "grpc/grpc.h"

#define SERVICES_MAX     16  /* Most services of all files */
#define SERVICE_NAME_MAX 128 /* Longest name of a service, with its package */

#define FILE_NAME    1
#define FILE_PACKAGE 2
#define FILE_SERVICE 6

struct span {
    const uint8_t *bytes;
    size_t size;
};

/* Numbers of the fields of a descriptor that hold named things: messages, enums, services, methods.
 * 0 ends the list. */
struct children {
    uint32_t number;
    const struct children *of; /* Kinds that such a child may hold */
};

static const struct children method_children[] = {{2, NULL}, {0, NULL}};
static const struct children nested_children[] = {{3, NULL}, {4, NULL}, {0, NULL}};
static const struct children message_children[] = {{3, nested_children}, {4, NULL}, {0, NULL}};
static const struct children file_children[] = {
    {4, message_children}, {5, NULL}, {FILE_SERVICE, method_children}, {0, NULL}};

/* Moves to the next field of a descriptor; returns 0 at its end. The build makes the bytes, so they
 * are never malformed. */
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

/* If name starts with `part` as a whole word, returns the text after the next dot ("" at the end of
 * name). */
static const char *after(const char *name, struct span part)
{
    if (part.size == 0 || strncmp(name, (const char *)part.bytes, part.size) != 0) {
        return NULL;
    }
    name += part.size;
    return name[0] == '.' ? name + 1 : name[0] == '\0' ? name : NULL;
}

/* Returns 1 if the descriptor contains the message, enum, service or method called `name`, at any
 * depth. */
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

/* Fields of a ServerReflectionRequest. Fields 3 to 7 exclude one another: the last one counts. */
struct request {
    char *host, *file, *symbol, *type, *services;
};

#define REQUEST(member) UMBW_AT(request, member), .flags = UMBW_FILLED

UMBW_TABLE(REQUEST_TABLE, grpc__reflection__v1__server_reflection_request, "",
           sizeof(struct request), {1, REQUEST(host)}, {3, REQUEST(file)}, {4, REQUEST(symbol)},
           {.number = 5}, {6, REQUEST(type)}, {7, REQUEST(services)});

struct service {
    char name[SERVICE_NAME_MAX];
};

/* A ServerReflectionResponse with one of four answers. */
struct response {
    const char *host;
    const uint8_t *request; /* uint8[request_size], the request as it came */
    size_t request_size;
    int has_type, has_services, has_error;
    struct span file;
    const char *type;
    struct service *services; /* [service_count] */
    size_t service_count;
    int error_code;
    const char *error_message;
};

#define RESPONSE(member)       UMBW_AT(response, member)
#define RESPONSE_COUNT(member) UMBW_COUNT(response, member)

UMBW_TABLE(FILE_TABLE, grpc__reflection__v1__file_descriptor_response, "", 0,
           {1, RESPONSE(file.bytes), RESPONSE_COUNT(file.size)});
UMBW_TABLE(TYPE_TABLE, grpc__reflection__v1__extension_number_response, "", 0, {1, RESPONSE(type)},
           {.number = 2}); /* there are no extensions */
UMBW_TABLE(SERVICE, grpc__reflection__v1__service_response, "", sizeof(struct service),
           {1, UMBW_AT(service, name)});
UMBW_TABLE(SERVICES, grpc__reflection__v1__list_service_response, "", 0,
           {1, RESPONSE(services), RESPONSE_COUNT(service_count), .table = &SERVICE,
            .most = SERVICES_MAX});
UMBW_TABLE(ERROR, grpc__reflection__v1__error_response, "", 0, {1, RESPONSE(error_code)},
           {2, RESPONSE(error_message)});
UMBW_TABLE(RESPONSE_TABLE, grpc__reflection__v1__server_reflection_response, "",
           sizeof(struct response), {1, RESPONSE(host)},
           {2, RESPONSE(request), RESPONSE_COUNT(request_size)},
           {4, RESPONSE_COUNT(file.size), .table = &FILE_TABLE},
           {5, RESPONSE_COUNT(has_type), .table = &TYPE_TABLE},
           {6, RESPONSE_COUNT(has_services), .table = &SERVICES},
           {7, RESPONSE_COUNT(has_error), .table = &ERROR});

static size_t list_services(struct service services[SERVICES_MAX])
{
    struct span set = {umbw__descriptor_set, umbw__descriptor_set_bytes};
    struct umbw_item item;
    size_t count = 0;
    while (next_item(&set, &item)) {
        struct span file = {item.payload, item.payload_size};
        struct span package = field_of(file, FILE_PACKAGE);
        while (next_item(&file, &item)) {
            struct span name = field_of((struct span){item.payload, item.payload_size}, FILE_NAME);
            if (item.number == FILE_SERVICE && count < SERVICES_MAX &&
                package.size + 1 + name.size < SERVICE_NAME_MAX) {
                (void)snprintf(services[count++].name, SERVICE_NAME_MAX, "%.*s.%.*s",
                               (int)package.size, (const char *)package.bytes, (int)name.size,
                               (const char *)name.bytes);
            }
        }
    }
    return count;
}

/* Fills in the answer. In: question: number of the request's field. */
static void answer_question(const struct request *request, uint32_t question,
                            struct response *response)
{
    response->error_code = UMBW_GRPC_NOT_FOUND;
    response->error_message = "not found";
    switch (question) {
    case 3:
        response->file = find_file(has_name, request->file);
        break;
    case 4:
        response->file = find_file(has_symbol, request->symbol);
        break;
    case 5: /* proto3 allows no extensions */
        response->error_message = "there are no extensions";
        break;
    case 6:
        response->type = request->type;
        response->has_type = find_file(has_symbol, request->type).size > 0;
        break;
    case 7:
        response->has_services = 1;
        response->service_count = list_services(response->services);
        break;
    default:
        response->error_code = UMBW_GRPC_INVALID_ARGUMENT;
        response->error_message = "nothing is asked for";
    }
    response->has_error =
        response->file.size == 0 && !response->has_type && !response->has_services;
}

enum umb_status umbw_reflection_answer(const uint8_t *message, size_t size,
                                       struct umbw_buffer *buffer, struct umb_error *error)
{
    struct service services[SERVICES_MAX] = {0};
    struct response response = {.request = message, .request_size = size, .services = services};
    struct request request;
    struct span rest = {message, size};
    struct umbw_item item;
    uint32_t question = 0;
    UMB__TRY(umbw_decode(&REQUEST_TABLE, message, size, &request, error));
    while (next_item(&rest, &item)) {
        question = item.number >= 3 && item.number <= 7 ? item.number : question;
    }
    response.host = request.host;
    answer_question(&request, question, &response);
    enum umb_status status = umbw_encode(&RESPONSE_TABLE, &response, buffer, error);
    free(request.host); /* begins the block */
    return status;
}
