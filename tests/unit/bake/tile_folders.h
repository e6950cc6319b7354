/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_UNIT_BAKE_TILE_FOLDERS_H
#define UMBRAGE_TESTS_UNIT_BAKE_TILE_FOLDERS_H
/* Folders of tile results for tests: made, listed, damaged, removed. Include after cmocka.h. */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static inline void folder_make(char path[64])
{
    snprintf(path, 64, "/tmp/umbrage-tiles-XXXXXX");
    assert_non_null(mkdtemp(path));
}

/* Calls visit for each entry's path; returns how many there are. */
static inline size_t folder_each(const char *path, void (*visit)(const char *entry))
{
    size_t count = 0;
    DIR *folder = opendir(path);
    assert_non_null(folder);
    for (const struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
            char name[512];
            snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
            if (visit != NULL) {
                visit(name);
            }
            count++;
        }
    }
    closedir(folder);
    return count;
}

static inline void folder_remove_entry(const char *entry)
{
    assert_int_equal(unlink(entry), 0);
}

static inline void folder_remove(const char *path)
{
    folder_each(path, folder_remove_entry);
    assert_int_equal(rmdir(path), 0);
}

/* Turns one bit around in the middle of a file. */
static inline void folder_damage(const char *entry)
{
    FILE *file = fopen(entry, "r+b");
    assert_non_null(file);
    fseek(file, 0, SEEK_END);
    const long middle = ftell(file) / 2;
    fseek(file, middle, SEEK_SET);
    const int byte = fgetc(file);
    fseek(file, middle, SEEK_SET);
    fputc(byte ^ 0x10, file);
    fclose(file);
}

#endif
