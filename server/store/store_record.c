/* SPDX-License-Identifier: Apache-2.0 */
/* The list of proven files, see store_record.h. */
#include "store/store_record.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "common/file_system.h"
#include "tool/output.h"
#include "common/private_folder.h"

#define TITLE          "umbrage proven 2\n"
#define HASH_LENGTH    64U /* hexadecimal digits of an id, a digest, a MAC */
#define LINE_MAX_BYTES 520

static size_t place_of(const struct umbs_records *records, const struct umbs_stamp *packed)
{
    const uint64_t name[2] = {packed->device, packed->inode};
    return (size_t)XXH3_64bits(name, sizeof name) & (records->place_count - 1);
}

static void put(struct umbs_records *records, size_t index)
{
    size_t at = place_of(records, &records->list[index].packed);
    while (records->places[at] != 0) {
        at = (at + 1) & (records->place_count - 1);
    }
    records->places[at] = (uint32_t)index + 1;
}

/* Makes room for one more record; returns 0 if out of memory. */
static int grow(struct umbs_records *records)
{
    const size_t capacity = records->capacity == 0 ? 16 : 2 * records->capacity;
    void *list = capacity <= UMBS_RECORDS_MAX
                     ? realloc(records->list, capacity * sizeof *records->list)
                     : NULL;
    if (list == NULL) {
        return 0;
    }
    records->list = list;
    uint32_t *places = calloc(2 * capacity, sizeof *places);
    if (places == NULL) {
        return 0;
    }
    free(records->places);
    records->places = places;
    records->place_count = 2 * capacity;
    records->capacity = capacity;
    for (size_t i = 0; i < records->count; i++) {
        put(records, i);
    }
    return 1;
}

enum umb_status umbs__records_add(struct umbs_records *records, const struct umbs_record *record)
{
    if (records->count == records->capacity && !grow(records)) {
        return UMB_E_NO_MEMORY;
    }
    records->list[records->count] = *record;
    put(records, records->count++);
    return UMB_OK;
}

const struct umbs_record *umbs__records_find(const struct umbs_records *records,
                                             const struct umbs_stamp *packed)
{
    size_t at = records->place_count > 0 ? place_of(records, packed) : 0;
    while (records->place_count > 0 && records->places[at] != 0) {
        const struct umbs_record *record = &records->list[records->places[at] - 1];
        if (umbs_stamp_equal(&record->packed, packed)) {
            return record;
        }
        at = (at + 1) & (records->place_count - 1);
    }
    return NULL;
}

const struct umbs_record *umbs__records_of_id(const struct umbs_records *records,
                                              const uint8_t id[UMB_ID_BYTES])
{
    for (size_t i = 0; i < records->count; i++) {
        if (memcmp(records->list[i].id, id, UMB_ID_BYTES) == 0) {
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
                memcmp(a->list[i].digest, b->list[i].digest, UMB_ID_BYTES) == 0 &&
                umbs_stamp_equal(&a->list[i].packed, &b->list[i].packed) &&
                umbs_stamp_equal(&a->list[i].mapped, &b->list[i].mapped);
    }
    return equal;
}

void umbs__records_finish(struct umbs_records *records)
{
    free(records->list);
    free(records->places);
    memset(records, 0, sizeof *records);
}

/* Reads seven numbers and moves *at past them. Returns 1, or 0 if there are fewer numbers. */
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

/* Reads 64 hexadecimal digits and then the character `end`; moves *at past them. */
static int parse_hash(const char **at, char end, uint8_t hash[UMB_ID_BYTES])
{
    char text[UMB_ID_TEXT_SIZE];
    if (strnlen(*at, HASH_LENGTH) < HASH_LENGTH || (*at)[HASH_LENGTH] != end) {
        return 0;
    }
    memcpy(text, *at, HASH_LENGTH);
    text[HASH_LENGTH] = '\0';
    *at += HASH_LENGTH + (end != '\0');
    return umb_id_from_text(text, hash) == UMB_OK;
}

/* Computes the MAC of a line's text. The list's title is part of the MAC, so a line from a list of
 * another version is not valid here. */
static void line_mac(const uint8_t key[UMBS_KEY_BYTES], const char *line, size_t length,
                     uint8_t mac[UMB_ID_BYTES])
{
    char text[sizeof TITLE + LINE_MAX_BYTES];
    memcpy(text, TITLE, sizeof TITLE - 1);
    memcpy(text + sizeof TITLE - 1, line, length);
    umbs_hmac_sha256(key, text, sizeof TITLE - 1 + length, mac);
}

/* Takes a line if its MAC is right and its fields are valid. */
static int parse_line(const char *line, const uint8_t key[UMBS_KEY_BYTES],
                      struct umbs_record *record)
{
    uint8_t claimed[UMB_ID_BYTES];
    uint8_t mac[UMB_ID_BYTES];
    const size_t length = strlen(line);
    if (length <= HASH_LENGTH || length > LINE_MAX_BYTES) {
        return 0;
    }
    const char *end = line + length - HASH_LENGTH;
    line_mac(key, line, length - HASH_LENGTH, mac);
    if (!parse_hash(&end, '\0', claimed) || !umbs_digest_equal(claimed, mac)) {
        return 0;
    }
    end = line + length - HASH_LENGTH - 2; /* two blanks before the MAC */
    return parse_hash(&line, ' ', record->id) && parse_hash(&line, ' ', record->digest) &&
           parse_stamp(&line, &record->packed) && parse_stamp(&line, &record->mapped) &&
           line == end;
}

/* Parses a whole file, up to its first NUL; changes the text. */
static enum umb_status parse(char *text, const uint8_t key[UMBS_KEY_BYTES],
                             struct umbs_records *records, size_t *refused, struct umb_error *error)
{
    if (strncmp(text, TITLE, sizeof TITLE - 1) != 0) {
        return umb_fail(error, UMB_E_CORRUPT, "no list of proven files of this version");
    }
    for (char *line = text + sizeof TITLE - 1; *line != '\0';) {
        struct umbs_record record;
        const size_t length = strcspn(line, "\n");
        const int is_last = line[length] == '\0';
        line[length] = '\0';
        if (!parse_line(line, key, &record)) {
            ++*refused;
        } else if (umbs__records_add(records, &record) != UMB_OK) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the list of proven files");
        }
        line += length + !is_last;
    }
    return UMB_OK;
}

