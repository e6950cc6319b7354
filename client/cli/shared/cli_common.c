/* SPDX-License-Identifier: Apache-2.0 */
/* Shared pieces of the sub-commands, see cli_common.h. */
#include "cli/shared/cli_common.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "tool/base.h"
#include "tool/exit_code.h"

#define NAME_BYTES ((size_t)200) /* most bytes of a path in a message of the libraries */

/* Prints a prefix and a formatted message as a line on stderr. */
static void complain(const char *prefix, const char *format, va_list arguments)
{
    (void)fprintf(stderr, "umbrage%s: ", prefix);
    (void)vfprintf(stderr, format, arguments);
    (void)fputc('\n', stderr);
}

int umbc_usage_error(const char *command, const char *format, ...)
{
    char prefix[64] = "";
    va_list arguments;
    if (command != NULL) {
        (void)snprintf(prefix, sizeof prefix, " %s", command);
    }
    va_start(arguments, format);
    complain(prefix, format, arguments);
    va_end(arguments);
    return UMBC_EXIT_USAGE;
}

static const char *said(const struct umb_error *error)
{
    return error->message[0] != '\0' ? error->message : umb_status_text(error->status);
}

int umbc_complain(const struct umb_error *error)
{
    (void)fprintf(stderr, "umbrage: %s\n", said(error));
    return umbu_exit_code(error->status);
}

/* Returns the reason of a message `NAME: reason`; NULL for messages without that name. */
static const char *after_name(const char *message, const char *name)
{
    const size_t length = strlen(name);
    return strncmp(message, name, length) == 0 && message[length] == ':' ? message + length : NULL;
}

int umbc_complain_file(const char *path, const struct umb_error *error)
{
    const char *message = said(error);
    const size_t length = strlen(path);
    char name[NAME_BYTES + 1], quoted[sizeof name + 2]; /* the path as messages write it */
    (void)umb__utf8_printable((const uint8_t *)path, length < NAME_BYTES ? length : NAME_BYTES,
                              name, sizeof name);
    (void)snprintf(quoted, sizeof quoted, "'%s'", name);
    const char *reason = after_name(message, name);
    (void)fputs("umbrage: ", stderr);
    if (reason == NULL && strstr(message, quoted) != NULL) {
        (void)fprintf(stderr, "%s\n", message);
    } else {
        umbc_print_text(stderr, path, length);
        (void)fprintf(stderr, "%s%s\n", reason != NULL ? "" : ": ",
                      reason != NULL ? reason : message);
    }
    int code = umbu_exit_code(error->status);
    return code == UMBC_EXIT_USAGE ? UMBC_EXIT_DATA : code;
}

int umbc_complain_as(enum umb_status status, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    complain("", format, arguments);
    va_end(arguments);
    return umbu_exit_code(status);
}

/* True for a name that the store accepts, and for an id. */
static bool may_be_asset(const char *word)
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    const size_t folder = strspn(word, allowed);
    const char *name = word[folder] == '/' ? word + folder + 1 : word;
    return word[0] != '.' && word[0] != '/' && name[0] != '.' && name[0] != '\0' &&
           name[strspn(name, allowed)] == '\0';
}

enum umb_status umbc_read_id(const struct umbu_option *option, const char *text, void *field,
                             struct umb_error *error)
{
    return umb_id_from_text(text, field) == UMB_OK ? UMB_OK : umbu_refuse(option, text, error);
}

bool umbc_is_file(const char *word)
{
    struct stat info;
    size_t length = strlen(word);
    if (!may_be_asset(word) || (length > 4 && strcmp(word + length - 4, ".umb") == 0) ||
        (length > 5 && strcmp(word + length - 5, ".umbm") == 0)) {
        return true;
    }
    return stat(word, &info) == 0 && !S_ISDIR(info.st_mode);
}

enum umb_status umbc_open_input(const char *path, FILE **file, struct umb_error *error)
{
    struct stat info;
    *file = fopen(path, "rb");
    if (*file == NULL) {
        const int code = errno;
        return umb_fail_errno(error, umb__open_status(code), code, "cannot open '%.200s'", path);
    }
    if (fstat(fileno(*file), &info) == 0 && S_ISDIR(info.st_mode)) {
        (void)fclose(*file);
        *file = NULL;
        return umb_fail(error, UMB_E_NO_INPUT, "cannot read '%.200s': it is a folder", path);
    }
    return UMB_OK;
}

int umbc_finish_stdout(int code)
{
    if (fflush(stdout) != 0 || ferror(stdout)) {
        return umbc_complain_as(UMB_E_IO, "cannot write to stdout");
    }
    return code;
}

void umbc_print_text(FILE *file, const char *text, size_t length)
{
    char piece[256];
    size_t at = 0;
    while (at < length) {
        size_t count =
            umb__utf8_printable((const uint8_t *)text + at, length - at, piece, sizeof piece);
        (void)fwrite(piece, 1, count, file);
        at += count; /* at least one byte: the longest character fits */
    }
}

void umbc_json_id(struct umbu_json *json, const char *key, const uint8_t id[UMB_ID_BYTES])
{
    char text[UMB_ID_TEXT_SIZE];
    umb_id_to_text(id, text);
    umbu_json_text(json, key, text);
}

void umbc_format_bytes(unsigned long long bytes, char text[32])
{
    static const char *const units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
    double value = (double)bytes;
    size_t unit = 0;
    while (value >= 1024 && unit + 1 < sizeof units / sizeof units[0]) {
        value /= 1024;
        unit++;
    }
    (void)snprintf(text, 32, unit == 0 ? "%.0f %s" : "%.2f %s", value, units[unit]);
}
