/* SPDX-License-Identifier: Apache-2.0 */
/* Files of a scene (import_job.h). */
#include "bake/import/import_job.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/try.h"
#include "common/open_beneath.h"

#define NAME_BYTES       UMBS_BENEATH_NAME_BYTES
#define TEXT_PROBE_BYTES 4096

enum umb_status umbb_file_map(int fd, uint64_t max_bytes, struct umbb_file *file,
                              struct umb_error *error)
{
    memset(file, 0, sizeof(*file));
    file->bytes = "";
    off_t end = lseek(fd, 0, SEEK_END);
    if (end < 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot look at the file");
    }
    uint64_t size = (uint64_t)end;
    if (size > max_bytes || size > SIZE_MAX) {
        return umb_fail(error, UMB_E_LIMIT, "file has %llu bytes, limit %llu",
                        (unsigned long long)size, (unsigned long long)max_bytes);
    }
    if (size == 0) {
        return UMB_OK;
    }
    void *map = mmap(NULL, (size_t)size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (map == MAP_FAILED) {
        return errno == ENOMEM ? umb_fail(error, UMB_E_NO_MEMORY, "no memory to map %llu bytes",
                                          (unsigned long long)size)
                               : umb_fail_errno(error, UMB_E_IO, errno, "cannot map the file");
    }
    (void)posix_madvise(map, (size_t)size, POSIX_MADV_SEQUENTIAL);
    file->map = map;
    file->bytes = map;
    file->size = (size_t)size;
    return UMB_OK;
}

/* Copies a name and refuses forms that no name beneath a folder needs. */
static enum umb_status clean_name(struct umbb_cursor name, char out[NAME_BYTES],
                                  struct umb_error *error)
{
    const size_t length = umbb_length(name);
    if (length == 0 || length >= NAME_BYTES || memchr(name.at, '\0', length) != NULL) {
        return umb_fail(error, UMB_E_PERMISSION, "a file name of %zu bytes is refused, limit %d",
                        length, NAME_BYTES - 1);
    }
    memcpy(out, name.at, length);
    out[length] = '\0';
    for (char *at = out; *at != '\0'; at++) {
        if (*at == '\\') {
            *at = '/';
        }
    }
    if (out[0] == '/') {
        return umb_fail(error, UMB_E_PERMISSION, "absolute file name '%.100s' is refused", out);
    }
    for (const char *at = out; at != NULL; at = strchr(at, '/')) {
        at += *at == '/';
        if (strncmp(at, "..", 2) == 0 && (at[2] == '/' || at[2] == '\0')) {
            return umb_fail(error, UMB_E_PERMISSION, "file name '%.100s' with '..' is refused",
                            out);
        }
    }
    return UMB_OK;
}

enum umb_status umbb_file_map_named(const struct umbb_import *job, struct umbb_cursor name,
                                    struct umbb_file *file, struct umb_error *error)
{
    char clean[NAME_BYTES];
    memset(file, 0, sizeof(*file));
    UMB__TRY(clean_name(name, clean, error));
    int fd = job->folder.open(job->folder.handle, clean);
    if (fd < 0 && (errno == EISDIR || errno == ENODEV)) {
        return umb_fail(error, UMB_E_NOT_FOUND, "file '%.100s' is not a regular file", clean);
    }
    if (fd < 0) {
        int saved = errno;
        int leaves = saved == EXDEV || saved == ELOOP || saved == EACCES;
        return umb_fail_errno(error, leaves ? UMB_E_PERMISSION : UMB_E_NOT_FOUND, saved,
                              "file '%.100s'", clean);
    }
    enum umb_status status = umbb_file_map(fd, job->max_input_bytes, file, error);
    (void)close(fd);
    return status;
}

/* Undoes percent-encoding into out[size]; returns the length, or 0 if nothing was encoded. */
static size_t decode(struct umbb_cursor name, char *out, size_t size)
{
    size_t used = 0;
    int changed = 0;
    for (const char *at = name.at; at < name.end && used < size; at++) {
        const int has_room = *at == '%' && name.end - at > 2;
        const char digits[3] = {has_room ? at[1] : '\0', has_room ? at[2] : '\0', '\0'};
        const int is_code =
            isxdigit((unsigned char)digits[0]) && isxdigit((unsigned char)digits[1]);
        out[used++] = is_code ? (char)strtoul(digits, NULL, 16) : *at;
        at += is_code ? 2 : 0;
        changed |= is_code;
    }
    return changed && used < size ? used : 0;
}

enum umb_status umbb_file_map_uri(const struct umbb_import *job, struct umbb_cursor uri,
                                  struct umbb_file *file, struct umb_error *error)
{
    char decoded[NAME_BYTES];
    enum umb_status status = umbb_file_map_named(job, uri, file, error);
    const size_t used = decode(uri, decoded, sizeof(decoded));
    if (status != UMB_OK && used > 0) {
        const struct umbb_cursor name = {decoded, decoded + used};
        status = umbb_file_map_named(job, name, file, error);
    }
    return status;
}

struct umbb_cursor umbb_text_of(const struct umbb_file *file)
{
    return (struct umbb_cursor){file->bytes, file->bytes + file->size};
}

int umbb_is_text(const struct umbb_file *file)
{
    const size_t probe = file->size < TEXT_PROBE_BYTES ? file->size : TEXT_PROBE_BYTES;
    return memchr(file->bytes, '\0', probe) == NULL;
}

void umbb_file_unmap(struct umbb_file *file)
{
    if (file->map != NULL) {
        (void)munmap(file->map, file->size);
    }
    memset(file, 0, sizeof(*file));
}
