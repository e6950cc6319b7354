/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reading the INI file by libinih. It gives no line numbers to its handler and cuts long lines, so
 * its line source here counts and measures the lines.
 */
#include "daemon/base/config_file.h"

#include <errno.h>
#include <ini.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "base/open_status.h"

struct reading {
    FILE *file;
    const char *path;
    unsigned line;
    enum umb_status (*set)(void *user, const char *name, const char *value,
                           struct umb_error *error);
    void *user;
    enum umb_status status;
    struct umb_error *error;
};

/* libinih's source of lines: fgets, counted. */
static char *next_line(char *line, int size, void *stream)
{
    struct reading *reading = stream;
    if (reading->status != UMB_OK || fgets(line, size, reading->file) == NULL) {
        return NULL;
    }
    size_t length = strlen(line);
    reading->line++;
    if (length > 0 && line[length - 1] != '\n' && !feof(reading->file)) {
        reading->status =
            umb_fail(reading->error, UMB_E_ARGUMENT, "%.120s line %u: longer than %d bytes",
                     reading->path, reading->line, UMBD_CONFIG_LINE_MAX);
        return NULL;
    }
    /* libinih would append an indented line to the one before it. */
    size_t blanks = strspn(line, " \t");
    memmove(line, line + blanks, length - blanks + 1);
    return line;
}

static int on_value(void *user, const char *section, const char *name, const char *value)
{
    struct reading *reading = user;
    struct umb_error cause = {0};
    if (reading->status != UMB_OK) {
        return 0;
    }
    if (section[0] != '\0' && strcmp(section, "umbraged") != 0) {
        reading->status = umb_fail(reading->error, UMB_E_ARGUMENT,
                                   "%.120s line %u: section [%.40s], not [umbraged]", reading->path,
                                   reading->line, section);
        return 0;
    }
    enum umb_status status = reading->set(reading->user, name, value, &cause);
    if (status != UMB_OK) {
        reading->status = umb_fail(reading->error, status, "%.120s line %u: %s", reading->path,
                                   reading->line, cause.message);
    }
    return status == UMB_OK;
}

enum umb_status umbd_config_read(const char *path,
                                 enum umb_status (*set)(void *user, const char *name,
                                                        const char *value, struct umb_error *error),
                                 void *user, struct umb_error *error)
{
    struct stat facts;
    struct reading reading = {
        .path = path, .set = set, .user = user, .status = UMB_OK, .error = error};
    reading.file = fopen(path, "re");
    if (reading.file == NULL) {
        return umb_fail_errno(error, umb__open_status(errno), errno, "--config: '%.200s'", path);
    }
    if (fstat(fileno(reading.file), &facts) == 0 && S_ISDIR(facts.st_mode)) {
        (void)fclose(reading.file);
        return umb_fail(error, UMB_E_NO_INPUT, "--config: '%.200s' is a folder", path);
    }
    int bad_line = ini_parse_stream(next_line, &reading, on_value, &reading);
    if (reading.status == UMB_OK && ferror(reading.file)) {
        reading.status = umb_fail_errno(error, UMB_E_IO, errno, "--config: '%.200s'", path);
    } else if (reading.status == UMB_OK && bad_line != 0) {
        reading.status = umb_fail(error, UMB_E_ARGUMENT,
                                  "%.120s line %d: not of the form name = value", path, bad_line);
    }
    (void)fclose(reading.file);
    return reading.status;
}
