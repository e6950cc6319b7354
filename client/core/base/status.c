/* SPDX-License-Identifier: Apache-2.0 */
/* Status names and texts, from the one list in status.h. */
#include "umbrage/status.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/utf8.h"

const char *umb_status_name(enum umb_status status)
{
    switch (status) {
#define NAME_CASE(name, value, text)                                                               \
    case UMB_##name:                                                                               \
        return #name;
        UMB_STATUS_LIST(NAME_CASE)
#undef NAME_CASE
    }
    return "E_UNKNOWN";
}

const char *umb_status_text(enum umb_status status)
{
    switch (status) {
#define TEXT_CASE(name, value, text)                                                               \
    case UMB_##name:                                                                               \
        return text;
        UMB_STATUS_LIST(TEXT_CASE)
#undef TEXT_CASE
    }
    return "unknown status";
}

/* Fills in an error. Every message is made here, so no message has terminal control characters or
 * broken UTF-8, even if it quotes a file name or a peer. */
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
