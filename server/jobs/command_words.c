/* SPDX-License-Identifier: Apache-2.0 */
/* Command lines, see command_words.h. */
#include "jobs/command_words.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RESOLUTION 16384 /* umbrage-bake's resolution without the option */

/* Takes a word over; NULL: out of memory. */
static void take_word(struct umbj_words *words, char *word)
{
    char **list = word != NULL && !words->failed
                      ? realloc(words->list, (words->count + 2) * sizeof *list)
                      : NULL;
    if (list == NULL) {
        words->failed = 1;
        free(word);
        return;
    }
    words->list = list;
    list[words->count++] = word;
    list[words->count] = NULL;
}

void umbj_words_add(struct umbj_words *words, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    char *word = length >= 0 ? malloc((size_t)length + 1) : NULL;
    if (word != NULL) {
        va_start(arguments, format);
        (void)vsnprintf(word, (size_t)length + 1, format, arguments);
        va_end(arguments);
    }
    take_word(words, word);
}

void umbj_words_add_sandbox(struct umbj_words *words, const char *mode)
{
    umbj_words_add(words, "--sandbox=%s", mode != NULL ? mode : "required");
}

/* The line after this one; the last line may lack its end. */
static const char *next_line(const char *line)
{
    const size_t length = strcspn(line, "\n");
    return line + length + (line[length] == '\n');
}

/* Value of the last --resolution; umbrage-bake itself refuses a value that is not a number. */
static unsigned long resolution_of(const char *settings)
{
    static const char name[] = "--resolution=";
    unsigned long resolution = RESOLUTION;
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        if (strncmp(line, name, sizeof name - 1) == 0) {
            resolution = strtoul(line + sizeof name - 1, NULL, 10);
        }
    }
    return resolution;
}

unsigned long umbj_tile_edge(const char *settings, uint32_t tile)
{
    const unsigned long resolution = resolution_of(settings);
    return resolution >= 64 && resolution < tile ? resolution : tile;
}

void umbj_words_add_settings(struct umbj_words *words, const char *settings, uint32_t tile)
{
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        umbj_words_add(words, "%.*s", (int)strcspn(line, "\n"), line);
    }
    if (tile > 0) { /* behind the settings: umbrage-bake refuses those by their own names */
        umbj_words_add(words, "--tile=%lu", umbj_tile_edge(settings, tile));
    }
}

void umbj_words_finish(struct umbj_words *words)
{
    for (size_t i = 0; i < words->count; i++) {
        free(words->list[i]);
    }
    free(words->list);
    *words = (struct umbj_words){0};
}

int umbj_settings_have(const char *settings, const char *wanted)
{
    for (const char *line = settings; *line != '\0'; line = next_line(line)) {
        const size_t length = strcspn(line, "\n");
        if (length == strlen(wanted) && memcmp(line, wanted, length) == 0) {
            return 1;
        }
    }
    return 0;
}
