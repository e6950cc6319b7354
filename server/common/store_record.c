/* SPDX-License-Identifier: Apache-2.0 */
/* The list of proven files, see store_record.h. */
#include "common/store_record.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "common/file.h"

#define TITLE          "umbrage proven 1\n"
#define END_LENGTH     21 /* "end ", 16 digits, newline */
#define LINE_MAX_BYTES 420

enum umb_status umbs__records_add(struct umbs_records *records, const struct umbs_record *record)
{
    if (records->count == records->capacity) {
        size_t capacity = records->capacity == 0 ? 16 : 2 * records->capacity;
        if (capacity > UMBS_RECORDS_MAX) {
            return UMB_E_NO_MEMORY;
        }
        void *list = realloc(records->list, capacity * sizeof *records->list);
        if (list == NULL) {
            return UMB_E_NO_MEMORY;
        }
        records->list = list;
        records->capacity = capacity;
    }
    records->list[records->count++] = *record;
    return UMB_OK;
}

const struct umbs_record *umbs__records_find(const struct umbs_records *records,
                                             const struct umbs_stamp *packed)
{
    for (size_t i = 0; i < records->count; i++) {
        if (umbs_stamp_equal(&records->list[i].packed, packed)) {
            return &records->list[i];
        }
    }
    return NULL;
}

int umbs__records_equal(const struct umbs_records *a, const struct umbs_records *b)
{
    int equal = a->count == b->count;
    for (size_t i = 0; equal && i < a->count; i++) {
        equal = memcmp(a->list[i].id, b->list[i].id, UMB_ID_BYTES) == 0 &&
                umbs_stamp_equal(&a->list[i].packed, &b->list[i].packed) &&
                umbs_stamp_equal(&a->list[i].mapped, &b->list[i].mapped);
    }
    return equal;
}

void umbs__records_finish(struct umbs_records *records)
{
    free(records->list);
    memset(records, 0, sizeof *records);
}

/* Reads seven numbers; moves *at behind them. Returns 1, or 0 if they are not there. */
static int parse_stamp(const char **at, struct umbs_stamp *stamp)
{
    uint64_t numbers[7];
    for (size_t i = 0; i < 7; i++) {
        char *end;
        errno = 0;
        numbers[i] = strtoull(*at, &end, 10);
        if (end == *at || errno != 0) {
            return 0;
        }
        *at = end;
    }
    *stamp = (struct umbs_stamp){
        .device = numbers[0],
        .inode = numbers[1],
        .size = numbers[2],
        .modified = {.tv_sec = (time_t)numbers[3], .tv_nsec = (long)numbers[4]},
        .changed = {.tv_sec = (time_t)numbers[5], .tv_nsec = (long)numbers[6]},
    };
    return 1;
}

static int parse_line(const char *line, struct umbs_record *record)
{
    char id[UMB_ID_TEXT_SIZE];
    if (strlen(line) < sizeof id) {
        return 0;
    }
    memcpy(id, line, sizeof id - 1);
    id[sizeof id - 1] = '\0';
    line += sizeof id - 1;
    return umb_id_from_text(id, record->id) && parse_stamp(&line, &record->packed) &&
           parse_stamp(&line, &record->mapped) && *line == '\0';
}

/* Parses a whole file, which ends with a NUL and is changed. */
static enum umb_status parse(char *text, size_t size, struct umbs_records *records,
                             struct umb_error *error)
{
    char end[END_LENGTH + 1];
    size_t body = size < END_LENGTH ? 0 : size - END_LENGTH;
    (void)snprintf(end, sizeof end, "end %016" PRIx64 "\n", (uint64_t)XXH3_64bits(text, body));
    if (body < sizeof TITLE - 1 || memcmp(text, TITLE, sizeof TITLE - 1) != 0 ||
        memcmp(text + body, end, END_LENGTH) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "%zu bytes are no list of proven files", size);
    }
    text[body] = '\0';
    char *line = text + sizeof TITLE - 1;
    while (*line != '\0') {
        struct umbs_record record;
        char *next = strchr(line, '\n');
        if (next == NULL) {
            break;
        }
        *next = '\0';
        if (!parse_line(line, &record)) {
            return umb_fail(error, UMB_E_CORRUPT, "line '%.80s' is not of a proven file", line);
        }
        if (umbs__records_add(records, &record) != UMB_OK) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the list of proven files");
        }
        line = next + 1;
    }
    return UMB_OK;
}

