/* SPDX-License-Identifier: Apache-2.0 */
/* Status names, texts and mappings, all from the one list in status.h. */
#include "umbrage/status.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/utf8.h"

struct status_row {
    enum umb_status status;
    const char *name;
    const char *text;
    int grpc;
    int exit_code;
};

static const struct status_row status_rows[] = {
#define STATUS_ROW(name, value, text, grpc, exit_code) {UMB_##name, #name, text, grpc, exit_code},
    UMB_STATUS_LIST(STATUS_ROW)
#undef STATUS_ROW
};

static const struct status_row *find_row(enum umb_status status)
{
    for (size_t i = 0; i < sizeof status_rows / sizeof status_rows[0]; i++) {
        if (status_rows[i].status == status) {
            return &status_rows[i];
        }
    }
    return NULL;
}

const char *umb_status_name(enum umb_status status)
{
    const struct status_row *row = find_row(status);
    return row ? row->name : "E_UNKNOWN";
}

const char *umb_status_text(enum umb_status status)
{
    const struct status_row *row = find_row(status);
    return row ? row->text : "unknown status";
}

int umb_status_grpc(enum umb_status status)
{
    const struct status_row *row = find_row(status);
    return row ? row->grpc : 2;
}

int umb_status_exit(enum umb_status status)
{
    const struct status_row *row = find_row(status);
    return row ? row->exit_code : 70;
}

enum umb_status umb_status_from_grpc(int grpc_code)
{
    switch (grpc_code) {
    case 0:
        return UMB_OK;
    case 1:
        return UMB_E_CANCELLED;
    case 3:
    case 11:
        return UMB_E_ARGUMENT;
    case 4:
        return UMB_E_DEADLINE;
    case 5:
        return UMB_E_NOT_FOUND;
    case 6:
        return UMB_E_EXISTS;
    case 7:
        return UMB_E_PERMISSION;
    case 8:
        return UMB_E_TOO_LARGE;
    case 9:
    case 10:
        return UMB_E_STATE;
    case 12:
        return UMB_E_UNSUPPORTED;
    case 13:
    case 2:
        return UMB_E_INTERNAL;
    case 14:
        return UMB_E_UNAVAILABLE;
    case 15:
        return UMB_E_CORRUPT;
    case 16:
        return UMB_E_UNAUTHENTICATED;
    default:
        return UMB_E_PROTOCOL;
    }
}

/* The one place where messages are made, so that none carries a terminal's control characters or
 * broken UTF-8 from a file's name or a peer's text. */
static void set_error(struct umb_error *error, enum umb_status status, int system_error,
                      const char *format, va_list arguments)
{
    error->status = status;
    error->system_error = system_error;
    int length = vsnprintf(error->message, sizeof error->message, format, arguments);
    if (length < 0) {
        error->message[0] = '\0';
        length = 0;
    }
    if (system_error != 0 && (size_t)length < sizeof error->message) {
        char text[96] = "";
        if (strerror_r(system_error, text, sizeof text) == 0) {
            size_t used = (size_t)length;
            (void)snprintf(error->message + used, sizeof error->message - used, ": %s", text);
        }
    }
    (void)umb__utf8_printable((const uint8_t *)error->message, strlen(error->message),
                              error->message, sizeof error->message);
}

enum umb_status umb_fail(struct umb_error *error, enum umb_status status, const char *format, ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        set_error(error, status, 0, format, arguments);
        va_end(arguments);
    }
    return status;
}

enum umb_status umb_fail_errno(struct umb_error *error, enum umb_status status, int system_error,
                               const char *format, ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        set_error(error, status, system_error, format, arguments);
        va_end(arguments);
    }
    return status;
}