/* Opens the list. Out: fd: -1 if there is no list; after a failure the caller closes it too. */
static enum umb_status open_list(const char *path, int *fd, size_t *size, struct umb_error *error)
{
    struct stat facts;
    *fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (*fd < 0 && errno == ENOENT) {
        return UMB_OK;
    }
    if (*fd < 0 || fstat(*fd, &facts) != 0) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot read '%.200s'", path);
    }
    if (!umbs_private_file(&facts)) {
        return umb_fail(error, UMB_E_PERMISSION, "'%.200s' can be written to by other users", path);
    }
    *size = (size_t)facts.st_size;
    return *size <= UMBS_RECORDS_MAX * LINE_MAX_BYTES
               ? UMB_OK
               : umb_fail(error, UMB_E_NO_MEMORY, "'%.200s' is too long", path);
}

enum umb_status umbs__records_read(const char *path, const uint8_t key[UMBS_KEY_BYTES],
                                   struct umbs_records *records, size_t *refused,
                                   struct umb_error *error)
{
    int fd = -1;
    uint8_t *text = NULL;
    size_t size = 0;
    *refused = 0;
    memset(records, 0, sizeof *records);
    enum umb_status status = open_list(path, &fd, &size, error);
    if (status == UMB_OK && fd >= 0) {
        status = umbs_read_file(fd, size, path, &text, error);
    }
    if (text != NULL) {
        text[size] = '\0'; /* umbs_read_file leaves room */
        status = parse((char *)text, key, records, refused, error);
    }
    umbs_hang_up(&fd);
    free(text);
    if (status != UMB_OK) {
        umbs__records_finish(records);
    }
    return status;
}

/* Writes seven numbers after two blanks; returns their length. */
static size_t print_stamp(char *out, size_t size, const struct umbs_stamp *stamp)
{
    return (size_t)snprintf(out, size, "  %" PRIu64 " %" PRIu64 " %" PRIu64 " %lld %ld %lld %ld",
                            stamp->device, stamp->inode, stamp->size,
                            (long long)stamp->modified.tv_sec, stamp->modified.tv_nsec,
                            (long long)stamp->changed.tv_sec, stamp->changed.tv_nsec);
}

static void print_line(FILE *out, const struct umbs_record *record,
                       const uint8_t key[UMBS_KEY_BYTES])
{
    char id[UMB_ID_TEXT_SIZE];
    char line[LINE_MAX_BYTES];
    uint8_t mac[UMB_ID_BYTES];
    umb_id_to_text(record->id, line);
    line[HASH_LENGTH] = ' ';
    umb_id_to_text(record->digest, line + HASH_LENGTH + 1);
    size_t length = 2 * HASH_LENGTH + 1;
    length += print_stamp(line + length, sizeof line - length, &record->packed);
    length += print_stamp(line + length, sizeof line - length, &record->mapped);
    length += (size_t)snprintf(line + length, sizeof line - length, "  ");
    line_mac(key, line, length, mac);
    umb_id_to_text(mac, id);
    (void)fprintf(out, "%s%s\n", line, id);
}

/* The file's text; free() it. NULL: out of memory. */
static char *print(const struct umbs_records *records, const uint8_t key[UMBS_KEY_BYTES],
                   size_t *size)
{
    char *text = NULL;
    FILE *out = open_memstream(&text, size);
    if (out == NULL) {
        return NULL;
    }
    (void)fputs(TITLE, out);
    for (size_t i = 0; i < records->count; i++) {
        print_line(out, &records->list[i], key);
    }
    const int bad = ferror(out) != 0;
    if (fclose(out) != 0 || bad) {
        free(text);
        return NULL;
    }
    return text;
}

enum umb_status umbs__records_write(const char *path, const uint8_t key[UMBS_KEY_BYTES],
                                    const struct umbs_records *records, struct umb_error *error)
{
    size_t size = 0;
    char *text = print(records, key, &size);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the list of proven files");
    }
    const enum umb_status status =
        umbu_output_replace(path, UMBU_OUTPUT_PRIVATE, text, size, error);
    free(text);
    return status;
}