enum umb_status umbs__records_read(const char *path, struct umbs_records *records,
                                   struct umb_error *error)
{
    const size_t limit = UMBS_RECORDS_MAX * LINE_MAX_BYTES;
    memset(records, 0, sizeof *records);
    FILE *file = fopen(path, "re");
    if (file == NULL) {
        return errno == ENOENT
                   ? UMB_OK
                   : umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
    }
    enum umb_status status = UMB_OK;
    char *text = NULL;
    size_t size = 0;
    size_t capacity = 0;
    while (status == UMB_OK) {
        if (size + 1 >= capacity) {
            capacity = capacity == 0 ? 65536 : 2 * capacity;
            char *grown = capacity <= limit ? realloc(text, capacity) : NULL;
            if (grown == NULL) {
                status = umb_fail(error, UMB_E_NO_MEMORY, "'%.200s' is too long", path);
                break;
            }
            text = grown;
        }
        size_t got = fread(text + size, 1, capacity - size - 1, file);
        size += got;
        if (got == 0) {
            break;
        }
    }
    if (status == UMB_OK && ferror(file)) {
        status = umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
    }
    (void)fclose(file);
    if (status == UMB_OK) {
        text[size] = '\0';
        status = parse(text, size, records, error);
    }
    free(text);
    if (status != UMB_OK) {
        umbs__records_finish(records);
    }
    return status;
}

static void print_stamp(FILE *out, const struct umbs_stamp *stamp)
{
    (void)fprintf(out, "  %" PRIu64 " %" PRIu64 " %" PRIu64 " %lld %ld %lld %ld", stamp->device,
                  stamp->inode, stamp->size, (long long)stamp->modified.tv_sec,
                  stamp->modified.tv_nsec, (long long)stamp->changed.tv_sec,
                  stamp->changed.tv_nsec);
}

/* The file's text; free() it. NULL: out of memory. */
static char *print(const struct umbs_records *records, size_t *size)
{
    char *text = NULL;
    FILE *out = open_memstream(&text, size);
    if (out == NULL) {
        return NULL;
    }
    (void)fputs(TITLE, out);
    for (size_t i = 0; i < records->count; i++) {
        char id[UMB_ID_TEXT_SIZE];
        umb_id_to_text(records->list[i].id, id);
        (void)fputs(id, out);
        print_stamp(out, &records->list[i].packed);
        print_stamp(out, &records->list[i].mapped);
        (void)fputc('\n', out);
    }
    int bad = fflush(out) != 0 || ferror(out) || text == NULL;
    if (!bad) {
        bad = fprintf(out, "end %016" PRIx64 "\n", (uint64_t)XXH3_64bits(text, *size)) < 0;
    }
    if (fclose(out) != 0 || bad) {
        free(text);
        return NULL;
    }
    return text;
}

enum umb_status umbs__records_write(const char *path, const struct umbs_records *records,
                                    struct umb_error *error)
{
    size_t size = 0;
    struct umbs_file file;
    char *text = print(records, &size);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the list of proven files");
    }
    enum umb_status status = umbs_file_begin(path, &file, error);
    if (status == UMB_OK) {
        status = umbs_file_write(&file, text, size, error);
        if (status == UMB_OK) {
            status = umbs_file_commit(&file, error);
        } else {
            umbs_file_abandon(&file);
        }
    }
    free(text);
    return status;
}
